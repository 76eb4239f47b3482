//! The tour: its data are what the plant makes, it reaches the noise, and its page needs no network.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

#[test]
fn the_plant_makes_the_same_logs_again() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/tour");
    let text = fs::read_to_string(folder.join("recipe.toml")).unwrap();
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let device = dynid_model::device(&recipe.device).unwrap();
    let files = recipe::make(&recipe, device).unwrap();
    assert_eq!(files.len(), recipe.runs.len() + 1);
    for (name, made) in files {
        let kept = fs::read_to_string(folder.join(&name)).unwrap().replace("\r\n", "\n");
        assert!(made == kept, "{name} is not what the recipe makes; run `dynid-plant src/tour/recipe.toml <folder>`");
    }
}

fn tour(folder: &TempDir, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("dynid").unwrap().arg("tour").args(arguments).current_dir(folder.path()).assert()
}

#[test]
fn it_identifies_the_joint_and_writes_a_page_that_stands_alone() {
    let folder = TempDir::new().unwrap();
    let output = tour(&folder, &["--json"]).success().get_output().stdout.clone();
    let told: Value = serde_json::from_slice(&output).unwrap();
    let runs = told["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 3);
    for run in runs {
        let [before, after, noise] = ["rmse_before", "rmse_after", "noise_floor"].map(|key| run[key].as_f64().unwrap());
        assert!(before > 50.0 * noise, "the believed model is far off: {run}");
        assert!(after < 1.1 * noise, "the fitted one is not: {run}");
    }

    let page = fs::read_to_string(folder.path().join("dynid-tour/report.html")).unwrap();
    for outside in ["http", "src=", "href=", "@import", "url(", "<script", "<link"] {
        assert!(!page.contains(outside), "the page contains `{outside}`");
    }
    assert_eq!(page.matches("<svg").count(), 2);
    assert!(page.contains("held") || page.contains("Held out"));
}

#[test]
fn a_second_tour_keeps_the_first() {
    let folder = TempDir::new().unwrap();
    fs::create_dir(folder.path().join("dynid-tour")).unwrap();
    fs::write(folder.path().join("dynid-tour/fitted.toml"), "mine\n").unwrap();
    let told = tour(&folder, &[]).success().get_output().stdout.clone();
    assert!(String::from_utf8(told).unwrap().contains("dynid-tour was there already and is kept."));
    assert_eq!(fs::read_to_string(folder.path().join("dynid-tour/fitted.toml")).unwrap(), "mine\n");
    assert!(folder.path().join("dynid-tour-2/report.html").is_file());

    let refused = tour(&folder, &["--out-dir", "dynid-tour"]).code(2).get_output().stderr.clone();
    let refused = String::from_utf8(refused).unwrap();
    assert!(refused.contains("fitted.toml exists already"), "{refused}");

    tour(&folder, &["--out-dir", "dynid-tour", "--force"]).success();
    assert_ne!(fs::read_to_string(folder.path().join("dynid-tour/fitted.toml")).unwrap(), "mine\n");
    let mut left: Vec<String> = fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["dynid-tour", "dynid-tour-2"]);
}
