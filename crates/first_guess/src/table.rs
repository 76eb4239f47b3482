//! A log as it stands in its file: a header and numbers, in the log's own units.

use std::path::{Path, PathBuf};

use dynid_logs::log::{LogError, delimiter};

use crate::FirstGuessError;

/// All columns of one file.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    pub path: PathBuf,
    pub names: Vec<String>,
    /// One vector a column, one entry a row; NaN where a cell is no number.
    pub columns: Vec<Vec<f64>>,
    /// The first cell of each column that is no number.
    no_numbers: Vec<Option<NoNumber>>,
}

/// A cell that is no number.
#[derive(Debug, Clone)]
pub(crate) struct NoNumber {
    /// From 1.
    pub line: u64,
    pub text: String,
}

impl Table {
    /// Values of the column of that name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let place = self.names.iter().position(|own| own == name)?;
        Some(&self.columns[place])
    }

    /// The first cell of the column of that name that is no number.
    pub fn no_number(&self, name: &str) -> Option<&NoNumber> {
        let place = self.names.iter().position(|own| own == name)?;
        self.no_numbers[place].as_ref()
    }

    /// The name of its file, for messages.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// The header, for messages.
    pub fn header(&self) -> String {
        self.names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
    }
}

/// Reads a table whose rows all have as many cells as its header.
pub(crate) fn read(path: &Path) -> Result<Table, FirstGuessError> {
    let unreadable = |reason: String| FirstGuessError::Unreadable { path: path.to_owned(), reason };
    let text = std::fs::read(path).map_err(|error| unreadable(error.to_string()))?;
    let header = text.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .delimiter(delimiter(&String::from_utf8_lossy(header)))
        .from_reader(text.as_slice());
    let names = reader.headers().map_err(|error| unreadable(error.to_string()))?;
    let names: Vec<String> = names.iter().map(str::to_owned).collect();
    if names.iter().all(String::is_empty) {
        return Err(LogError::Empty { path: path.to_owned(), found: "no header".to_owned() }.into());
    }
    if let Some(number) = names.iter().find(|name| name.parse::<f64>().is_ok()) {
        return Err(FirstGuessError::NumbersForHeader { path: path.to_owned(), number: number.clone() });
    }
    if let [header] = &names[..] {
        return Err(FirstGuessError::OneCell { path: path.to_owned(), header: header.clone() });
    }
    let mut columns = vec![Vec::new(); names.len()];
    let mut no_numbers = vec![None; names.len()];
    let mut record = csv::ByteRecord::new();
    while reader.read_byte_record(&mut record).map_err(|error| unreadable(error.to_string()))? {
        let line = record.position().map_or(0, csv::Position::line);
        // A delimiter at the end of a row makes an empty cell more.
        let cells = record.iter().rposition(|cell| !cell.is_empty()).map_or(0, |last| last + 1);
        if cells > names.len() || record.len() < names.len() {
            let (path, n_names) = (path.to_owned(), names.len());
            return Err(FirstGuessError::RaggedRow { path, line, n_cells: record.len(), n_names });
        }
        for ((column, no_number), cell) in columns.iter_mut().zip(&mut no_numbers).zip(record.iter()) {
            let text = String::from_utf8_lossy(cell);
            column.push(text.parse().unwrap_or_else(|_| {
                no_number.get_or_insert_with(|| NoNumber { line, text: text.into_owned() });
                f64::NAN
            }));
        }
    }
    match columns[0].len() {
        0 => Err(LogError::Empty { path: path.to_owned(), found: "a header but no rows".to_owned() }.into()),
        1 => Err(LogError::Empty { path: path.to_owned(), found: "a single row".to_owned() }.into()),
        _ => Ok(Table { path: path.to_owned(), names, columns, no_numbers }),
    }
}
