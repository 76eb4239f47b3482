//! What an error follows: a regression that takes in one signal after another.
//!
//! Each candidate is one or a few columns. The one that lowers the sum of squares most, less what its number of columns
//! (and of tried frequencies) would by chance, is taken if the gain is significant for the number of independent
//! samples of what it leaves; the others are then judged by what they explain of the rest.

use std::f64::consts::TAU;

use super::{
    Finding, FindingKind, LEAST_SHARE, OtherSignal, OwnSignal, RegressionStep, Regressor,
    trace::{Signals, Trace, command_rate},
};
use dynid_signal::statistics::{correlation_time, critical, effective_samples};

/// Regressors that are taken at most.
const MOST_TAKEN: usize = 6;

/// Others that explain at least this share of what the best one does are named with it.
const NEARLY: f64 = 0.9;
/// As many of them.
const MOST_NAMED: usize = 3;

/// Speeds below this share of the RMS speed smooth the sign of the speed; a numerical choice.
const SIGN_WIDTH: f64 = 0.05;

/// Orders of a repetition in position that are tried: periods in the range of motion, from the lowest, that is told apart
/// from a smooth function, upwards.
const PERIODS: (f64, f64) = (2.0, 40.0);
/// Frequencies tried per period in the range.
const PER_PERIOD: f64 = 4.0;

/// A signal, or a few, that the error may follow.
struct Candidate {
    regressor: Regressor,
    columns: Vec<Vec<f64>>,
    /// How many alternatives this one is the best of.
    looked: usize,
    found: Found,
}

/// Makes what is found from the coefficients of the columns.
type Found = Box<dyn Fn(&[f64]) -> FindingKind>;

/// A candidate that was taken in.
struct Taken {
    candidate: Candidate,
    coefficients: Vec<f64>,
    /// By how much it lowered the sum of squares.
    gain: f64,
    /// Others that would have lowered it nearly as much.
    nearly: Vec<Regressor>,
}

/// What the error of `trace` follows, in the order in which it was taken in.
pub fn findings(trace: &Trace) -> Vec<Finding> {
    let n_used = trace.n_used();
    let total = trace.power();
    let mut fit = Regression::new(trace);
    let mut taken = take_in(trace, &mut fit);
    // What is left of everything taken is the noise by which each is judged.
    let mut effective = effective_samples(&fit.remainder, n_used);
    while let Some(last) = taken.last() {
        if is_significant(last, effective - fit.basis.len() as f64, fit.left()) {
            break;
        }
        fit.drop_last(last.candidate.columns.len());
        taken.pop();
        effective = effective_samples(&fit.remainder, n_used);
    }
    let freedom = effective - fit.basis.len() as f64;
    let reported: Vec<&Taken> = taken.iter().filter(|taken| is_significant(taken, freedom, fit.left())).collect();
    let coefficients = together(trace, &reported);
    let mut findings: Vec<Finding> = Vec::new();
    for (taken, coefficients) in reported.into_iter().zip(coefficients) {
        let Candidate { columns, looked, found, .. } = &taken.candidate;
        let share = taken.gain / total;
        let expected = (columns.len() as f64 + 2.0 * (*looked as f64).ln()) / effective * fit.left() / total;
        let nearly = taken.nearly[..taken.nearly.len().min(MOST_NAMED)].to_vec();
        let regression = Some(RegressionStep { order: findings.len() + 1, nearly });
        let found = Finding { regression, ..trace.finding(found(&coefficients), share, expected) };
        // What was taken in later says how much more it explains, and stands behind what it was added to.
        let rank = findings.last().map_or(found.rank, |before| found.rank.min(before.rank));
        findings.push(Finding { rank, ..found });
    }
    findings.extend(offset(trace, &fit));
    findings
}

/// The coefficients of all that is reported beside each other: what was taken in later changes those of what was there.
fn together(trace: &Trace, reported: &[&Taken]) -> Vec<Vec<f64>> {
    let columns: Vec<Vec<f64>> = reported.iter().flat_map(|taken| taken.candidate.columns.iter().cloned()).collect();
    let Some(all) = Regression::new(trace).take(&columns) else {
        return reported.iter().map(|taken| taken.coefficients.clone()).collect();
    };
    let mut rest = all.as_slice();
    reported
        .iter()
        .map(|taken| {
            let (own, later) = rest.split_at(taken.candidate.columns.len());
            rest = later;
            own.to_vec()
        })
        .collect()
}

/// Takes candidates in, the best first, as long as one explains a share that is worth telling.
fn take_in(trace: &Trace, fit: &mut Regression) -> Vec<Taken> {
    let (n_used, total) = (trace.n_used() as f64, trace.power());
    let mut candidates = candidates(trace);
    let mut taken = Vec::new();
    for _ in 0..MOST_TAKEN {
        candidates.extend(repetition(trace, fit));
        let before = fit.left();
        let gains: Vec<f64> = candidates.iter().map(|candidate| fit.gain(&candidate.columns)).collect();
        let worth = |index: usize| {
            let price = candidates[index].columns.len() as f64 + 2.0 * (candidates[index].looked as f64).ln();
            gains[index] - price * before / n_used
        };
        let Some(best) = (0..gains.len()).max_by(|a, b| worth(*a).total_cmp(&worth(*b))) else { break };
        let gain = gains[best];
        if gain < LEAST_SHARE * total {
            break;
        }
        let nearly = (0..gains.len())
            .filter(|other| *other != best && gains[*other] >= NEARLY * gain)
            .map(|other| candidates[other].regressor)
            .collect();
        let candidate = candidates.swap_remove(best);
        candidates.retain(|candidate| candidate.regressor != Regressor::Repetition);
        let Some(coefficients) = fit.take(&candidate.columns) else { break };
        taken.push(Taken { candidate, coefficients, gain, nearly });
    }
    taken
}

/// Whether a gain is larger than chance gives it beside a sum of squares `left`, with so many degrees of freedom.
fn is_significant(taken: &Taken, freedom: f64, left: f64) -> bool {
    let statistic = freedom * (taken.gain / left.max(f64::MIN_POSITIVE)).ln_1p();
    freedom >= 8.0 && statistic >= critical(taken.candidate.columns.len(), taken.candidate.looked)
}

/// The mean that the signals taken so far do not account for.
fn offset(trace: &Trace, fit: &Regression) -> Option<Finding> {
    let n_used = trace.n_used();
    let total = trace.power();
    // The constant against everything but itself: the columns as they were, not as they stand in the basis.
    let mut apart: Vec<Vec<f64>> = Vec::new();
    let outside = |column: &[f64], apart: &[Vec<f64>]| {
        let mut own = column.to_vec();
        for _ in 0..2 {
            for basis in apart {
                let along = dot(&own, basis);
                own.iter_mut().zip(basis).for_each(|(value, basis)| *value -= along * basis);
            }
        }
        own
    };
    for column in &fit.taken {
        let mut own = outside(column, &apart);
        let size = dot(&own, &own).sqrt();
        if size > 1e-9 * dot(column, column).sqrt() {
            own.iter_mut().for_each(|value| *value /= size);
            apart.push(own);
        }
    }
    let one: Vec<f64> = trace.used.iter().map(|used| f64::from(u8::from(*used))).collect();
    let one = outside(&one, &apart);
    let size = dot(&one, &one);
    if size <= 1e-6 * n_used as f64 {
        return None;
    }
    let constant = dot(&one, &trace.residual) / size;
    let gain = constant * constant * size;
    let share = gain / total;
    // A constant is slower than any error.
    let effective = n_used as f64 / correlation_time(&fit.remainder, n_used);
    let expected = fit.left() / total / effective;
    let statistic = (effective - fit.basis.len() as f64) * (gain / fit.left().max(f64::MIN_POSITIVE)).ln_1p();
    if share < LEAST_SHARE || statistic < critical(1, 1) {
        return None;
    }
    Some(trace.finding(FindingKind::Offset { constant }, share, expected))
}

/// Least squares by an orthonormal basis that grows.
struct Regression {
    used: Vec<bool>,
    /// Orthonormal, the constant first; zero where samples do not count.
    basis: Vec<Vec<f64>>,
    /// What is left of the error.
    remainder: Vec<f64>,
    /// What was taken off the remainder for each entry of the basis.
    amounts: Vec<f64>,
    /// The columns that were taken in, zero where samples do not count.
    taken: Vec<Vec<f64>>,
}

impl Regression {
    fn new(trace: &Trace) -> Self {
        let size = 1.0 / (trace.n_used().max(1) as f64).sqrt();
        let one: Vec<f64> = trace.used.iter().map(|used| if *used { size } else { 0.0 }).collect();
        let along = dot(&trace.residual, &one);
        let remainder = trace.residual.iter().zip(&one).map(|(value, one)| value - along * one).collect();
        Self { used: trace.used.clone(), basis: vec![one], remainder, amounts: vec![along], taken: Vec::new() }
    }

    /// Sum of squares that is left.
    fn left(&self) -> f64 {
        dot(&self.remainder, &self.remainder)
    }

    /// Zero where samples do not count.
    fn counted(&self, column: &[f64]) -> Vec<f64> {
        column.iter().zip(&self.used).map(|(value, used)| if *used { *value } else { 0.0 }).collect()
    }

    /// `columns` as orthonormal ones beside the basis, each with its parts along what came before and its own size;
    /// `None` where one of them says nothing new.
    fn beside(&self, columns: &[Vec<f64>]) -> Option<Vec<(Vec<f64>, Vec<f64>)>> {
        /// A column with less than this share of its size outside the basis is in it.
        const NEW: f64 = 0.03;
        let mut found: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        for column in columns {
            let mut own = self.counted(column);
            let mean = own.iter().sum::<f64>() / self.used.iter().filter(|used| **used).count().max(1) as f64;
            let spread: f64 =
                own.iter().zip(&self.used).filter(|(_, used)| **used).map(|(value, _)| (value - mean).powi(2)).sum();
            let mut parts = vec![0.0; found.len()];
            // Twice, for the rounding of the first time.
            for _ in 0..2 {
                for basis in &self.basis {
                    let along = dot(&own, basis);
                    own.iter_mut().zip(basis).for_each(|(value, basis)| *value -= along * basis);
                }
                for (part, (basis, _)) in parts.iter_mut().zip(&found) {
                    let along = dot(&own, basis);
                    *part += along;
                    own.iter_mut().zip(basis).for_each(|(value, basis)| *value -= along * basis);
                }
            }
            let size = dot(&own, &own).sqrt();
            if !(size > NEW * spread.sqrt() && size > 0.0) {
                return None;
            }
            own.iter_mut().for_each(|value| *value /= size);
            parts.push(size);
            found.push((own, parts));
        }
        Some(found)
    }

    /// How much taking `columns` in lowers the sum of squares.
    fn gain(&self, columns: &[Vec<f64>]) -> f64 {
        self.beside(columns)
            .map_or(0.0, |found| found.iter().map(|(basis, _)| dot(basis, &self.remainder).powi(2)).sum())
    }

    /// Takes `columns` in; their coefficients beside everything taken before.
    fn take(&mut self, columns: &[Vec<f64>]) -> Option<Vec<f64>> {
        let found = self.beside(columns)?;
        let amounts: Vec<f64> = found.iter().map(|(basis, _)| dot(basis, &self.remainder)).collect();
        // Back substitution: column k is the sum over j <= k of parts[j] times basis j.
        let mut coefficients = vec![0.0; columns.len()];
        for k in (0..columns.len()).rev() {
            let later: f64 = (k + 1..columns.len()).map(|other| coefficients[other] * found[other].1[k]).sum();
            coefficients[k] = (amounts[k] - later) / found[k].1[k];
        }
        for ((basis, _), amount) in found.into_iter().zip(amounts) {
            self.remainder.iter_mut().zip(&basis).for_each(|(value, basis)| *value -= amount * basis);
            self.basis.push(basis);
            self.amounts.push(amount);
        }
        let counted: Vec<Vec<f64>> = columns.iter().map(|column| self.counted(column)).collect();
        self.taken.extend(counted);
        Some(coefficients)
    }

    /// Gives back the last columns that were taken.
    fn drop_last(&mut self, columns: usize) {
        for _ in 0..columns {
            self.taken.pop();
            if let (Some(basis), Some(amount)) = (self.basis.pop(), self.amounts.pop()) {
                self.remainder.iter_mut().zip(&basis).for_each(|(value, basis)| *value += amount * basis);
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// -1 to 1: the sign of `values`, smooth where they are small beside their root mean square.
fn sign(values: &[f64]) -> Vec<f64> {
    let rms = (dot(values, values) / values.len().max(1) as f64).sqrt();
    let width = (SIGN_WIDTH * rms).max(f64::MIN_POSITIVE);
    values.iter().map(|value| (value / width).tanh()).collect()
}

fn times(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

fn varies(values: &[f64]) -> bool {
    values.windows(2).any(|pair| pair[0] != pair[1])
}

/// Everything that an error may follow but a repetition in position.
fn candidates(trace: &Trace) -> Vec<Candidate> {
    let mut all = Vec::new();
    let mut add = |regressor, columns: Vec<Vec<f64>>, found: Found| {
        if columns.iter().all(|column| varies(column)) {
            all.push(Candidate { regressor, columns, looked: 1, found });
        }
    };
    // A mechanism answers late and long: its position error is not a function of its speed or torque at the time.
    let nothing = Signals { joint: trace.joint, ..Signals::default() };
    let own = if trace.is_local { &trace.own } else { &nothing };
    let rest = trace.rest;
    if !own.dq.is_empty() {
        let direction = sign(&own.dq);
        let squared: Vec<f64> = own.dq.iter().map(|dq| dq * dq.abs()).collect();
        let reach = own.q.iter().fold(0.0_f64, |reach, q| reach.max((q - rest).abs())).max(f64::MIN_POSITIVE);
        let scaled: Vec<f64> = own.q.iter().map(|q| (q - rest) / reach).collect();
        for (signal, column, unit) in [
            (OwnSignal::SpeedSign, direction.clone(), 1.0),
            (OwnSignal::Speed, own.dq.clone(), 1.0),
            (OwnSignal::SpeedSquared, squared, 1.0),
            (OwnSignal::Acceleration, own.ddq.clone(), 1.0),
            (OwnSignal::Position, scaled.clone(), reach),
        ] {
            add(Regressor::Own { signal }, vec![column], follows(signal, unit));
        }
        add(
            Regressor::SmoothPosition,
            vec![scaled.clone(), times(&scaled, &scaled), times(&scaled, &times(&scaled, &scaled))],
            Box::new(move |c| FindingKind::FollowsSmoothly {
                coefficients: [c[0] / reach, c[1] / reach.powi(2), c[2] / reach.powi(3)],
                rest,
            }),
        );
        let below: Vec<f64> = own.q.iter().map(|q| if *q < rest { 1.0 } else { 0.0 }).collect();
        add(
            Regressor::SidedFriction,
            vec![times(&direction, &below)],
            Box::new(move |c| FindingKind::HasSidedFriction { amplitude: c[0], rest }),
        );
        if varies(&own.command) {
            let size: Vec<f64> = own.command.iter().map(|value| value.abs()).collect();
            let signal = OwnSignal::LoadFriction;
            add(Regressor::Own { signal }, vec![times(&direction, &size)], follows(signal, 1.0));
        }
    }
    if varies(&own.command) {
        for (signal, column) in [
            (OwnSignal::Command, own.command.clone()),
            (OwnSignal::CommandSign, sign(&own.command)),
            (OwnSignal::CommandRate, command_rate(own, trace.step)),
        ] {
            add(Regressor::Own { signal }, vec![column], follows(signal, 1.0));
        }
    }
    for other in &trace.others {
        candidates_of(trace, other, &mut add);
    }
    let n = trace.residual.len() as f64;
    let duration_s = n * trace.step;
    add(
        Regressor::Time,
        vec![(0..trace.residual.len()).map(|k| k as f64 / n - 0.5).collect()],
        Box::new(move |c| FindingKind::Drifts { change: c[0], duration_s }),
    );
    all
}

/// The error follows a signal whose column is in multiples of `unit`.
fn follows(signal: OwnSignal, unit: f64) -> Found {
    Box::new(move |c| FindingKind::Follows { signal, per_unit: c[0] / unit })
}

/// What it may follow of another joint.
fn candidates_of(trace: &Trace, other: &Signals, add: &mut impl FnMut(Regressor, Vec<Vec<f64>>, Found)) {
    let joint = other.joint;
    let mut one = |signal, column: Vec<f64>| {
        let found = move |c: &[f64]| FindingKind::FollowsOther { joint, signal, per_unit: c[0] };
        add(Regressor::Other { joint, signal }, vec![column], Box::new(found));
    };
    if varies(&other.command) {
        one(OtherSignal::Command, other.command.clone());
    }
    if other.dq.is_empty() {
        return;
    }
    one(OtherSignal::Position, other.q.clone());
    one(OtherSignal::Speed, other.dq.clone());
    one(OtherSignal::Acceleration, other.ddq.clone());
    one(OtherSignal::SpeedSign, sign(&other.dq));
    if !trace.own.dq.is_empty() {
        let sum: Vec<f64> = trace.own.dq.iter().zip(&other.dq).map(|(own, other)| own + other).collect();
        one(OtherSignal::SummedSpeedSign, sign(&sum));
    }
}

/// The repetition in position that explains most of what is left, if the motion covers enough periods of any.
fn repetition(trace: &Trace, fit: &Regression) -> Option<Candidate> {
    if !trace.is_local {
        return None;
    }
    let q: Vec<f64> = trace.own.q.iter().zip(&trace.used).filter(|(_, used)| **used).map(|(q, _)| *q).collect();
    let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
    let range = high - low;
    if !(range > 0.0 && range.is_finite()) {
        return None;
    }
    let columns = |periods: f64| -> Vec<Vec<f64>> {
        let turn = |q: &f64| TAU * periods * (q - low) / range;
        vec![trace.own.q.iter().map(|q| turn(q).sin()).collect(), trace.own.q.iter().map(|q| turn(q).cos()).collect()]
    };
    // Finer repetitions than the motion from sample to sample resolves cannot be found.
    let steps = trace.own.q.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let fastest = steps.fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let most = PERIODS.1.min(0.25 * range / fastest);
    let looked = ((most - PERIODS.0) * PER_PERIOD).floor();
    if looked < 1.0 {
        return None;
    }
    let looked = looked as usize + 1;
    let (periods, _) = (0..looked)
        .map(|k| PERIODS.0 + k as f64 / PER_PERIOD)
        .map(|periods| (periods, fit.gain(&columns(periods))))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let period = range / periods;
    Some(Candidate {
        regressor: Regressor::Repetition,
        columns: columns(periods),
        looked,
        found: Box::new(move |c| FindingKind::Repeats { period, amplitude: (c[0] * c[0] + c[1] * c[1]).sqrt() }),
    })
}
