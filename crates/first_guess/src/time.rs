//! The time column: which one it is, its unit, stamps that stand twice.

use dynid_signal::{median_step, statistics::median};
use dynid_tables::Cell;

use crate::chosen::Chosen;
use crate::guess::{Factor, FactorReason, Remark};
use crate::names::{Meaning, Quantity};
use crate::table::Table;
use crate::{ColumnGuess, FirstGuessError, WhyColumn};

/// The time column of the logs.
pub(crate) fn choose(tables: &[Table], meanings: &[Meaning]) -> Result<ColumnGuess, FirstGuessError> {
    let first = &tables[0];
    let is_named = |place: &usize| meanings[*place].quantity == Some(Quantity::Time);
    let of_all = |place: usize| tables.iter().filter_map(move |table| table.column(&first.names[place]));
    let mut named: Vec<usize> = (0..first.names.len()).filter(is_named).collect();
    named.sort_by_key(|place| meanings[*place].unknown.len());
    let rising: Vec<usize> = named.iter().copied().filter(|place| of_all(*place).all(mostly_rises)).collect();
    let name = |place: usize| first.names[place].clone();
    let guess = |place: usize, why, others: &[usize]| ColumnGuess {
        logical: "t".to_owned(),
        name: name(place),
        why,
        others: others.iter().filter(|other| **other != place).map(|other| name(*other)).collect(),
        factors: Vec::new(),
        turn: None,
    };
    let unit_of = |place: usize| meanings[place].unit.filter(|unit| unit.quantity == Quantity::Time);
    let unit = |place: usize| unit_of(place).map(|unit| unit.factor);
    if let Some(&place) = rising.first() {
        let why = if name(place) == "t" { WhyColumn::OwnName } else { WhyColumn::OnlyOne };
        let mut own = guess(place, why, &rising);
        own.factors.extend(
            unit_of(place)
                .filter(|unit| unit.factor != 1.0)
                .map(|unit| Factor { factor: unit.factor, reason: FactorReason::UnitInName { unit: unit.name } }),
        );
        return Ok(own);
    }
    named.iter().try_for_each(|place| refuse_words(tables, &first.names[*place]))?;
    let whole = named.iter().find(|place| unit(**place).is_none_or(|factor| factor == 1.0));
    let part = named.iter().find(|place| unit(**place).is_some_and(|factor| factor < 1.0));
    if let (Some(&whole), Some(&part)) = (whole, part) {
        let (whole, part) = (name(whole), name(part));
        return Err(FirstGuessError::TimeInParts { path: first.path.clone(), whole, part });
    }
    let even = (0..first.names.len()).find(|place| of_all(*place).all(rises_evenly));
    let even = even.map(|place| guess(place, WhyColumn::RisesEvenly, &[]));
    even.ok_or_else(|| FirstGuessError::NoTime { path: first.path.clone(), available: first.header() })
}

/// A time must have a number in every row.
pub(crate) fn refuse_words(tables: &[Table], name: &str) -> Result<(), FirstGuessError> {
    let found = tables.iter().find_map(|table| Some((table, table.no_number(name)?)));
    let Some((table, cell)) = found else { return Ok(()) };
    let Cell { line, text } = cell.clone();
    let remedy = if text.contains(',') && text.replace(',', ".").parse::<f64>().is_ok() {
        "write decimal points, not commas"
    } else if line == Some(FIRST_LINE) {
        "take lines between the header and the numbers out; a name may say the unit, as in `t [ms]`"
    } else {
        "repair the row, or take it out"
    };
    Err(FirstGuessError::TimeIsNoNumber { path: table.path.clone(), line, column: name.to_owned(), cell: text, remedy })
}

/// The line below the header.
const FIRST_LINE: u64 = 2;

/// Never falls, and does not stand still for long: stamps of a coarser clock stand a few times each, whole seconds many times.
fn mostly_rises(t: &[f64]) -> bool {
    /// Of so many rows one must rise.
    const ROWS: usize = 4;
    let rising = t.windows(2).filter(|pair| pair[1] > pair[0]).count();
    t.windows(2).all(|pair| pair[1] >= pair[0]) && ROWS * rising >= t.len() - 1
}

fn rises_evenly(t: &[f64]) -> bool {
    /// A step may be off the typical one by this share of it.
    const UNEVEN: f64 = 0.2;
    let typical = median_step(t);
    typical > 0.0 && t.windows(2).all(|pair| ((pair[1] - pair[0]) / typical - 1.0).abs() < UNEVEN)
}

/// Whether stamps stand twice.
pub(crate) fn repeated(tables: &[Table], chosen: &Chosen, remarks: &mut Vec<Remark>) -> bool {
    let before = remarks.len();
    for table in tables {
        let t = table.column(&chosen.time().name).unwrap_or_default();
        let count = t.windows(2).filter(|pair| pair[1] == pair[0]).count();
        if count > 0 {
            let percent = 100.0 * count as f64 / t.len() as f64;
            remarks.push(Remark::RepeatedTimes { log: table.name(), count, percent });
        }
    }
    remarks.len() > before
}

/// Units of time and their factors.
pub(crate) const UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];

/// The unit of a time whose name does not say it: what the speeds tell, else seconds, unless the sample rate is no robot's then. The
/// project's own name says seconds, which only speeds contradict.
pub(crate) fn factor(tables: &[Table], chosen: &mut Chosen, told: Option<&Factor>, remarks: &mut Vec<Remark>) {
    if chosen.is_time_unit_known {
        return;
    }
    let time = chosen.time();
    let step = typical_step(tables, &time.name);
    match told {
        Some(told) if told.factor != 1.0 => chosen.columns[0].factors.push(told.clone()),
        Some(_) => {}
        None if step * SLOWEST_HZ <= 1.0 => {}
        None if time.why == WhyColumn::OwnName => {
            remarks.push(Remark::RowsFarApart { column: time.name.clone(), step_s: step });
        }
        None => chosen.columns[0].factors.push(by_rate(step)),
    }
}

/// Below that, rows tell nothing of a motion. Whole numbers, as clocks count them, are never more in seconds than half of it.
const SLOWEST_HZ: f64 = 2.0;

/// The part of a second in which the sample rate is most like a robot's.
fn by_rate(step: f64) -> Factor {
    /// Robots are sampled at 10 Hz to 10 kHz: the middle of that, as a ratio.
    const TYPICAL_HZ: f64 = 316.0;
    let far = |factor: f64| (step * factor * TYPICAL_HZ).ln().abs();
    let nearest = UNITS[1..].iter().min_by(|a, b| far(a.1).total_cmp(&far(b.1)));
    let &(unit, factor) = nearest.unwrap_or(&UNITS[1]);
    Factor { factor, reason: FactorReason::SampleRate { unit, step, rate_hz: 1.0 / (step * factor) } }
}

/// In the log's own unit, of rows that rise; 1 where none does.
fn typical_step(tables: &[Table], name: &str) -> f64 {
    let times = tables.iter().filter_map(|table| table.column(name));
    let steps: Vec<f64> =
        times.flat_map(|t| t.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0)).collect();
    if steps.is_empty() { 1.0 } else { median(steps) }
}
