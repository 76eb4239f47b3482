//! All figures of comparisons, fits and ladders of small logs, as snapshots of five digits. Whether figures are right, other tests
//! ask; these show a change of any of them to whoever reviews it.

use std::fmt::Write as _;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

/// Five digits of every number; how long it took and where it was written are left out.
fn rounded(value: &Value) -> Value {
    match value {
        Value::Number(number) if number.is_f64() => {
            let number = number.as_f64().unwrap_or_default();
            format!("{number:.4e}").parse::<f64>().map_or_else(|_| value.clone(), Value::from)
        }
        Value::Array(values) => values.iter().map(rounded).collect(),
        Value::Object(entries) => {
            let told = entries.iter().filter(|(key, _)| !["wall_seconds", "out"].contains(&key.as_str()));
            told.map(|(key, value)| (key.clone(), rounded(value))).collect()
        }
        other => other.clone(),
    }
}

/// A heading for each part of an object, and a line for each of its items.
pub fn lines(value: &Value) -> String {
    let Value::Object(parts) = rounded(value) else { panic!("{value} is no object") };
    let mut text = String::new();
    for (name, part) in parts {
        let items = match part {
            Value::Array(items) => items,
            other => vec![other],
        };
        let _ = writeln!(text, "{name}");
        for item in items {
            let _ = writeln!(text, "  {item}");
        }
    }
    text
}

/// What a command prints as JSON, whether or not it came to its end.
fn said(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::cargo_bin("dynid").unwrap();
    let output = command.args(arguments).arg("--json").current_dir(folder).output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    let value = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{arguments:?}: {error}: {told}"));
    format!("ended with {}\n{}", output.status.code().expect("no signal"), lines(&value))
}

/// The comparison of what is believed with the logs of a folder, a few iterations of a fit to each error, and what these fits gained.
fn figures(folder: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let fitted = TempDir::new().unwrap();
    let mut text = format!("= compare\n{}", said(&folder, &["compare", "experiment.toml", "--model", "believed.toml"]));
    for error in ["torque", "position", "prediction"] {
        let out = fitted.path().join(format!("{error}.toml"));
        let out = out.to_str().unwrap();
        let fit = ["fit", "experiment.toml", "--model", "believed.toml", "--iterations", "8", "--out", out];
        let _ =
            write!(text, "\n= fit to the {error} error\n{}", said(&folder, &[&fit[..], &["--error", error]].concat()));
    }
    let (experiment, believed) = (folder.join("experiment.toml"), folder.join("believed.toml"));
    // A fit that did not come to its end is not written.
    let written = ["torque.toml", "position.toml", "prediction.toml"].into_iter();
    let written: Vec<&str> = written.filter(|name| fitted.path().join(name).exists()).collect();
    assert!(!written.is_empty(), "one of three fits comes to its end");
    let ladder = ["ladder", experiment.to_str().unwrap(), believed.to_str().unwrap()];
    let _ = write!(text, "\n= ladder\n{}", said(fitted.path(), &[&ladder[..], &written].concat()));
    assert!(!text.contains(env!("CARGO_MANIFEST_DIR")), "no snapshot names where it was made");
    text
}

#[test]
fn of_a_servo() {
    insta::assert_snapshot!(figures("docs/book/logs/servo"));
}

#[test]
fn of_a_base() {
    insta::assert_snapshot!(figures("docs/book/logs/base"));
}

#[test]
fn of_a_bearing() {
    insta::assert_snapshot!(figures("docs/book/logs/bearing"));
}

#[test]
fn of_a_wrist() {
    insta::assert_snapshot!(figures("tests/wrist"));
}
