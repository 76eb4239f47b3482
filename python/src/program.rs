//! The command line, for `python -m dynid`.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the program with these arguments, the first of which is its name, and returns its exit status; `again` is the command that
/// runs it once more, for jobs.
#[pyfunction]
pub fn main(py: Python<'_>, arguments: Vec<OsString>, again: Vec<OsString>) -> u8 {
    py.detach(|| dynid::cli::main(arguments, Some(again)))
}
