//! `cargo xtask bench`: the criterion benchmarks of the workspace.

use crate::shell;

/// Runs the benchmarks.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only benchmarks whose id contains this, e.g. `forward_dynamics/freedom6s/all`.
    filter: Option<String>,
}

/// Runs them; criterion prints the times and keeps them in `target/criterion`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut command = shell::cargo(&["bench", "--package", "dynid", "--benches"]);
    if let Some(filter) = &arguments.filter {
        command.args(["--", filter]);
    }
    shell::succeed(&mut command)
}
