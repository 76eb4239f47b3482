//! Files that hold logs, read as tables: columns of numbers that have names.
//!
//! [`Table::open`] reads a file and says which columns and how many rows it has; [`Table::columns`] makes numbers of the
//! columns that are asked for. What stands in a cell that is no number is told on demand ([`Table::cell`]).
//!
//! [`Cells::open`] reads a small table of words as well as numbers, and [`written()`] writes either kind ([`Format`]).
//!
//! What a file is, its first bytes tell; [`ENDINGS`] are those that names of such files have:
//!
//! - text with cells and a header, also compressed (`text`, `unpacked`);
//! - Parquet (`parquet_file`) and Arrow, as a file or a stream (`arrow_file`): columns of numbers and of lists that are
//!   of one length;
//! - MATLAB (`matlab`, `matlab73`): variables of as many values;
//! - MCAP (`mcap`): messages about joints.
//!
//! Nothing here depends on how many threads there are. No more memory is taken than a file fills, whatever lengths it
//! claims, but for what is compressed: that is unpacked up to [`LARGEST_UNPACKED`].

mod arrow_file;
mod cells;
mod guarded;
mod matlab;
mod matlab73;
mod mcap;
mod parquet_file;
mod text;
mod unpacked;
mod written;

use std::{
    fs::File,
    io::{Read, Seek},
    ops::Range,
    path::Path,
};

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use text::Text;

pub use {
    cells::{Cells, Row},
    written::{Filled, Format, Values, written},
};

/// Endings of the names of files that can be read.
pub const ENDINGS: [&str; 14] = [
    "csv", "tsv", "txt", "csv.gz", "tsv.gz", "txt.gz", "csv.zst", "tsv.zst", "txt.zst", "parquet", "arrow", "feather",
    "mat", "mcap",
];

/// The ending of a file's name, if it is one of [`ENDINGS`].
pub fn ending(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_string_lossy().to_lowercase();
    ENDINGS
        .into_iter()
        .find(|ending| name.strip_suffix(ending).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.')))
}

/// Bytes that the text, or all parts of another file, may have once they are unpacked.
pub const LARGEST_UNPACKED: u64 = 4 << 30;

/// A file as a table.
#[derive(Debug)]
pub struct Table {
    names: Vec<String>,
    n_rows: usize,
    content: Content,
    remarks: Vec<Remark>,
}

#[derive(Debug)]
enum Content {
    Text(Text),
    Parquet(parquet_file::Columns),
    /// One vector a column; [`NOTHING`] where there is no number.
    Numbers(Vec<Vec<f64>>),
}

/// Marks a cell without a number: a NaN that no computation makes, told from others by its bits.
const NOTHING: f64 = f64::from_bits(0x7ff8_6e6f_7468_696e);

fn is_nothing(number: f64) -> bool {
    number.to_bits() == NOTHING.to_bits()
}

/// A column with its name.
#[derive(Debug, Clone, PartialEq)]
struct Named {
    name: String,
    /// [`NOTHING`] where there is no number.
    values: Vec<f64>,
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
    /// Line of the file, from 1, where it has lines.
    pub line: Option<u64>,
    /// Without blanks around it; empty where there is nothing.
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

/// What was done to make a table of a file, where more than one could be made of it.
#[derive(Debug, Clone, PartialEq)]
pub enum Remark {
    /// Topics were joined on the times of one.
    Joined {
        /// The topic whose messages are the rows.
        clock: String,
        /// The others: of their positions a straight line between two messages is taken, of all else the message before.
        others: Vec<String>,
        /// Messages of the clock for which another has none before, or positions none after.
        left_out: usize,
    },
    /// Times are those at which messages were logged: some have no stamp of their own.
    TimeOfLogging,
    /// Variables that have another number of values than the others are no columns.
    OtherLengths {
        /// Of the columns.
        n_rows: usize,
        /// Their names.
        names: Vec<String>,
    },
}

/// Why a file is no table. Whoever asked for it names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// It cannot be opened, or does not hold what it should.
    #[error("{0}")]
    Unreadable(String),
    /// No column has a name.
    #[error("the file has no header")]
    NoHeader,
}

impl From<std::io::Error> for TableError {
    fn from(error: std::io::Error) -> Self {
        Self::Unreadable(error.to_string())
    }
}

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Text,
    Gzip,
    Zstd,
    Parquet,
    ArrowFile,
    ArrowStream,
    Mcap,
    Matlab5,
    Matlab73,
}

impl Kind {
    /// How the files of each but text begin.
    const BEGINNINGS: [(&'static [u8], Self); 8] = [
        (&[0x1f, 0x8b], Self::Gzip),
        (&[0x28, 0xb5, 0x2f, 0xfd], Self::Zstd),
        (b"PAR1", Self::Parquet),
        (b"ARROW1\0\0", Self::ArrowFile),
        (&[0xff; 4], Self::ArrowStream),
        (b"\x89MCAP0\r\n", Self::Mcap),
        (b"MATLAB 5.0", Self::Matlab5),
        (b"MATLAB 7.3", Self::Matlab73),
    ];

    /// By the first bytes; what begins like none of the others is text, unless its name says that it is none.
    fn of(beginning: &[u8], path: &Path) -> Result<Self, TableError> {
        let known = Self::BEGINNINGS.iter().find(|(own, _)| beginning.starts_with(own));
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let promised = match ending.as_str() {
            "gz" => "gzip",
            "zst" => "Zstandard",
            "parquet" => "Parquet",
            "arrow" | "feather" => "Arrow",
            "mcap" => "MCAP",
            "mat" => "MATLAB (5 or later)",
            _ => "",
        };
        match known {
            Some((_, kind)) => Ok(*kind),
            None if promised.is_empty() => Ok(Self::Text),
            None => Err(TableError::Unreadable(format!("it does not begin as a file of {promised} does"))),
        }
    }
}

/// Opens what is a file: a pipe that nobody writes to would keep the program for ever, and a device may never end. A folder says so itself.
fn opened(path: &Path) -> Result<File, TableError> {
    let found = std::fs::metadata(path)?;
    if !found.is_file() && !found.is_dir() {
        return Err(TableError::Unreadable(
            "it is no file but a pipe or a device; save what it gives to a file first".to_owned(),
        ));
    }
    Ok(File::open(path)?)
}

impl Table {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`TableError`].
    pub fn open(path: &Path) -> Result<Self, TableError> {
        Self::open_within(path, LARGEST_UNPACKED)
    }

    /// As [`Table::open`], with another limit than [`LARGEST_UNPACKED`].
    ///
    /// # Errors
    /// [`TableError`].
    pub fn open_within(path: &Path, unpacked: u64) -> Result<Self, TableError> {
        let mut file = opened(path)?;
        let mut beginning = Vec::new();
        Read::by_ref(&mut file).take(16).read_to_end(&mut beginning)?;
        file.rewind()?;
        let whole = |mut file: File| {
            let mut bytes = Vec::with_capacity(file.metadata().map_or(0, |found| found.len() as usize));
            file.read_to_end(&mut bytes).map(|_| bytes)
        };
        match Kind::of(&beginning, path)? {
            Kind::Text => Self::of_text(whole(file)?),
            Kind::Gzip => Self::of_text(unpacked::gzip(file, unpacked)?),
            Kind::Zstd => Self::of_text(unpacked::zstd(file, unpacked)?),
            Kind::Parquet => {
                let columns = parquet_file::Columns::new(whole(file)?, unpacked)?;
                let (names, n_rows) = (columns.names(), columns.n_rows());
                Self::checked(names, n_rows, Content::Parquet(columns), Vec::new())
            }
            Kind::ArrowFile => {
                Self::of_columns(arrow_file::columns(arrow_file::stream_in(&whole(file)?), unpacked)?, Vec::new())
            }
            Kind::ArrowStream => Self::of_columns(arrow_file::columns(&whole(file)?, unpacked)?, Vec::new()),
            Kind::Mcap => {
                let (columns, remarks) = mcap::columns(file, unpacked)?;
                Self::of_columns(columns, remarks)
            }
            Kind::Matlab5 => {
                let (columns, remarks) = matlab::columns(&whole(file)?, unpacked)?;
                Self::of_columns(columns, remarks)
            }
            Kind::Matlab73 => {
                let (columns, remarks) = matlab73::columns(whole(file)?, unpacked)?;
                Self::of_columns(columns, remarks)
            }
        }
    }

    fn of_text(bytes: Vec<u8>) -> Result<Self, TableError> {
        let (names, text) = Text::new(bytes).map_err(|error| {
            let readable = "a log is a text, or a file of Parquet, Arrow, MATLAB or MCAP";
            TableError::Unreadable(format!("its header is no text ({error}); {readable}"))
        })?;
        if names.iter().all(String::is_empty) {
            return Err(TableError::NoHeader);
        }
        Ok(Self { names, n_rows: text.n_rows(), content: Content::Text(text), remarks: Vec::new() })
    }

    /// The table of these columns, which no file holds. They are as long as the shortest.
    pub fn of_numbers(columns: Vec<(String, Vec<f64>)>) -> Self {
        let n_rows = columns.iter().map(|(_, values)| values.len()).min().unwrap_or(0);
        let (names, values) = columns.into_iter().unzip();
        Self { names, n_rows, content: Content::Numbers(values), remarks: Vec::new() }
    }

    /// The table of Arrow's record batches of this schema: the same as that of a file that holds them.
    ///
    /// # Errors
    /// [`TableError`], where no column holds numbers, or lists are not all of one length.
    pub fn of_batches(schema: &Schema, batches: &[RecordBatch]) -> Result<Self, TableError> {
        Self::of_columns(arrow_file::of_batches(schema, batches)?, Vec::new())
    }

    /// Columns of one length.
    fn of_columns(columns: Vec<Named>, remarks: Vec<Remark>) -> Result<Self, TableError> {
        let n_rows = columns.first().map_or(0, |column| column.values.len());
        let (names, values) = columns.into_iter().map(|column| (column.name, column.values)).unzip();
        Self::checked(names, n_rows, Content::Numbers(values), remarks)
    }

    fn checked(names: Vec<String>, n_rows: usize, content: Content, remarks: Vec<Remark>) -> Result<Self, TableError> {
        if names.is_empty() {
            return Err(TableError::Unreadable("it has no column of numbers".to_owned()));
        }
        Ok(Self { names, n_rows, content, remarks })
    }

    /// Names of the columns, in the order of the file; some may be empty or stand twice.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Number of rows; of a text those below the header, without empty lines.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// What was done to make one table of the file.
    pub fn remarks(&self) -> &[Remark] {
        &self.remarks
    }

    /// The numbers in these rows of these columns (places in [`Table::names`]), in the order that they are asked for.
    ///
    /// # Errors
    /// A file of which only the parts that are asked for are read may be damaged there.
    pub fn columns(&self, places: &[usize], rows: Range<usize>) -> Result<Vec<Column>, TableError> {
        let of_numbers = |values: &[f64]| {
            let values = values[rows.clone()].to_vec();
            let no_number = values.iter().position(|value| is_nothing(*value)).map(|row| rows.start + row);
            Column { values, no_number }
        };
        match &self.content {
            Content::Text(text) => Ok(text.columns(places, rows)),
            Content::Parquet(columns) => Ok(columns.read(places)?.iter().map(|values| of_numbers(values)).collect()),
            Content::Numbers(columns) => Ok(places.iter().map(|place| of_numbers(&columns[*place])).collect()),
        }
    }

    /// What stands in a row of a column.
    ///
    /// # Errors
    /// As [`Table::columns`].
    pub fn cell(&self, row: usize, place: usize) -> Result<Cell, TableError> {
        if let Content::Text(text) = &self.content {
            return Ok(text.cell(row, place));
        }
        let column = self.columns(&[place], row..row + 1)?;
        let number = column.iter().find(|column| column.no_number.is_none()).and_then(|column| column.values.first());
        Ok(Cell { line: None, text: number.map_or(String::new(), f64::to_string) })
    }

    /// The first row of a text of another number of cells than the header. Empty cells at the end of a row may be more.
    pub fn ragged_row(&self) -> Option<RaggedRow> {
        match &self.content {
            Content::Text(text) => text.ragged_row(self.names.len()),
            Content::Parquet(_) | Content::Numbers(_) => None,
        }
    }
}
