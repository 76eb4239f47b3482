//! Damaged input for every reader and for the whole program (`tests/fuzz`).

use crate::shell;

#[derive(clap::Args)]
pub struct Arguments {
    /// Inputs, of all readers together.
    #[arg(long, default_value_t = 10_000_000)]
    inputs: u64,
    /// Runs of the program.
    #[arg(long, default_value_t = 20_000)]
    runs: u64,
    /// What all are drawn from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Builds, tries the readers, then the program.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    shell::succeed(&mut shell::cargo(&["build", "--release", "--locked", "-p", "dynid"]))?;
    let (inputs, runs, seed) = (arguments.inputs.to_string(), arguments.runs.to_string(), arguments.seed.to_string());
    let fuzz = ["run", "--release", "--locked", "-p", "dynid-fuzz", "--", "--seed", &seed];
    shell::succeed(&mut shell::cargo(&[&fuzz[..], &["--inputs", &inputs]].concat()))?;
    shell::succeed(&mut shell::cargo(&[&fuzz[..], &["--binary", "target/release/dynid", "--runs", &runs]].concat()))
}
