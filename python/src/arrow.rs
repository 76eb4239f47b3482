//! Columns of Arrow tables, whoever made them: pandas, polars, pyarrow, DuckDB, ..

use arrow_array::cast::AsArray;
use arrow_array::ffi_stream::RecordBatchStreamReader;
use arrow_array::types::{
    ArrowPrimitiveType, Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type,
    UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, RecordBatchReader};
use arrow_pyarrow::FromPyArrow;
use arrow_schema::{DataType, TimeUnit};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::raised;

/// The columns of numbers of a table that hands out an Arrow stream (`__arrow_c_stream__`), as arrays by names. Times become seconds, what
/// is null or no number NaN; columns of something else are left out.
#[pyfunction]
pub fn columns_of<'py>(py: Python<'py>, table: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let reader = RecordBatchStreamReader::from_pyarrow_bound(table)?;
    let fields = reader.schema().fields().clone();
    let mut columns: Vec<Option<Vec<f64>>> = vec![Some(Vec::new()); fields.len()];
    for batch in reader {
        let batch = batch.map_err(|error| raised(format!("the table cannot be read: {error}; give another table")))?;
        for (column, array) in columns.iter_mut().zip(batch.columns()) {
            match numbers(array) {
                Some(numbers) => column.iter_mut().for_each(|column| column.extend(&numbers)),
                None => *column = None,
            }
        }
    }
    let dict = PyDict::new(py);
    for (field, column) in fields.iter().zip(columns) {
        if let Some(column) = column {
            dict.set_item(field.name(), column.into_pyarray(py))?;
        }
    }
    Ok(dict)
}

/// The numbers of an array; `None` where it holds something else.
fn numbers(array: &dyn Array) -> Option<Vec<f64>> {
    let per_second = |unit: &TimeUnit| match unit {
        TimeUnit::Second => 1.0,
        TimeUnit::Millisecond => 1e3,
        TimeUnit::Microsecond => 1e6,
        TimeUnit::Nanosecond => 1e9,
    };
    Some(match array.data_type() {
        DataType::Float64 => of::<Float64Type>(array, |own| own),
        DataType::Float32 => of::<Float32Type>(array, f64::from),
        DataType::Float16 => of::<Float16Type>(array, |own| own.to_f64()),
        DataType::Int8 => of::<Int8Type>(array, f64::from),
        DataType::Int16 => of::<Int16Type>(array, f64::from),
        DataType::Int32 => of::<Int32Type>(array, f64::from),
        DataType::Int64 => of::<Int64Type>(array, |own| own as f64),
        DataType::UInt8 => of::<UInt8Type>(array, f64::from),
        DataType::UInt16 => of::<UInt16Type>(array, f64::from),
        DataType::UInt32 => of::<UInt32Type>(array, f64::from),
        DataType::UInt64 => of::<UInt64Type>(array, |own| own as f64),
        DataType::Boolean => {
            array.as_boolean().iter().map(|own| own.map_or(f64::NAN, |own| f64::from(u8::from(own)))).collect()
        }
        DataType::Timestamp(unit, _) | DataType::Duration(unit) => {
            let per_second = per_second(unit);
            // Both are whole numbers of the unit.
            let whole = array.to_data().into_builder().data_type(DataType::Int64).build().ok()?;
            of::<Int64Type>(&arrow_array::make_array(whole), |own| own as f64 / per_second)
        }
        _ => return None,
    })
}

fn of<T: ArrowPrimitiveType>(array: &dyn Array, number: impl Fn(T::Native) -> f64) -> Vec<f64> {
    array.as_primitive::<T>().iter().map(|own| own.map_or(f64::NAN, &number)).collect()
}
