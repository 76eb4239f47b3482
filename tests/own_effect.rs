//! A user's own effect: one file in a folder of theirs, and the program built with it simulates, adds, fits and diagnoses it.
//!
//! These build the program once more, in a target directory of its own, so `cargo xtask ci` runs them by themselves:
//! `cargo test --release --test own_effect -- --ignored`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

/// From the repository's root.
const EFFECTS: &str = "tests/own_effect";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn target() -> PathBuf {
    root().join("target/own-effect")
}

/// Cargo, in the target directory of these tests, with the effects of a folder.
fn cargo(arguments: &[&str], effects: &Path) -> Output {
    Command::new(env!("CARGO"))
        .args(arguments)
        .args(["--release", "--locked", "--target-dir"])
        .arg(target())
        .env("DYNID_EFFECTS", effects)
        .current_dir(root())
        .output()
        .expect("cargo runs")
}

/// What the build says of a folder with one effect of that name and text.
fn refused(name: &str, text: &str) -> String {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join(name), text).unwrap();
    let output = cargo(&["check", "--package", "dynid-model"], folder.path());
    assert!(!output.status.success(), "a wrong effect file must not build");
    String::from_utf8(output.stderr).unwrap()
}

fn dynid(folder: &Path, arguments: &[&str]) -> Value {
    let program = target().join("release/dynid");
    let output =
        Command::new(program).args(arguments).arg("--json").current_dir(folder).output().expect("it was built");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// One after the other: they share a target directory.
#[test]
#[ignore = "builds the program once more; `cargo xtask ci` runs it"]
fn a_made_up_effect_is_one_file() {
    let text = fs::read_to_string(root().join(EFFECTS).join("end_stops.toml")).unwrap();
    let wrong = refused("end_stops.toml", &text.replacen("\"Ke * (max(q - q_end", "\"Ke * (max(q - q_ned", 1));
    for part in ["unknown symbol `q_ned`", "end_stops.toml:29:", "did you mean `q_end`"] {
        assert!(wrong.contains(part), "`{part}` is not in:\n{wrong}");
    }
    let remains = refused("end_stops.toml", &text.replacen("null = 0.0", "null = 1.0", 1));
    for part in ["`torque` does not vanish at the null values (Ke = 1)", "end_stops.toml:29:"] {
        assert!(remains.contains(part), "`{part}` is not in:\n{remains}");
    }
    let taken = refused("coulomb.toml", &text);
    assert!(taken.contains("the library has an effect of this name"), "{taken}");

    let built = cargo(&["build", "--bin", "dynid"], Path::new(EFFECTS));
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));

    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
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
