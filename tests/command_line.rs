//! What a user and other programs see of the binary.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use dynid_plant::recipe::{self, Recipe};
use serde_json::Value;
use tempfile::TempDir;

/// Two runs of the two-link arm's elbow, made by the plant: one to fit to, one held out.
fn folder() -> TempDir {
    folder_with(4.0, "validate")
}

/// The same of another length and role of the second run.
fn folder_with(duration_s: f64, second: &str) -> TempDir {
    let text =
        "device = \"planar2r\"\nseed = 5\nsample_s = 0.01\nsteps_per_sample = 20\nnoise_rms = 1e-4\nquantum = 1e-5\n\
         start = [0.2, -1.5]\n\
         [parameters]\n\"link.2.m\" = 0.84\n\
         [[effect]]\nid = \"viscous\"\njoint = 1\nFv = 0.035\n\
         [[effect]]\nid = \"coulomb\"\njoint = 1\nFc = 0.12\nv_eps = 0.01\n\
         [[run]]\nfile = \"one.csv\"\nfree = [1]\nrole = \"fit\"\nduration_s = 4.0\n\
         torque = [{ joint = 1, amplitude = 0.8, hz = 0.6 }, { joint = 1, amplitude = 0.4, hz = 1.7 }]\n\
         [[run]]\nfile = \"two.csv\"\nfree = [1]\nrole = \"validate\"\nduration_s = 4.0\n\
         torque = [{ joint = 1, amplitude = 0.7, hz = 0.9 }]\n"
            .replace("duration_s = 4.0", &format!("duration_s = {duration_s:?}"))
            .replace("\"validate\"", &format!("\"{second}\""));
    let recipe: Recipe = toml::from_str(&text).unwrap();
    let folder = TempDir::new().unwrap();
    for (name, text) in recipe::make(&recipe, dynid_model::device("planar2r").unwrap()).unwrap() {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

fn dynid(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder).assert()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = dynid(folder, &[arguments, &["--json"]].concat()).success().get_output().stdout.clone();
    serde_json::from_slice(&output).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn assert_has(value: &Value, wanted: &[&str]) {
    for key in wanted {
        assert!(value.get(key).is_some(), "`{key}` is not among {:?}", keys(value));
    }
}

#[test]
fn fit_and_compare_speak_to_programs() {
    let folder = folder();
    let fit = json(folder.path(), &["fit", "experiment.toml", "--error", "torque", "--out", "fitted.toml"]);
    assert_has(
        &fit,
        &["cost_before", "cost_after", "rmse_fit", "rmse_validate", "iterations", "wall_seconds", "parameters"],
    );
    assert_has(&fit["parameters"][0], &["name", "value", "std_error", "identifiable"]);
    assert!(fit["cost_after"].as_f64() < fit["cost_before"].as_f64());

    let compared = json(folder.path(), &["compare", "experiment.toml", "--model", "fitted.toml"]);
    assert_has(&compared, &["runs", "rmse_fit", "rmse_validate"]);
    assert_eq!(compared["runs"][0]["file"], "one.csv");
    assert_eq!(compared["runs"][1]["role"], "validate");
    let joint = &compared["runs"][1]["joints"][0];
    assert_has(
        joint,
        &["joint", "rmse", "fit_percent", "max_abs", "noise_floor", "white", "torque_rmse", "torque_percent"],
    );
    assert!(joint["torque_percent"].as_f64().unwrap() < 3.0, "{joint}");
}

#[test]
fn simulate_writes_logs_that_can_be_compared_with() {
    let folder = folder();
    let answer = json(folder.path(), &["simulate", "experiment.toml", "--out-dir", "simulated"]);
    assert_eq!(answer["runs"][0]["joints"][0]["joint"], 1);
    let log = fs::read_to_string(folder.path().join("simulated/one.csv")).unwrap();
    assert_eq!(log.lines().next(), Some("t,tau0,tau1,q0,q1"));
    assert_eq!(log.lines().count(), 402);
    dynid(folder.path(), &["simulate", "experiment.toml", "--out-dir", "simulated"]).code(2);
}

/// Under a controller the commands are the controller's, and the position error is not what is fitted.
#[test]
fn a_run_with_a_controller_is_in_closed_loop() {
    let folder = folder();
    let log = fs::read_to_string(folder.path().join("one.csv")).unwrap();
    let (header, rows) = log.split_once('\n').unwrap();
    let rows: String = rows.lines().map(|row| format!("{row},-1.5\n")).collect();
    fs::write(folder.path().join("one.csv"), format!("{header},ref1\n{rows}")).unwrap();
    fs::write(folder.path().join("control.toml"), "P = [0, 2]\nD = [0, 0.2]\nlimit = [1, 0.125]\n").unwrap();
    let experiment = fs::read_to_string(folder.path().join("experiment.toml")).unwrap();
    let run = "file = \"one.csv\"\n";
    let experiment = experiment.replace(run, &format!("{run}controller = \"control.toml\"\n"));
    fs::write(folder.path().join("experiment.toml"), experiment).unwrap();

    for error in ["position", "both"] {
        let fit = dynid(folder.path(), &["fit", "experiment.toml", "--error", error, "--out", "fitted.toml"]).code(2);
        let message = String::from_utf8(fit.get_output().stderr.clone()).unwrap();
        assert!(
            message.contains("one.csv: the run is in closed loop") && message.contains("--error torque"),
            "{message}"
        );
    }
    let simulated = json(folder.path(), &["simulate", "experiment.toml", "--out-dir", "simulated"]);
    let compared = json(folder.path(), &["compare", "experiment.toml"]);
    let rmse = |answer: &Value| answer["runs"][0]["joints"][0]["rmse"].as_f64().unwrap();
    assert!((rmse(&simulated) / rmse(&compared) - 1.0).abs() < 1e-3, "{simulated} {compared}");
    let log = fs::read_to_string(folder.path().join("simulated/one.csv")).unwrap();
    let torques = log.lines().skip(1).map(|row| row.split(',').nth(2).unwrap().parse::<f64>().unwrap());
    assert!(torques.clone().all(|torque| torque.abs() <= 0.125) && torques.clone().any(|torque| torque != 0.0));
}

/// The torque fit hears `--iterations`; `both` starts where the user does.
#[test]
fn a_fit_takes_no_more_iterations_than_allowed() {
    let folder = folder();
    let fit = |error: &str, iterations: &str| {
        let arguments = ["fit", "experiment.toml", "--error", error, "--iterations", iterations, "--json"];
        let output = dynid(folder.path(), &[&arguments[..], &["--force", "--out", "fitted.toml"]].concat());
        serde_json::from_slice::<Value>(&output.get_output().stdout).unwrap()
    };
    let short = fit("torque", "1");
    assert_eq!((short["iterations"].as_u64(), short["status"].as_str()), (Some(1), Some("iteration limit")));
    let (position, both) = (fit("position", "2"), fit("both", "2"));
    assert_eq!(position["cost_before"], both["cost_before"]);
}

#[test]
fn compare_draws_a_picture_that_stands_alone() {
    let folder = folder();
    dynid(folder.path(), &["compare", "experiment.toml", "--picture", "x.svg", "--report", "x.svg"]).code(2);
    assert!(!folder.path().join("x.svg").exists());
    dynid(folder.path(), &["compare", "experiment.toml", "--picture", "overlay.svg"]).success();
    let svg = fs::read_to_string(folder.path().join("overlay.svg")).unwrap();
    assert!(
        svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\"")
            && svg.matches("class=\"residual curve\"").count() == 4
    );
    assert!(!svg.contains("href") && svg.matches("http").count() == 1);
    dynid(folder.path(), &["compare", "experiment.toml", "--picture", "overlay.svg"]).code(2);
}

/// Same input, same bytes, whatever the thread count: two runs, each of several of the pieces that threads share.
#[test]
fn a_fit_does_not_depend_on_threads() {
    let folder = folder_with(50.0, "fit");
    for (threads, out) in [("1", "one.toml"), ("3", "three.toml")] {
        Command::cargo_bin("dynid")
            .unwrap()
            .args(["fit", "experiment.toml", "--error", "torque", "--out", out])
            .env("RAYON_NUM_THREADS", threads)
            .current_dir(folder.path())
            .assert()
            .success();
    }
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(read("one.toml") == read("three.toml"));
}

/// The thesis's Figure 4.2: new link parameters per configuration, and those that never appear.
#[test]
fn plan_counts_as_the_thesis_does() {
    let folder = TempDir::new().unwrap();
    let plan = json(folder.path(), &["plan", "freedom6s", "--method", "isolated"]);
    let links = |names: &Value| {
        let names = names.as_array().unwrap().iter().map(|name| name.as_str().unwrap());
        names.filter(|name| name.starts_with("link.")).count()
    };
    let steps = plan["configurations"].as_array().unwrap();
    let new: Vec<usize> = steps.iter().map(|step| links(&step["new_parameters"])).collect();
    assert_eq!(new, [4, 4, 6, 13, 17, 16, 4]);
    assert_eq!(steps[6]["free"], serde_json::json!([0, 1]));
    assert_eq!(
        plan["never"],
        serde_json::json!(["link.1.z", "link.1.Ixx", "link.1.Ixy", "link.1.Ixz", "link.1.Iyy", "link.1.Iyz"])
    );
    assert_has(&steps[0], &["number", "free", "new_parameters", "parameters"]);
    assert!(steps[0]["parameters"].as_array().unwrap().contains(&"joint.4.lugre.sigma0".into()));
}

#[test]
fn a_device_is_described_with_its_end_point() {
    let folder = TempDir::new().unwrap();
    let described = json(folder.path(), &["devices", "planar2r"]);
    assert_eq!(described["devices"][0]["end_point"], serde_json::json!({ "frame": "f2", "point": [0.0, 0.0, 0.0] }));
    dynid(folder.path(), &["devices", "planar2r"]).stdout(predicates::str::contains("end point: 0 0 0 m in frame f2"));
}

#[test]
fn every_verb_teaches_by_example() {
    let folder = TempDir::new().unwrap();
    let verbs = [
        "new", "devices", "plan", "excite", "simulate", "check", "fit", "compare", "diagnose", "add", "ladder",
        "report", "wall", "tour",
    ];
    let help: BTreeMap<&str, String> = verbs
        .into_iter()
        .map(|verb| {
            let output = dynid(folder.path(), &[verb, "--help"]).success().get_output().stdout.clone();
            (verb, String::from_utf8(output).unwrap())
        })
        .collect();
    for (verb, help) in help {
        assert!(help.contains("Examples:") && help.contains(&format!("  dynid {verb}")), "{verb}: {help}");
        assert!(help.contains("--json"), "{verb}");
    }
}

#[test]
fn unknown_arguments_are_bad_input() {
    let folder = TempDir::new().unwrap();
    dynid(folder.path(), &["fit"]).code(2);
    dynid(folder.path(), &["dance"]).code(2);
}

/// Whoever reads stderr may have read enough (`2>&1 | head`): the status is that of the error, not of a panic.
#[cfg(unix)]
#[test]
fn an_error_that_nobody_reads_is_an_error_still() {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_dynid"))
        .args(["devices", "no_such_device"])
        .stderr(writer)
        .stdout(std::process::Stdio::null())
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(2));
}
