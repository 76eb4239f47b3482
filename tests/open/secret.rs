//! Who learns of the secret in the address: nobody but who is told.

use super::*;

/// A page from elsewhere can hand on where it was shown, which opens pages and nothing else.
#[test]
fn the_address_of_a_page_opens_pages_only() {
    let folder = tour();
    fs::write(folder.path().join("of-elsewhere.html"), "<meta name=referrer content=unsafe-url>").unwrap();
    let server = Server::new(folder.path(), &[]);
    server.get("api/page?path=of-elsewhere.html").error(404);
    let page = server.page("of-elsewhere.html");
    assert_eq!(page.status, 200);
    assert!(page.head.contains("referrer-policy: no-referrer") && page.head.contains("sandbox"), "{}", page.head);
    assert!(!String::from_utf8_lossy(&page.body).contains(&server.token));

    let pages = server.get("api/folder").ok()["pages"].as_str().unwrap().to_owned();
    let secret = pages.strip_prefix('/').unwrap().strip_suffix("/api/page").unwrap();
    assert!(secret.len() == 32 && secret != server.token, "{pages}");
    for path in ["", "app.js", "api/folder", "api/file?path=experiment.toml", "api/events", "api/jobs", EXPERIMENT] {
        server.raw("GET", &format!("/{secret}/{path}"), &[], b"").error(404);
    }
    let write = json!({ "path": "x.toml", "text": "a = 1", "replaces": null }).to_string();
    server.raw("POST", &format!("/{secret}/api/write"), &[JSON], write.as_bytes()).error(404);
}

/// Every user of the machine may read a command line.
#[cfg(all(unix, not(target_os = "macos")))]
#[test]
fn the_starter_of_the_browser_is_not_given_the_address() {
    use std::os::unix::fs::PermissionsExt;
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let (folder, given, runtime) = (tour(), TempDir::new().unwrap(), TempDir::new().unwrap());
    let starter = given.path().join("xdg-open");
    let script = "#!/bin/sh\nprintf '%s' \"$*\" > \"$TOLD.partial\" && mv \"$TOLD.partial\" \"$TOLD\"\n";
    fs::write(&starter, script).unwrap();
    fs::set_permissions(&starter, fs::Permissions::from_mode(0o700)).unwrap();
    let told = given.path().join("told");
    for kept_by_the_system in [true, false] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dynid"));
        command.args(["open", "experiment.toml"]).current_dir(folder.path());
        let paths = format!("{}:{}", given.path().display(), std::env::var("PATH").unwrap());
        command.env("PATH", paths).env("DISPLAY", ":0").env("TOLD", &told).env("TMPDIR", runtime.path());
        match kept_by_the_system {
            true => command.env("XDG_RUNTIME_DIR", runtime.path()),
            false => command.env_remove("XDG_RUNTIME_DIR"),
        };
        let mut server = Server::by(&mut command);
        let begun = Instant::now();
        while !told.exists() {
            assert!(begun.elapsed() < Duration::from_secs(60), "no browser was asked for");
            std::thread::sleep(Duration::from_millis(20));
        }
        let said = fs::read_to_string(&told).unwrap();
        assert!(!said.contains(&server.token), "{said}");
        let file = Path::new(&said);
        assert!(file.starts_with(runtime.path()) && mode(file) == 0o600, "{said}");
        let leads = format!("http://{}/{}/", server.host, server.token);
        assert!(fs::read_to_string(file).unwrap().contains(&format!("url={leads}\"")));
        if !kept_by_the_system {
            assert!(file.parent() != Some(runtime.path()) && mode(file.parent().unwrap()) == 0o700, "{said}");
        }
        server.end();
        assert_eq!(fs::read_dir(runtime.path()).unwrap().count(), 0, "nothing is left");
        fs::remove_file(&told).unwrap();
    }
}
