//! The tour's logs with three models of one lineage: believed, fitted, and fitted with the effect that was hidden.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use dynid::tour::FILES;
use dynid_user_model::Model;
use tempfile::TempDir;

/// The program in `folder`, told to do so.
pub fn dynid(folder: &Path, arguments: &[&str]) -> Output {
    Command::cargo_bin("dynid").unwrap().args(arguments).current_dir(folder).output().unwrap()
}

/// Its stdout; it must succeed.
pub fn message(folder: &Path, arguments: &[&str]) -> String {
    let output = dynid(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Its stderr; it must refuse its input.
pub fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = dynid(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stdout));
    assert!(output.stdout.is_empty(), "{arguments:?}");
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(message.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{message}");
    message
}

/// `believed.toml`, `fitted.toml`, `better.toml` (with the effect, not fitted) and `better-fitted.toml`.
pub fn lineage() -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, text) in FILES {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let fit = |from: &str, to: &str| message(folder.path(), &["fit", "experiment.toml", "--model", from, "--out", to]);
    fit("believed.toml", "fitted.toml");
    let mut model = Model::load(folder.path().join("fitted.toml")).unwrap();
    model.add_effect("input_coupling", Some(4), Some(5)).unwrap();
    fs::write(folder.path().join("better.toml"), model.to_toml()).unwrap();
    fit("better.toml", "better-fitted.toml");
    folder
}
