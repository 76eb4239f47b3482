//! The series of one quantity of one robot.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use crate::{Estimate, LARGEST, median};

/// Estimates of one quantity of one robot, night by night.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Which robot.
    pub robot: String,
    /// Which quantity.
    pub quantity: String,
    /// Places of the nights that have an estimate, rising.
    pub nights: Vec<usize>,
    /// Values in these nights.
    pub values: Vec<f64>,
    /// Their standard errors.
    pub std_errors: Vec<f64>,
}

impl Series {
    /// Nights that have an estimate.
    pub fn len(&self) -> usize {
        self.nights.len()
    }

    /// Without any; no series of [`crate::analyse`] is.
    pub fn is_empty(&self) -> bool {
        self.nights.is_empty()
    }
}

/// All names, in their order: numbers by their sizes, whole numbers also within words.
pub(crate) fn names(estimates: &[Estimate], of: impl Fn(&Estimate) -> &String) -> Vec<String> {
    let mut all: Vec<&String> = estimates.iter().map(of).collect();
    all.sort_by(|a, b| by_number(a, b));
    all.dedup();
    all.into_iter().cloned().collect()
}

fn by_number(a: &str, b: &str) -> Ordering {
    match (a.parse::<f64>(), b.parse::<f64>()) {
        (Ok(one), Ok(other)) => one.total_cmp(&other).then_with(|| a.cmp(b)),
        (Ok(_), Err(_)) => Ordering::Less,
        (Err(_), Ok(_)) => Ordering::Greater,
        (Err(_), Err(_)) => parts(a).cmp(&parts(b)).then_with(|| a.cmp(b)),
    }
}

/// Words and the whole numbers after them, which are compared by their sizes: `n2` comes before `n10`.
fn parts(name: &str) -> Vec<(&str, usize, &str)> {
    let (mut parts, mut rest) = (Vec::new(), name);
    while !rest.is_empty() {
        let (word, after) = rest.split_at(rest.find(|own: char| own.is_ascii_digit()).unwrap_or(rest.len()));
        let (digits, after) = after.split_at(after.find(|own: char| !own.is_ascii_digit()).unwrap_or(after.len()));
        let number = digits.trim_start_matches('0');
        parts.push((word, number.len(), number));
        rest = after;
    }
    parts
}

/// Series by quantity, then robot. Of several estimates of a night the last is taken.
pub(crate) fn of(estimates: &[Estimate], robots: &[String], nights: &[String]) -> Vec<Series> {
    let place = |all: &[String], name: &String| all.iter().position(|own| own == name);
    let places = |all: &[String]| -> BTreeMap<String, usize> {
        all.iter().filter_map(|name| Some((name.clone(), place(all, name)?))).collect()
    };
    let (robots_by_name, nights_by_name) = (places(robots), places(nights));
    /// Value and standard error by the place of the night.
    type ByNight = BTreeMap<usize, (f64, f64)>;
    let mut found: BTreeMap<(&String, usize), ByNight> = BTreeMap::new();
    for own in estimates.iter().filter(|own| own.value.abs() <= LARGEST) {
        let known = Some(own.std_error).filter(|error| error.is_finite() && *error > 0.0).unwrap_or(0.0);
        let series = found.entry((&own.quantity, robots_by_name[&own.robot])).or_default();
        series.insert(nights_by_name[&own.night], (own.value, known));
    }
    found
        .into_iter()
        .map(|((quantity, robot), own)| Series {
            robot: robots[robot].clone(),
            quantity: quantity.clone(),
            nights: own.keys().copied().collect(),
            values: own.values().map(|(value, _)| *value).collect(),
            std_errors: own.values().map(|(_, error)| *error).collect(),
        })
        .collect()
}

/// Robots that must share a night before something is called common to them.
const LEAST_ROBOTS: usize = 5;

/// Takes out what all robots do alike (a cold night, the season): the median over robots of how far each is from its own middle. A night
/// that fewer than five robots share has what the nearest night with so many has, so that robots which leave make no step.
pub(crate) fn without_common(own: &mut [Series], n_nights: usize) {
    let middles: Vec<f64> = own.iter().filter_map(|own| median(own.values.clone())).collect();
    let known: Vec<(usize, f64)> = (0..n_nights)
        .filter_map(|night| {
            let away = own.iter().zip(&middles).filter_map(|(own, middle)| {
                let at = own.nights.binary_search(&night).ok()?;
                Some(own.values[at] - middle)
            });
            let away: Vec<f64> = away.collect();
            (away.len() >= LEAST_ROBOTS).then(|| median(away)).flatten().map(|common| (night, common))
        })
        .collect();
    let nearest =
        |night: usize| known.iter().min_by_key(|(own, _)| own.abs_diff(night)).map_or(0.0, |(_, common)| *common);
    for series in own {
        for (night, value) in series.nights.iter().zip(&mut series.values) {
            *value -= nearest(*night);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ordered_with_numbers_by_their_sizes() {
        let night = |night: &str| Estimate {
            robot: "r".to_owned(),
            night: night.to_owned(),
            quantity: "p".to_owned(),
            value: 0.0,
            std_error: 0.0,
        };
        let ordered = |all: &[&str]| names(&all.iter().map(|own| night(own)).collect::<Vec<_>>(), |own| &own.night);
        assert_eq!(ordered(&["n10", "n2", "n1", "n2"]), ["n1", "n2", "n10"]);
        assert_eq!(ordered(&["2026-10-01", "2026-9-30", "2026-09-01"]), ["2026-09-01", "2026-9-30", "2026-10-01"]);
        assert_eq!(ordered(&["10", "late", "2.5", "n01b", "n1b"]), ["2.5", "10", "late", "n01b", "n1b"]);
    }
}
