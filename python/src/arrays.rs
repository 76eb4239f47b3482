//! Arrays in and out.

use std::borrow::Cow;

use numpy::{IntoPyArray, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::raised;

/// Whatever numpy makes an array of numbers of.
pub type Array<'py> = PyArrayLikeDyn<'py, f64, numpy::AllowTypeChange>;

/// The numbers, row after row; copied only where they do not stand so.
pub fn rows<'a>(array: &'a Array<'_>) -> Cow<'a, [f64]> {
    match array.as_slice() {
        // A slice may also be column after column.
        Ok(slice) if array.is_c_contiguous() => Cow::Borrowed(slice),
        _ => array.as_array().iter().copied().collect::<Vec<f64>>().into(),
    }
}

/// The shape of an array without its last axis, which is as long as `n`.
///
/// # Errors
/// Another length.
pub fn shape_of_states(name: &str, array: &Array<'_>, n: usize) -> PyResult<Vec<usize>> {
    match array.shape() {
        [states @ .., last] if *last == n => Ok(states.to_vec()),
        shape => Err(raised(format!("{name} has the shape {shape:?}; its last axis is that of the {n} free joints"))),
    }
}

/// Numbers as an array of this shape.
pub fn shaped<'py>(py: Python<'py>, numbers: Vec<f64>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    numbers.into_pyarray(py).reshape(shape)
}
