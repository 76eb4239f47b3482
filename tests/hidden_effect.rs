//! The program, told nothing, against machines that have an effect more than the believed model.
//!
//! The machines and their logs are the plant's (`tests/plant`), which shares no code with the program. Here are the few
//! cases that take seconds; `cargo xtask hidden-effects` runs all of them and prints the table.

use std::path::Path;

use dynid_plant::hidden::{Case, table, trial};

fn program() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_dynid"))
}

/// The case of that name (without its number), with runs of 15 s.
fn case(name: &str) -> Case {
    let mut cases = table::cases();
    let index = cases.iter().position(|case| case.name.ends_with(name)).expect("a case of the table");
    let mut case = cases.swap_remove(index);
    for recipe in [&mut case.truth, &mut case.without] {
        for run in &mut recipe.runs {
            run.duration_s = 15.0;
        }
    }
    case
}

/// Every effect of this list is simulated twice, by the plant and by the program: what a fit of the true model leaves of the
/// held-out run is its noise.
#[test]
fn plant_and_program_agree() {
    for name in ["servo_pendulum-0-backlash", "freedom6s-45-input_delay", "servo_pendulum-0-friction_load"] {
        let case = case(name);
        let folder = tempfile::tempdir().expect("a temporary folder");
        trial::write(&case, folder.path()).expect("the case can be played");
        let ratio = trial::fit_the_truth(folder.path(), program()).expect("the true model can be fitted");
        assert!(ratio < 1.1, "{name}: {ratio} times the noise floor");
        assert!(ratio > 0.9, "{name}: {ratio} times the noise floor: the log has less noise than it says");
    }
}
