//! Tables whose cells are words as well as numbers: nights, robots, estimates.

use std::{io::Read, path::Path, sync::Arc};

use arrow_array::{
    Array, ArrayRef, Date32Array, Date64Array, LargeStringArray, StringArray, StringViewArray, cast::AsArray,
};
use arrow_ipc::reader::StreamReader;
use arrow_schema::DataType;
use parquet::{
    basic::{LogicalType, TimeUnit},
    file::reader::FileReader,
    record::Field,
    schema::types::Type,
};

use crate::{
    Kind, LARGEST_UNPACKED, TableError, arrow_file, guarded::guarded, opened, parquet_file, text::delimiter, unpacked,
};

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
    let mut reader = csv::ReaderBuilder::new().delimiter(delimiter(bytes)).trim(csv::Trim::All).from_reader(bytes);
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
    // The reader of rows knows no billionths of seconds and no zones.
    let ticks_of = |field: &Arc<Type>| {
        let Some(LogicalType::Timestamp(own)) = field.get_basic_info().logical_type_ref() else { return None };
        let per_second = match own.unit {
            TimeUnit::MILLIS => 1_000,
            TimeUnit::MICROS => 1_000_000,
            TimeUnit::NANOS => 1_000_000_000,
        };
        Some(Ticks::of_moments(per_second, own.is_adjusted_to_u_t_c))
    };
    let ticks: Vec<Option<Ticks>> = schema.get_fields().iter().map(ticks_of).collect();
    let mut rows = Vec::new();
    for (line, row) in (1..).zip(reader.get_row_iter(None).map_err(parquet_file::damaged)?) {
        let row = row.map_err(parquet_file::damaged)?;
        let cells = row.get_column_iter().zip(&ticks).map(|((_, field), ticks)| match (field, ticks) {
            (Field::Long(own) | Field::TimestampMillis(own) | Field::TimestampMicros(own), Some(ticks)) => {
                ticks.words(*own)
            }
            // Of older writers, which state no logical type.
            (Field::TimestampMillis(own), None) => Ticks::of_moments(1_000, false).words(*own),
            (Field::TimestampMicros(own), None) => Ticks::of_moments(1_000_000, false).words(*own),
            (Field::Date(days), _) => Ticks::DAYS.words(i64::from(*days)),
            (Field::Null, _) => String::new(),
            (Field::Str(text), _) => text.trim().to_owned(),
            (Field::Double(number), _) => number.to_string(),
            (Field::Float(number), _) => number.to_string(),
            (other, _) => other.to_string(),
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

/// What is counted from the beginning of 1970.
#[derive(Clone, Copy)]
struct Ticks {
    /// Of one tick.
    nanoseconds: i64,
    is_utc: bool,
}

impl Ticks {
    const A_SECOND: i64 = 1_000_000_000;
    const DAYS: Self = Self { nanoseconds: 86_400 * Self::A_SECOND, is_utc: false };

    fn of_moments(per_second: i64, is_utc: bool) -> Self {
        Self { nanoseconds: Self::A_SECOND / per_second, is_utc }
    }

    /// A moment as people write it: at midnight the date alone, as other programs write columns of dates.
    /// One of a stated zone is that of UTC, and says so: its date may be another.
    fn words(self, ticks: i64) -> String {
        let (all, second) = (i128::from(ticks) * i128::from(self.nanoseconds), i128::from(Self::A_SECOND));
        let seconds = i64::try_from(all.div_euclid(second)).ok().zip(u32::try_from(all.rem_euclid(second)).ok());
        let moment = seconds.and_then(|(seconds, rest)| chrono::DateTime::from_timestamp(seconds, rest));
        let Some(moment) = moment.map(|own| own.naive_utc()) else { return ticks.to_string() };
        match moment.time() {
            _ if self.is_utc => format!("{moment}Z"),
            chrono::NaiveTime::MIN => moment.date().to_string(),
            _ => moment.to_string(),
        }
    }

    fn column(self, ticks: impl Iterator<Item = Option<i64>>) -> Vec<String> {
        ticks.map(|own| own.map_or_else(String::new, |own| self.words(own))).collect()
    }
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
    let categories = || {
        let categories = column.as_any_dictionary_opt()?;
        let known = words(name, categories.values()).ok()?;
        let keys = if known.is_empty() { vec![0; column.len()] } else { categories.normalized_keys() };
        let cell =
            |(row, key): (usize, &usize)| known.get(*key).filter(|_| column.is_valid(row)).cloned().unwrap_or_default();
        Some(keys.iter().enumerate().map(cell).collect())
    };
    let dates = || {
        let days =
            any.downcast_ref().map(|own: &Date32Array| Ticks::DAYS.column(own.iter().map(|own| own.map(i64::from))));
        let thousandths = || {
            let dates: &Date64Array = any.downcast_ref()?;
            Some(Ticks::of_moments(1_000, false).column(dates.iter()))
        };
        let moments = || {
            let DataType::Timestamp(unit, zone) = column.data_type() else { return None };
            let ticks = Ticks::of_moments(arrow_file::ticks_per_second(*unit), zone.is_some());
            Some(ticks.column(arrow_file::ticks(column)?.into_iter()))
        };
        days.or_else(thousandths).or_else(moments)
    };
    let numbers = || {
        let numbers = arrow_file::numbers(column)?;
        let cell = |(row, number): (usize, &f64)| if column.is_null(row) { String::new() } else { number.to_string() };
        Some(numbers.iter().enumerate().map(cell).collect())
    };
    texts.or_else(categories).or_else(dates).or_else(numbers).ok_or_else(|| {
        TableError::Unreadable(format!(
            "column `{name}` holds neither words nor numbers; leave it out, or write it as words"
        ))
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{DictionaryArray, RecordBatch, TimestampNanosecondArray, types::Int32Type};

    use super::*;

    #[test]
    fn tables_of_text_may_be_parted_as_logs_are() {
        for text in ["robot;night\na;1,5\n", "\n\nrobot\tnight\na\t1,5\n"] {
            let read = of_text(text.as_bytes()).unwrap();
            assert_eq!((read.names.join(" "), read.rows[0].cells.join(" ")), ("robot night".into(), "a 1,5".into()));
        }
    }

    #[test]
    fn categories_and_dates_are_words() {
        let robots: DictionaryArray<Int32Type> = [Some("a"), None, Some("b")].into_iter().collect();
        let midnight = 20_513 * 86_400 * 1_000_000_000;
        let nights = TimestampNanosecondArray::from(vec![Some(midnight), Some(midnight + 1_500_000_000), None]);
        let zoned = nights.clone().with_timezone("Europe/Berlin");
        let days = Date32Array::from(vec![Some(20_513), Some(-1), None]);
        let columns: [(&str, ArrayRef); 4] = [
            ("robot", Arc::new(robots)),
            ("night", Arc::new(nights)),
            ("began", Arc::new(zoned)),
            ("day", Arc::new(days)),
        ];
        let batch = RecordBatch::try_from_iter_with_nullable(columns.map(|(name, own)| (name, own, true))).unwrap();
        let mut writer = arrow_ipc::writer::StreamWriter::try_new(Vec::new(), &batch.schema()).unwrap();
        writer.write(&batch).unwrap();
        let read = of_arrow(&writer.into_inner().unwrap()).unwrap();
        let rows: Vec<String> = read.rows.iter().map(|row| row.cells.join("|")).collect();
        assert_eq!(
            rows,
            [
                "a|2026-03-01|2026-03-01 00:00:00Z|2026-03-01",
                "|2026-03-01 00:00:01.500|2026-03-01 00:00:01.500Z|1969-12-31",
                "b|||"
            ]
        );
    }
}
