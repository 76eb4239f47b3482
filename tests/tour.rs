//! The tour: its data are what the plant makes, it finds what is hidden in them, and its page needs no network.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

#[test]
fn the_plant_makes_the_same_logs_again() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for place in ["src/tour", "tests/wrist"] {
        let folder = root.join(place);
        let text = fs::read_to_string(folder.join("recipe.toml")).unwrap();
        let recipe: Recipe = toml::from_str(&text).unwrap();
        let device = dynid_model::device(&recipe.device).unwrap();
        let files = recipe::make(&recipe, device).unwrap();
        assert_eq!(files.len(), recipe.runs.len() + 1);
        for (name, made) in files {
            let kept = fs::read_to_string(folder.join(&name)).unwrap().replace("\r\n", "\n");
            assert!(
                made == kept,
                "{place}/{name} is not what the recipe makes; run `dynid-plant {place}/recipe.toml <folder>`"
            );
        }
    }
}

fn tour(folder: &TempDir, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("dynid").unwrap().arg("tour").args(arguments).current_dir(folder.path()).assert()
}

#[test]
fn it_finds_what_is_hidden_and_writes_a_page_that_stands_alone() {
    // A folder that is there is kept, unless it is asked for.
    let folder = TempDir::new().unwrap();
    fs::create_dir(folder.path().join("dynid-tour")).unwrap();
    fs::write(folder.path().join("dynid-tour/fitted.toml"), "mine\n").unwrap();
    let refused = tour(&folder, &["--out-dir", "dynid-tour"]).code(2).get_output().stderr.clone();
    let refused = String::from_utf8(refused).unwrap();
    assert!(refused.contains("fitted.toml exists already"), "{refused}");
    let output = tour(&folder, &["--json"]).success().get_output().stdout.clone();
    let answer: Value = serde_json::from_slice(&output).unwrap();
    assert_eq!(answer["verdict"], "missing_effect");
    assert_eq!(answer["found"], serde_json::json!({ "effect": "input_coupling", "joint": 4, "from": 5 }));
    assert_eq!((&answer["where"]["joint"], &answer["where"]["other"]), (&4.into(), &5.into()));
    let ladder = &answer["ladder"];
    let noise = ladder["noise_floor"].as_f64().unwrap();
    let rungs = ladder["rungs"].as_array().unwrap();
    let held_out: Vec<f64> = rungs.iter().map(|rung| rung["rmse_validate"].as_f64().unwrap()).collect();
    assert_eq!(held_out.len(), 3);
    assert!(held_out[1] > 50.0 * noise && held_out[2] < 1.2 * noise, "{held_out:?} {noise}");
    let lineage: Vec<&Value> = rungs.iter().map(|rung| &rung["lineage"]).collect();
    assert_eq!(lineage, [&Value::Null, &"fitted".into(), &"added_and_fitted".into()]);

    // The commands that it tells work in its folder, and the page is the same.
    assert_eq!(fs::read_to_string(folder.path().join("dynid-tour/fitted.toml")).unwrap(), "mine\n");
    let mut left: Vec<String> = fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    assert_eq!(left, ["dynid-tour", "dynid-tour-2"]);
    let made = folder.path().join("dynid-tour-2");
    let page = fs::read_to_string(made.join("report.html")).unwrap();
    for outside in ["http", "src=", "href=", "@import", "url(", "<link"] {
        assert!(!page.contains(outside), "the page contains `{outside}`");
    }
    assert!(page.contains("input_coupling at joint 4 from 5") && page.contains("<h2>The ladder</h2>"));
    assert!(page.contains("<dd>experiment.toml, sha256"), "the logs by the name that they have beside the page");
    let commands = answer["commands"].as_array().unwrap();
    assert_eq!(commands.len(), 7);
    for command in commands.iter().filter(|command| command.as_str().unwrap().contains(" add ")) {
        let arguments: Vec<&str> = command.as_str().unwrap().split(' ').skip(1).chain(["--force"]).collect();
        let before = fs::read(made.join("better.toml")).unwrap();
        Command::cargo_bin("dynid").unwrap().args(&arguments).current_dir(&made).assert().success();
        assert_eq!(fs::read(made.join("better.toml")).unwrap(), before);
    }
}
