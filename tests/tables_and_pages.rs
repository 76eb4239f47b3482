//! What a fit along a method tells, beside the model: its steps, its error budget, the table of parameters and the page.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

use crate::wrist;

/// The wrist's files, and a model fitted along the isolated method; also what the fit said. One fit serves all tests.
fn fitted() -> &'static (TempDir, Value) {
    static FITTED: OnceLock<(TempDir, Value)> = OnceLock::new();
    FITTED.get_or_init(fit)
}

fn fit() -> (TempDir, Value) {
    let folder = wrist::folder();
    let fit = ["fit", "experiment.toml", "--model", "believed.toml", "--method", "isolated", "--substeps", "20"];
    let answer = json(folder.path(), &[&fit[..], &["--starts", "2", "--out", "fitted.toml"]].concat());
    (folder, answer)
}

fn dynid(folder: &Path, arguments: &[&str]) -> String {
    let output = Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn json(folder: &Path, arguments: &[&str]) -> Value {
    serde_json::from_str(&dynid(folder, &[arguments, &["--json"]].concat())).unwrap()
}

fn stands_alone(page: &str) {
    for outside in ["http", "src=", "href=", "@import", "url(", "<script ", "<link"] {
        assert!(!page.contains(outside), "the page contains `{outside}`");
    }
}

#[test]
fn a_fit_along_a_method_is_reported_whole() {
    let (folder, answer) = fitted();
    let numbers = |key: &str| answer[key].as_array().unwrap().clone();

    let steps = numbers("steps");
    assert_eq!(steps.len(), 1, "the logs are of one configuration: {steps:?}");
    assert_eq!((&steps[0]["configuration"], &steps[0]["free"]), (&Value::from(1), &serde_json::json!([4])));
    assert!(answer["notes"][0].as_str().unwrap().contains("without a run to fit to"), "{}", answer["notes"]);
    assert_eq!(numbers("starts").len(), 2);
    assert!(numbers("starts")[0]["cost"].as_f64().is_some_and(f64::is_finite), "{}", answer["starts"]);
    for pair in numbers("correlations") {
        let value = pair["value"].as_f64().unwrap();
        assert!((0.5..=1.0 + 1e-9).contains(&value.abs()), "{pair}");
        assert!(pair["one"].is_string() && pair["other"].is_string());
    }

    // With one source of data, N times the variance of the simulated positions over the noise's is the number of
    // parameters (in combinations) that the data determine.
    let budget = numbers("budget");
    assert_eq!(budget.len(), 1);
    let [noise, remaining, range] = ["noise_floor", "remaining", "range"].map(|key| budget[0][key].as_f64().unwrap());
    let from = budget[0]["from"][0]["rms"].as_f64().unwrap();
    assert!((remaining.powi(2) - range.powi(2) - from.powi(2)).abs() < 1e-9 * remaining.powi(2), "{budget:?}");
    let n_samples = 2.0 * 2001.0;
    let determined = (from / noise).powi(2) * n_samples;
    let n_parameters = numbers("parameters").len() as f64;
    let n_open = numbers("open").len() as f64;
    assert!(
        determined > n_parameters - n_open - 1.0 && determined < 1.1 * n_parameters,
        "{determined} of {n_parameters}, {n_open} open"
    );

    let text = fs::read_to_string(folder.path().join("fitted.toml")).unwrap();
    assert!(text.contains("[[fit.budget]]") && text.contains("method = \"isolated\""), "{text}");
    assert!(!text.contains("wall_seconds"), "no time in the model file");
}

#[test]
fn the_table_and_the_page_show_it() {
    let (folder, answer) = fitted();
    let table = json(folder.path(), &["table", "believed.toml", "fitted.toml", "--out", "table.html"]);
    let fitted = answer["parameters"].as_array().unwrap();
    let rows = table["parameters"].as_array().unwrap();
    assert_eq!(rows.len(), fitted.len());
    for parameter in fitted {
        let row = rows.iter().find(|row| row["name"] == parameter["name"]).unwrap();
        assert_eq!(row["unit"], parameter["unit"]);
        assert_eq!(row["models"][0]["value"], parameter["start"], "{row}");
        assert_eq!(row["models"][0]["standing"], "not fitted");
        assert_eq!(row["models"][1]["value"], parameter["value"], "{row}");
        assert_eq!(row["models"][1]["std_error"], parameter["std_error"], "{row}");
        let standing = match (parameter["at_bound"] == true, parameter["identifiable"] == true) {
            (true, _) => "held by bound",
            (false, true) => "determined",
            (false, false) => "not identifiable",
        };
        assert_eq!(row["models"][1]["standing"], standing, "{row}");
    }
    let page = fs::read_to_string(folder.path().join("table.html")).unwrap();
    stands_alone(&page);
    assert!(page.contains("joint.4.lugre.sigma0") && page.contains("Error budget of fitted"));
    let text = dynid(folder.path(), &["table", "believed.toml", "fitted.toml"]);
    assert!(text.contains("joint.4.lugre.sigma0") && text.contains("error budget"), "{text}");

    dynid(
        folder.path(),
        &["compare", "experiment.toml", "--model", "fitted.toml", "--report", "page.html", "--error", "position"],
    );
    let page = fs::read_to_string(folder.path().join("page.html")).unwrap();
    stands_alone(&page);
    assert_eq!(page.matches("<svg class=\"dynid-plot\"").count(), 3, "one picture a joint of every run");
    for heading in ["How far off", "wrist-3.csv, to validate", "Parameters", "Where what is left comes from"] {
        assert!(page.contains(heading), "{heading}");
    }
}

#[test]
fn models_of_two_devices_make_no_table() {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("one.toml"), "device = \"planar2r\"\n").unwrap();
    fs::write(folder.path().join("two.toml"), "device = \"double_pendulum\"\n").unwrap();
    let mut command = Command::cargo_bin("dynid").unwrap();
    let message = command.args(["table", "one.toml", "two.toml"]).current_dir(folder.path()).assert().code(2);
    let message = String::from_utf8(message.get_output().stderr.clone()).unwrap();
    assert!(
        message.contains("two.toml: the model is of device `double_pendulum`, one.toml of `planar2r`"),
        "{message}"
    );
}
