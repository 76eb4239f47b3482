//! Arrow, as a stream (a file is one between a beginning and an end of its own): columns of numbers, booleans and times, lists
//! of them that are of one length (`q[0]`, `q[1]`), and what lies in structs (`arm.q`).
//!
//! A time becomes seconds since the first of its column: seconds since 1970 would lose what is below a microsecond.

use arrow_array::{
    Array, ArrayRef, ArrowPrimitiveType, BooleanArray, FixedSizeListArray, LargeListArray, ListArray, PrimitiveArray,
    RecordBatch, StructArray,
    types::{
        DurationMicrosecondType, DurationMillisecondType, DurationNanosecondType, DurationSecondType, Float16Type,
        Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, TimestampMicrosecondType,
        TimestampMillisecondType, TimestampNanosecondType, TimestampSecondType, UInt8Type, UInt16Type, UInt32Type,
        UInt64Type,
    },
};
use arrow_ipc::{reader::StreamReader, root_as_message};
use arrow_schema::{ArrowError, DataType, Field, Schema, TimeUnit};

use crate::{NOTHING, Named, TableError, guarded::guarded};

/// The stream in a file: after the six bytes that it begins with, and zeros up to a multiple of 8, or of 64 as some write it.
pub(crate) fn stream_in(file: &[u8]) -> &[u8] {
    let first = file.iter().skip(8).position(|byte| *byte != 0).unwrap_or(0);
    file.get(8 + first / 8 * 8..).unwrap_or_default()
}

/// All columns of numbers.
pub(crate) fn columns(bytes: &[u8], most: u64) -> Result<Vec<Named>, TableError> {
    check_claims(bytes, most)?;
    guarded(|| of_stream(bytes))
}

pub(crate) fn damaged(error: ArrowError) -> TableError {
    TableError::Unreadable(format!("it is no whole file of Arrow ({error})"))
}

fn of_stream(bytes: &[u8]) -> Result<Vec<Named>, TableError> {
    let schema = StreamReader::try_new(bytes, None).map_err(damaged)?.schema();
    // What holds no numbers is not read.
    let wanted = (0..schema.fields().len()).filter(|place| is_numeric(schema.field(*place))).collect();
    let reader = StreamReader::try_new(bytes, Some(wanted)).map_err(damaged)?;
    let schema = reader.schema();
    let batches = reader.collect::<Result<Vec<_>, _>>().map_err(damaged)?;
    of_batches(&schema, &batches)
}

/// All columns of numbers of a table that comes in pieces.
pub(crate) fn of_batches(schema: &Schema, batches: &[RecordBatch]) -> Result<Vec<Named>, TableError> {
    let mut columns = Vec::new();
    for (place, field) in schema.fields().iter().enumerate().filter(|(_, field)| is_numeric(field)) {
        let chunks: Vec<ArrayRef> = batches.iter().map(|batch| batch.column(place).clone()).collect();
        flatten(field.name(), field, &chunks, &mut columns)?;
    }
    Ok(columns)
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
        DataType::FixedSizeList(inner, _) | DataType::List(inner) | DataType::LargeList(inner) => {
            !inner.data_type().is_nested() && is_numeric(inner)
        }
        DataType::Struct(fields) => fields.iter().any(|field| is_numeric(field)),
        kind => kind.is_integer() || kind.is_floating(),
    }
}

/// Adds the columns that an array is, which comes in chunks.
fn flatten(name: &str, field: &Field, chunks: &[ArrayRef], found: &mut Vec<Named>) -> Result<(), TableError> {
    let named = |name: String, values| Named { name, values };
    match field.data_type() {
        DataType::Struct(fields) => {
            let structs: Vec<&StructArray> = chunks.iter().filter_map(|chunk| chunk.as_any().downcast_ref()).collect();
            for (place, inner) in fields.iter().enumerate() {
                let own: Vec<ArrayRef> = structs.iter().map(|chunk| chunk.column(place).clone()).collect();
                let before = found.len();
                flatten(&format!("{name}.{}", inner.name()), inner, &own, found)?;
                // What stands in a struct that is null does not count.
                let rows = structs.iter().flat_map(|chunk| (0..chunk.len()).map(|row| chunk.is_null(row)));
                for (row, _) in rows.enumerate().filter(|(_, is_null)| *is_null) {
                    found[before..].iter_mut().for_each(|column| column.values[row] = NOTHING);
                }
            }
        }
        DataType::List(_) | DataType::LargeList(_) | DataType::FixedSizeList(..) => {
            let lists: Vec<Vec<Option<Vec<f64>>>> = chunks.iter().filter_map(lists).collect();
            let lists: Vec<Option<Vec<f64>>> = lists.into_iter().flatten().collect();
            let n_items = lists.iter().flatten().next().map_or(0, Vec::len);
            if let Some(other) = lists.iter().flatten().find(|list| list.len() != n_items) {
                return Err(TableError::Unreadable(format!(
                    "the lists in column `{name}` have {n_items} items and {}; expected as many in all rows",
                    other.len()
                )));
            }
            found.extend((0..n_items).map(|item| {
                let number = |list: &Option<Vec<f64>>| list.as_ref().map_or(NOTHING, |list| list[item]);
                named(format!("{name}[{item}]"), lists.iter().map(number).collect())
            }));
        }
        DataType::Timestamp(unit, _) => {
            let times: Vec<Option<i64>> = chunks.iter().flat_map(ticks).flatten().collect();
            found.push(named(name.to_owned(), seconds_since_first(&times, ticks_per_second(*unit) as f64)));
        }
        _ => {
            let values: Option<Vec<Vec<f64>>> = chunks.iter().map(numbers).collect();
            found.extend(values.map(|values| named(name.to_owned(), values.concat())));
        }
    }
    Ok(())
}

/// The numbers of each list of an array of such; `None` where the list is null.
fn lists(array: &ArrayRef) -> Option<Vec<Option<Vec<f64>>>> {
    let any = array.as_any();
    let rows = 0..array.len();
    let (items, ranges): (_, Vec<std::ops::Range<usize>>) = if let Some(list) = any.downcast_ref::<ListArray>() {
        let offsets = list.value_offsets();
        (list.values(), rows.map(|row| offsets[row] as usize..offsets[row + 1] as usize).collect())
    } else if let Some(list) = any.downcast_ref::<LargeListArray>() {
        let offsets = list.value_offsets();
        (list.values(), rows.map(|row| offsets[row] as usize..offsets[row + 1] as usize).collect())
    } else {
        let list = any.downcast_ref::<FixedSizeListArray>()?;
        let length = list.value_length() as usize;
        (list.values(), rows.map(|row| row * length..(row + 1) * length).collect())
    };
    let items = numbers(items)?;
    let list = |(row, range): (usize, std::ops::Range<usize>)| array.is_valid(row).then(|| items[range].to_vec());
    Some(ranges.into_iter().enumerate().map(list).collect())
}

/// The numbers of an array that holds such.
pub(crate) fn numbers(array: &ArrayRef) -> Option<Vec<f64>> {
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
    // Most columns have a number in every row.
    Some(match array.null_count() {
        0 => array.values().iter().map(|value| number(*value)).collect(),
        _ => array.iter().map(|value| value.map_or(NOTHING, &number)).collect(),
    })
}

/// The times of an array that holds such.
pub(crate) fn ticks(array: &ArrayRef) -> Option<Vec<Option<i64>>> {
    fn of<T: ArrowPrimitiveType<Native = i64>>(array: &ArrayRef) -> Option<Vec<Option<i64>>> {
        Some(array.as_any().downcast_ref::<PrimitiveArray<T>>()?.iter().collect())
    }
    of::<TimestampNanosecondType>(array)
        .or_else(|| of::<TimestampMicrosecondType>(array))
        .or_else(|| of::<TimestampMillisecondType>(array))
        .or_else(|| of::<TimestampSecondType>(array))
}

pub(crate) fn ticks_per_second(unit: TimeUnit) -> i64 {
    match unit {
        TimeUnit::Second => 1,
        TimeUnit::Millisecond => 1_000,
        TimeUnit::Microsecond => 1_000_000,
        TimeUnit::Nanosecond => 1_000_000_000,
    }
}

/// The library takes for granted that the parts of a batch lie within it, and makes room for what a compressed part claims to hold before
/// it looks.
pub(crate) fn check_claims(bytes: &[u8], most: u64) -> Result<(), TableError> {
    let mut rest = bytes;
    while let Some((metadata, body, after)) = message(rest) {
        rest = after;
        let Ok(message) = root_as_message(metadata) else { return Ok(()) };
        let batch = message.header_as_record_batch();
        let Some(batch) = batch.or_else(|| message.header_as_dictionary_batch().and_then(|batch| batch.data())) else {
            continue;
        };
        // Of no kind of column a batch has more rows than what it holds may have bits.
        let lengths = batch.nodes().into_iter().flatten().map(|node| node.length());
        let mut claims = lengths.max().map_or(0, |length| length.unsigned_abs() / 8);
        for buffer in batch.buffers().into_iter().flatten() {
            let range = usize::try_from(buffer.offset()).ok().zip(usize::try_from(buffer.length()).ok());
            let part = range.and_then(|(start, length)| body.get(start..)?.get(..length));
            let Some(part) = part else {
                return Err(TableError::Unreadable("parts of it lie outside of it: it is damaged or cut".to_owned()));
            };
            let claim = part.first_chunk().map_or(-1, |length| i64::from_le_bytes(*length));
            // -1 stands before what is not compressed.
            if batch.compression().is_some() && claim > 0 {
                claims = claims.saturating_add(claim.unsigned_abs());
            }
        }
        if claims > most {
            let message = format!("a part of it claims to hold more than {most} bytes, unpacked");
            return Err(TableError::Unreadable(message));
        }
    }
    Ok(())
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
