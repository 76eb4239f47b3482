//! The library for Python, as a user has it: built and installed by pip, and tested there.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;

use crate::shell;

/// Python's part, below the root.
const FOLDER: &str = "python";

/// Installs the wheel with pip and runs its tests; without a Python and pip it says loudly that nobody did, and fails where `CI` is set.
pub fn tests() -> anyhow::Result<()> {
    let python = match environment() {
        Ok(python) => python,
        Err(error) => {
            let message = format!(
                "the library for Python was NOT tested: {error:#}; install Python 3.10 or later with venv and pip, and a network to fetch packages from"
            );
            anyhow::ensure!(std::env::var_os("CI").is_none(), message);
            eprintln!("\n{0}\n{message}\n{0}\n", "!".repeat(message.chars().count()));
            return Ok(());
        }
    };
    // What the wheel says is compared with what the program says.
    let program = shell::built_for_tests("dynid")?;
    let folder = shell::root().join(FOLDER);
    // Without a build environment of its own for each build, which would lie at another place, and what knows it be compiled anew.
    let mut install = pip(&python, &["install", "--no-build-isolation", "--no-deps", "--force-reinstall"]);
    install.arg(&folder).env("CARGO_TARGET_DIR", shell::root().join("target")).env("PATH", path_with(&python)?);
    shell::succeed(&mut install)?;
    let run = |arguments: &[&str]| {
        let mut command = Command::new(&python);
        // Not in the folder of the sources, which have no compiled module beside them.
        command.args(arguments).current_dir(folder.join("tests")).stdin(Stdio::null());
        command.env("DYNID", &program).env("MPLBACKEND", "agg");
        shell::succeed(&mut command)
    };
    run(&["-X", "dev", "-W", "error", "-m", "pytest", "--quiet", "-p", "no:cacheprovider", "."])?;
    run(&[
        "-m",
        "mypy",
        "--strict",
        "--cache-dir",
        "../../target/python/mypy",
        "../examples",
        "../dynid",
        "../../docs/proof",
    ])
}

/// Where programs lie, those of the environment first: maturin is one.
fn path_with(python: &Path) -> anyhow::Result<OsString> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let all = python.parent().map(Path::to_path_buf).into_iter().chain(std::env::split_paths(&path));
    std::env::join_paths(all).context("the environment's folder cannot stand in PATH")
}

/// The Python of an environment that has what the wheel and its tests need, but for the wheel.
fn environment() -> anyhow::Result<PathBuf> {
    let environment = shell::root().join("target/python/venv");
    let python = environment.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    let has_pip = |python: &Path| {
        let mut pip = pip(python, &["--version"]);
        pip.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    // A run that was interrupted may have left one without pip.
    if !has_pip(&python) {
        let mut make = Command::new("python3");
        make.args(["-c", MAKE]).arg(&environment).stdin(Stdio::null());
        shell::succeed(&mut make)?;
    }
    shell::succeed(pip(&python, &["install", "--quiet", "--disable-pip-version-check"]).args(needed()?))?;
    Ok(python)
}

/// Makes an environment, where Python is new enough.
const MAKE: &str = "import sys, venv
if sys.version_info < (3, 10): sys.exit(f'Python is {sys.version.split()[0]}')
venv.create(sys.argv[1], clear=True, with_pip=True)";

/// What `pyproject.toml` asks for: to build, to run and to test.
fn needed() -> anyhow::Result<Vec<String>> {
    let path = shell::root().join(FOLDER).join("pyproject.toml");
    let text = std::fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
    let project: toml::Table = text.parse().with_context(|| format!("reading {}", path.display()))?;
    let lists = [
        project.get("build-system").and_then(|own| own.get("requires")),
        project.get("project").and_then(|own| own.get("dependencies")),
        project.get("project").and_then(|own| own.get("optional-dependencies")?.get("test")),
    ];
    let names = lists.into_iter().flatten().filter_map(toml::Value::as_array).flatten();
    Ok(names.filter_map(toml::Value::as_str).map(str::to_owned).collect())
}

fn pip(python: &Path, arguments: &[&str]) -> Command {
    let mut pip = Command::new(python);
    pip.args(["-m", "pip"]).args(arguments).stdin(Stdio::null());
    pip
}

#[cfg(test)]
mod tests {
    #[test]
    fn what_the_wheel_needs_is_read() {
        let needed = super::needed().unwrap();
        for package in ["maturin", "numpy", "pytest", "mypy"] {
            assert!(needed.iter().any(|own| own.starts_with(package)), "{package} is not in {needed:?}");
        }
    }
}
