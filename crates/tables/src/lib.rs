//! Files that hold logs, read as tables: columns of numbers that have names.
//!
//! [`Table::open`] reads a file and says which columns and how many rows it has; [`Table::columns`] makes numbers of the
//! columns that are asked for. What stands in a cell that is no number is told on demand ([`Table::cell`]).
//!
//! Nothing here depends on how many threads there are.

mod numbers;
mod text;

use std::{ops::Range, path::Path};

use numbers::Numbers;
use text::Text;

/// A file as a table, or columns that are at hand.
#[derive(Debug)]
pub struct Table {
    names: Vec<String>,
    body: Body,
}

/// What stands below the names.
#[derive(Debug)]
enum Body {
    Text(Text),
    Numbers(Numbers),
}

/// The numbers of a column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// One entry a row; NaN where a cell is no number.
    pub values: Vec<f64>,
    /// The first row (from 0, of the file) whose cell is no number. One that says NaN is a number.
    pub no_number: Option<usize>,
}

/// What stands in a file where a number should.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cell {
    /// Line of the file, from 1.
    pub line: u64,
    /// Without blanks around it; empty where the row is too short.
    pub text: String,
}

/// A row of another number of cells than the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RaggedRow {
    /// Line of the file, from 1.
    pub line: u64,
    /// In the row.
    pub n_cells: usize,
}

/// Why a file is no table. Whoever asked for it names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// It cannot be opened, or does not hold what its name says.
    #[error("{0}")]
    Unreadable(String),
    /// No column has a name.
    #[error("the file has no header")]
    NoHeader,
}

impl Table {
    /// Reads the file at `path`: cells parted by commas, semicolons or tabs, whichever parts the first line into the most,
    /// with a header.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn open(path: &Path) -> Result<Self, TableError> {
        let bytes = std::fs::read(path).map_err(|error| TableError::Unreadable(error.to_string()))?;
        let (names, text) = Text::new(bytes).map_err(|error| TableError::Unreadable(error.to_string()))?;
        if names.iter().all(String::is_empty) {
            return Err(TableError::NoHeader);
        }
        Ok(Self { names, body: Body::Text(text) })
    }

    /// The table of these columns, which no file holds. They are as long as the shortest.
    pub fn of_columns(columns: Vec<(String, Vec<f64>)>) -> Self {
        let (names, columns) = columns.into_iter().unzip();
        Self { names, body: Body::Numbers(Numbers::new(columns)) }
    }

    /// Names of the columns, in the order of the file; some may be empty or stand twice.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Number of rows below the header; empty lines are none.
    pub fn n_rows(&self) -> usize {
        match &self.body {
            Body::Text(text) => text.n_rows(),
            Body::Numbers(numbers) => numbers.n_rows(),
        }
    }

    /// The numbers in these rows of these columns (places in [`Table::names`]), in the order that they are asked for.
    pub fn columns(&self, places: &[usize], rows: Range<usize>) -> Vec<Column> {
        match &self.body {
            Body::Text(text) => text.columns(places, rows),
            Body::Numbers(numbers) => numbers.columns(places, rows),
        }
    }

    /// What stands in a row of a column.
    pub fn cell(&self, row: usize, place: usize) -> Cell {
        match &self.body {
            Body::Text(text) => text.cell(row, place),
            Body::Numbers(numbers) => numbers.cell(row, place),
        }
    }

    /// The first row of another number of cells than the header. Empty cells at the end of a row may be more.
    pub fn ragged_row(&self) -> Option<RaggedRow> {
        match &self.body {
            Body::Text(text) => text.ragged_row(self.names.len()),
            Body::Numbers(_) => None,
        }
    }
}
