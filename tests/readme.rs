//! The README shows what the program says.

use std::fs;
use std::path::Path;

use assert_cmd::Command;

#[test]
fn the_readme_is_true() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).unwrap().replace("\r\n", "\n");
    for command in ["cargo run --release -- tour", "cargo xtask ci"] {
        assert!(readme.contains(&format!("```sh\n{command}\n```")), "{command}");
    }
    let plan = ["plan", "freedom6s", "--method", "isolated"];
    let plan = Command::cargo_bin("dynid").unwrap().args(plan).output().unwrap();
    assert!(
        readme.contains(String::from_utf8(plan.stdout).unwrap().trim_end()),
        "the README's plan is not the program's"
    );
    let folder = tempfile::tempdir().unwrap();
    let excite = ["excite", "freedom6s", "--input", "table-4.7-configuration-1", "--out", "run.csv"];
    let excite = Command::cargo_bin("dynid").unwrap().current_dir(folder.path()).args(excite).output().unwrap();
    assert!(
        readme.contains(String::from_utf8(excite.stdout).unwrap().trim_end()),
        "the README's excitation is not the program's"
    );
    let report = ["wall", "report", "--out", "wall.html"];
    let report = Command::cargo_bin("dynid").unwrap().current_dir(folder.path()).args(report).output().unwrap();
    assert!(
        readme.contains(String::from_utf8(report.stdout).unwrap().trim_end()),
        "the README's walls are not the program's"
    );
    let space = ["wall", "space", "--compensate", "--out", "space.html"];
    let space = Command::cargo_bin("dynid").unwrap().current_dir(folder.path()).args(space).output().unwrap();
    assert!(
        readme.contains(String::from_utf8(space.stdout).unwrap().trim_end()),
        "the README's wall in space is not the program's"
    );
    // Over a tour that is there: told to, it takes its place.
    fs::create_dir(folder.path().join("dynid-tour")).unwrap();
    fs::write(folder.path().join("dynid-tour/fitted.toml"), "mine\n").unwrap();
    let tour = ["tour", "--force"];
    let tour = Command::cargo_bin("dynid").unwrap().current_dir(folder.path()).args(tour).output().unwrap();
    assert_ne!(fs::read_to_string(folder.path().join("dynid-tour/fitted.toml")).unwrap(), "mine\n");
    let tour = String::from_utf8(tour.stdout).unwrap();
    // How long it took differs.
    let message: Vec<&str> = tour.lines().filter(|line| !line.starts_with("The whole loop took")).collect();
    assert!(message.len() > 30, "{tour}");
    for line in message {
        assert!(readme.contains(line), "the README's tour is not the program's: {line}");
    }
    for picture in ["docs/ladder.svg", "docs/report.png", "docs/report-where.png", "docs/wall.png"] {
        assert!(readme.contains(picture) && root.join(picture).is_file(), "{picture}");
    }
}
