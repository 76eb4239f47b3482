//! The peers' script, in a virtual environment of its own with what it needs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;
use serde_json::{Value, json};

use crate::shell;

/// What the script prints: `peers`, each with its numbers or why it is `missing`, and `tools`. Where it cannot run at all, `failed` says why.
pub fn measured(folder: &Path, work: &Path) -> Value {
    run(folder, work).unwrap_or_else(|error| json!({ "failed": format!("{error:#}") }))
}

fn run(folder: &Path, work: &Path) -> anyhow::Result<Value> {
    let scripts = shell::root().join("benches/peers");
    let python = environment(folder)?;
    let refused = installed(&python, &scripts.join("requirements.txt"))?;
    let mut command = Command::new(&python);
    command.arg("-B").arg(scripts.join("run.py")).arg(work).stdin(Stdio::null());
    let text = shell::stdout_of(&mut command)?;
    let mut measured: Value = serde_json::from_str(&text).context("the peers' script prints JSON")?;
    // The script knows that a package is not there, pip why.
    for peer in measured["peers"].as_array_mut().into_iter().flatten() {
        let versions: Vec<String> = peer["versions"].as_array().into_iter().flatten().map(Value::to_string).collect();
        let needs = |package: &str| versions.iter().any(|version| version.contains(package));
        let why = refused.iter().filter(|(package, _)| needs(package)).map(|(_, why)| why.as_str());
        let why: Vec<&str> = why.collect();
        if let (Some(missing), false) = (peer["missing"].as_str(), why.is_empty()) {
            peer["missing"] = json!(format!("{missing}; pip said: {}", why.join(", ")));
        }
    }
    Ok(measured)
}

/// The environment's Python; it is made where there is none.
fn environment(folder: &Path) -> anyhow::Result<PathBuf> {
    let environment = folder.join("venv");
    let python = environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    // A run that was interrupted may have left one without pip.
    let has_pip = |python: &Path| {
        let mut pip = Command::new(python);
        pip.args(["-m", "pip", "--version"]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        pip.status().is_ok_and(|status| status.success())
    };
    if !has_pip(&python) {
        shell::succeed(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&environment).stdin(Stdio::null()))?;
    }
    Ok(python)
}

/// Installs each package by itself, so that one that is not to be had takes no other with it; returns those, and what pip said.
fn installed(python: &Path, requirements: &Path) -> anyhow::Result<Vec<(String, String)>> {
    let text = fs::read_to_string(requirements).with_context(|| format!("reading {}", requirements.display()))?;
    let mut refused = Vec::new();
    for requirement in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let mut pip = Command::new(python);
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", requirement]).stdin(Stdio::null());
        let output = pip.output().with_context(|| format!("starting {}", shell::shown(&pip)))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            let why = said.lines().rfind(|line| line.starts_with("ERROR")).or(said.lines().last()).unwrap_or("nothing");
            let package = requirement.split(['=', '[']).next().unwrap_or(requirement);
            eprintln!("{requirement} cannot be installed: {why}");
            refused.push((package.to_owned(), why.to_owned()));
        }
    }
    Ok(refused)
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A package that is not to be had takes no other with it, and pip's reason is kept.
    #[test]
    fn what_cannot_be_installed_is_named_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let python = folder.path().join("python");
        let script =
            "#!/bin/sh\ncase \"$*\" in *absent*) echo 'ERROR: there is none' >&2; echo 'a notice' >&2; exit 1;; esac\n";
        fs::write(&python, script).unwrap();
        fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
        let requirements = folder.path().join("requirements.txt");
        fs::write(&requirements, "absent[more]==1.0\n\nthere==2.0\n").unwrap();
        let refused = installed(&python, &requirements).unwrap();
        assert_eq!(refused, [("absent".to_owned(), "ERROR: there is none".to_owned())]);
    }
}
