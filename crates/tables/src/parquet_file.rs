//! Parquet: columns of numbers, booleans and times, lists of them that are of one length (`q[0]`, `q[1]`), and what lies in
//! groups (`arm.q`). A column is read when it is asked for.
//!
//! A time becomes seconds since the first of its column, as in [`crate::arrow_file`].

use bytes::Bytes;
use parquet::{
    basic::{ConvertedType, LogicalType, TimeUnit, Type},
    column::reader::{ColumnReader, ColumnReaderImpl},
    data_type::DataType,
    errors::ParquetError,
    file::{metadata::ColumnChunkMetaData, reader::FileReader, serialized_reader::SerializedFileReader},
    schema::types::ColumnDescriptor,
};
use rayon::prelude::*;

use crate::{NOTHING, TableError, arrow_file::seconds_since_first, guarded::guarded};

/// Records that are read at once.
const BATCH: usize = 1 << 13;

/// The columns of a file.
pub(crate) struct Columns {
    reader: SerializedFileReader<Bytes>,
    columns: Vec<Place>,
    n_rows: usize,
    /// Bytes that the numbers of a column of the file may take.
    most: u64,
}

impl std::fmt::Debug for Columns {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Columns").field("columns", &self.columns).field("n_rows", &self.n_rows).finish()
    }
}

/// Where the numbers of a column are.
#[derive(Debug, Clone, PartialEq)]
struct Place {
    name: String,
    /// Number of the column in the file.
    leaf: usize,
    /// Which item of its lists, and how many they have.
    item: usize,
    n_items: usize,
}

impl Columns {
    /// Reads which columns there are. How long lists are is seen in the first row group.
    pub fn new(bytes: Vec<u8>, most: u64) -> Result<Self, TableError> {
        guarded(|| Self::of_file(bytes, most))
    }

    /// Of the whole file, whose parts lie within it.
    pub fn reader(&self) -> &SerializedFileReader<Bytes> {
        &self.reader
    }

    fn of_file(bytes: Vec<u8>, most: u64) -> Result<Self, TableError> {
        let length = bytes.len() as u64;
        // In memory: columns that are read side by side from a file would share its place.
        let reader = SerializedFileReader::new(Bytes::from(bytes)).map_err(damaged)?;
        let chunks = reader.metadata().row_groups().iter().flat_map(|group| group.columns());
        if !chunks.into_iter().all(|chunk| lies_within(chunk, length)) {
            return Err(TableError::Unreadable("parts of it lie outside of it: it is damaged or cut".to_owned()));
        }
        let metadata = reader.metadata().file_metadata();
        let n_rows = usize::try_from(metadata.num_rows()).map_err(|_| too_few())?;
        let schema = metadata.schema_descr_ptr();
        let mut own = Self { reader, columns: Vec::new(), n_rows, most };
        for (leaf, column) in schema.columns().iter().enumerate().filter(|(_, column)| is_numeric(column)) {
            let is_list = column.max_rep_level() > 0;
            let n_items = if is_list { own.items_of_first_list(leaf)? } else { 1 };
            let name = name_of(column);
            own.columns.extend((0..n_items).map(|item| Place {
                name: if is_list { format!("{name}[{item}]") } else { name.clone() },
                leaf,
                item,
                n_items,
            }));
        }
        Ok(own)
    }

    pub fn names(&self) -> Vec<String> {
        self.columns.iter().map(|column| column.name.clone()).collect()
    }

    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// All values of these columns.
    pub fn read(&self, places: &[usize]) -> Result<Vec<Vec<f64>>, TableError> {
        let mut leaves: Vec<usize> = places.iter().map(|place| self.columns[*place].leaf).collect();
        leaves.sort_unstable();
        leaves.dedup();
        let read = leaves.par_iter().map(|leaf| guarded(|| self.leaf(*leaf))).collect::<Result<Vec<_>, _>>()?;
        let of_place = |place: &usize| {
            let Place { leaf, item, n_items, .. } = &self.columns[*place];
            let values = &read[leaves.partition_point(|other| other < leaf)];
            values.iter().skip(*item).step_by(*n_items).copied().collect()
        };
        Ok(places.iter().map(of_place).collect())
    }

    /// All values of a column of the file: of lists row by row.
    fn leaf(&self, leaf: usize) -> Result<Vec<f64>, TableError> {
        let column = self.reader.metadata().file_metadata().schema_descr().column(leaf);
        let n_items = self.columns.iter().find(|own| own.leaf == leaf).map_or(1, |own| own.n_items);
        let mut values = Entries::of(&column);
        for group in 0..self.reader.num_row_groups() {
            let mut reader = self.group(group, leaf)?;
            while values.read(&mut reader, BATCH)? {
                // A few bytes may stand for any number of equal values.
                if values.bytes() > self.most {
                    let message = format!(
                        "the column `{}` holds more than {} bytes, unpacked; part it",
                        name_of(&column),
                        self.most
                    );
                    return Err(TableError::Unreadable(message));
                }
            }
        }
        let values = values.rows(n_items, &name_of(&column))?;
        if values.len() != n_items.saturating_mul(self.n_rows) { Err(too_few()) } else { Ok(values) }
    }

    fn group(&self, group: usize, leaf: usize) -> Result<ColumnReader, TableError> {
        let group = self.reader.get_row_group(group).map_err(damaged)?;
        if leaf >= group.num_columns() {
            return Err(too_few());
        }
        group.get_column_reader(leaf).map_err(damaged)
    }

    /// Of the first row that has a list.
    fn items_of_first_list(&self, leaf: usize) -> Result<usize, TableError> {
        let column = self.reader.metadata().file_metadata().schema_descr().column(leaf);
        let mut values = Entries::of(&column);
        for group in 0..self.reader.num_row_groups() {
            let mut reader = self.group(group, leaf)?;
            while values.read(&mut reader, 1)? {
                let last = values.repeated.iter().rposition(|level| *level == 0).unwrap_or(0);
                if values.is_item(last) {
                    return Ok(values.repeated.len() - last);
                }
            }
        }
        Ok(0)
    }
}

pub(crate) fn damaged(error: ParquetError) -> TableError {
    TableError::Unreadable(format!("it is no whole file of Parquet ({error})"))
}

/// Whether a part lies within so many bytes, which the library takes for granted.
fn lies_within(chunk: &ColumnChunkMetaData, length: u64) -> bool {
    let start = chunk.dictionary_page_offset().unwrap_or(chunk.data_page_offset());
    let end = start.checked_add(chunk.compressed_size()).and_then(|end| u64::try_from(end).ok());
    start >= 0 && chunk.compressed_size() >= 0 && end.is_some_and(|end| end <= length)
}

fn too_few() -> TableError {
    TableError::Unreadable("its columns do not hold as many rows as it says: it is damaged".to_owned())
}

fn is_numeric(column: &ColumnDescriptor) -> bool {
    let is_number = !matches!(column.physical_type(), Type::BYTE_ARRAY | Type::FIXED_LEN_BYTE_ARRAY);
    is_number && column.max_rep_level() <= 1
}

/// Its path, without what only says that it is a list.
fn name_of(column: &ColumnDescriptor) -> String {
    let parts = column.path().parts();
    let kept = if column.max_rep_level() > 0 && parts.len() > 2 { &parts[..parts.len() - 2] } else { parts };
    kept.join(".")
}

/// What was read of a column.
struct Entries {
    /// Ticks where the column has times.
    numbers: Numbers,
    /// Definition level of each entry; empty where all are defined.
    defined: Vec<i16>,
    /// Repetition level of each entry; empty where there are no lists.
    repeated: Vec<i16>,
    max_defined: i16,
    /// Definition level from which on there is an item, if only a null; below it, its list is null or empty.
    from_item: i16,
    is_list: bool,
    /// How many units of a value are 1.
    divisor: f64,
    is_unsigned: bool,
}

enum Numbers {
    Plain(Vec<f64>),
    /// With how many ticks are a second.
    Times(Vec<i64>, f64),
}

impl Entries {
    fn of(column: &ColumnDescriptor) -> Self {
        let per_second = |unit: &TimeUnit| match unit {
            TimeUnit::MILLIS => 1e3,
            TimeUnit::MICROS => 1e6,
            TimeUnit::NANOS => 1e9,
        };
        let (mut numbers, mut divisor, mut is_unsigned) = (Numbers::Plain(Vec::new()), 1.0, false);
        match column.logical_type_ref() {
            Some(LogicalType::Timestamp(own)) => numbers = Numbers::Times(Vec::new(), per_second(&own.unit)),
            Some(LogicalType::Time(own)) => divisor = per_second(&own.unit),
            Some(LogicalType::Decimal(own)) => divisor = 10f64.powi(own.scale),
            Some(LogicalType::Integer(own)) => is_unsigned = !own.is_signed,
            _ => match column.converted_type() {
                ConvertedType::TIMESTAMP_MILLIS => numbers = Numbers::Times(Vec::new(), 1e3),
                ConvertedType::TIMESTAMP_MICROS => numbers = Numbers::Times(Vec::new(), 1e6),
                ConvertedType::UINT_32 | ConvertedType::UINT_64 => is_unsigned = true,
                _ => {}
            },
        }
        if column.physical_type() == Type::INT96 {
            numbers = Numbers::Times(Vec::new(), 1e9);
        }
        let (defined, repeated) = (Vec::new(), Vec::new());
        let (is_list, max_defined) = (column.max_rep_level() > 0, column.max_def_level());
        let from_item = max_defined - i16::from(column.self_type().is_optional());
        Self { numbers, defined, repeated, max_defined, from_item, is_list, divisor, is_unsigned }
    }

    /// Reads so many records more; false at the end.
    fn read(&mut self, reader: &mut ColumnReader, n_records: usize) -> Result<bool, TableError> {
        let is_unsigned = self.is_unsigned;
        let divisor = self.divisor;
        match reader {
            ColumnReader::BoolColumnReader(reader) => {
                self.more(reader, n_records, |value| f64::from(u8::from(*value)), |_| 0)
            }
            ColumnReader::Int32ColumnReader(reader) => self.more(
                reader,
                n_records,
                |value| (if is_unsigned { f64::from(*value as u32) } else { f64::from(*value) }) / divisor,
                |value| i64::from(*value),
            ),
            ColumnReader::Int64ColumnReader(reader) => self.more(
                reader,
                n_records,
                |value| (if is_unsigned { *value as u64 as f64 } else { *value as f64 }) / divisor,
                |value| *value,
            ),
            ColumnReader::Int96ColumnReader(reader) => {
                self.more(reader, n_records, |_| NOTHING, |value| value.to_nanos())
            }
            ColumnReader::FloatColumnReader(reader) => self.more(reader, n_records, |value| f64::from(*value), |_| 0),
            ColumnReader::DoubleColumnReader(reader) => self.more(reader, n_records, |value| *value, |_| 0),
            ColumnReader::ByteArrayColumnReader(_) | ColumnReader::FixedLenByteArrayColumnReader(_) => Ok(false),
        }
    }

    fn more<T: DataType>(
        &mut self,
        reader: &mut ColumnReaderImpl<T>,
        n_records: usize,
        number: impl Fn(&T::T) -> f64,
        tick: impl Fn(&T::T) -> i64,
    ) -> Result<bool, TableError> {
        let mut values = Vec::new();
        let defined = (self.max_defined > 0).then_some(&mut self.defined);
        let repeated = self.is_list.then_some(&mut self.repeated);
        let (n_read, ..) = reader.read_records(n_records, defined, repeated, &mut values).map_err(damaged)?;
        match &mut self.numbers {
            Numbers::Plain(own) => own.extend(values.iter().map(number)),
            Numbers::Times(own, _) => own.extend(values.iter().map(tick)),
        }
        Ok(n_read > 0)
    }

    /// What all that was read takes.
    fn bytes(&self) -> u64 {
        let n_values = match &self.numbers {
            Numbers::Plain(values) => values.len(),
            Numbers::Times(values, _) => values.len(),
        };
        8 * n_values as u64 + 2 * (self.defined.len() + self.repeated.len()) as u64
    }

    /// Whether at this entry there is an item, or a null among items.
    fn is_item(&self, entry: usize) -> bool {
        self.defined.get(entry).is_none_or(|level| *level >= self.from_item)
    }

    /// The values with those that are nothing; a row without a list has only such.
    fn rows(mut self, n_items: usize, name: &str) -> Result<Vec<f64>, TableError> {
        let n_values = match &self.numbers {
            Numbers::Plain(values) => values.len(),
            Numbers::Times(values, _) => values.len(),
        };
        let n_entries = if self.max_defined > 0 { self.defined.len() } else { n_values };
        if let (Numbers::Plain(values), false, true) = (&mut self.numbers, self.is_list, n_values == n_entries) {
            return Ok(std::mem::take(values));
        }
        // Which value each entry has.
        let mut next = 0;
        let mut places: Vec<Option<usize>> = Vec::new();
        let mut in_row = 0;
        for entry in 0..n_entries {
            let is_defined = self.defined.get(entry).is_none_or(|level| *level == self.max_defined);
            let place = is_defined.then_some(next).filter(|place| *place < n_values);
            next += usize::from(is_defined);
            if !self.is_list {
                places.push(place);
                continue;
            }
            let begins = self.repeated.get(entry) == Some(&0);
            let ended = begins && entry > 0 && in_row != n_items;
            in_row = if begins { 1 } else { in_row + 1 };
            if ended || in_row > n_items && n_items > 0 {
                return Err(other_length(name, n_items));
            }
            if n_items > 1 && begins && !self.is_item(entry) {
                places.extend(std::iter::repeat_n(None, n_items));
                in_row = n_items;
            } else {
                places.push(place);
            }
        }
        if self.is_list && n_entries > 0 && in_row != n_items {
            return Err(other_length(name, n_items));
        }
        Ok(match self.numbers {
            Numbers::Plain(values) => places.iter().map(|place| place.map_or(NOTHING, |place| values[place])).collect(),
            Numbers::Times(values, per_second) => {
                let ticks: Vec<Option<i64>> = places.iter().map(|place| place.map(|place| values[place])).collect();
                seconds_since_first(&ticks, per_second)
            }
        })
    }
}

fn other_length(name: &str, n_items: usize) -> TableError {
    TableError::Unreadable(format!(
        "the lists in column `{name}` are not all of {n_items} items as the first; expected as many in all rows"
    ))
}
