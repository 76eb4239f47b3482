//! Text with cells and a header (CSV and its relatives), cut into pieces that are read side by side.
//!
//! Only quotes let a line end stand within a cell. Text without them is cut at line ends and read here; text with a quote
//! below the header is one piece, which the `csv` crate reads. What is a row and what is a cell is the same for both:
//! lines end with `\n`, `\r` or `\r\n`, empty lines are no rows, and rows may be of different lengths.

use std::ops::{ControlFlow, Range};

use memchr::{memchr, memchr2, memchr2_iter};
use rayon::prelude::*;

use crate::{Cell, Column, RaggedRow};

/// Bytes of a piece, but for its last row: much more than starting a task costs, and many pieces in a long log.
const PIECE: usize = 1 << 19;

/// The rows of a text, and where they stand.
#[derive(Debug)]
pub(crate) struct Text {
    bytes: Vec<u8>,
    delimiter: u8,
    is_quoted: bool,
    pieces: Vec<Piece>,
}

/// Whole rows.
#[derive(Debug, Clone, PartialEq)]
struct Piece {
    bytes: Range<usize>,
    rows: Range<usize>,
}

/// Something that looks at rows, until it breaks.
trait Visitor {
    /// A row that begins at this byte of the text.
    fn row<'a>(&mut self, start: usize, cells: impl Iterator<Item = &'a [u8]>) -> ControlFlow<()>;
}

impl Text {
    /// The header and the text.
    pub fn new(bytes: Vec<u8>) -> Result<(Vec<String>, Self), csv::Error> {
        Self::in_pieces_of(PIECE, bytes)
    }

    fn in_pieces_of(size: usize, bytes: Vec<u8>) -> Result<(Vec<String>, Self), csv::Error> {
        let delimiter = delimiter(&bytes);
        let mut reader = reader(delimiter).trim(csv::Trim::Headers).has_headers(true).from_reader(&bytes[..]);
        let names = reader.headers()?.iter().map(str::to_owned).collect();
        let below = reader.position().byte() as usize;
        let pieces = cut(&bytes, below, size);
        let counts = pieces.par_iter().map(|piece| count_rows(&bytes[piece.clone()])).collect::<Option<Vec<usize>>>();
        let mut text = Self { bytes, delimiter, is_quoted: counts.is_none(), pieces: Vec::new() };
        match counts {
            Some(counts) => {
                let mut first = 0;
                text.pieces.extend(pieces.into_iter().zip(counts).map(|(bytes, count)| {
                    let rows = first..first + count;
                    first = rows.end;
                    Piece { bytes, rows }
                }));
            }
            None => {
                let mut whole = Piece { bytes: below..text.bytes.len(), rows: 0..0 };
                let mut count = Count(0);
                text.visit(&whole, &mut count);
                whole.rows.end = count.0;
                text.pieces.push(whole);
            }
        }
        Ok((names, text))
    }

    pub fn n_rows(&self) -> usize {
        self.pieces.last().map_or(0, |piece| piece.rows.end)
    }

    pub fn columns(&self, places: &[usize], rows: Range<usize>) -> Vec<Column> {
        let mut columns: Vec<Column> =
            places.iter().map(|_| Column { values: vec![0.0; rows.len()], no_number: None }).collect();
        // Each piece fills its own part of every column.
        let pieces = self.pieces.iter().filter(|piece| piece.rows.start < rows.end && piece.rows.end > rows.start);
        let mut parts: Vec<(&Piece, Vec<&mut [f64]>)> = pieces.map(|piece| (piece, Vec::new())).collect();
        for column in &mut columns {
            let mut rest = &mut column.values[..];
            for (piece, own) in &mut parts {
                let n_rows = piece.rows.end.min(rows.end) - piece.rows.start.max(rows.start);
                let (part, after) = rest.split_at_mut(n_rows);
                own.push(part);
                rest = after;
            }
        }
        let no_numbers: Vec<Vec<Option<usize>>> = parts
            .into_par_iter()
            .map(|(piece, own)| {
                let mut values = Values::new(places, own, piece.rows.start, rows.start);
                self.visit(piece, &mut values);
                values.no_numbers
            })
            .collect();
        for (place, column) in columns.iter_mut().enumerate() {
            column.no_number = no_numbers.iter().find_map(|of_piece| of_piece[place]);
        }
        columns
    }

    pub fn cell(&self, row: usize, place: usize) -> Cell {
        let mut found = Found { rows_before: 0, place, start: self.bytes.len(), text: String::new() };
        if let Some(piece) = self.pieces.iter().find(|piece| piece.rows.contains(&row)) {
            found.rows_before = row - piece.rows.start;
            self.visit(piece, &mut found);
        }
        Cell { line: Some(self.line(found.start)), text: found.text }
    }

    pub fn ragged_row(&self, n_names: usize) -> Option<RaggedRow> {
        let of_piece = |piece: &Piece| {
            let mut ragged = Ragged { n_names, found: None };
            self.visit(piece, &mut ragged);
            ragged.found
        };
        let (start, n_cells) = self.pieces.par_iter().find_map_first(of_piece)?;
        Some(RaggedRow { line: self.line(start), n_cells })
    }

    /// The line in which this byte stands.
    fn line(&self, byte: usize) -> u64 {
        1 + memchr::memchr_iter(b'\n', &self.bytes[..byte]).count() as u64
    }

    /// Shows the rows of a piece to `visitor`, in order.
    fn visit(&self, piece: &Piece, visitor: &mut impl Visitor) {
        let bytes = &self.bytes[piece.bytes.clone()];
        if self.is_quoted {
            let mut reader = reader(self.delimiter).from_reader(bytes);
            let mut record = csv::ByteRecord::new();
            // Reading from memory does not fail, and a record of bytes may hold anything.
            while reader.read_byte_record(&mut record).unwrap_or(false) {
                let before = record.position().map_or(0, |position| position.byte() as usize);
                // A record may begin with what ended the lines before it.
                let ends = bytes[before..].iter().take_while(|byte| is_line_end(**byte)).count();
                if visitor.row(piece.bytes.start + before + ends, record.iter()).is_break() {
                    return;
                }
            }
        } else {
            let mut start = 0;
            let ends = memchr2_iter(b'\n', b'\r', bytes).chain([bytes.len()]);
            for end in ends {
                let row = &bytes[start..end];
                if !row.is_empty()
                    && visitor.row(piece.bytes.start + start, row.split(|byte| *byte == self.delimiter)).is_break()
                {
                    return;
                }
                start = end + 1;
            }
        }
    }
}

fn reader(delimiter: u8) -> csv::ReaderBuilder {
    let mut builder = csv::ReaderBuilder::new();
    // Cells are trimmed where they are read: the reader would copy each row for it.
    builder.flexible(true).has_headers(false).delimiter(delimiter);
    builder
}

/// What parts the cells: of comma, semicolon and tab the one that stands most often in the header, the first line that is not empty.
pub(crate) fn delimiter(text: &[u8]) -> u8 {
    let header = text.split(|byte| is_line_end(*byte)).find(|line| !line.trim_ascii().is_empty()).unwrap_or_default();
    let count = |delimiter: &u8| header.iter().filter(|byte| *byte == delimiter).count();
    // Of equals the last is taken: a comma where there is none of them.
    [b'\t', b';', b','].into_iter().max_by_key(count).unwrap_or(b',')
}

fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

/// The text from this byte on, cut at line ends.
fn cut(bytes: &[u8], from: usize, size: usize) -> Vec<Range<usize>> {
    let mut pieces = Vec::new();
    let mut start = from;
    while start < bytes.len() {
        let least = bytes.len().min(start + size);
        let end = memchr2(b'\n', b'\r', &bytes[least..]).map_or(bytes.len(), |more| least + more + 1);
        pieces.push(start..end);
        start = end;
    }
    pieces
}

/// Lines that are not empty; `None` where a quote may hide that a line goes on.
fn count_rows(bytes: &[u8]) -> Option<usize> {
    if memchr(b'"', bytes).is_some() {
        return None;
    }
    let mut start = 0;
    let mut count = 0;
    for end in memchr2_iter(b'\n', b'\r', bytes).chain([bytes.len()]) {
        count += usize::from(end > start);
        start = end + 1;
    }
    Some(count)
}

struct Count(usize);

impl Visitor for Count {
    fn row<'a>(&mut self, _: usize, _: impl Iterator<Item = &'a [u8]>) -> ControlFlow<()> {
        self.0 += 1;
        ControlFlow::Continue(())
    }
}

/// Makes numbers of the wanted cells.
struct Values<'a> {
    /// Places of the wanted columns in a row, ascending, each with its number among them.
    wanted: Vec<(usize, usize)>,
    values: Vec<&'a mut [f64]>,
    no_numbers: Vec<Option<usize>>,
    row: usize,
    first: usize,
}

impl<'a> Values<'a> {
    /// `row` is the first that will be seen, `from` the first that is wanted.
    fn new(places: &[usize], values: Vec<&'a mut [f64]>, row: usize, from: usize) -> Self {
        let mut wanted: Vec<(usize, usize)> = places.iter().copied().zip(0..).collect();
        wanted.sort_unstable();
        Self { wanted, no_numbers: vec![None; places.len()], values, row, first: from.max(row) }
    }
}

impl Visitor for Values<'_> {
    fn row<'a>(&mut self, _: usize, cells: impl Iterator<Item = &'a [u8]>) -> ControlFlow<()> {
        let row = self.row;
        self.row += 1;
        if row < self.first {
            return ControlFlow::Continue(());
        }
        let sample = row - self.first;
        if self.values.first().is_none_or(|values| sample >= values.len()) {
            return ControlFlow::Break(());
        }
        let mut cells = cells.enumerate();
        let mut current: (usize, &[u8]) = (usize::MAX, &[]);
        for &(place, column) in &self.wanted {
            if current.0 != place {
                // The next wanted cell; a row that is too short has none.
                current = cells.by_ref().find(|(index, _)| *index == place).unwrap_or((place, &[]));
            }
            let number = std::str::from_utf8(current.1.trim_ascii()).ok().and_then(|cell| cell.parse().ok());
            self.values[column][sample] = number.unwrap_or_else(|| {
                self.no_numbers[column].get_or_insert(row);
                f64::NAN
            });
        }
        ControlFlow::Continue(())
    }
}

/// Looks for one cell.
struct Found {
    rows_before: usize,
    place: usize,
    start: usize,
    text: String,
}

impl Visitor for Found {
    fn row<'a>(&mut self, start: usize, mut cells: impl Iterator<Item = &'a [u8]>) -> ControlFlow<()> {
        if self.rows_before > 0 {
            self.rows_before -= 1;
            return ControlFlow::Continue(());
        }
        self.start = start;
        self.text = String::from_utf8_lossy(cells.nth(self.place).unwrap_or_default().trim_ascii()).into_owned();
        ControlFlow::Break(())
    }
}

/// Looks for a row that does not have a cell for every name, or has more than empty ones.
struct Ragged {
    n_names: usize,
    found: Option<(usize, usize)>,
}

impl Visitor for Ragged {
    fn row<'a>(&mut self, start: usize, cells: impl Iterator<Item = &'a [u8]>) -> ControlFlow<()> {
        let (mut n_cells, mut n_filled) = (0, 0);
        for cell in cells {
            n_cells += 1;
            if !cell.trim_ascii().is_empty() {
                n_filled = n_cells;
            }
        }
        // A delimiter at the end of a row makes an empty cell more.
        if n_filled > self.n_names || n_cells < self.n_names {
            self.found = Some((start, n_cells));
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

#[cfg(test)]
mod tests;
