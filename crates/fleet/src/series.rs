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

/// All names, numbers in their order and others in theirs.
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
        (Err(_), Err(_)) => a.cmp(b),
    }
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
