//! Columns of Arrow tables, whoever made them: pandas, polars, pyarrow, DuckDB, ..

use std::path::PathBuf;

use arrow_array::RecordBatchReader;
use arrow_array::ffi_stream::RecordBatchStreamReader;
use arrow_pyarrow::FromPyArrow;
use dynid_tables::{Cells, Table};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::raised;

/// The columns of numbers of a table that hands out an Arrow stream (`__arrow_c_stream__`), as arrays by names: those of a file that holds the
/// same table.
#[pyfunction]
pub fn columns_of<'py>(py: Python<'py>, table: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let reader = RecordBatchStreamReader::from_pyarrow_bound(table)?;
    let schema = reader.schema();
    let unreadable =
        |error: &dyn std::fmt::Display| raised(format!("the table cannot be read: {error}; give another table"));
    let batches = reader.collect::<Result<Vec<_>, _>>().map_err(|error| unreadable(&error))?;
    let table = Table::of_batches(&schema, &batches).map_err(|error| unreadable(&error))?;
    let places: Vec<usize> = (0..table.names().len()).collect();
    let columns = table.columns(&places, 0..table.n_rows()).map_err(|error| unreadable(&error))?;
    let dict = PyDict::new(py);
    for (name, column) in table.names().iter().zip(columns) {
        dict.set_item(name, column.values.into_pyarray(py))?;
    }
    Ok(dict)
}

/// Names of the columns of a table of words as well as numbers: a file of text, Parquet or Arrow.
#[pyfunction]
pub fn names_in(path: PathBuf) -> PyResult<Vec<String>> {
    let cells = Cells::open(&path).map_err(|error| raised(format!("{}: {error}", path.display())))?;
    Ok(cells.names)
}
