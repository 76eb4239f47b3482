//! A log as it stands in its file: a header and numbers, in the log's own units.

use std::path::{Path, PathBuf};

use dynid_logs::log::LogError;
use dynid_tables::{Cell, RaggedRow, TableError};

use crate::{FirstGuessError, Remark};

/// All columns of one file.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    pub path: PathBuf,
    pub names: Vec<String>,
    /// One vector a column, one entry a row; NaN where a cell is no number.
    pub columns: Vec<Vec<f64>>,
    /// The first cell of each column that is no number.
    no_numbers: Vec<Option<Cell>>,
    /// How the file became a table.
    remarks: Vec<dynid_tables::Remark>,
}

impl Table {
    /// Values of the column of that name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let place = self.names.iter().position(|own| own == name)?;
        Some(&self.columns[place])
    }

    /// The first cell of the column of that name that is no number.
    pub fn no_number(&self, name: &str) -> Option<&Cell> {
        let place = self.names.iter().position(|own| own == name)?;
        self.no_numbers[place].as_ref()
    }

    /// The name of its file, for messages.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// How the file became a table, as remarks on it.
    pub fn said(&self) -> impl Iterator<Item = Remark> {
        use dynid_tables::Remark as Read;
        let log = || self.name();
        self.remarks.iter().map(move |remark| match remark.clone() {
            Read::Joined { clock, others, left_out } => Remark::JoinedTopics { log: log(), clock, others, left_out },
            Read::TimeOfLogging => Remark::TimeOfLogging { log: log() },
            Read::OtherLengths { n_rows, names } => Remark::OtherLengths { log: log(), n_rows, names },
        })
    }

    /// The header, for messages.
    pub fn header(&self) -> String {
        self.names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
    }
}

/// Reads a table whose rows all have as many cells as its header.
pub(crate) fn read(path: &Path) -> Result<Table, FirstGuessError> {
    let unreadable = |error: TableError| match error {
        TableError::NoHeader => LogError::of_table(path, error).into(),
        error => FirstGuessError::Unreadable { path: path.to_owned(), reason: error.to_string() },
    };
    let table = dynid_tables::Table::open(path).map_err(unreadable)?;
    let names = table.names().to_vec();
    if let Some(number) = names.iter().find(|name| name.parse::<f64>().is_ok()) {
        return Err(FirstGuessError::NumbersForHeader { path: path.to_owned(), number: number.clone() });
    }
    if let [header] = &names[..] {
        return Err(FirstGuessError::OneCell { path: path.to_owned(), header: header.clone() });
    }
    if let Some(RaggedRow { line, n_cells }) = table.ragged_row() {
        return Err(FirstGuessError::RaggedRow { path: path.to_owned(), line, n_cells, n_names: names.len() });
    }
    let empty = |found: &str| Err(LogError::Empty { path: path.to_owned(), found: found.to_owned() }.into());
    match table.n_rows() {
        0 => return empty("a header but no rows"),
        1 => return empty("a single row"),
        _ => {}
    }
    let places: Vec<usize> = (0..names.len()).collect();
    let columns = table.columns(&places, 0..table.n_rows()).map_err(unreadable)?;
    let cell = |row: usize, place| table.cell(row, place).map_err(unreadable);
    let no_numbers =
        columns.iter().zip(places).map(|(column, place)| column.no_number.map(|row| cell(row, place)).transpose());
    Ok(Table {
        path: path.to_owned(),
        no_numbers: no_numbers.collect::<Result<_, _>>()?,
        remarks: table.remarks().to_vec(),
        names,
        columns: columns.into_iter().map(|column| column.values).collect(),
    })
}
