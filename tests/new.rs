//! `dynid new`, as a user begins: logs in a foreign header and foreign units, a URDF, and nothing else.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use dynid_model::device_named;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

fn dynid(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder).assert()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = dynid(folder, &[arguments, &["--json"]].concat()).success().get_output().stdout.clone();
    serde_json::from_slice(&output).unwrap()
}

/// What made the logs, where it is not the URDF's.
const TRUTH: [(&str, f64); 3] = [("joint.0.viscous.Fv", 0.22), ("joint.1.viscous.Fv", 0.085), ("noise", 1e-4)];

/// A folder with a URDF and logs of that arm: times in milliseconds, angles in degrees, the torque of the elbow against its
/// angle, cells parted by semicolons.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("arm.urdf"), include_str!("own_robot/arm.urdf")).unwrap();
    dynid(folder.path(), &["device", "import", "arm.urdf", "--out", "true.toml"]).success();
    let run = |file: &str, hz: f64| {
        let torque = |joint: usize, amplitude: f64, hz: f64| {
            format!("{{ joint = {joint}, amplitude = {amplitude:?}, hz = {hz:?} }}")
        };
        let torques =
            [torque(0, 2.5, 0.7 * hz), torque(0, 1.2, 1.9 * hz), torque(1, 0.5, hz), torque(1, 0.6, 2.6 * hz)];
        format!(
            "[[run]]\nfile = \"{file}\"\nfree = [0, 1]\nrole = \"fit\"\nduration_s = 8.0\ntorque = [{}]\n",
            torques.join(", ")
        )
    };
    let text = format!(
        "device = \"true\"\nseed = 3\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = {:?}\nquantum = 1e-5\n\
         start = [0.1, 0.0]\n[parameters]\n\"link.2.m\" = 0.9\n\
         [[effect]]\nid = \"viscous\"\njoint = 0\nFv = {:?}\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = {:?}\n{}{}{}",
        TRUTH[2].1,
        TRUTH[0].1,
        TRUTH[1].1,
        run("one.csv", 0.5),
        run("two.csv", 0.8),
        run("three.csv", 0.6)
    );
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let device = device_named("true.toml", folder.path()).unwrap();
    for (name, text) in recipe::make(&recipe, device).unwrap() {
        if name.ends_with(".csv") {
            fs::write(folder.path().join(name), foreign(&text)).unwrap();
        }
    }
    fs::remove_file(folder.path().join("true.toml")).unwrap();
    folder
}

fn foreign(log: &str) -> String {
    let mut text =
        "stamp;/joint_states/effort[0];/joint_states/effort[1];/joint_states/position[0];/joint_states/position[1]\n"
            .to_owned();
    for row in log.lines().skip(1) {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.parse().unwrap()).collect();
        let [t, tau0, tau1, q0, q1] = cells[..] else { panic!("{row}") };
        text += &format!("{:.0};{tau0};{};{};{}\n", 1000.0 * t, -tau1, q0.to_degrees(), q1.to_degrees());
    }
    text
}

#[test]
fn from_foreign_logs_to_the_true_parameters_without_an_edit() {
    let folder = folder();
    let guess = json(folder.path(), &["new", "one.csv", "two.csv", "three.csv", "--device", "arm.urdf"]);
    assert_eq!(guess["written"], serde_json::json!(["experiment.toml", "model.toml", "robot.toml"]), "{guess}");
    let scale = |logical: &str| {
        let column = guess["columns"].as_array().unwrap().iter().find(|own| own["logical"] == logical);
        column.unwrap_or_else(|| panic!("{logical} of {guess}"))["scale"].as_f64().unwrap()
    };
    assert_eq!((scale("t"), scale("tau0"), scale("tau1")), (1e-3, 1.0, -1.0));
    assert!((scale("q0") / 1_f64.to_radians() - 1.0).abs() < 1e-12 && scale("q0") == scale("q1"));
    assert_eq!(guess["findings"], serde_json::json!([]), "{guess}");
    let roles: Vec<&str> = guess["runs"].as_array().unwrap().iter().map(|run| run["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["fit", "fit", "validate"]);

    let fit = json(folder.path(), &["fit", "experiment.toml", "--model", "model.toml", "--out", "fitted.toml"]);
    let rmse = fit["rmse_validate"].as_f64().unwrap();
    assert!(rmse < 1.5 * TRUTH[2].1, "the held-out run is followed to its noise: {rmse}");
    for (name, truth) in &TRUTH[..2] {
        let found = fit["parameters"].as_array().unwrap().iter().find(|own| own["name"] == *name).unwrap();
        let value = found["value"].as_f64().unwrap();
        assert!((value / truth - 1.0).abs() < 0.01, "{name} is {truth}: {found}");
    }
}

#[test]
fn nothing_is_overwritten_and_all_is_written_or_nothing() {
    let folder = folder();
    let new = ["new", "one.csv", "two.csv", "--device", "arm.urdf"];
    let there = |name: &str| folder.path().join(name).exists();
    fs::write(folder.path().join("robot.toml"), "mine").unwrap();
    let refused = dynid(folder.path(), &new).code(2);
    let said = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(said.contains("robot.toml exists already and is kept"), "{said}");
    assert!(!there("experiment.toml") && !there("model.toml"));
    dynid(folder.path(), &[&new[..], &["--force"]].concat()).success();
    assert!(there("experiment.toml") && there("model.toml"));
}

#[test]
fn what_a_person_says_is_written_with_its_reason() {
    let folder = folder();
    let log = fs::read_to_string(folder.path().join("one.csv")).unwrap();
    let log = log.replacen("stamp", "clock \"a\"", 1).replacen("/joint_states/effort[1]", "x", 1);
    fs::write(folder.path().join("one.csv"), log).unwrap();
    let new = ["new", "one.csv", "--device", "arm.urdf", "--out", "arm"];
    let refused = dynid(folder.path(), &new).code(2);
    let said = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(
        said.contains("no column is the torque of joint 1 (elbow)") && said.contains("--column tau1=NAME"),
        "{said}"
    );
    assert!(!folder.path().join("arm").exists(), "nothing is written");

    dynid(folder.path(), &[&new[..], &["--column", "tau1=x", "--free", "0,1"]].concat()).success();
    let experiment = fs::read_to_string(folder.path().join("arm/experiment.toml")).unwrap();
    assert!(experiment.contains("tau1 = \"x\"") && experiment.contains("# said with --column"), "{experiment}");
    assert!(experiment.contains("free = [0, 1]") && experiment.contains("# said with --free"), "{experiment}");
    assert!(experiment.contains("file = \"../one.csv\""), "{experiment}");
    dynid(folder.path(), &["check", "arm/experiment.toml", "--model", "arm/model.toml"]).success();
}

#[test]
fn a_log_that_is_not_there_is_one_error() {
    let folder = folder();
    let refused = dynid(folder.path(), &["new", "no.csv", "--device", "arm.urdf"]).code(2);
    let said = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(said.contains("no.csv: cannot be read") && said.contains("give the path of a log"), "{said}");
    assert!(!said.contains("experiment"), "there is none yet: {said}");
}

#[test]
fn a_device_that_is_none_is_one_error() {
    let folder = folder();
    for (device, expected) in [
        ("planar3r", "--device planar3r: there is no device `planar3r`"),
        ("no.urdf", "cannot read no.urdf"),
        ("no.toml", "no.toml: cannot be read"),
    ] {
        let refused = dynid(folder.path(), &["new", "one.csv", "--device", device]).code(2);
        let said = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
        assert!(said.contains(expected) && said.matches("error: ").count() == 1, "{said}");
    }
}
