//! Running cargo, and finding the workspace.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail};

/// Root of the workspace.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().map_or_else(|| here.to_path_buf(), Path::to_path_buf)
}

/// The cargo that runs us, in the root of the workspace, without stdin.
pub fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).current_dir(root()).stdin(Stdio::null());
    // what cargo tells its own children must not leak into a nested build of other crates
    for (name, _) in std::env::vars_os() {
        if name.to_str().is_some_and(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_")) {
            command.env_remove(name);
        }
    }
    command
}

/// Cargo on all packages but `dynid-derive`, which compiles Symbolica. With a choice of packages the features of what they share may change, and
/// everything is compiled anew: so all checks that can make this one.
pub fn cargo_on_all(verb: &str, arguments: &[&str]) -> Command {
    let mut command = cargo(&[verb, "--release", "--workspace", "--exclude", "dynid-derive", "--locked"]);
    command.args(arguments);
    command
}

/// `cargo test` on all; what needs a browser is ignored unless it is asked for.
pub fn cargo_test(arguments: &[&str]) -> Command {
    cargo_on_all("test", arguments)
}

/// A program or an example (`examples/..`) that the tests are built with; it is built first where it is not there or not of these sources.
pub fn built_for_tests(name: &str) -> anyhow::Result<PathBuf> {
    succeed(&mut cargo_test(&["--no-run"]))?;
    Ok(root().join("target/release").join(format!("{name}{}", std::env::consts::EXE_SUFFIX)))
}

/// Runs to the end; anything but success is an error that shows the command.
pub fn succeed(command: &mut Command) -> anyhow::Result<()> {
    let status = command.status().with_context(|| format!("starting {}", shown(command)))?;
    if !status.success() {
        bail!("{} ended with {status}", shown(command));
    }
    Ok(())
}

/// Runs to the end and returns what it wrote to stdout.
pub fn stdout_of(command: &mut Command) -> anyhow::Result<String> {
    let output = command.stderr(Stdio::inherit()).output().with_context(|| format!("starting {}", shown(command)))?;
    if !output.status.success() {
        bail!("{} ended with {}", shown(command), output.status);
    }
    String::from_utf8(output.stdout).with_context(|| format!("{} wrote no UTF-8", shown(command)))
}

/// The command as a person would type it.
pub fn shown(command: &Command) -> String {
    let words = command.get_args().map(|word| word.to_string_lossy().into_owned());
    let program = Path::new(command.get_program()).file_name().unwrap_or_default().to_string_lossy().into_owned();
    std::iter::once(program).chain(words).collect::<Vec<_>>().join(" ")
}
