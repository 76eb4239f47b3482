//! Matrices as they stand in files: the number of columns, and the entries row by row.

use nalgebra::DMatrix;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

#[derive(Serialize, Deserialize)]
struct Rows {
    columns: usize,
    entries: Vec<f64>,
}

/// Writes a matrix: its number of columns, and its entries row by row.
///
/// # Errors
/// As the serializer.
pub fn serialize<S: Serializer>(matrix: &DMatrix<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    let entries = matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()).collect();
    Rows { columns: matrix.ncols(), entries }.serialize(serializer)
}

/// Reads what [`serialize`] wrote.
///
/// # Errors
/// As the deserializer; entries that fill no rows.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<DMatrix<f64>, D::Error> {
    let Rows { columns, entries } = Rows::deserialize(deserializer)?;
    let rows = entries.len().checked_div(columns).unwrap_or(0);
    if rows * columns != entries.len() {
        return Err(D::Error::custom(format!("{} entries are no rows of {columns}", entries.len())));
    }
    Ok(DMatrix::from_row_slice(rows, columns, &entries))
}
