//! Tables whose cells are words as well as numbers: nights, robots, estimates.

use std::{io::Read, path::Path};

use arrow_array::{Array, ArrayRef, LargeStringArray, StringArray, StringViewArray};
use arrow_ipc::reader::StreamReader;
use parquet::{file::reader::FileReader, record::Field};

use crate::{Kind, LARGEST_UNPACKED, TableError, arrow_file, guarded::guarded, opened, parquet_file, unpacked};

/// A table of words, small enough to be held as such.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cells {
    /// Of the columns; no two are alike.
    pub names: Vec<String>,
    /// In the order of the file.
    pub rows: Vec<Row>,
}

/// A row of [`Cells`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Row {
    /// Line of the file, from 1, where it has lines; else the row, from 1.
    pub line: u64,
    /// One a column, without blanks around it; empty where there is nothing.
    pub cells: Vec<String>,
}

impl Cells {
    /// Reads a table of text, Parquet or Arrow.
    ///
    /// # Errors
    /// [`TableError`], also where two columns have one name.
    pub fn open(path: &Path) -> Result<Self, TableError> {
        let mut bytes = Vec::new();
        opened(path)?.read_to_end(&mut bytes)?;
        let read = match Kind::of(&bytes[..bytes.len().min(16)], path)? {
            Kind::Text => of_text(&bytes),
            Kind::Gzip => of_text(&unpacked::gzip(bytes.as_slice(), LARGEST_UNPACKED)?),
            Kind::Zstd => of_text(&unpacked::zstd(bytes.as_slice(), LARGEST_UNPACKED)?),
            Kind::Parquet => guarded(|| of_parquet(bytes)),
            Kind::ArrowFile => of_arrow(arrow_file::stream_in(&bytes)),
            Kind::ArrowStream => of_arrow(&bytes),
            Kind::Mcap | Kind::Matlab5 | Kind::Matlab73 => {
                Err(TableError::Unreadable("a table of words is a text, or a file of Parquet or Arrow".to_owned()))
            }
        }?;
        let twice = (0..read.names.len()).find(|place| read.names[..*place].contains(&read.names[*place]));
        match twice {
            Some(place) => Err(TableError::Unreadable(format!(
                "two columns are called `{}`; rename one of them",
                read.names[place]
            ))),
            None => Ok(read),
        }
    }

    /// The place of a column.
    ///
    /// # Errors
    /// There is none of this name.
    pub fn column(&self, name: &str) -> Result<usize, TableError> {
        let place = self.names.iter().position(|own| own == name);
        place.ok_or_else(|| TableError::Unreadable(format!("no column is called `{name}`")))
    }
}

fn of_text(bytes: &[u8]) -> Result<Cells, TableError> {
    let no_table = |error: csv::Error| TableError::Unreadable(format!("it is no table ({error})"));
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let names: Vec<String> = reader.headers().map_err(no_table)?.iter().map(str::to_owned).collect();
    if names.iter().all(String::is_empty) {
        return Err(TableError::NoHeader);
    }
    let row = |record: Result<csv::StringRecord, _>| {
        let record = record.map_err(no_table)?;
        let line = record.position().map_or(0, csv::Position::line);
        Ok(Row { line, cells: record.iter().map(str::to_owned).collect() })
    };
    Ok(Cells { names, rows: reader.records().map(row).collect::<Result<_, TableError>>()? })
}

fn of_parquet(bytes: Vec<u8>) -> Result<Cells, TableError> {
    let columns = parquet_file::Columns::new(bytes, LARGEST_UNPACKED)?;
    let reader = columns.reader();
    let schema = reader.metadata().file_metadata().schema();
    let names = schema.get_fields().iter().map(|field| field.name().to_owned()).collect();
    let mut rows = Vec::new();
    for (line, row) in (1..).zip(reader.get_row_iter(None).map_err(parquet_file::damaged)?) {
        let row = row.map_err(parquet_file::damaged)?;
        let cells = row.get_column_iter().map(|(_, field)| match field {
            Field::Null => String::new(),
            Field::Str(text) => text.trim().to_owned(),
            Field::Double(number) => number.to_string(),
            Field::Float(number) => number.to_string(),
            other => other.to_string(),
        });
        rows.push(Row { line, cells: cells.collect() });
    }
    Ok(Cells { names, rows })
}

fn of_arrow(bytes: &[u8]) -> Result<Cells, TableError> {
    arrow_file::check_claims(bytes, LARGEST_UNPACKED)?;
    guarded(|| {
        let reader = StreamReader::try_new(bytes, None).map_err(arrow_file::damaged)?;
        let names: Vec<String> = reader.schema().fields().iter().map(|field| field.name().clone()).collect();
        let mut rows = Vec::new();
        for batch in reader {
            let batch = batch.map_err(arrow_file::damaged)?;
            let columns = names.iter().zip(batch.columns()).map(|(name, column)| words(name, column));
            let columns = columns.collect::<Result<Vec<_>, _>>()?;
            for row in 0..batch.num_rows() {
                let cells = columns.iter().map(|column| column[row].clone()).collect();
                rows.push(Row { line: rows.len() as u64 + 1, cells });
            }
        }
        Ok(Cells { names, rows })
    })
}

/// The cells of a column.
fn words(name: &str, column: &ArrayRef) -> Result<Vec<String>, TableError> {
    fn of<'a>(texts: impl Iterator<Item = Option<&'a str>>) -> Vec<String> {
        texts.map(|text| text.unwrap_or_default().trim().to_owned()).collect()
    }
    let any = column.as_any();
    let texts = (any.downcast_ref().map(|own: &StringArray| of(own.iter())))
        .or_else(|| any.downcast_ref().map(|own: &LargeStringArray| of(own.iter())))
        .or_else(|| any.downcast_ref().map(|own: &StringViewArray| of(own.iter())));
    let numbers = || {
        let numbers = arrow_file::numbers(column)?;
        let cell = |(row, number): (usize, &f64)| if column.is_null(row) { String::new() } else { number.to_string() };
        Some(numbers.iter().enumerate().map(cell).collect())
    };
    texts.or_else(numbers).ok_or_else(|| {
        TableError::Unreadable(format!(
            "column `{name}` holds neither words nor numbers; leave it out, or write it as words"
        ))
    })
}
