//! `dynid check` as a user runs it: good logs, logs made wrong on purpose, logs that answer nothing, and the commands that it
//! proposes.

use std::f64::consts::PI;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

/// The two-link arm, hanging: shaken at both joints, and a held-out run.
const RECIPE: &str = r#"
device = "planar2r"
seed = 7
sample_s = 0.01
steps_per_sample = 20
noise_rms = 1e-5
quantum = 0.0
start = [-1.5, 0.1]

[[effect]]
id = "viscous"
joint = 0
Fv = 0.06

[[effect]]
id = "coulomb"
joint = 0
Fc = 0.15
v_eps = 0.05

[[effect]]
id = "viscous"
joint = 1
Fv = 0.022

[[effect]]
id = "coulomb"
joint = 1
Fc = 0.07
v_eps = 0.05

[[run]]
file = "shaken.csv"
free = [0, 1]
role = "fit"
duration_s = 30.0
torque = [
  { joint = 0, amplitude = 1.5, hz = 0.37 },
  { joint = 0, amplitude = 1.0, hz = 0.91, phase = 1.0 },
  { joint = 1, amplitude = 0.4, hz = 0.53, phase = 0.3 },
  { joint = 1, amplitude = 0.3, hz = 1.37, phase = 2.0 },
]

[[run]]
file = "chirped.csv"
free = [0, 1]
role = "validate"
duration_s = 20.0
torque = [
  { joint = 0, amplitude = 2.0, hz = 0.2, hz_per_s = 0.05 },
  { joint = 1, amplitude = 0.5, hz = 0.4, hz_per_s = 0.04, phase = 1.0 },
]
"#;

fn folder(recipe: &str) -> TempDir {
    let recipe: Recipe = toml::from_str(recipe).unwrap();
    let folder = TempDir::new().unwrap();
    for (name, text) in recipe::make(&recipe, dynid_model::device(&recipe.device).unwrap()).unwrap() {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// Changes every row of a log: its number and its cells.
fn rewrite(path: &Path, mut change: impl FnMut(usize, &mut Vec<f64>)) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let mut changed = format!("{}\n", lines.next().unwrap());
    for (number, line) in lines.enumerate() {
        let mut cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        change(number, &mut cells);
        let cells: Vec<String> = cells.iter().map(f64::to_string).collect();
        changed.push_str(&format!("{}\n", cells.join(",")));
    }
    fs::write(path, changed).unwrap();
}

fn dynid(folder: &Path, arguments: &str) -> assert_cmd::assert::Assert {
    Command::cargo_bin("dynid").unwrap().current_dir(folder).args(arguments.split_whitespace()).assert()
}

fn checked(folder: &Path) -> Value {
    let output = dynid(folder, "check experiment.toml --json").success().get_output().stdout.clone();
    serde_json::from_slice(&output).unwrap()
}

/// Kinds of what looks wrong at a joint of the shaken run.
fn kinds(checked: &Value, joint: usize) -> Vec<&str> {
    let findings = checked["findings"].as_array().unwrap().iter();
    let own = findings.filter(|own| own["run"] == "shaken.csv" && own["joint"] == joint);
    own.map(|own| own["finding"]["kind"].as_str().unwrap()).collect()
}

// Columns of a log: t, tau0, tau1, q0, q1.

#[test]
fn good_logs_have_nothing_wrong() {
    let folder = folder(RECIPE);
    let checked = checked(folder.path());
    assert_eq!(checked["verdict"], "nothing_wrong", "{checked:#}");
    assert_eq!((&checked["findings"], &checked["suggestions"]), (&serde_json::json!([]), &serde_json::json!([])));
    assert!(checked["identifiability"]["parameters"].as_array().unwrap().len() >= 7);
    dynid(folder.path(), "check experiment.toml")
        .success()
        .stdout("Nothing looks wrong in these logs, and they excite every parameter that they can reveal.\n");
}

/// What makes a row wrong.
type Change = fn(usize, &mut Vec<f64>);

#[test]
fn what_is_made_wrong_is_found_and_said() {
    let cases: [(&str, Change); 4] = [
        ("wrong_sign", |_, cells| cells[2] = -cells[2]),
        ("thousand", |_, cells| cells[2] *= 1000.0),
        ("degrees", |_, cells| (3..5).for_each(|cell| cells[cell] *= 180.0 / PI)),
        ("saturated", |_, cells| cells[2] = cells[2].clamp(-0.4, 0.4)),
    ];
    for (kind, change) in cases {
        let folder = folder(RECIPE);
        rewrite(&folder.path().join("shaken.csv"), change);
        let checked = checked(folder.path());
        assert_eq!(checked["verdict"], "warnings");
        assert!(kinds(&checked, 1).contains(&kind), "{kind}: {checked:#}");
        let said = checked["findings"][0]["what"].as_str().unwrap();
        dynid(folder.path(), "check experiment.toml").success().stdout(predicates::str::contains(said));
    }
}

#[test]
fn a_shift_between_columns_is_found() {
    let folder = folder(RECIPE);
    let mut before: Vec<[f64; 2]> = Vec::new();
    // Positions are logged four rows late.
    rewrite(&folder.path().join("shaken.csv"), |row, cells| {
        before.push([cells[3], cells[4]]);
        cells[3..5].copy_from_slice(&before[row.saturating_sub(4)]);
    });
    let checked = checked(folder.path());
    let findings = checked["findings"].as_array().unwrap();
    let delay = findings.iter().find(|own| own["finding"]["kind"] == "delay" && own["joint"] == 1);
    let samples = delay.unwrap_or_else(|| panic!("{checked:#}"))["finding"]["samples"].as_f64().unwrap();
    assert!((samples - 4.0).abs() <= 0.5, "{samples}");
}

/// Joint 1 is held by nobody and moved by nobody, and joint 0 by one sine: both are told, with a command that can be typed.
#[test]
fn what_the_runs_leave_open_comes_with_a_command_to_play() {
    let folder = folder(RECIPE);
    let path = folder.path();
    let experiment = fs::read_to_string(path.join("experiment.toml")).unwrap();
    for name in ["shaken.csv", "chirped.csv"] {
        rewrite(&path.join(name), |row, cells| {
            let t = 0.01 * row as f64;
            cells[2] = 0.0;
            cells[3] = -1.5 + 0.3 * (4.0 * t).sin() + 1e-5 * (row as f64 * 12.9898).sin();
            cells[4] = 0.1 + 1e-5 * (row as f64 * 78.233).sin();
        });
    }
    let checked = checked(path);
    assert_eq!(checked["verdict"], "warnings");
    let kinds: Vec<&str> =
        checked["typed_unanswered"].as_array().unwrap().iter().map(|own| own["kind"].as_str().unwrap()).collect();
    assert!(kinds.contains(&"never_moves") && kinds.contains(&"few_frequencies"), "{checked:#}");
    let suggestion = &checked["suggestions"][0];
    assert_eq!((&suggestion["free"], &suggestion["joints"]), (&serde_json::json!([0, 1]), &serde_json::json!([0, 1])));
    let command = suggestion["command"].as_str().unwrap();
    let typed = command.strip_prefix("dynid ").unwrap().to_owned() + " --evaluations 50";
    dynid(path, &typed).success();
    assert!(path.join("excite-0-1.csv").is_file());
    assert_eq!(fs::read_to_string(path.join("experiment.toml")).unwrap(), experiment, "nothing else is touched");
}

#[test]
fn logs_that_answer_nothing_are_told_in_one_sentence() {
    let folder = folder(RECIPE);
    for name in ["shaken.csv", "chirped.csv"] {
        rewrite(&folder.path().join(name), |_, cells| cells[3..5].copy_from_slice(&[-1.5, 0.1]));
    }
    let output = dynid(folder.path(), "check experiment.toml").code(1).get_output().stdout.clone();
    let text = String::from_utf8(output).unwrap();
    assert!(text.starts_with("These logs answer nothing: no joint moves by more than 10 times its noise"), "{text}");
}

#[test]
fn a_time_stamp_twice_is_refused_with_its_place() {
    let folder = folder(RECIPE);
    rewrite(&folder.path().join("shaken.csv"), |row, cells| {
        if row == 100 {
            cells[0] = 0.99;
        }
    });
    dynid(folder.path(), "check experiment.toml").code(2).stderr(predicates::str::contains("time stands still"));
}
