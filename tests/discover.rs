//! A formula for what no effect of the library says, from logs of a plant that has such an effect.

use std::fs;
use std::path::Path;

use dynid_diagnose::{Discovered, discover};
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_model::Effect;
use dynid_plant::recipe::{self, Recipe};
use dynid_user_model::Model;
use tempfile::TempDir;

/// Two runs to fit to and one held out, so long, with both joints free. Waves have a frequency (Hz) and a share of each joint's torque,
/// and are others in every run.
pub fn both_joints(waves: &[(f64, f64)], duration_s: f64) -> String {
    let run = |file: &str, role: &str, index: u32| {
        let wave = |joint: u32, size: f64, order: usize| {
            let (hz, share) = waves[order];
            let hz = hz * (1.0 + 0.07 * f64::from(index) + 0.03 * f64::from(joint));
            let phase = 0.7 * f64::from(index) + 1.3 * order as f64 + 2.0 * f64::from(joint);
            format!("{{ joint = {joint}, amplitude = {:?}, hz = {hz:?}, phase = {phase:?} }}", size * share)
        };
        let waves: Vec<String> =
            (0..waves.len()).flat_map(|order| [wave(0, 2.5, order), wave(1, 0.8, order)]).collect();
        format!(
            "[[run]]\nfile = \"{file}\"\nfree = [0, 1]\nrole = \"{role}\"\nduration_s = {duration_s:?}\ntorque = [{}]\n",
            waves.join(", ")
        )
    };
    [run("one.csv", "fit", 0), run("two.csv", "fit", 1), run("three.csv", "validate", 2)].concat()
}

/// What is found of an arm of two joints with this effect on top of what the model has.
fn found(effect: &str) -> Option<Discovered> {
    // From slow to fast: a narrow motion has many formulas.
    let runs = both_joints(&[(0.11, 0.6), (0.37, 0.4), (1.1, 0.3), (2.7, 0.27), (4.6, 0.2)], 20.0);
    let viscous =
        "[[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.6\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.15\n";
    let text = format!(
        "device = \"planar2r\"\nseed = 8\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = 2e-5\nquantum = 1e-5\nstart = \
         [-1.5, 0.1]\n[parameters]\n{viscous}{effect}{runs}"
    );
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let folder = TempDir::new().unwrap();
    for (name, text) in recipe::make(&recipe, dynid_model::device("planar2r").unwrap()).unwrap() {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let experiment = Experiment::read_with(&folder.path().join("experiment.toml"), dynid_model::devices()).unwrap();
    let prior = format!("device = \"planar2r\"\n{}", viscous.replace("0.6\n", "0.55\n"));
    let prior = Model::parse(&prior, Path::new("believed.toml")).unwrap();
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    discover(&prior, &runs).unwrap()
}

#[test]
fn a_product_of_two_speeds_is_found() {
    let found = found("[[effect]]\nid = \"speed_product\"\njoint = 0\nfrom = 1\nG = 0.12\n").expect("a formula");
    assert_eq!((found.joint, found.from), (0, Some(1)), "{found:?}");
    let first = &found.terms[0];
    assert_eq!((first.term.as_str(), first.unit.as_str()), ("dq0 * dq1", "N*m*s^2/rad^2"), "{found:?}");
    assert!((first.coefficient - 0.12).abs() < 0.012 && first.chosen_in >= 0.8, "{found:?}");
    assert!(found.explained_validate > 0.5, "{found:?}");
    let file = found.effect_file.expect("a pair of joints");
    let effect = Effect::parse(&file, Path::new("speeds.toml")).unwrap();
    assert_eq!(effect.parameters[0].initial, first.coefficient);
}

#[test]
fn of_noise_there_is_nothing_worth_writing() {
    assert_eq!(found(""), None);
}
