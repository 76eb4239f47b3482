//! `dynid.Error`, with the library's words.

use std::fmt::Display;
use std::path::Path;

use dynid_files::{FileError, Overwrite, write_new};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

pyo3::create_exception!(dynid, Error, PyException, "What went wrong, where, and what to do, in one sentence.");

/// As Python sees it.
pub fn raised(error: impl Display) -> PyErr {
    Error::new_err(error.to_string())
}

/// Writes a file whole or not at all.
pub fn write(path: &Path, text: &str, overwrite: bool) -> PyResult<()> {
    let overwrite = if overwrite { Overwrite::Force } else { Overwrite::Refuse };
    write_new(path, text, overwrite).map_err(|error| match error {
        FileError::Exists { path } => raised(format!(
            "{} exists already and is kept; choose another name, or overwrite it with `overwrite=True`",
            path.display()
        )),
        other => raised(other),
    })
}
