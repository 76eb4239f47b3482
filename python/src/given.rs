//! Arguments that Python's words for what is wrong would not help with.

use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;

use crate::errors::raised;

/// Indices and counts, alone, in a list or left out.
pub fn natural<'py, T: FromPyObjectOwned<'py>>(given: &Bound<'py, PyAny>) -> PyResult<T> {
    given.extract::<T>().map_err(Into::<PyErr>::into).map_err(|error| {
        if error.is_instance_of::<PyOverflowError>(given.py()) {
            raised(format!("expected an index or a count from 0 to {}, found {given}; correct the value", usize::MAX))
        } else {
            error
        }
    })
}

/// Names; one alone is a list of one.
pub fn names(given: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    given.extract().map(|name| vec![name]).or_else(|_| given.extract())
}
