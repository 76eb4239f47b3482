//! Runs `dynid-derive` from within a build: a nested cargo with its own target directory, one at a time.

use std::error::Error;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use dynid_model::Device;

/// What cargo sets for build scripts, and what would send the nested cargo to another target or other flags.
const NOT_INHERITED: [&str; 22] = [
    "CARGO",
    "CARGO_BUILD_RUSTFLAGS",
    "CARGO_BUILD_TARGET",
    "CARGO_ENCODED_RUSTFLAGS",
    "CARGO_MAKEFLAGS",
    "CARGO_PRIMARY_PACKAGE",
    "CARGO_TARGET_DIR",
    "CLIPPY_ARGS",
    "DEBUG",
    "HOST",
    "MAKEFLAGS",
    "MFLAGS",
    "NUM_JOBS",
    "OPT_LEVEL",
    "OUT_DIR",
    "PROFILE",
    "RUSTC",
    "RUSTC_LINKER",
    "RUSTC_WORKSPACE_WRAPPER",
    "RUSTDOC",
    "RUSTFLAGS",
    "TARGET",
];
const NOT_INHERITED_PREFIXES: [&str; 5] = ["CARGO_CFG_", "CARGO_FEATURE_", "CARGO_MANIFEST_", "CARGO_PKG_", "DEP_"];

/// Derives the equations of all configurations of `device` into `<derived>/<device>/`.
pub fn run(device: &Device, reason: &str, derived: &Path) -> Result<(), Box<dyn Error>> {
    let target = target_folder(derived);
    std::fs::create_dir_all(&target)?;
    // Two builds at once would compile the computer algebra twice, and it runs but once per machine.
    let lock = File::create(target.join("derive.lock"))?;
    lock.lock()?;
    tell(&format!(
        "{}: {reason}; deriving them, once per structure (the first time, the computer algebra is compiled: minutes)",
        device.id
    ));

    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().ok_or("the workspace has a folder")?;
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    for (name, _) in std::env::vars_os() {
        let text = name.to_string_lossy();
        if NOT_INHERITED.contains(&&*text) || NOT_INHERITED_PREFIXES.iter().any(|prefix| text.starts_with(prefix)) {
            command.env_remove(&name);
        }
    }
    command
        .args(["run", "--release", "--locked", "--package", "dynid-derive", "--target-dir"])
        .arg(target.join("derive"));
    command.args(["--", "--device", &device.id, "--out"]).arg(derived).current_dir(workspace);
    let output = command.output()?;
    eprintln!("{}", String::from_utf8_lossy(&output.stderr));
    if output.status.success() {
        return Ok(());
    }
    let told = String::from_utf8_lossy(&output.stderr);
    let last = told.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
    Err(format!("{}: {reason}, and deriving them failed ({}): {last}", device.id, output.status).into())
}

/// To the person at the terminal, while it happens: cargo shows what a build script prints only after its end.
fn tell(message: &str) {
    eprintln!("{message}");
    if let Ok(mut terminal) = File::options().write(true).open("/dev/tty") {
        // Nobody is there to be told, or is: both are fine.
        let _ = writeln!(terminal, "\n{message}");
    }
}

/// The outermost target folder: where cargo left its tag, else the workspace's.
fn target_folder(out: &Path) -> PathBuf {
    let tagged = out.ancestors().find(|folder| folder.join("CACHEDIR.TAG").exists());
    match tagged {
        Some(folder) => folder.to_owned(),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"),
    }
}
