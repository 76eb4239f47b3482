//! Columns of numbers that are at hand.

use std::ops::Range;

use crate::{Cell, Column};

/// Columns of one length.
#[derive(Debug)]
pub(crate) struct Numbers(Vec<Vec<f64>>);

impl Numbers {
    pub fn new(columns: Vec<Vec<f64>>) -> Self {
        Self(columns)
    }

    pub fn n_rows(&self) -> usize {
        self.0.iter().map(Vec::len).min().unwrap_or(0)
    }

    pub fn columns(&self, places: &[usize], rows: Range<usize>) -> Vec<Column> {
        let column = |place: &usize| Column { values: self.0[*place][rows.clone()].to_vec(), no_number: None };
        places.iter().map(column).collect()
    }

    /// There are no lines: rows take their place, from 1.
    pub fn cell(&self, row: usize, place: usize) -> Cell {
        Cell { line: row as u64 + 1, text: self.0[place][row].to_string() }
    }
}

#[cfg(test)]
mod tests {
    use crate::Table;

    #[test]
    fn columns_at_hand_are_a_table() {
        let table =
            Table::of_columns(vec![("t".to_owned(), vec![0.0, 0.5, 1.0]), ("q0".to_owned(), vec![1.0, f64::NAN])]);
        assert_eq!((table.names(), table.n_rows()), (&["t".to_owned(), "q0".to_owned()][..], 2));
        assert_eq!(table.columns(&[1, 0], 0..1).iter().map(|column| column.values[0]).collect::<Vec<_>>(), [1.0, 0.0]);
        let cell = table.cell(1, 1);
        assert_eq!((cell.line, cell.text.as_str()), (2, "NaN"));
    }
}
