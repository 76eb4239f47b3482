//! What a diagnosis says of runs that are not all that one would wish for.
//!
//! The machines and their logs are the plant's (`tests/plant`), which shares no code with the program.

use std::path::Path;

use assert_cmd::Command;
use dynid_plant::hidden::{Case, table, trial};
use serde_json::Value;
use tempfile::TempDir;

/// The case of that name (without its number), with runs so short.
fn case(name: &str, duration_s: f64) -> Case {
    let mut cases = table::cases();
    let index = cases.iter().position(|case| case.name.ends_with(name)).expect("a case of the table");
    let mut case = cases.swap_remove(index);
    for run in case.truth.runs.iter_mut().chain(&mut case.without.runs) {
        run.duration_s = duration_s;
    }
    case
}

fn played(case: &Case) -> TempDir {
    let folder = TempDir::new().unwrap();
    trial::write(case, folder.path()).unwrap();
    folder
}

fn diagnosed(folder: &Path) -> Value {
    let arguments = ["diagnose", "experiment.toml", "--model", "believed.toml", "--error", "position", "--json"];
    let output = Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder).assert().success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

fn has_note(diagnosis: &Value, text: &str) -> bool {
    diagnosis["notes"].as_array().unwrap().iter().any(|note| note.as_str().unwrap().contains(text))
}

/// The same with runs that are all to be fitted to, and only two of them.
fn without_held_out_runs(name: &str) -> TempDir {
    let mut case = case(name, 12.0);
    case.truth.runs.truncate(2);
    case.truth.runs.iter_mut().for_each(|run| run.role = "fit".to_owned());
    played(&case)
}

/// Without a held-out run every block of the runs is held out once, and the answer is the same.
#[test]
fn without_a_held_out_run_blocks_are_held_out() {
    let folder = without_held_out_runs("servo_pendulum-0-stribeck");
    let diagnosis = diagnosed(folder.path());
    assert!(has_note(&diagnosis, "blocked cross-validation"), "{}", diagnosis["notes"]);
    assert_eq!(diagnosis["verdict"], "missing_effect", "{diagnosis:#}");
    let ranking = diagnosis["ranking"].as_array().unwrap();
    let first = &ranking[0];
    assert_eq!((&first["effect"], &first["joint"]), (&"stribeck".into(), &0.into()), "{diagnosis:#}");
    let floor = dynid_plant::hidden::noise_floor();
    assert!(first["rmse_validate_after"].as_f64().unwrap() < 1.2 * floor, "{diagnosis:#}");
    assert!(first["rmse_validate_before"].as_f64().unwrap() > 10.0 * floor, "{diagnosis:#}");
    assert!(ranking.len() <= 3, "only those that all blocks have judged: {diagnosis:#}");
}

/// Nothing is found in blocks of a machine that lacks nothing.
#[test]
fn blocks_find_nothing_where_nothing_is_missing() {
    let folder = without_held_out_runs("servo_pendulum-0-coulomb");
    let diagnosis = diagnosed(folder.path());
    assert_eq!(diagnosis["verdict"], "nothing_missing", "{diagnosis:#}");
    assert!(has_note(&diagnosis, "blocked cross-validation"), "{}", diagnosis["notes"]);
    let ratio = diagnosis["worst_ratio"].as_f64().unwrap();
    assert!((0.9..1.2).contains(&ratio), "{ratio}");
}
