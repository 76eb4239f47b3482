//! MATLAB's files up to version 7 (`save` without `-v7.3`): every real, full variable of numbers of one length, the
//! one that holds most numbers. Columns of a matrix are `q[0]`, `q[1]`, ..; fields of a struct are `arm.q`, those of several `signals[0].values`.
//!
//! Layout by "MAT-File Format" of MathWorks: a header of 128 bytes, then elements, each of a type, a length and its bytes, padded to 8.

use crate::{Named, Remark, TableError, unpacked};

/// Elements within each other.
pub(crate) const DEEPEST: usize = 16;

const COMPRESSED: u32 = 15;
const MATRIX: u32 = 14;

/// The columns, and what was left out.
pub(crate) fn columns(bytes: &[u8], most: u64) -> Result<(Vec<Named>, Vec<Remark>), TableError> {
    let order = match bytes.get(126..128) {
        Some(b"IM") => Order::Little,
        Some(b"MI") => Order::Big,
        _ => return Err(damaged()),
    };
    let mut variables = Vec::new();
    // Bytes of all numbers together: those of eight bits take eight times what they do in the file.
    let mut left = most;
    let mut rest = Elements { bytes: &bytes[128..], order };
    while let Some((kind, content)) = rest.next()? {
        match kind {
            COMPRESSED => {
                let unpacked = unpacked::whole(flate2::read::ZlibDecoder::new(content), left)?;
                if let Some((MATRIX, content)) = (Elements { bytes: &unpacked, order }).next()? {
                    matrix(content, order, None, DEEPEST, &mut left, &mut variables)?;
                }
            }
            MATRIX => matrix(content, order, None, DEEPEST, &mut left, &mut variables)?,
            _ => {}
        }
    }
    Ok(table(variables))
}

fn damaged() -> TableError {
    TableError::Unreadable("it is no whole file of MATLAB: it is damaged or cut".to_owned())
}

/// A variable of numbers, column by column.
pub(crate) struct Variable {
    pub name: String,
    pub n_rows: usize,
    pub n_columns: usize,
    pub values: Vec<f64>,
}

/// The variables of the length that holds most numbers (columns times rows), the longest of several: a small matrix beside a log has many columns,
/// too.
pub(crate) fn table(variables: Vec<Variable>) -> (Vec<Named>, Vec<Remark>) {
    let n_columns = |n_rows: usize| -> usize {
        variables.iter().filter(|own| own.n_rows == n_rows).map(|own| own.n_columns).sum::<usize>()
            + variables
                .iter()
                .filter(|own| own.n_columns == n_rows && own.n_rows != n_rows)
                .map(|own| own.n_rows)
                .sum::<usize>()
    };
    // A row vector or a wide matrix has its times side by side.
    let long = |own: &Variable| own.n_rows.max(own.n_columns);
    let candidates = variables.iter().map(long).filter(|length| *length > 1);
    let Some(n_rows) = candidates.max_by_key(|length| (length * n_columns(*length), *length)) else {
        return (Vec::new(), Vec::new());
    };
    let (mut columns, mut others) = (Vec::new(), Vec::new());
    for Variable { name, n_rows: down, n_columns: across, values } in variables {
        let (n_series, at): (usize, Box<dyn Fn(usize, usize) -> usize>) = if down == n_rows {
            (across, Box::new(move |series, row| series * down + row))
        } else if across == n_rows {
            (down, Box::new(move |series, row| row * down + series))
        } else {
            others.push(name);
            continue;
        };
        columns.extend((0..n_series).map(|series| Named {
            name: if n_series == 1 { name.clone() } else { format!("{name}[{series}]") },
            values: (0..n_rows).map(|row| values[at(series, row)]).collect(),
        }));
    }
    let remarks = if others.is_empty() { Vec::new() } else { vec![Remark::OtherLengths { n_rows, names: others }] };
    (columns, remarks)
}

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    Little,
    Big,
}

impl Order {
    /// A number of these bytes.
    fn number<const N: usize, T>(self, bytes: [u8; N], little: fn([u8; N]) -> T, big: fn([u8; N]) -> T) -> T {
        match self {
            Self::Little => little(bytes),
            Self::Big => big(bytes),
        }
    }

    fn u32(self, bytes: &[u8]) -> Option<u32> {
        Some(self.number(bytes.get(..4)?.try_into().ok()?, u32::from_le_bytes, u32::from_be_bytes))
    }

    /// Numbers of one type of element; `None` of what is no number.
    fn numbers(self, kind: u32, bytes: &[u8]) -> Option<Vec<f64>> {
        fn each<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
            bytes.as_chunks().0.iter().map(|own| number(*own)).collect()
        }
        Some(match kind {
            1 => each(bytes, |[own]| f64::from(own as i8)),
            2 => each(bytes, |[own]| f64::from(own)),
            3 => each(bytes, |own| f64::from(self.number(own, i16::from_le_bytes, i16::from_be_bytes))),
            4 => each(bytes, |own| f64::from(self.number(own, u16::from_le_bytes, u16::from_be_bytes))),
            5 => each(bytes, |own| f64::from(self.number(own, i32::from_le_bytes, i32::from_be_bytes))),
            6 => each(bytes, |own| f64::from(self.number(own, u32::from_le_bytes, u32::from_be_bytes))),
            7 => each(bytes, |own| f64::from(self.number(own, f32::from_le_bytes, f32::from_be_bytes))),
            9 => each(bytes, |own| self.number(own, f64::from_le_bytes, f64::from_be_bytes)),
            12 => each(bytes, |own| self.number(own, i64::from_le_bytes, i64::from_be_bytes) as f64),
            13 => each(bytes, |own| self.number(own, u64::from_le_bytes, u64::from_be_bytes) as f64),
            _ => return None,
        })
    }
}

/// Elements that follow each other.
struct Elements<'a> {
    bytes: &'a [u8],
    order: Order,
}

impl<'a> Elements<'a> {
    /// The type and the content of the next one.
    fn next(&mut self) -> Result<Option<(u32, &'a [u8])>, TableError> {
        if self.bytes.is_empty() {
            return Ok(None);
        }
        let word = self.order.u32(self.bytes).ok_or_else(damaged)?;
        // A short element has its length in the upper half of its type, and its content in the same eight bytes.
        let (kind, start, length) = match word >> 16 {
            0 => (word, 8, self.order.u32(self.bytes.get(4..).unwrap_or_default()).ok_or_else(damaged)? as usize),
            length => (word & 0xffff, 4, length as usize),
        };
        let content = self.bytes.get(start..).and_then(|rest| rest.get(..length)).ok_or_else(damaged)?;
        // What is compressed is not padded; the last element may lack its padding.
        let end = if kind == COMPRESSED { start + length } else { (start + length).next_multiple_of(8) };
        self.bytes = self.bytes.get(end..).unwrap_or_default();
        Ok(Some((kind, content)))
    }

    fn expect(&mut self) -> Result<(u32, &'a [u8]), TableError> {
        self.next()?.ok_or_else(damaged)
    }
}

/// Adds the numbers of an array, which goes by its own name if it is no part of another.
fn matrix(
    bytes: &[u8],
    order: Order,
    name: Option<String>,
    deepest: usize,
    left: &mut u64,
    found: &mut Vec<Variable>,
) -> Result<(), TableError> {
    // An empty field of a struct is an element without content.
    if bytes.is_empty() || deepest == 0 {
        return Ok(());
    }
    let mut parts = Elements { bytes, order };
    let flags = order.u32(parts.expect()?.1).ok_or_else(damaged)?;
    let (class, is_complex) = (flags & 0xff, flags & 0x800 != 0);
    /// Structs, and classes of numbers from that of doubles to that of unsigned integers of 64 bits.
    const STRUCT: u32 = 2;
    const NUMBERS: std::ops::RangeInclusive<u32> = 6..=15;
    if class != STRUCT && !NUMBERS.contains(&class) {
        return Ok(());
    }
    let (kind, sizes) = parts.expect()?;
    let sizes: Vec<usize> = order.numbers(kind, sizes).ok_or_else(damaged)?.iter().map(|size| *size as usize).collect();
    let own_name = text(parts.expect()?.1);
    let name = name.unwrap_or(own_name);
    if class == STRUCT {
        let width = order.u32(parts.expect()?.1).ok_or_else(damaged)? as usize;
        let fields: Vec<String> = match width {
            0 => Vec::new(),
            _ => parts.expect()?.1.chunks(width).map(text).collect(),
        };
        let mut element = 0;
        let n_elements = sizes.iter().fold(1usize, |all, size| all.saturating_mul(*size));
        while element < n_elements && !fields.is_empty() {
            let own = if n_elements == 1 { name.clone() } else { format!("{name}[{element}]") };
            for field in &fields {
                let (_, content) = parts.expect()?;
                matrix(content, order, Some(format!("{own}.{field}")), deepest - 1, left, found)?;
            }
            element += 1;
        }
        return Ok(());
    }
    // Of more than two sizes those of 1 say nothing, as in Simulink's 1 x 1 x n.
    let mut long: Vec<usize> = sizes.iter().copied().filter(|size| *size != 1).collect();
    if sizes.len() == 2 {
        long = sizes;
    }
    long.resize(long.len().max(2), 1);
    let (kind, content) = parts.expect()?;
    let bytes = long.iter().fold(8_u64, |all, size| all.saturating_mul(*size as u64));
    if bytes > *left {
        let message =
            format!("its numbers are more than may be held: those of `{name}` take {bytes} bytes, {left} are left");
        return Err(TableError::Unreadable(message));
    }
    *left -= bytes;
    let Some(values) = order.numbers(kind, content) else { return Ok(()) };
    let [n_rows, n_columns] = long[..] else { return Ok(()) };
    if n_rows.checked_mul(n_columns) != Some(values.len()) {
        return Err(damaged());
    }
    if !is_complex && !values.is_empty() {
        found.push(Variable { name, n_rows, n_columns, values });
    }
    Ok(())
}

/// A name, which ends where its bytes are zero.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes.split(|byte| *byte == 0).next().unwrap_or_default()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_is_taken_before_a_small_matrix_with_more_columns() {
        let variable = |name: &str, n_rows, n_columns| Variable {
            name: name.to_owned(),
            n_rows,
            n_columns,
            values: vec![0.0; n_rows * n_columns],
        };
        let (columns, remarks) = table(vec![variable("t", 801, 1), variable("q0", 1, 801), variable("flange", 4, 4)]);
        assert_eq!(columns.iter().map(|own| own.name.as_str()).collect::<Vec<_>>(), ["t", "q0"]);
        assert_eq!(remarks, [Remark::OtherLengths { n_rows: 801, names: vec!["flange".to_owned()] }]);
    }
}
