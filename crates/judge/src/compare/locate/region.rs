//! In which samples an error lies: near reversals, at high speed, at large torque, on one side, early or late.
//!
//! The share of the squared error in a region stands beside the share of samples in it. The test is on
//! `(e^2 / mean(e^2) - 1) (inside - share of samples)`, whose sum is zero in the mean when the error does not care; how
//! uncertain the sum is, the spread of the squares within and without the region tells.

use super::{AlsoIn, Finding, FindingKind, Region, Side, Third, trace::Trace};
use dynid_signal::statistics::standard_errors;

/// Surpluses below so many standard errors may be chance; more than a normal variable needs, for squares have long tails.
const STANDARD_ERRORS: f64 = 5.0;

/// A region holds a finding when its density of squared error is so many times that of the whole.
const DENSER: f64 = 1.3;

/// Samples within this share of the typical time between reversals are near one.
const NEAR_REVERSAL: f64 = 0.15;

/// A region with its samples.
struct Samples {
    region: Region,
    inside: Vec<bool>,
}

/// The regions that hold more of the squared error than chance gives them.
pub fn findings(trace: &Trace) -> Vec<Finding> {
    let n_used = trace.n_used() as f64;
    let mean_square = trace.power() / n_used;
    let surplus: Vec<f64> = trace
        .residual
        .iter()
        .zip(&trace.used)
        .map(|(value, used)| if *used { value * value / mean_square - 1.0 } else { 0.0 })
        .collect();
    let mut found: Vec<(Samples, Finding)> = Vec::new();
    for samples in regions(trace) {
        let counts = |k: &usize| trace.used[*k] && samples.inside[*k];
        let n_inside = (0..surplus.len()).filter(counts).count() as f64;
        if n_inside < 16.0 {
            continue;
        }
        let expected = n_inside / n_used;
        let share = (0..surplus.len()).filter(counts).map(|k| trace.residual[k].powi(2)).sum::<f64>() / trace.power();
        if share < DENSER * expected {
            continue;
        }
        let (inside, outside) = (share / expected - 1.0, (1.0 - share) / (1.0 - expected).max(1e-9) - 1.0);
        let spread: Vec<f64> = (0..surplus.len())
            .map(|k| match (trace.used[k], samples.inside[k]) {
                (false, _) => 0.0,
                (true, true) => (surplus[k] - inside) * (1.0 - expected),
                (true, false) => (outside - surplus[k]) * expected,
            })
            .collect();
        if standard_errors(n_used * (share - expected), &spread) < STANDARD_ERRORS {
            continue;
        }
        let kind = FindingKind::LiesIn { region: samples.region.clone(), also: Vec::new() };
        found.push((samples, trace.finding(kind, share, expected)));
    }
    grouped(trace, found)
}

/// The strongest first, with what only looks like it beside it: a region that outside of a stronger one holds no more than
/// chance gives it is the same samples under another name, as reversals are slow.
fn grouped(trace: &Trace, mut found: Vec<(Samples, Finding)>) -> Vec<Finding> {
    found.sort_by(|a, b| b.1.surplus().total_cmp(&a.1.surplus()));
    let mut reported: Vec<(Samples, Finding)> = Vec::new();
    for (samples, finding) in found {
        let stronger =
            reported.iter_mut().find(|(stronger, _)| !is_denser_outside(trace, &samples.inside, &stronger.inside));
        match stronger {
            Some((_, stronger)) => {
                if let FindingKind::LiesIn { also, .. } = &mut stronger.kind {
                    also.push(AlsoIn { region: samples.region, share: finding.share });
                }
            }
            None => reported.push((samples, finding)),
        }
    }
    reported.into_iter().map(|(_, finding)| finding).collect()
}

/// Whether the squared error is denser within a region than elsewhere, among the samples outside of another region.
fn is_denser_outside(trace: &Trace, inside: &[bool], other: &[bool]) -> bool {
    let (mut within, mut all) = ((0.0, 0.0), (0.0, 0.0));
    for k in (0..inside.len()).filter(|k| trace.used[*k] && !other[*k]) {
        let square = trace.residual[k] * trace.residual[k];
        all = (all.0 + square, all.1 + 1.0);
        if inside[k] {
            within = (within.0 + square, within.1 + 1.0);
        }
    }
    within.0 * all.1 > DENSER * all.0 * within.1
}

/// Which samples that count lie in a region like this one.
pub fn inside(trace: &Trace, region: &Region) -> Option<Vec<bool>> {
    let samples = regions(trace).into_iter().find(|samples| samples.region.is_like(region))?;
    Some(samples.inside.iter().zip(&trace.used).map(|(inside, used)| *inside && *used).collect())
}

fn regions(trace: &Trace) -> Vec<Samples> {
    let mut regions = Vec::new();
    let own = &trace.own;
    let n = trace.residual.len();
    if !own.dq.is_empty() {
        regions.extend(reversals(trace));
        let speed: Vec<f64> = own.dq.iter().map(|dq| dq.abs()).collect();
        let (slow, fast) = (quantile(trace, &speed, 0.2), quantile(trace, &speed, 0.8));
        regions.push(Samples {
            region: Region::LowSpeed { below: slow },
            inside: speed.iter().map(|speed| *speed < slow).collect(),
        });
        regions.push(Samples {
            region: Region::HighSpeed { above: fast },
            inside: speed.iter().map(|speed| *speed > fast).collect(),
        });
        let (low, high) = (quantile(trace, &own.q, 0.1), quantile(trace, &own.q, 0.9));
        regions.push(Samples {
            region: Region::EndOfRange { below: low, above: high },
            inside: own.q.iter().map(|q| *q < low || *q > high).collect(),
        });
        for side in [Side::Below, Side::Above] {
            regions.push(Samples {
                region: Region::OneSide { side, rest: trace.rest },
                inside: own.q.iter().map(|q| (*q > trace.rest) == (side == Side::Above)).collect(),
            });
        }
    }
    let load: Vec<f64> = own.command.iter().map(|value| value.abs()).collect();
    let large = quantile(trace, &load, 0.8);
    if large > 0.0 {
        regions.push(Samples {
            region: Region::HighCommand { above: large },
            inside: load.iter().map(|load| *load > large).collect(),
        });
    }
    for (part, third) in [Third::First, Third::Second, Third::Last].into_iter().enumerate() {
        regions.push(Samples {
            region: Region::PartOfRun { third },
            inside: (0..n).map(|k| 3 * k / n.max(1) == part).collect(),
        });
    }
    regions
}

/// Samples near a change of sign of the speed. A change counts once the speed has left the band of its noise on the
/// other side.
fn reversals(trace: &Trace) -> Option<Samples> {
    let dq = &trace.own.dq;
    let rms = (dq.iter().map(|dq| dq * dq).sum::<f64>() / dq.len() as f64).sqrt();
    let mut turns = Vec::new();
    let mut side = 0.0;
    let mut crossed = 0;
    for (k, dq) in dq.iter().enumerate() {
        if k > 0 && trace.own.dq[k - 1] * dq <= 0.0 {
            crossed = k;
        }
        if dq.abs() > 0.1 * rms && dq.signum() != side {
            if side != 0.0 {
                turns.push(crossed);
            }
            side = dq.signum();
        }
    }
    if turns.len() < 4 {
        return None;
    }
    let mut spans: Vec<usize> = turns.windows(2).map(|pair| pair[1] - pair[0]).collect();
    spans.sort_unstable();
    let near = ((0.5 * NEAR_REVERSAL * spans[spans.len() / 2] as f64).round() as usize).max(1);
    let mut inside = vec![false; dq.len()];
    for turn in &turns {
        let end = (turn + near).min(dq.len());
        inside[turn.saturating_sub(near)..end].fill(true);
    }
    Some(Samples { region: Region::Reversals { within_s: near as f64 * trace.step, count: turns.len() }, inside })
}

/// The value below which so large a share of the samples that count lies; 0 without samples.
fn quantile(trace: &Trace, values: &[f64], share: f64) -> f64 {
    let mut used: Vec<f64> =
        values.iter().zip(&trace.used).filter(|(_, used)| **used).map(|(value, _)| *value).collect();
    used.sort_by(f64::total_cmp);
    used.get((share * used.len() as f64) as usize).copied().unwrap_or(0.0)
}

/// The samples of each region, for tests.
#[cfg(test)]
pub fn named(trace: &Trace) -> Vec<(&'static str, Vec<bool>)> {
    let name = |region: &Region| match region {
        Region::Reversals { .. } => "reversals",
        Region::LowSpeed { .. } => "low speed",
        Region::HighSpeed { .. } => "high speed",
        Region::EndOfRange { .. } => "end of range",
        Region::OneSide { side: Side::Below, .. } => "below",
        Region::OneSide { side: Side::Above, .. } => "above",
        Region::HighCommand { .. } => "high command",
        Region::PartOfRun { third: Third::First } => "first",
        Region::PartOfRun { third: Third::Second } => "second",
        Region::PartOfRun { third: Third::Last } => "last",
    };
    regions(trace).into_iter().map(|samples| (name(&samples.region), samples.inside)).collect()
}
