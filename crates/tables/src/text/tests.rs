use proptest::prelude::*;

use super::*;

/// Cells as logs have them; `quotes` says whether some are quoted.
fn cell(quotes: bool) -> BoxedStrategy<String> {
    let number = (-1e3..1e3).prop_map(|number: f64| number.to_string());
    let plain = vec!["", " ", "0", " -1.5e-3 ", "\t2", "NaN", "inf", "much", "1.2.3", "µ", "3 4", "+.5"];
    let plain = prop_oneof![6 => number, 2 => proptest::sample::select(plain).prop_map(str::to_owned)];
    if !quotes {
        return plain.boxed();
    }
    let quoted = vec!["\"\"", "\"1.5\"", "\"a\nb\"", "\"1,2;3\"", "\" 7\r\n\"", "\"a \"\"b\"\"\"", "4\"", "\"9"];
    prop_oneof![8 => plain, 1 => proptest::sample::select(quoted).prop_map(str::to_owned)].boxed()
}

/// A header and rows of about as many cells, parted by `delimiter`.
fn file() -> impl Strategy<Value = Vec<u8>> {
    let delimiter = proptest::sample::select(&[",", ";", "\t"][..]);
    let header = proptest::sample::select(&["", "\u{feff}"][..]);
    (delimiter, header, any::<bool>(), 1..5usize).prop_flat_map(|(delimiter, mark, quotes, n_names)| {
        let row = proptest::collection::vec(cell(quotes), n_names.max(2) - 1..n_names + 2);
        let end =
            prop_oneof![6 => Just("\n"), 3 => Just("\r\n"), 1 => Just("\r"), 1 => Just("\n\n"), 1 => Just("\r\n \r\n")];
        let header_end = prop_oneof![Just("\n"), Just("\r\n"), Just("\n\n")];
        let rows = proptest::collection::vec((row, end), 0..30);
        (rows, header_end, any::<bool>()).prop_map(move |(rows, header_end, ends)| {
            let names: Vec<String> = (0..n_names).map(|name| format!(" x{name}")).collect();
            let mut text = format!("{mark}{}{header_end}", names.join(delimiter));
            for (row, end) in &rows {
                text.push_str(&row.join(delimiter));
                text.push_str(end);
            }
            if !ends {
                text.truncate(text.trim_end_matches(['\r', '\n']).len());
            }
            text.into_bytes()
        })
    })
}

/// All records by the `csv` crate alone: the line of each and its cells.
fn records(bytes: &[u8]) -> (Vec<String>, Vec<(u64, Vec<String>)>) {
    let first_line = bytes.split(|byte| *byte == b'\n').next().unwrap();
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .delimiter(delimiter(first_line))
        .from_reader(bytes);
    let header = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let records = reader.byte_records().map(|record| {
        let record = record.unwrap();
        let mut start = record.position().unwrap().byte() as usize;
        while matches!(bytes.get(start), Some(b'\r' | b'\n')) {
            start += 1;
        }
        let line = 1 + bytes[..start].iter().filter(|byte| **byte == b'\n').count() as u64;
        (line, record.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect())
    });
    (header, records.collect())
}

proptest! {
    /// In pieces of any size, a text has the rows, numbers, cells and lines that the `csv` crate finds in it.
    #[test]
    fn pieces_hold_what_the_csv_crate_reads(bytes in file(), size in 1..60usize, cuts in (0..40usize, 0..40usize)) {
        let (header, records) = records(&bytes);
        let (names, text) = Text::in_pieces_of(size, bytes).unwrap();
        prop_assert_eq!(&names, &header);
        prop_assert_eq!(text.n_rows(), records.len());

        let from = cuts.0.min(records.len());
        let to = (from + cuts.1).min(records.len());
        // From the right to the left, and one of them twice.
        let places: Vec<usize> = (0..names.len()).rev().chain([0]).collect();
        let columns = text.columns(&places, from..to);
        for (column, place) in columns.iter().zip(&places) {
            let cells = records[from..to].iter().map(|(_, cells)| cells.get(*place).map_or("", String::as_str));
            let numbers: Vec<Option<f64>> = cells.map(|cell| cell.parse().ok()).collect();
            let bits = |value: f64| if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() };
            let expected: Vec<u64> = numbers.iter().map(|number| bits(number.unwrap_or(f64::NAN))).collect();
            prop_assert_eq!(column.values.iter().map(|value| bits(*value)).collect::<Vec<_>>(), expected);
            let no_number = numbers.iter().position(Option::is_none).map(|row| from + row);
            prop_assert_eq!(column.no_number, no_number);
        }
        for (row, (line, cells)) in records.iter().enumerate() {
            for place in 0..names.len() {
                let expected = Cell { line: Some(*line), text: cells.get(place).cloned().unwrap_or_default() };
                prop_assert_eq!(text.cell(row, place), expected);
            }
        }
        let is_ragged = |(_, cells): &&(u64, Vec<String>)| {
            let n_filled = cells.iter().rposition(|cell| !cell.is_empty()).map_or(0, |last| last + 1);
            cells.len() < names.len() || n_filled > names.len()
        };
        let ragged = records.iter().find(is_ragged);
        let ragged = ragged.map(|(line, cells)| RaggedRow { line: *line, n_cells: cells.len() });
        prop_assert_eq!(text.ragged_row(names.len()), ragged);
    }
}

#[test]
fn a_quote_below_the_header_makes_one_piece_and_one_in_the_header_does_not() {
    let rows = "0,1\n".repeat(10);
    let n_pieces = |text: String| Text::in_pieces_of(8, text.into_bytes()).unwrap().1.pieces.len();
    assert_eq!(n_pieces(format!("\"t\",\"q\"\n{rows}")), 4);
    assert_eq!(n_pieces(format!("t,q\n{rows}\"2\",1\n")), 1);
}
