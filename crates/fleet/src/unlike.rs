//! Robots that are unlike the others of their fleet.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::{Estimate, Level, Series, Settings, change::Explained, median};

/// Robots that a fleet must have before one of them is unlike the others.
const LEAST_ROBOTS: usize = 5;
/// Standard deviation of normal numbers over the median of their distances from the middle.
const OF_MEDIAN: f64 = 1.482_602_218_505_602;
/// Degrees of freedom of that spread, as a share of the robots: its asymptotic efficiency.
const EFFICIENCY: f64 = 0.37;

/// A robot whose value is far from that of the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unlike {
    /// Which robot.
    pub robot: String,
    /// In what.
    pub quantity: String,
    /// Its value in its last night, without what all robots do alike.
    pub value: f64,
    /// Standard error of that.
    pub std_error: f64,
    /// The middle of the fleet.
    pub middle: f64,
    /// Standard deviation of robots about it.
    pub spread: f64,
    /// Probability that any robot of a normal fleet is as far in any quantity.
    pub chance: f64,
}

/// A robot that does not have what most others have: an effect that its model lacks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lacking {
    /// Which robot.
    pub robot: String,
    /// What.
    pub quantity: String,
    /// Robots that have it.
    pub others: usize,
}

/// Of the series of one quantity.
pub(crate) fn unlike(
    series: &[Series],
    explained: &[Explained],
    settings: &Settings,
    n_quantities: usize,
) -> Vec<Unlike> {
    let n = series.len();
    let middle = median(explained.iter().map(|own| own.last).collect()).unwrap_or(0.0);
    let spread = OF_MEDIAN * median(explained.iter().map(|own| (own.last - middle).abs()).collect()).unwrap_or(0.0);
    let level = Level { looks: n * n_quantities, false_alarms: settings.false_alarms };
    let of = |(series, own): (&Series, &Explained)| {
        let size = (spread * spread + own.std_error * own.std_error).sqrt();
        let chance = level.chance((own.last - middle) / size, EFFICIENCY * n as f64);
        // Where most are alike to the last digit nobody knows how far robots may be from each other.
        (n >= LEAST_ROBOTS && spread > 0.0 && level.is_sure(chance)).then(|| Unlike {
            robot: series.robot.clone(),
            quantity: series.quantity.clone(),
            value: own.last,
            std_error: own.std_error,
            middle,
            spread,
            chance,
        })
    };
    series.iter().zip(explained).filter_map(of).collect()
}

/// What most robots have and some have not: that a night could not tell a number is no lack.
pub(crate) fn lacking(estimates: &[Estimate], robots: &[String]) -> Vec<Lacking> {
    let mut have: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for own in estimates {
        have.entry(&own.quantity).or_default().insert(&own.robot);
    }
    let common = have.into_iter().filter(|(_, own)| robots.len() >= LEAST_ROBOTS && 2 * own.len() > robots.len());
    let mut lacking: Vec<Lacking> = common
        .flat_map(|(quantity, own)| {
            let without: Vec<&String> = robots.iter().filter(|robot| !own.contains(robot.as_str())).collect();
            let others = own.len();
            without.into_iter().map(move |robot| Lacking {
                robot: robot.clone(),
                quantity: quantity.to_owned(),
                others,
            })
        })
        .collect();
    lacking.sort_by(|a, b| (&a.robot, &a.quantity).cmp(&(&b.robot, &b.quantity)));
    lacking
}
