//! The numbers of the selected rows, in SI, and the first thing that is wrong with them.

use std::{ops::Range, path::Path};

use dynid_tables::Table;
use rayon::prelude::*;

use super::{LogError, Repeated};

/// One column of the file that the log needs.
pub(super) struct Column {
    /// Its place in a row.
    pub index: usize,
    /// Its name in the file.
    pub name: String,
    /// To SI.
    pub scale: f64,
    /// How much a turn of its encoder is, in SI, where that begins anew after each.
    pub turn: Option<f64>,
    /// Its value before the selected rows, where its encoder begins anew: the turns are counted from the first row of the file, so that all
    /// parts of a log agree.
    pub before: Option<f64>,
    /// Values of the selected rows: as they stand in the file, then in SI.
    pub values: Vec<f64>,
}

impl Column {
    /// A value in SI, with the turns that the encoder has forgotten.
    fn in_si(&self, number: f64, before: Option<f64>) -> f64 {
        let value = number * self.scale;
        match (self.turn, before) {
            (Some(turn), Some(before)) => value + turn * ((before - value) / turn).round(),
            _ => value,
        }
    }

    /// Counts the turns of rows that are not selected. Cells that are no numbers do not matter there.
    fn pass(&mut self, numbers: &[f64]) {
        for number in numbers.iter().filter(|number| number.is_finite()) {
            self.before = Some(self.in_si(*number, self.before));
        }
    }

    /// Brings the first `n_rows` to SI and drops the rest, and those to leave out; the first that holds no finite number, if there is one.
    fn bring_to_si(&mut self, n_rows: usize, left_out: &[usize]) -> Option<usize> {
        let mut left_out = left_out.iter().copied().peekable();
        let mut before = self.before;
        let mut kept = 0;
        for row in 0..n_rows {
            if left_out.next_if_eq(&row).is_some() {
                continue;
            }
            let value = self.in_si(self.values[row], before);
            if !value.is_finite() {
                return Some(row);
            }
            before = Some(value);
            self.values[kept] = value;
            kept += 1;
        }
        self.values.truncate(kept);
        None
    }
}

/// Reads the selected rows into the columns (the first is time); returns which of them were left out.
pub(super) fn read_rows(
    path: &Path,
    table: &Table,
    rows: Range<usize>,
    repeated: Repeated,
    columns: &mut [&mut Column],
) -> Result<Vec<usize>, LogError> {
    let from = rows.start;
    let mut turning: Vec<&mut Column> = columns.iter_mut().map(|column| &mut **column).collect();
    turning.retain(|column| column.turn.is_some());
    let unreadable = |error| LogError::of_table(path, error);
    let earlier =
        table.columns(&turning.iter().map(|column| column.index).collect::<Vec<_>>(), 0..from).map_err(unreadable)?;
    turning.into_iter().zip(earlier).for_each(|(column, earlier)| column.pass(&earlier.values));
    let selected =
        table.columns(&columns.iter().map(|column| column.index).collect::<Vec<_>>(), rows).map_err(unreadable)?;
    columns.iter_mut().zip(selected).for_each(|(column, selected)| column.values = selected.values);

    let times = Times::of(columns[0], repeated);
    // Of a row whose time is wrong, the other cells come first: they may say why.
    let n_rows = times.wrong.as_ref().map_or(columns[0].values.len(), |wrong| wrong.row + 1);
    let no_numbers: Vec<Option<usize>> =
        columns.par_iter_mut().map(|column| column.bring_to_si(n_rows, &times.left_out)).collect();
    let first = no_numbers.iter().zip(0..).filter_map(|(row, place)| Some(((*row)?, place))).min();
    if let Some((row, place)) = first {
        let Column { index, name, .. } = &*columns[place];
        let cell = table.cell(from + row, *index).map_err(unreadable)?;
        return Err(LogError::NotANumber {
            path: path.to_owned(),
            line: cell.line,
            row: from + row,
            column: name.clone(),
            found: if cell.text.is_empty() { "nothing".to_owned() } else { format!("`{}`", cell.text) },
        });
    }
    if let Some(NotRising { row, before, now }) = times.wrong {
        return Err(LogError::TimeNotRising {
            path: path.to_owned(),
            line: table.cell(from + row, columns[0].index).map_err(unreadable)?.line,
            row: from + row,
            column: columns[0].name.clone(),
            what: if now < before { "runs backwards" } else { "stands still" },
            before,
            now,
            remedy: if now < before {
                "sort the log, or split it where it restarts (rows = [from, to])"
            } else {
                "leave such rows out (repeated_times = \"skip\" in the experiment), or give each its own time"
            },
        });
    }
    Ok(times.left_out.into_iter().map(|row| from + row).collect())
}

/// What the times say of rows, which count from the first selected one.
struct Times {
    /// Rows that repeat a time and are to be left out, ascending.
    left_out: Vec<usize>,
    /// The first whose time is not above that before. What follows is not looked at.
    wrong: Option<NotRising>,
}

struct NotRising {
    row: usize,
    /// Time of the row before (s).
    before: f64,
    /// Time of this row (s).
    now: f64,
}

impl Times {
    /// Up to the first time that is no finite number.
    fn of(column: &Column, repeated: Repeated) -> Self {
        let mut times = Self { left_out: Vec::new(), wrong: None };
        let mut last = None;
        let mut turned = column.before;
        for (row, number) in column.values.iter().enumerate() {
            let now = column.in_si(*number, turned);
            if !now.is_finite() {
                break;
            }
            turned = Some(now);
            match last {
                Some(before) if now == before && repeated == Repeated::Skip => times.left_out.push(row),
                Some(before) if now <= before => {
                    times.wrong = Some(NotRising { row, before, now });
                    break;
                }
                _ => last = turned,
            }
        }
        times
    }
}
