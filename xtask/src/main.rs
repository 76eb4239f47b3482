//! The project's own commands: `cargo xtask gen`, `ci`, `api`, `wheel`, `bench`, `hidden-effects`, `fleet`, `fuzz`,
//! `mutants`, `torture`.

mod api;
mod at_once;
mod bench;
mod book;
mod browser;
mod ci;
mod crate_order;
mod dependency_cycles;
mod fleet;
mod fuzz;
mod generate;
mod hidden_effects;
mod licences;
#[cfg(unix)]
mod mutants;
mod shell;
mod size;
mod snapshots;
mod sources;
#[cfg(unix)]
mod torture;
mod unused;
mod wheel;
mod workspace;

use std::fmt;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Commands for those who change dynid.
#[derive(Parser)]
#[command(name = "cargo xtask", max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Derives the equations of motion (`generated/<device>/cNN.kir`) and prints the kernels made of them.
    Gen(generate::Arguments),
    /// Runs every check that a change must pass, in the order of what fails fastest.
    Ci(ci::Arguments),
    /// Writes the list of the library's public items (`docs/api.txt`) anew.
    Api,
    /// Builds the wheel for Python, installs it into an environment of its own, and tests it there.
    Wheel,
    /// Runs the benchmarks.
    Bench(bench::Arguments),
    /// Hides one effect after another from the program and prints what it finds.
    HiddenEffects(hidden_effects::Arguments),
    /// Plays many robots over many nights, in six of which something changes, and prints what `dynid fleet` finds.
    Fleet(fleet::Arguments),
    /// Gives damaged input to every reader, then to the whole program.
    Fuzz(fuzz::Arguments),
    /// Changes the code that judges, one place at a time, and counts what the tests notice.
    #[cfg(unix)]
    Mutants(mutants::Arguments),
    /// Kills the program, fills its disk, takes its files away, and looks at what it leaves.
    #[cfg(unix)]
    Torture(torture::Arguments),
}

/// What was asked for does not exist; like clap's errors, it ends with 2.
#[derive(Debug)]
struct BadInput(String);

impl fmt::Display for BadInput {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadInput {}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Gen(arguments) => generate::run(&arguments),
        Command::Ci(arguments) => ci::run(&arguments),
        Command::Api => api::write(),
        Command::Wheel => wheel::tests(),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::HiddenEffects(arguments) => hidden_effects::run(&arguments),
        Command::Fleet(arguments) => fleet::run(&arguments),
        Command::Fuzz(arguments) => fuzz::run(&arguments),
        #[cfg(unix)]
        Command::Mutants(arguments) => mutants::run(&arguments),
        #[cfg(unix)]
        Command::Torture(arguments) => torture::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            if error.is::<BadInput>() { ExitCode::from(2) } else { ExitCode::FAILURE }
        }
    }
}
