//! The program, told nothing, against machines that have an effect more than the believed model.
//!
//! The machines and their logs are the plant's (`tests/plant`), which shares no code with the program. Here are the few
//! cases that take seconds; `cargo xtask hidden-effects` runs all of them and prints the table.

use std::path::Path;

use dynid_plant::hidden::trial::{self, Outcome};
use dynid_plant::hidden::{Case, table};

fn program() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_dynid"))
}

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

fn tried(name: &str) -> Outcome {
    tried_in(tempfile::tempdir().expect("a temporary folder").path(), name)
}

fn tried_in(folder: &Path, name: &str) -> Outcome {
    let case = case(name, 12.0);
    trial::write(&case, folder).expect("the case can be played");
    trial::run(&case, folder, program()).expect("every verb answers")
}

/// Each of these effects is simulated twice, by the plant and by the program: what a fit of the true model leaves of the
/// held-out run is its noise.
#[test]
fn plant_and_program_agree() {
    for name in ["servo_pendulum-0-joint_elasticity", "freedom6s-45-input_delay", "servo_pendulum-0-friction_load"] {
        let case = case(name, 12.0);
        let folder = tempfile::tempdir().expect("a temporary folder");
        trial::write(&case, folder.path()).expect("the case can be played");
        let ratio = trial::fit_the_truth(folder.path(), program()).expect("the true model can be fitted");
        assert!(ratio < 1.2, "{name}: {ratio} times the noise floor");
        assert!(ratio > 0.9, "{name}: {ratio} times the noise floor: the log has less noise than it says");
    }
}

#[test]
fn names_the_effect_that_the_model_lacks() {
    let outcome = tried("servo_pendulum-0-stribeck");
    assert!(outcome.right, "{outcome:?}");
    assert!(outcome.before > Some(10.0), "{outcome:?}");
}

#[test]
fn says_that_nothing_is_missing() {
    let outcome = tried("servo_pendulum-0-coulomb");
    assert!(outcome.right, "{outcome:?}");
}

#[test]
fn says_that_it_knows_no_such_effect() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let outcome = tried_in(folder.path(), "servo_pendulum-0-resonance");
    assert!(outcome.right, "{outcome:?}");
    // Nor does it say that parameters moved: they are the same in every run.
    let diagnosis = std::fs::read_to_string(folder.path().join("diagnosis.json")).expect("the trial keeps it");
    let diagnosis: serde_json::Value = serde_json::from_str(&diagnosis).expect("JSON");
    assert_eq!(diagnosis["moved"], serde_json::json!([]));
}

/// Where a formula does far better than any effect, it is told.
#[test]
fn what_no_effect_comes_near_is_told_by_a_formula() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let outcome = tried_in(folder.path(), "freedom6s-5-viscous_position");
    assert!(outcome.right && outcome.discovered == Some(true), "{outcome:?}");
}
