//! The `dynid` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(dynid::cli::main(std::env::args_os(), None))
}
