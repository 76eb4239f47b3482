//! Changes of a table in text: columns, rows, cells, the ends of its lines.

use super::{LARGEST, NUMBERS, WORDS, binary, text};
use crate::draw::Draw;

/// Some random changes.
pub fn of(seed: &[u8], others: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    let text = String::from_utf8_lossy(seed);
    let mut rows: Vec<Vec<String>> = text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect();
    for _ in 0..draw.size(5) {
        change(&mut rows, draw);
    }
    let delimiter = *draw.of_these(&[",", ",", ",", ",", ";", "\t", ", ", " "]);
    let end = *draw.of_these(&["\n", "\n", "\n", "\r\n", "\r", "\n\n"]);
    let mut bytes = Vec::new();
    for row in &rows {
        bytes.extend(row.join(delimiter).bytes());
        bytes.extend(end.bytes());
        if bytes.len() > LARGEST {
            break;
        }
    }
    if draw.one_in(8) {
        bytes.truncate(bytes.len().saturating_sub(draw.size(40)));
    }
    if draw.one_in(8) {
        let none = Vec::new();
        let other = if others.is_empty() { &none } else { draw.of_these(others).as_slice() };
        for _ in 0..draw.size(6) {
            binary::change(&mut bytes, other, draw);
        }
    }
    if draw.one_in(32) {
        bytes = text::in_another_encoding(&bytes, draw);
    }
    bytes
}

fn word(draw: &mut Draw) -> String {
    let words: &[&str] = if draw.one_in(3) { &WORDS } else { &NUMBERS };
    (*draw.of_these(words)).to_owned()
}

fn change(rows: &mut Vec<Vec<String>>, draw: &mut Draw) {
    let n_rows = rows.len();
    let n_columns = rows.first().map_or(0, Vec::len);
    let column = draw.below(n_columns);
    let row = draw.below(n_rows);
    // Of each row that has such a cell.
    let cells = |rows: &mut Vec<Vec<String>>, change: &mut dyn FnMut(usize, &mut String)| {
        for (at, row) in rows.iter_mut().enumerate() {
            if let Some(cell) = row.get_mut(column) {
                change(at, cell);
            }
        }
    };
    match draw.below(18) {
        // Twice, under the same name.
        0 => rows.iter_mut().for_each(|row| {
            if let Some(cell) = row.get(column).cloned() {
                row.push(cell);
            }
        }),
        1 => rows.iter_mut().filter(|row| column < row.len()).for_each(|row| drop(row.remove(column))),
        2 => {
            let with = draw.below(n_columns);
            rows.iter_mut().filter(|row| column.max(with) < row.len()).for_each(|row| row.swap(column, with));
        }
        3 => {
            let name = word(draw);
            cells(rows, &mut |at, cell| {
                if at == 0 {
                    cell.clone_from(&name);
                }
            });
        }
        4 => {
            let constant = word(draw);
            cells(rows, &mut |at, cell| {
                if at > 0 {
                    cell.clone_from(&constant);
                }
            });
        }
        5..=7 => {
            let new = word(draw);
            if let Some(cell) = rows.get_mut(row).and_then(|row| row.get_mut(column)) {
                *cell = new;
            }
        }
        // Times that jitter.
        8 => cells(rows, &mut |_, cell| {
            if let Ok(number) = cell.parse::<f64>() {
                *cell = (number + 0.002 * draw.normal()).to_string();
            }
        }),
        // A factor.
        9 => {
            let factor = *draw.of_these(&[0.0, -1.0, 1e-300, 1e300, 1e-310, 57.3, 1000.0]);
            cells(rows, &mut |_, cell| {
                if let Ok(number) = cell.parse::<f64>() {
                    *cell = (number * factor).to_string();
                }
            });
        }
        // A gap.
        10 if n_rows > 1 => {
            let end = (row + draw.size(200)).min(n_rows);
            rows.drain(row.max(1).min(end)..end);
        }
        11 if n_rows > 0 => {
            let own = rows[row].clone();
            rows.insert(row, own);
        }
        12 if n_rows > 0 => {
            let with = draw.below(n_rows);
            rows.swap(row, with);
        }
        13 => {
            if let Some(row) = rows.get_mut(row) {
                row.push(word(draw));
            }
        }
        14 => {
            if let Some(row) = rows.get_mut(row) {
                row.truncate(column);
            }
        }
        // Many columns.
        15 if draw.one_in(20) => {
            let count = draw.size(100_000);
            rows.truncate(4);
            for (at, row) in rows.iter_mut().enumerate() {
                row.extend((0..count).map(|more| if at == 0 { format!("c{more}") } else { "0".to_owned() }));
            }
        }
        // A long cell.
        16 if draw.one_in(20) => {
            let length = draw.size(100_000);
            if let Some(cell) = rows.get_mut(row).and_then(|row| row.get_mut(column)) {
                *cell = draw.of_these(&["9", "é", "\"", "q"]).repeat(length);
            }
        }
        17 => {
            if let Some(cell) = rows.get_mut(row).and_then(|row| row.get_mut(column)) {
                *cell = format!("\"{cell}\"");
            }
        }
        _ => {}
    }
}
