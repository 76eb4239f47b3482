//! The browser is started with a file that leads to the address: every user of the machine may read a command line, and the address
//! holds the secret.

use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use tempfile::{Builder, NamedTempFile, TempDir};

/// The file that leads to the address; gone when it is dropped.
pub struct Leading {
    _file: NamedTempFile,
    /// The folder that was made for it.
    _folder: Option<TempDir>,
}

/// Shows the page in a browser, where there is a screen to show it on.
pub fn show(url: &str) -> std::io::Result<Option<Leading>> {
    let program = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let has_screen =
        cfg!(target_os = "macos") || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if !has_screen {
        return Ok(None);
    }
    let (file, folder) = leading(url)?;
    let mut command = Command::new(program);
    command.arg(file.path()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    // The address is printed: who has no such program opens it by hand.
    if let Ok(mut shown) = command.spawn() {
        std::thread::spawn(move || shown.wait());
    }
    Ok(Some(Leading { _file: file, _folder: folder }))
}

/// A file that only its owner may read, in the user's folder for what runs, else in one that is made for it.
fn leading(url: &str) -> std::io::Result<(NamedTempFile, Option<TempDir>)> {
    let text = format!(
        "<!doctype html>\n<meta charset=\"utf-8\">\n<meta http-equiv=\"refresh\" content=\"0; url={url}\">\n<title>dynid</title>\n\
         <a href=\"{url}\">dynid</a>\n"
    );
    // Without permissions of its own, a temporary file has those of the owner alone.
    let in_folder = |folder: PathBuf| {
        let mut file = Builder::new().prefix("dynid-open-").suffix(".html").tempfile_in(folder)?;
        file.write_all(text.as_bytes())?;
        std::io::Result::Ok(file)
    };
    let of_user = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_absolute());
    if let Some(Ok(file)) = of_user.map(in_folder) {
        return Ok((file, None));
    }
    let mut private = Builder::new();
    private.prefix("dynid-open-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        private.permissions(std::fs::Permissions::from_mode(0o700));
    }
    let folder = private.tempdir()?;
    Ok((in_folder(folder.path().to_owned())?, Some(folder)))
}
