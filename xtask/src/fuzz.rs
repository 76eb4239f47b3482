//! Damaged input for every reader, for the whole program and for the server of its page (`tests/fuzz`).

#[cfg(unix)]
use std::process::Command;

use crate::shell;

#[derive(clap::Args)]
pub struct Arguments {
    /// Inputs, of all readers together.
    #[arg(long, default_value_t = 10_000_000)]
    inputs: u64,
    /// Runs of the program.
    #[arg(long, default_value_t = 20_000)]
    runs: u64,
    /// Requests of the server.
    #[arg(long, default_value_t = 200_000)]
    requests: u64,
    /// What all are drawn from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Some requests of the server, for every change; readers are tried by a test of the fuzzer's.
#[cfg(unix)]
pub fn short() -> anyhow::Result<()> {
    let program = shell::built_for_tests("dynid")?;
    let mut fuzzer = Command::new(shell::built_for_tests("dynid-fuzz")?);
    fuzzer.current_dir(shell::root()).arg("--server").arg(program).args(["--requests", "2000"]);
    shell::succeed(&mut fuzzer)
}

/// Builds, tries the readers, then the program, then its server.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    shell::succeed(&mut shell::cargo(&["build", "--release", "--locked", "-p", "dynid"]))?;
    let Arguments { inputs, runs, requests, seed } = arguments;
    let [inputs, runs, requests, seed] = [inputs, runs, requests, seed].map(u64::to_string);
    let program = "target/release/dynid";
    for tried in [
        &["--inputs", &inputs][..],
        &["--binary", program, "--runs", &runs],
        &["--server", program, "--requests", &requests],
    ] {
        let fuzz = ["run", "--release", "--locked", "-p", "dynid-fuzz", "--", "--seed", &seed];
        shell::succeed(&mut shell::cargo(&[&fuzz[..], tried].concat()))?;
    }
    Ok(())
}
