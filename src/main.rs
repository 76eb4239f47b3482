//! The `dynid` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    dynid::cli::main(std::env::args_os(), None)
}
