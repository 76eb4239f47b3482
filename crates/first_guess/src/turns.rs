//! Encoders that begin anew after each turn.

use std::f64::consts::TAU;

use dynid_check::columns::wraps;

use crate::chosen::{Chosen, scale_positions};
use crate::guess::{Factor, FactorReason};
use crate::table::Table;
use dynid_model::{Device, JointKind};

/// Notes how much a turn is where a position jumps by one, and what that says of its unit.
pub(crate) fn factors(device: &Device, tables: &[Table], chosen: &mut Chosen) {
    let mut are_degrees = None;
    for column in chosen.columns.iter_mut().filter(|column| column.kind() == "q") {
        let is_angle = column.joint().is_some_and(|joint| device.joints[joint].kind == JointKind::Revolute);
        let turn = if is_angle { turn_of(tables, &column.name) } else { None };
        column.turn = turn;
        let Some(turn) = turn.filter(|_| column.factors.is_empty()) else { continue };
        let factor = Factor { factor: TAU / turn, reason: FactorReason::Turn { turn } };
        if turn == DEGREES {
            are_degrees = Some(factor);
        } else if turn != TAU {
            column.factors.push(factor);
        }
        chosen.is_position_unit_known = true;
    }
    // Who logs one angle in degrees logs all so.
    if let Some(factor) = are_degrees {
        scale_positions(device, &mut chosen.columns, &factor);
    }
}

const DEGREES: f64 = 360.0;

/// A turn of a column in its own unit: in radians, in degrees, or, of whole numbers, a power of two.
fn turn_of(tables: &[Table], name: &str) -> Option<f64> {
    /// Bits of an encoder, at least and at most.
    const BITS: std::ops::RangeInclusive<i32> = 8..=24;
    /// What begins anew stays within a turn; so much more noise may make of it. What leaves it jumps for another reason: rows are lost.
    const WITHIN: f64 = 1.1;
    let logs: Vec<&[f64]> = tables.iter().filter_map(|table| table.column(name)).collect();
    let are_whole = logs.iter().all(|q| q.iter().all(|q| q.fract() == 0.0));
    let counts = BITS.filter(|_| are_whole).map(|bits| 2.0_f64.powi(bits));
    let mut turns = [TAU, DEGREES].into_iter().chain(counts);
    let stays_within = |turn: &f64| logs.iter().all(|q| range(q) <= WITHIN * turn);
    turns.find(|turn| stays_within(turn) && logs.iter().any(|q| wraps(q, *turn).is_some()))
}

fn range(q: &[f64]) -> f64 {
    let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
    high - low
}
