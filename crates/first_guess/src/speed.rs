//! What a speed column beside a position tells: units of angle and time, and whether both are of one joint.
//!
//! Over windows of the log the change of a position is compared with the integral of its speed, as logged. Their ratio is 1
//! in SI, 180/pi where one of them is in degrees, 1000 where the time is in milliseconds. Sums over windows are not
//! disturbed by noise, as derivatives would be.

use std::f64::consts::PI;

use crate::chosen::Chosen;
use crate::guess::{Factor, FactorReason, Remark};
use crate::table::Table;
use crate::time::UNITS;
use dynid_signal::statistics::median;

/// What the speeds tell.
#[derive(Default)]
pub(crate) struct Told {
    /// Factor of the time.
    pub time: Option<Factor>,
    /// Factor of the positions.
    pub position: Option<Factor>,
    pub remarks: Vec<Remark>,
}

/// A speed and a position belong together from this correlation on.
const SURE: f64 = 0.9;

/// Compares all speeds with all positions.
pub(crate) fn compare(tables: &[Table], chosen: &Chosen) -> Told {
    let mut told = Told::default();
    let mut ratios: Vec<(f64, &str, f64)> = Vec::new();
    let moved: Vec<usize> = chosen.of_kind("tau").filter_map(|column| column.joint()).collect();
    for (joint, speed) in chosen.speeds.iter().enumerate() {
        let Some((column, factor)) = speed else { continue };
        let Some((ratio, correlation)) = ratio(tables, chosen, column, joint) else { continue };
        if correlation > SURE {
            ratios.push((ratio, column, factor.unwrap_or(f64::NAN)));
        } else if correlation < -SURE {
            told.remarks.push(Remark::SpeedAgainstPosition { column: column.clone(), joint });
        } else {
            let fits = |other: &usize| self::ratio(tables, chosen, column, *other).is_some_and(|(_, own)| own > SURE);
            if let Some(&fits) = moved.iter().find(|other| **other != joint && fits(other)) {
                told.remarks.push(Remark::SpeedOfOtherJoint { column: column.clone(), joint, fits });
            }
        }
    }
    let Some(&(_, column, speed_factor)) = ratios.first() else { return told };
    let ratio = median(ratios.iter().map(|(ratio, ..)| *ratio).collect());
    let because = |factor: f64| Factor { factor, reason: FactorReason::Speed { column: column.to_owned(), ratio } };
    if let Some((time, position)) = units(chosen, ratio, speed_factor) {
        told.time = (!chosen.is_time_unit_known).then(|| because(time));
        told.position = (!chosen.is_position_unit_known && position != 1.0).then(|| because(position));
    }
    told
}

/// Factors of time and position that bring `ratio` to 1. What a name says is known; positions and speeds that are both in
/// degrees look like radians here.
fn units(chosen: &Chosen, ratio: f64, speed_factor: f64) -> Option<(f64, f64)> {
    /// How far from 1 the ratio may be.
    const NEAR: f64 = 1.15;
    const ANGLES: [f64; 2] = [1.0, PI / 180.0];
    let named = chosen.of_kind("q").next().map_or(1.0, |column| column.scale());
    let positions = if chosen.is_position_unit_known { vec![named] } else { ANGLES.to_vec() };
    let speeds = if speed_factor.is_nan() { ANGLES.to_vec() } else { vec![speed_factor] };
    let times = match chosen.is_time_unit_known {
        true => vec![chosen.time().scale()],
        false => UNITS.iter().map(|(_, factor)| *factor).collect(),
    };
    let mut found: Option<(f64, f64, f64)> = None;
    for &time in &times {
        for &position in &positions {
            for &speed in &speeds {
                let off = (ratio * speed * time / position).ln().abs();
                // Both in SI are tried first: only what fits clearly better takes their place.
                if found.is_none_or(|(least, ..)| off < least - 0.01) {
                    found = Some((off, time, position));
                }
            }
        }
    }
    found.filter(|(off, ..)| *off < NEAR.ln()).map(|(_, time, position)| (time, position))
}

/// Integral of a speed column over the change of a joint's position, by least squares over windows, and their correlation.
fn ratio(tables: &[Table], chosen: &Chosen, speed: &str, joint: usize) -> Option<(f64, f64)> {
    /// Windows in a log, and rows in a window at least.
    const WINDOWS: usize = 200;
    const LEAST_ROWS: usize = 4;
    let position = chosen.of_kind("q").find(|column| column.joint() == Some(joint))?;
    let (mut both, mut of_speed, mut of_position) = (0.0, 0.0, 0.0);
    for table in tables {
        let (t, dq) = (table.column(&chosen.time().name)?, table.column(speed)?);
        let q = without_turns(table.column(&position.name)?, position.turn);
        let window = (t.len() / WINDOWS).max(LEAST_ROWS);
        for from in (0..t.len().saturating_sub(window)).step_by(window) {
            let steps = from..from + window;
            let integral: f64 = steps.map(|k| 0.5 * (dq[k] + dq[k + 1]) * (t[k + 1] - t[k])).sum();
            let change = q[from + window] - q[from];
            if integral.is_finite() && change.is_finite() {
                both += integral * change;
                of_speed += integral * integral;
                of_position += change * change;
            }
        }
    }
    let size = of_speed * of_position;
    (size > 0.0).then(|| (both / of_position, both / size.sqrt()))
}

fn without_turns(q: &[f64], turn: Option<f64>) -> Vec<f64> {
    let Some(turn) = turn else { return q.to_vec() };
    let mut before = q[0];
    let unwrapped = q.iter().map(|q| {
        before = q + turn * ((before - q) / turn).round();
        before
    });
    unwrapped.collect()
}
