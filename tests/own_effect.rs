//! A user's own effect: one file in a folder of theirs, and the program simulates, adds, fits and diagnoses it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

/// Without the environment: no compiler, and no effects but those of the folder.
fn run(folder: &Path, arguments: &[&str]) -> Output {
    let program = Command::new(env!("CARGO_BIN_EXE_dynid")).args(arguments).current_dir(folder).env_clear().output();
    program.expect("it runs")
}

fn dynid(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, &[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

fn text() -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/own_effect/end_stops.toml")).unwrap()
}

/// What a command says of a folder with one effect of that name and text.
fn refused(name: &str, text: &str) -> String {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join(name), text).unwrap();
    let output = run(folder.path(), &["plan", "planar2r", "--effects", "."]);
    assert_eq!(output.status.code(), Some(2), "a wrong effect file is an error");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_wrong_file_is_one_pointed_error() {
    let wrong = refused("end_stops.toml", &text().replacen("\"Ke * (max(q - q_end", "\"Ke * (max(q - q_ned", 1));
    for part in ["unknown symbol `q_ned`", "end_stops.toml:29:", "did you mean `q_end`"] {
        assert!(wrong.contains(part), "`{part}` is not in:\n{wrong}");
    }
    let remains = refused("end_stops.toml", &text().replacen("null = 0.0", "null = 1.0", 1));
    for part in ["`torque` does not vanish at the null values (Ke = 1)", "end_stops.toml:29:"] {
        assert!(remains.contains(part), "`{part}` is not in:\n{remains}");
    }
    let taken = refused("coulomb.toml", &text());
    assert!(taken.contains("the library has an effect of this name"), "{taken}");
    let folder = TempDir::new().unwrap();
    let missing = run(folder.path(), &["plan", "planar2r", "--effects", "nowhere"]);
    assert!(String::from_utf8_lossy(&missing.stderr).contains("nowhere: cannot be read"), "{missing:?}");
}

/// A folder `effects` beside the model.
#[test]
fn a_made_up_effect_is_one_file() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("effects")).unwrap();
    fs::write(at("effects/end_stops.toml"), text()).unwrap();
    let run = |file: &str, role: &str, amplitude: f64, hz: f64| {
        format!(
            "[[run]]\nfile = \"{file}\"\nfree = [1]\nrole = \"{role}\"\nduration_s = 6.0\n\
             torque = [{{ joint = 1, amplitude = {amplitude:?}, hz = {hz:?} }}, {{ joint = 1, amplitude = 0.5, hz = 1.9 }}]\n"
        )
    };
    let recipe = format!(
        "device = \"planar2r\"\nseed = 5\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = 1e-4\nquantum = 1e-5\n\
         start = [0.0, -1.5]\n[parameters]\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.08\n{}{}",
        run("one.csv", "fit", 1.3, 0.6),
        run("two.csv", "validate", 1.1, 0.8)
    );
    let recipe: Recipe = toml::from_str(&recipe).unwrap();
    for (name, text) in recipe::make(&recipe, dynid_model::device("planar2r").unwrap()).unwrap() {
        fs::write(at(&name), text).unwrap();
    }
    let prior = "device = \"planar2r\"\n[[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.08\n";
    fs::write(at("believed.toml"), prior).unwrap();
    let added = ["add", "end_stops", "--joint", "1", "--model", "believed.toml"];
    dynid(folder.path(), &[&added[..], &["--set", "Ke=4.0,q_end=1.7", "--out", "truth.toml"]].concat());
    dynid(folder.path(), &["simulate", "experiment.toml", "--model", "truth.toml", "--out-dir", "logs"]);
    fs::copy(at("experiment.toml"), at("logs/experiment.toml")).unwrap();

    let diagnosis = dynid(folder.path(), &["diagnose", "logs/experiment.toml", "--model", "believed.toml"]);
    let first = &diagnosis["ranking"][0];
    assert_eq!(diagnosis["verdict"], "missing_effect", "{diagnosis}");
    assert_eq!((first["effect"].as_str(), first["joint"].as_u64()), (Some("end_stops"), Some(1)), "{diagnosis}");

    dynid(folder.path(), &[&added[..], &["--out", "better.toml"]].concat());
    let fit = ["fit", "logs/experiment.toml", "--model", "better.toml", "--error", "position", "--out", "fitted.toml"];
    let fitted = dynid(folder.path(), &fit);
    assert!(fitted["rmse_validate"].as_f64().unwrap() < 1e-4, "{fitted}");
    for (name, truth) in [("joint.1.end_stops.Ke", 4.0), ("joint.1.end_stops.q_end", 1.7)] {
        let found = fitted["parameters"].as_array().unwrap().iter().find(|parameter| parameter["name"] == name);
        let value = found.expect("it was fitted")["value"].as_f64().unwrap();
        assert!((value - truth).abs() < 1e-3 * truth, "{name}: {value}");
    }
}
