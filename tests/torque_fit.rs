//! The torque fit against logs of the independent plant: known parameters come back.

use std::fs;

use dynid_identify::{FitStatus, identify::ErrorSignal, identify::identify, position::Options};
use dynid_judge::compare::compare;
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_user_model::Model;

/// A two-link arm that hangs and is shaken. Truth: links 5 % off the device file, friction a third.
const RECIPE: &str = r#"
device = "planar2r"
seed = 42
sample_s = 0.005
steps_per_sample = 20
noise_rms = 1e-5
quantum = 0.0
start = [-1.5, 0.1]

[parameters]
"link.1.m" = 1.25
"link.1.x" = -0.19
"link.2.m" = 0.84
"link.2.x" = -0.157

[[effect]]
id = "viscous"
joint = 0
Fv = 0.067

[[effect]]
id = "coulomb"
joint = 0
Fc = 0.15
v_eps = 0.01

[[effect]]
id = "viscous"
joint = 1
Fv = 0.022

[[effect]]
id = "coulomb"
joint = 1
Fc = 0.07
v_eps = 0.01

[[run]]
file = "shaken.csv"
free = [0, 1]
role = "fit"
duration_s = 30.0
torque = [
  { joint = 0, amplitude = 2.5, hz = 0.37 },
  { joint = 0, amplitude = 1.5, hz = 0.91, phase = 1.0 },
  { joint = 1, amplitude = 0.8, hz = 0.53, phase = 0.3 },
  { joint = 1, amplitude = 0.5, hz = 1.37, phase = 2.0 },
]

[[run]]
file = "chirped.csv"
free = [0, 1]
role = "validate"
duration_s = 20.0
torque = [
  { joint = 0, amplitude = 3.0, hz = 0.2, hz_per_s = 0.05 },
  { joint = 1, amplitude = 1.0, hz = 0.4, hz_per_s = 0.04, phase = 1.0 },
]
"#;

#[test]
fn known_parameters_come_back() {
    let device = dynid_model::device("planar2r").expect("a shipped device");
    let recipe = toml::from_str(RECIPE).expect("the recipe is a recipe");
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in dynid_plant::recipe::make(&recipe, device).expect("the recipe can be played") {
        fs::write(folder.path().join(name), text).expect("the folder is writable");
    }
    let experiment =
        Experiment::read_with(&folder.path().join("experiment.toml"), dynid_model::devices()).expect("good logs");
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let model = Model::of_device(device);
    let found = identify(&model, &experiment, &runs, ErrorSignal::Torque, &Options::default(), &mut |_| {})
        .expect("there is something to fit");
    assert!(found.status.may_update_model(), "{:?}", found.status);
    assert_eq!(found.status, FitStatus::NotIdentifiable, "a link's parameters act only together");

    // What the data determine by themselves comes back within its own error.
    let truth = [
        ("joint.0.viscous.Fv", 0.067),
        ("joint.0.coulomb.Fc", 0.15),
        ("joint.1.viscous.Fv", 0.022),
        ("joint.1.coulomb.Fc", 0.07),
    ];
    for (name, expected) in truth {
        let parameter = found.parameters.iter().find(|parameter| parameter.name == name).expect("is fitted");
        let error = parameter.std_error.expect("is identifiable");
        let off = (parameter.value - expected).abs();
        assert!(off < 4.0 * error + 0.03 * expected, "{name} = {} +- {error}, not {expected}", parameter.value);
        assert!(error < 0.1 * expected, "{name} is known to {error}");
    }
    // The others come back in the combinations that the motion shows (m2 x2' with x' from the joint, and so on).
    let value = |name: &str| found.model.parameter(name).expect("a parameter of the arm").value;
    let second = value("link.2.m") * (0.3 + value("link.2.x"));
    let first = value("link.1.m") * (0.4 + value("link.1.x")) + 0.4 * value("link.2.m");
    assert!((second / (0.84 * 0.143) - 1.0).abs() < 0.01, "{second}");
    assert!((first / (1.25 * 0.21 + 0.4 * 0.84) - 1.0).abs() < 0.01, "{first}");

    // Held out, little of the torque is left unexplained; with the prior values much more was.
    let percent = |model: &Model| -> f64 {
        compare(model, &runs).expect("comparable").torque_percent_validate.expect("there is torque")
    };
    let (before, after) = (percent(&model), percent(&found.model));
    assert!(after < 2.0 && after < 0.3 * before, "{before} % to {after} %");
}
