//! A robot of one's own, from its URDF and logs to a named missing effect and a page, with nothing but the program.

use std::fs;
use std::path::Path;
use std::process::Command;

use dynid_model::device_named;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

/// With an empty environment: no compiler, no other program.
fn dynid(folder: &Path, arguments: &[&str]) -> Value {
    let mut program = Command::new(env!("CARGO_BIN_EXE_dynid"));
    let output = program.args(arguments).arg("--json").current_dir(folder).env_clear().output().expect("it runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// Logs of the arm with friction at its elbow that the URDF does not know; all joints free, then the elbow alone.
fn logs(folder: &Path) {
    let run = |file: &str, free: &str, role: &str, hz: f64| {
        let torque = |joint: usize, amplitude: f64, hz: f64| {
            format!("{{ joint = {joint}, amplitude = {amplitude:?}, hz = {hz:?} }}")
        };
        let shoulder = if free.contains('0') { format!("{}, ", torque(0, 2.5, 0.7 * hz)) } else { String::new() };
        format!(
            "[[run]]\nfile = \"{file}\"\nfree = {free}\nrole = \"{role}\"\nduration_s = 8.0\ntorque = [{shoulder}{}, {}]\n",
            torque(1, 1.6, hz),
            torque(1, 0.8, 2.6 * hz)
        )
    };
    let text = format!(
        "device = \"arm\"\nseed = 3\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = 1e-4\nquantum = 1e-5\n\
         start = [0.1, 0.0]\n[parameters]\n[[effect]]\nid = \"viscous\"\njoint = 0\nFv = 0.15\n[[effect]]\nid = \"viscous\"\n\
         joint = 1\nFv = 0.06\n[[effect]]\nid = \"coulomb\"\njoint = 1\nFc = 0.25\nv_eps = 0.01\n{}{}{}",
        run("one.csv", "[0, 1]", "fit", 0.5),
        run("elbow.csv", "[1]", "fit", 0.8),
        run("two.csv", "[0, 1]", "validate", 0.6)
    );
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let device = device_named("arm.toml", folder).unwrap();
    for (name, text) in recipe::make(&recipe, device).unwrap() {
        fs::write(folder.join(name), text.replace("device = \"arm\"", "device = \"arm.toml\"")).unwrap();
    }
}

#[test]
fn from_a_urdf_to_a_missing_effect_and_a_page() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("arm.urdf"), include_str!("own_robot/arm.urdf")).unwrap();
    let imported = dynid(folder.path(), &["device", "import", "arm.urdf", "--out", "arm.toml"]);
    assert_eq!(imported["joints"], 2);
    logs(folder.path());

    dynid(folder.path(), &["fit", "experiment.toml", "--out", "fitted.toml"]);
    let diagnosis = dynid(
        folder.path(),
        &["diagnose", "experiment.toml", "--model", "fitted.toml", "--out", "better.toml", "--save", "diagnosis.json"],
    );
    assert_eq!(diagnosis["verdict"], "missing_effect", "{diagnosis}");
    let first = &diagnosis["ranking"][0];
    assert_eq!((first["effect"].as_str(), first["joint"].as_u64()), (Some("coulomb"), Some(1)), "{diagnosis}");
    let better = fs::read_to_string(at("better.toml")).unwrap();
    assert!(better.contains("device = \"arm.toml\""), "{better}");

    let page = ["report", "experiment.toml", "fitted.toml", "better.toml", "--out", "report.html"];
    dynid(folder.path(), &page);
    let page = fs::read_to_string(at("report.html")).unwrap();
    assert!(page.contains("coulomb") && page.contains("<svg"), "a page with pictures");
}

/// A model that is written to another folder still finds its device file.
#[test]
fn a_model_names_its_device_from_where_it_lies() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("arm.urdf"), include_str!("own_robot/arm.urdf")).unwrap();
    dynid(folder.path(), &["device", "import", "arm.urdf", "--out", "arm.toml"]);
    fs::write(at("believed.toml"), "device = \"arm.toml\" # mine\n").unwrap();
    fs::create_dir(at("models")).unwrap();
    let added = ["add", "coulomb", "--joint", "1", "--model", "believed.toml", "--out", "models/better.toml"];
    dynid(folder.path(), &added);
    let text = fs::read_to_string(at("models/better.toml")).unwrap();
    assert!(text.starts_with("device = \"../arm.toml\" # mine\n"), "{text}");
    let plan = dynid(folder.path(), &["plan", "--model", "models/better.toml"]);
    assert_eq!(plan["device"], "arm");
}
