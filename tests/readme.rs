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
    let tour = Command::cargo_bin("dynid").unwrap().current_dir(folder.path()).arg("tour").output().unwrap();
    let tour = String::from_utf8(tour.stdout).unwrap();
    // How long it took and where the binary lies differ.
    let told = tour.lines().map(|line| line.split(" iterations and ").next().unwrap_or(line));
    let told: Vec<&str> = told.filter(|line| !line.contains(" dynid-tour/experiment.toml ")).collect();
    assert!(told.len() > 30, "{tour}");
    for line in told {
        assert!(readme.contains(line), "the README's tour is not the program's: {line}");
    }
    for picture in ["docs/wrist-believed.svg", "docs/wrist-fitted.svg"] {
        assert!(readme.contains(picture) && root.join(picture).is_file(), "{picture}");
    }
}
