//! Tables as files, for other programs: CSV, Parquet or Arrow. Our reader reads each of them back to the same bits.

use std::{fmt::Write, path::Path, sync::Arc};

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray};
use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel},
    data_type::{ByteArray, ByteArrayType, DoubleType},
    errors::ParquetError,
    file::{properties::WriterProperties, writer::SerializedFileWriter},
    schema::types::Type,
};

use crate::ending;

/// A kind of file that tables are written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Text with a header; cells are parted by commas.
    Csv,
    /// Parquet, compressed by Zstandard.
    Parquet,
    /// Arrow, as a file.
    Arrow,
}

impl Format {
    /// All of them, by the endings of their files' names.
    pub const ALL: [(&'static str, Self); 3] = [("csv", Self::Csv), ("parquet", Self::Parquet), ("arrow", Self::Arrow)];

    /// By the ending of a file's name; `None` where it has none of these.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = ending(path)?;
        Self::ALL.into_iter().find_map(|(own, format)| (own == ending).then_some(format))
    }

    /// As files' names end.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Parquet => "parquet",
            Self::Arrow => "arrow",
        }
    }
}

/// What a column holds, one entry a row.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// NaN where there is none: an empty cell, or null.
    Numbers(Vec<f64>),
    /// Words.
    Texts(Vec<String>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Numbers(values) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }
}

/// Columns that are filled from the same rows.
#[derive(Debug)]
pub struct Filled<'a, R> {
    rows: &'a [R],
    columns: Vec<(String, Values)>,
}

impl<'a, R> Filled<'a, R> {
    /// From these rows; no column yet.
    pub fn from(rows: &'a [R]) -> Self {
        Self { rows, columns: Vec::new() }
    }

    /// Adds a column of numbers, NaN where there is none.
    #[must_use]
    pub fn numbers(self, name: &str, of: impl Fn(&R) -> f64) -> Self {
        let values = Values::Numbers(self.rows.iter().map(of).collect());
        self.with(name, values)
    }

    /// Adds a column of words.
    #[must_use]
    pub fn texts<'r>(self, name: &str, of: impl Fn(&'r R) -> &'r str) -> Self
    where
        'a: 'r,
        R: 'r,
    {
        let values = Values::Texts(self.rows.iter().map(|row| of(row).to_owned()).collect());
        self.with(name, values)
    }

    fn with(mut self, name: &str, values: Values) -> Self {
        self.columns.push((name.to_owned(), values));
        self
    }

    /// The columns, in the order in which they were added.
    pub fn columns(self) -> Vec<(String, Values)> {
        self.columns
    }
}

/// The file that holds these columns, in this order. They are as long as each other.
///
/// # Panics
/// Where they are not.
pub fn written(columns: &[(String, Values)], format: Format) -> Vec<u8> {
    let n_rows = columns.first().map_or(0, |(_, values)| values.len());
    assert!(columns.iter().all(|(_, values)| values.len() == n_rows), "columns of one table have one length");
    match format {
        Format::Csv => csv(columns, n_rows).into_bytes(),
        // Nothing but memory is written to.
        Format::Parquet => parquet(columns).expect("a table of numbers and words can be written"),
        Format::Arrow => arrow(columns).expect("a table of numbers and words can be written"),
    }
}

fn csv(columns: &[(String, Values)], n_rows: usize) -> String {
    let mut text = String::new();
    // A line that is empty would be no row.
    let nothing = if columns.len() == 1 { "\"\"" } else { "" };
    for (place, (name, _)) in columns.iter().enumerate() {
        text.push_str(if place > 0 { "," } else { "" });
        text.push_str(&quoted(name));
    }
    for row in 0..n_rows {
        text.push('\n');
        for (place, (_, values)) in columns.iter().enumerate() {
            text.push_str(if place > 0 { "," } else { "" });
            match values {
                // Writing to a string cannot fail.
                Values::Numbers(values) if !values[row].is_nan() => drop(write!(text, "{}", values[row])),
                Values::Numbers(_) => text.push_str(nothing),
                Values::Texts(values) if values[row].is_empty() => text.push_str(nothing),
                Values::Texts(values) => text.push_str(&quoted(&values[row])),
            }
        }
    }
    text.push('\n');
    text
}

/// A cell; in quotes where it would be taken for several, or lose its blanks.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) || cell.trim() != cell {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

fn parquet(columns: &[(String, Values)]) -> Result<Vec<u8>, ParquetError> {
    let field = |(name, values): &(String, Values)| {
        let (physical, logical) = match values {
            Values::Numbers(_) => (Physical::DOUBLE, None),
            Values::Texts(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let own = Type::primitive_type_builder(name, physical).with_logical_type(logical);
        own.with_repetition(Repetition::OPTIONAL).build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("table").with_fields(fields).build()?);
    let properties = WriterProperties::builder().set_compression(Compression::ZSTD(ZstdLevel::default()));
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties.build()))?;
    let mut rows = writer.next_row_group()?;
    for (_, values) in columns {
        let Some(mut column) = rows.next_column()? else { break };
        match values {
            Values::Numbers(values) => {
                let defined: Vec<i16> = values.iter().map(|value| i16::from(!value.is_nan())).collect();
                let there: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
                column.typed::<DoubleType>().write_batch(&there, Some(&defined), None)?;
            }
            Values::Texts(values) => {
                let cells: Vec<ByteArray> = values.iter().map(|cell| cell.as_str().into()).collect();
                column.typed::<ByteArrayType>().write_batch(&cells, Some(&vec![1; cells.len()]), None)?;
            }
        }
        column.close()?;
    }
    rows.close()?;
    writer.into_inner()
}

fn arrow(columns: &[(String, Values)]) -> Result<Vec<u8>, arrow_schema::ArrowError> {
    let arrays = columns.iter().map(|(name, values)| {
        let array: ArrayRef = match values {
            Values::Numbers(values) => {
                Arc::new(values.iter().map(|value| (!value.is_nan()).then_some(*value)).collect::<Float64Array>())
            }
            Values::Texts(values) => Arc::new(values.iter().map(Some).collect::<StringArray>()),
        };
        (name.clone(), array, true)
    });
    let batch = RecordBatch::try_from_iter_with_nullable(arrays)?;
    let mut writer = arrow_ipc::writer::FileWriter::try_new(Vec::new(), &batch.schema())?;
    writer.write(&batch)?;
    writer.into_inner()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::{Cells, Table};

    #[test]
    fn what_is_written_is_read_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let numbers = vec![0.1 + 0.2, f64::NAN, -1e-300, 1e17, -0.0];
        let words = ["a,b", "", " x", "\u{e4} \"q\"", "line\nbreak"].map(str::to_owned).to_vec();
        let columns = [
            ("robot, its".to_owned(), Values::Texts(words.clone())),
            ("value".to_owned(), Values::Numbers(numbers.clone())),
        ];
        for (ending, format) in Format::ALL {
            let path = folder.path().join(format!("table.{ending}"));
            assert_eq!(Format::of(&path), Some(format));
            fs::write(&path, written(&columns, format)).unwrap();
            let table = Table::open(&path).unwrap();
            let place = table.names().iter().position(|name| name == "value").unwrap();
            let read = table.columns(&[place], 0..5).unwrap().remove(0).values;
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&read[2..]), bits(&numbers[2..]), "{ending}");
            assert!(read[0] == numbers[0] && read[1].is_nan(), "{ending}");
            let cells = Cells::open(&path).unwrap();
            assert_eq!(cells.names, ["robot, its", "value"], "{ending}");
            let trimmed: Vec<&str> = words.iter().map(|word| word.trim()).collect();
            assert_eq!(cells.rows.iter().map(|row| row.cells[0].as_str()).collect::<Vec<_>>(), trimmed, "{ending}");
            assert_eq!(cells.rows[0].cells[1].parse::<f64>().unwrap(), numbers[0], "{ending}");
            assert_eq!(cells.rows[1].cells[1], "", "{ending}");
        }
    }

    #[test]
    fn an_empty_cell_alone_in_its_row_is_a_row() {
        let folder = tempfile::tempdir().unwrap();
        let columns = Filled::from(&[1.0, f64::NAN, 3.0]).numbers("value", |value| *value).columns();
        for (ending, format) in Format::ALL {
            let path = folder.path().join(format!("table.{ending}"));
            fs::write(&path, written(&columns, format)).unwrap();
            let read = Table::open(&path).unwrap().columns(&[0], 0..3).unwrap().remove(0).values;
            assert!(read[0] == 1.0 && read[1].is_nan() && read[2] == 3.0, "{ending}");
            let cells = Cells::open(&path).unwrap();
            assert_eq!(cells.rows.iter().map(|row| row.cells[0].as_str()).collect::<Vec<_>>(), ["1", "", "3"]);
        }
    }

    #[test]
    fn a_table_of_no_rows_is_a_table() {
        let folder = tempfile::tempdir().unwrap();
        for (ending, format) in Format::ALL {
            let path = folder.path().join(format!("table.{ending}"));
            fs::write(&path, written(&[("value".to_owned(), Values::Numbers(Vec::new()))], format)).unwrap();
            assert_eq!(Cells::open(&path).unwrap().names, ["value"], "{ending}");
        }
    }
}
