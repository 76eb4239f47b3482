//! Arrow, as a stream (a file is one between a beginning and an end of its own): columns of numbers, booleans and times, lists
//! of them that are of one length (`q[0]`, `q[1]`), and what lies in structs (`arm.q`).
//!
//! A time becomes seconds since the first of its column: seconds since 1970 would lose what is below a microsecond.

use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, BooleanArray, FixedSizeListArray, LargeListArray, ListArray, PrimitiveArray,
    StructArray,
    types::{
        DurationMicrosecondType, DurationMillisecondType, DurationNanosecondType, DurationSecondType, Float16Type,
        Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, TimestampMicrosecondType,
        TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType, UInt8Type, UInt16Type, UInt32Type,
        UInt64Type,
    },
};
use arrow_ipc::{RecordBatch, reader::StreamReader, root_as_message};
use arrow_schema::{ArrowError, DataType, Field, TimeUnit};

use crate::{LARGEST_UNPACKED, NOTHING, Named, TableError};

/// All columns of numbers.
pub(crate) fn columns(bytes: &[u8]) -> Result<Vec<Named>, TableError> {
    check_claims(bytes)?;
    let damaged = |error: ArrowError| TableError::Unreadable(format!("it is no whole file of Arrow ({error})"));
    let schema = StreamReader::try_new(bytes, None).map_err(damaged)?.schema();
    let wanted: Vec<usize> = (0..schema.fields().len()).filter(|place| is_numeric(schema.field(*place))).collect();
    let reader = StreamReader::try_new(bytes, Some(wanted.clone())).map_err(damaged)?;
    let mut columns: Vec<Building> = Vec::new();
    for batch in reader {
        let batch = batch.map_err(damaged)?;
        let mut found = Vec::new();
        for (array, place) in batch.columns().iter().zip(&wanted) {
            flatten(schema.field(*place).name(), array, &mut found)?;
        }
        if columns.is_empty() {
            columns = found;
            continue;
        }
        let same = columns.len() == found.len() && columns.iter().zip(&found).all(|(own, more)| own.name == more.name);
        if !same {
            return Err(TableError::Unreadable("its lists are of different lengths in different rows".to_owned()));
        }
        columns.iter_mut().zip(found).for_each(|(own, more)| own.values.append(more.values));
    }
    Ok(columns.into_iter().map(Building::finish).collect())
}

/// A column that grows by batches.
struct Building {
    name: String,
    values: Values,
}

enum Values {
    Numbers(Vec<f64>),
    /// Ticks of a clock, and how many are a second.
    Times(Vec<Option<i64>>, f64),
}

impl Values {
    fn append(&mut self, more: Self) {
        match (self, more) {
            (Self::Numbers(own), Self::Numbers(more)) => own.extend(more),
            (Self::Times(own, _), Self::Times(more, _)) => own.extend(more),
            // All batches have one schema.
            _ => {}
        }
    }
}

impl Building {
    fn finish(self) -> Named {
        let values = match self.values {
            Values::Numbers(values) => values,
            Values::Times(ticks, per_second) => seconds_since_first(&ticks, per_second),
        };
        Named { name: self.name, values }
    }
}

/// Seconds since the first of these times that there is, of a clock with so many ticks a second.
pub(crate) fn seconds_since_first(ticks: &[Option<i64>], per_second: f64) -> Vec<f64> {
    let first = ticks.iter().flatten().next().copied().unwrap_or(0);
    let second =
        |tick: &Option<i64>| tick.map_or(NOTHING, |tick| (i128::from(tick) - i128::from(first)) as f64 / per_second);
    ticks.iter().map(second).collect()
}

/// Whether a column holds numbers, however deep.
fn is_numeric(field: &Field) -> bool {
    match field.data_type() {
        DataType::Boolean | DataType::Timestamp(..) | DataType::Duration(_) => true,
        DataType::FixedSizeList(inner, _) | DataType::List(inner) | DataType::LargeList(inner) => is_numeric(inner),
        DataType::Struct(fields) => fields.iter().any(|field| is_numeric(field)),
        kind => kind.is_integer() || kind.is_floating(),
    }
}

/// The columns that an array is.
fn flatten(name: &str, array: &ArrayRef, found: &mut Vec<Building>) -> Result<(), TableError> {
    let any = array.as_any();
    let numbers = numbers(array).map(Values::Numbers).or_else(|| {
        let (ticks, per_second) = ticks(array)?;
        Some(Values::Times(ticks, per_second))
    });
    if let Some(values) = numbers {
        found.push(Building { name: name.to_owned(), values });
    } else if let Some(array) = any.downcast_ref::<StructArray>() {
        for (field, inner) in array.fields().iter().zip(array.columns()) {
            flatten(&format!("{name}.{}", field.name()), inner, found)?;
        }
    } else if let Some(array) = any.downcast_ref::<FixedSizeListArray>() {
        let (n_items, n_rows) = (array.value_length() as usize, array.len());
        list(name, n_rows, |row| (row * n_items, n_items), |row| array.is_null(row), array.values(), found)?;
    } else if let Some(array) = any.downcast_ref::<ListArray>() {
        let range = |row: usize| (array.value_offsets()[row] as usize, array.value_length(row) as usize);
        list(name, array.len(), range, |row| array.is_null(row), array.values(), found)?;
    } else if let Some(array) = any.downcast_ref::<LargeListArray>() {
        let range = |row: usize| (array.value_offsets()[row] as usize, array.value_length(row) as usize);
        list(name, array.len(), range, |row| array.is_null(row), array.values(), found)?;
    }
    Ok(())
}

/// A list as one column for each of its items; all lists that are not null must have as many.
fn list(
    name: &str,
    n_rows: usize,
    range: impl Fn(usize) -> (usize, usize),
    is_null: impl Fn(usize) -> bool,
    items: &ArrayRef,
    found: &mut Vec<Building>,
) -> Result<(), TableError> {
    let Some(items) = numbers(items) else { return Ok(()) };
    let n_items = (0..n_rows).find(|row| !is_null(*row)).map_or(0, |row| range(row).1);
    let mut columns = vec![vec![NOTHING; n_rows]; n_items];
    for row in (0..n_rows).filter(|row| !is_null(*row)) {
        let (start, length) = range(row);
        if length != n_items {
            return Err(TableError::Unreadable(format!(
                "the lists in column `{name}` have {n_items} items and {length}; expected as many in all rows"
            )));
        }
        columns.iter_mut().zip(&items[start..start + length]).for_each(|(column, item)| column[row] = *item);
    }
    let named = |(item, values)| Building { name: format!("{name}[{item}]"), values: Values::Numbers(values) };
    found.extend(columns.into_iter().enumerate().map(named));
    Ok(())
}

/// The numbers of an array that holds such.
fn numbers(array: &ArrayRef) -> Option<Vec<f64>> {
    if let Some(array) = array.as_any().downcast_ref::<BooleanArray>() {
        return Some(array.iter().map(|value| value.map_or(NOTHING, |value| f64::from(u8::from(value)))).collect());
    }
    primitive::<Float64Type>(array, |value| value)
        .or_else(|| primitive::<Float32Type>(array, f64::from))
        .or_else(|| primitive::<Float16Type>(array, |value| value.to_f64()))
        .or_else(|| primitive::<Int64Type>(array, |value| value as f64))
        .or_else(|| primitive::<Int32Type>(array, f64::from))
        .or_else(|| primitive::<Int16Type>(array, f64::from))
        .or_else(|| primitive::<Int8Type>(array, f64::from))
        .or_else(|| primitive::<UInt64Type>(array, |value| value as f64))
        .or_else(|| primitive::<UInt32Type>(array, f64::from))
        .or_else(|| primitive::<UInt16Type>(array, f64::from))
        .or_else(|| primitive::<UInt8Type>(array, f64::from))
        .or_else(|| primitive::<DurationSecondType>(array, |value| value as f64))
        .or_else(|| primitive::<DurationMillisecondType>(array, |value| value as f64 / 1e3))
        .or_else(|| primitive::<DurationMicrosecondType>(array, |value| value as f64 / 1e6))
        .or_else(|| primitive::<DurationNanosecondType>(array, |value| value as f64 / 1e9))
}

fn primitive<T: ArrowPrimitiveType>(array: &ArrayRef, number: impl Fn(T::Native) -> f64) -> Option<Vec<f64>> {
    let array: &PrimitiveArray<T> = array.as_any().downcast_ref()?;
    Some(array.iter().map(|value| value.map_or(NOTHING, &number)).collect())
}

/// The times of an array that holds such, and how many ticks of its clock are a second.
fn ticks(array: &ArrayRef) -> Option<(Vec<Option<i64>>, f64)> {
    fn of<T: ArrowPrimitiveType<Native = i64>>(array: &ArrayRef) -> Option<Vec<Option<i64>>> {
        Some(array.as_any().downcast_ref::<PrimitiveArray<T>>()?.iter().collect())
    }
    let DataType::Timestamp(unit, _) = array.data_type() else { return None };
    Some(match unit {
        TimeUnit::Second => (of::<TimestampSecondType>(array)?, 1.0),
        TimeUnit::Millisecond => (of::<TimestampMillisecondType>(array)?, 1e3),
        TimeUnit::Microsecond => (of::<TimestampMicrosecondType>(array)?, 1e6),
        TimeUnit::Nanosecond => (of::<TimestampNanosecondType>(array)?, 1e9),
    })
}

/// A compressed part says how long it is when it is unpacked, and the library makes room for that before it looks.
fn check_claims(bytes: &[u8]) -> Result<(), TableError> {
    let mut rest = bytes;
    while let Some((metadata, body, after)) = message(rest) {
        let Ok(message) = root_as_message(metadata) else { return Ok(()) };
        let batch = message.header_as_record_batch();
        let batch = batch.or_else(|| message.header_as_dictionary_batch().and_then(|batch| batch.data()));
        let claims = batch.filter(|batch| batch.compression().is_some()).map(|batch| claims(&batch, body));
        if claims.is_some_and(|claims| claims > LARGEST_UNPACKED) {
            let message = format!("a part of it claims to hold more than {LARGEST_UNPACKED} bytes, unpacked");
            return Err(TableError::Unreadable(message));
        }
        rest = after;
    }
    Ok(())
}

/// Bytes that all parts of a compressed batch claim to hold.
fn claims(batch: &RecordBatch<'_>, body: &[u8]) -> u64 {
    let buffers = batch.buffers().into_iter().flatten();
    let claim = |buffer: &arrow_ipc::Buffer| {
        let start = usize::try_from(buffer.offset()).ok()?;
        let length: [u8; 8] = body.get(start..start.checked_add(8)?)?.try_into().ok()?;
        // -1 stands before what is not compressed.
        u64::try_from(i64::from_le_bytes(length)).ok()
    };
    buffers.filter_map(claim).fold(0, u64::saturating_add)
}

/// The next message of a stream: what describes it, its body, and what follows; `None` at the end, or where a file is cut.
fn message(bytes: &[u8]) -> Option<(&[u8], &[u8], &[u8])> {
    let bytes = bytes.strip_prefix(&[0xff; 4]).unwrap_or(bytes);
    let (length, rest) = bytes.split_first_chunk()?;
    let length = u32::from_le_bytes(*length) as usize;
    let (metadata, rest) = rest.split_at_checked(length).filter(|_| length > 0)?;
    let body = root_as_message(metadata).ok().and_then(|message| usize::try_from(message.bodyLength()).ok())?;
    let (body, rest) = rest.split_at_checked(body)?;
    Some((metadata, body, rest))
}

#[cfg(test)]
mod tests;
