//! README's pictures of the live page: `cargo test --release --workspace --exclude dynid-derive --test pictures -- --ignored` writes them anew.

use std::fs;
use std::path::Path;

use dynid_browser::{Browser, Scheme, Server, tour};

/// 1280 pixels wide and as high as what is to be seen, from the top of the window.
fn write(browser: &Browser, name: &str, height: u32) {
    browser.look(1280, height, Scheme::Light);
    browser.idle();
    // The mouse and the focus are nobody's business here; messages go by themselves.
    browser.value(
        "document.activeElement.blur(); document.querySelectorAll('.toast').forEach((own) => own.remove()); return 0",
    );
    std::thread::sleep(std::time::Duration::from_secs(1));
    browser.idle();
    let picture = browser.picture();
    let folder = std::env::var_os("DYNID_PICTURES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs"), std::path::PathBuf::from);
    println!("{name}: {} kB", picture.len() / 1000);
    assert!(picture.len() < 200_000, "{name} is small enough for a README");
    fs::write(folder.join(name), picture).unwrap();
}

#[test]
#[ignore = "writes the README's pictures"]
fn of_the_readme() {
    let folder = tour(&["wrist-1.csv", "wrist-2.csv", "wrist-3.csv", "experiment.toml", "believed.toml"]);
    // The page shows where it works: not a name that nobody would choose.
    let place = Path::new("/tmp/wrist");
    let _ = fs::remove_dir_all(place);
    fs::rename(folder.path(), place).unwrap();
    let server = Server::open(place, &["experiment.toml", "--model", "believed.toml"]);
    let browser = Browser::new();
    browser.look(1280, 1100, Scheme::Light);
    browser.go(&format!("{}#view=check", server.address));
    browser.click("#fit");
    browser.shown("#to-diagnose");
    browser.idle();
    browser.click(".where .chip");
    browser.value("scrollTo(0, 0); return 0");
    write(&browser, "open-compare.png", 1000);

    browser.press("5");
    browser.click("#diagnose");
    browser.shown(".facts");
    browser.idle();
    write(&browser, "open-diagnose.png", 900);

    browser.click("#add");
    browser.until("location.hash.includes('view=ladder')");
    browser.shown(".fall-chart");
    browser.idle();
    write(&browser, "open-ladder.png", 1000);
    let _ = fs::remove_dir_all(place);
}
