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
}

impl Table {
    /// Values of the column of that name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let place = self.names.iter().position(|own| own == name)?;
        Some(&self.columns[place])
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
    let unreadable = |reason: String| LogError::Unreadable { path: path.to_owned(), reason };
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
    let mut columns = vec![Vec::new(); names.len()];
    let mut record = csv::ByteRecord::new();
    while reader.read_byte_record(&mut record).map_err(|error| unreadable(error.to_string()))? {
        // A delimiter at the end of a row makes an empty cell more.
        let cells = record.iter().rposition(|cell| !cell.is_empty()).map_or(0, |last| last + 1);
        if cells > names.len() || record.len() < names.len() {
            let line = record.position().map_or(0, csv::Position::line);
            let (path, n_names) = (path.to_owned(), names.len());
            return Err(FirstGuessError::RaggedRow { path, line, n_cells: record.len(), n_names });
        }
        for (column, cell) in columns.iter_mut().zip(record.iter()) {
            let number = std::str::from_utf8(cell).ok().and_then(|cell| cell.parse().ok());
            column.push(number.unwrap_or(f64::NAN));
        }
    }
    match columns[0].len() {
        0 => Err(LogError::Empty { path: path.to_owned(), found: "a header but no rows".to_owned() }.into()),
        1 => Err(LogError::Empty { path: path.to_owned(), found: "a single row".to_owned() }.into()),
        _ => Ok(Table { path: path.to_owned(), names, columns }),
    }
}
