//! Implicit steps, for what is too stiff for explicit ones: friction that holds a joint, bristles, cables.
//!
//! The diagonally implicit Runge-Kutta scheme of Alexander (1977) of third order with three stages, which damps whatever decays
//! faster than its steps (L-stable) and whose last stage is the end of the step. Each stage is solved by Newton's iteration with
//! the exact derivative, which is taken anew where an older one does not do, damped where the residual would not fall (Deuflhard's natural monotonicity test).

use dynid_generated::{Lanes, Scalar};
use nalgebra::DMatrix;

use super::{Input, step_bounds};
use crate::system::{Linear, Scratch, System, substitute};

/// Stages of a step.
pub const STAGES: usize = 3;
/// Weight of a stage's own slope in it.
pub const OWN: f64 = 0.435_866_521_508_459_2;
/// Weights of the slopes of the stages before, stage by stage.
pub const BEFORE: [[f64; 2]; STAGES] = [
    [0.0, 0.0],
    [0.5 * (1.0 - OWN), 0.0],
    [-0.25 * (6.0 * OWN * OWN - 16.0 * OWN + 1.0), 0.25 * (6.0 * OWN * OWN - 20.0 * OWN + 5.0)],
];
/// Where in the step the stages stand.
const SHARES: [f64; STAGES] = [OWN, 0.5 * (1.0 + OWN), 1.0];

/// Newton's iteration ends where what is left to correct changes no state by more than this share of what it is made of: corrections
/// that shrink by a factor r each leave r / (1 - r) of the last one (Hairer & Wanner 1996, section IV.8).
const CONVERGED: f64 = 1e-12;
/// What a new derivative costs, in iterations: an older one does while corrections that go on shrinking as the last one did end in fewer.
const DERIVATIVE: f64 = 3.0;
/// Iterations, and halvings of one correction, at most.
const ITERATIONS: usize = 40;
const HALVINGS: usize = 12;

/// Room for implicit steps, and what the last one went through.
#[derive(Debug, Clone)]
pub struct Implicit {
    /// Time of each stage (s).
    pub time: [f64; STAGES],
    /// State at each stage, one after the other.
    pub states: Vec<f64>,
    /// Its rate.
    pub rates: Vec<f64>,
    linear: Linear<Lanes>,
    scratch: Scratch,
    command: Vec<f64>,
    base: Vec<f64>,
    trial: Vec<f64>,
    rate: Vec<f64>,
    residual: Vec<f64>,
    correction: Vec<f64>,
    next: Vec<f64>,
    from: Vec<f64>,
    scales: Vec<f64>,
    matrix: Matrix,
    /// Whether `matrix` is of this step, and what it holds of the rigid body.
    is_factored: bool,
    has_body: bool,
    lanes: [Vec<Lanes>; 4],
}

impl Implicit {
    /// Room for steps of `system`.
    pub fn new(system: &System) -> Self {
        let (n, n_free) = (system.n_states(), system.n_free());
        let room = || vec![0.0; n];
        let lanes = |length: usize| vec![Lanes::constant(0.0); length];
        Self {
            time: [0.0; STAGES],
            states: vec![0.0; STAGES * n],
            rates: vec![0.0; STAGES * n],
            linear: Linear::new(system),
            scratch: system.scratch(),
            command: vec![0.0; system.n_joints()],
            base: room(),
            trial: room(),
            rate: room(),
            residual: room(),
            correction: room(),
            next: room(),
            from: room(),
            scales: room(),
            matrix: Matrix::new(n_free, n),
            is_factored: false,
            has_body: false,
            lanes: [lanes(n), lanes(n_free), lanes(system.n_joints()), lanes(n)],
        }
    }

    /// Step `index` of `steps` from a sample of `input` to the next, as [`Implicit::step`].
    pub fn step_of(
        &mut self,
        system: &System,
        input: &Input<'_>,
        sample: usize,
        (index, steps): (usize, usize),
        x: &mut [f64],
    ) -> bool {
        let (begin, end) = step_bounds(input.time[sample], input.time[sample + 1], steps, index);
        let command = |t: f64, command: &mut [f64]| input.command_at(system, sample, (index, steps), t, command);
        self.step(system, (begin, end - begin), x, command)
    }

    /// Takes the state `x` from `t` to `t + step` (s); `command` tells what arrives when. Says whether every stage was solved; where
    /// one was not, `x` stays.
    pub fn step(
        &mut self,
        system: &System,
        (t, step): (f64, f64),
        x: &mut [f64],
        mut command: impl FnMut(f64, &mut [f64]),
    ) -> bool {
        let n = x.len();
        (self.is_factored, self.has_body) = (false, false);
        for stage in 0..STAGES {
            self.time[stage] = t + SHARES[stage] * step;
            command(self.time[stage], &mut self.command);
            for state in 0..n {
                let slopes = BEFORE[stage].iter().enumerate().map(|(j, weight)| weight * self.rates[j * n + state]);
                self.base[state] = if stage == 0 { x[state] } else { x[state] + step * slopes.sum::<f64>() };
            }
            self.guess(stage, step, x);
            if !self.solve(system, stage, step * OWN) {
                return false;
            }
        }
        x.copy_from_slice(&self.states[(STAGES - 1) * n..]);
        true
    }

    /// Where a stage's iteration begins: where the slopes of the stages before lead (Adams and Bashforth's formulas).
    fn guess(&mut self, stage: usize, step: f64, x: &[f64]) {
        let n = x.len();
        let (before, own) = self.states.split_at_mut(stage * n);
        let Some(last) = stage.checked_sub(1) else { return own[..n].copy_from_slice(x) };
        let ahead = step * (SHARES[stage] - SHARES[last]);
        for (state, own) in own[..n].iter_mut().enumerate() {
            let slope = |stage: usize| self.rates[stage * n + state];
            let bend = last.checked_sub(1).map_or(0.0, |first| 0.5 * (slope(last) - slope(first)));
            *own = before[last * n + state] + ahead * (slope(last) + bend);
        }
    }

    /// Solves `X - base - reach f(X) = 0` for one stage.
    fn solve(&mut self, system: &System, stage: usize, reach: f64) -> bool {
        let n = system.n_states();
        let t = self.time[stage];
        self.trial.copy_from_slice(&self.states[stage * n..(stage + 1) * n]);
        self.set_residual(system, t, reach);
        // Whether `correction` is that of the residual, and the size of the last one by the same matrix.
        let (mut is_corrected, mut size_before) = (false, f64::INFINITY);
        for iteration in 0..ITERATIONS {
            let is_fresh = !self.is_factored;
            if is_fresh {
                self.linearise(system, t, reach);
                self.is_factored = self.matrix.factorise();
                if !self.is_factored {
                    return false;
                }
                is_corrected = false;
            }
            if !is_corrected {
                self.correction.copy_from_slice(&self.residual);
                self.matrix.solve(&mut self.correction);
            }
            for k in 0..n {
                self.scales[k] = self.base[k].abs() + self.trial[k].abs() + reach * self.rate[k].abs() + f64::EPSILON;
            }
            let size = largest(&self.correction, &self.scales);
            if !size.is_finite() {
                return false;
            }
            let contraction = size / size_before;
            if !is_fresh && size > CONVERGED && contraction.ln() * DERIVATIVE > (CONVERGED / size).ln() {
                // The effects change much within a step; the rigid body, as a rule, little.
                (self.is_factored, self.has_body) = (false, iteration < ITERATIONS / 2);
                size_before = f64::INFINITY;
                continue;
            }
            let is_shrinking = size_before.is_finite() && contraction < 0.5;
            let left = if is_shrinking { contraction / (1.0 - contraction) * size } else { size };
            let is_last = left <= CONVERGED;
            size_before = size;
            self.from.copy_from_slice(&self.trial);
            let mut share = 1.0;
            for halvings in 0.. {
                for ((trial, from), correction) in self.trial.iter_mut().zip(&self.from).zip(&self.correction) {
                    *trial = from - share * correction;
                }
                if is_last {
                    let places = stage * n..(stage + 1) * n;
                    self.states[places.clone()].copy_from_slice(&self.trial);
                    for (k, rate) in self.rates[places].iter_mut().enumerate() {
                        *rate = (self.trial[k] - self.base[k]) / reach;
                    }
                    return true;
                }
                self.set_residual(system, t, reach);
                self.next.copy_from_slice(&self.residual);
                self.matrix.solve(&mut self.next);
                if halvings == HALVINGS || largest(&self.next, &self.scales) <= (1.0 - 0.25 * share) * size {
                    break;
                }
                share *= 0.5;
            }
            std::mem::swap(&mut self.correction, &mut self.next);
            is_corrected = true;
        }
        false
    }

    fn set_residual(&mut self, system: &System, t: f64, reach: f64) {
        system.derivative(&mut self.scratch, t, &self.trial, &self.command, &mut self.rate);
        for k in 0..self.trial.len() {
            self.residual[k] = self.trial[k] - self.base[k] - reach * self.rate[k];
        }
    }

    /// The derivative of the residual at the trial state.
    fn linearise(&mut self, system: &System, t: f64, reach: f64) {
        let n = system.n_free();
        let [x, ddq, command, rates] = &mut self.lanes;
        let fill = |lanes: &mut [Lanes], values: &[f64]| {
            lanes.iter_mut().zip(values).for_each(|(lane, value)| *lane = Lanes::constant(*value));
        };
        fill(x, &self.trial);
        fill(ddq, &self.rate[n..2 * n]);
        fill(command, &self.command);
        self.linear.renew_drive();
        self.linear.by_state(system, Lanes::constant(t), x, ddq, command, rates, !self.has_body);
        self.has_body = true;
        let one = |lanes: &Lanes| lanes.to_array()[0];
        let n_states = self.trial.len();
        let matrix = &mut self.matrix;
        matrix.reach = reach;
        matrix.by_state.fill(0.0);
        for (entry, inertia) in matrix.inertia.iter_mut().zip(&self.linear.inertia) {
            *entry = one(inertia);
        }
        for (state, column) in matrix.by_state.chunks_exact_mut(n_states - n).enumerate() {
            for (row, entry) in column[..n].iter_mut().enumerate() {
                *entry = -reach * one(&self.linear.torque_by_state[row * n_states + state]);
                if let Some(slot) = state.checked_sub(n).filter(|slot| *slot < n) {
                    *entry += matrix.inertia[row * n + slot];
                }
            }
        }
        for (row, state, value) in &self.linear.rate_by_state {
            matrix.by_state[state * (n_states - n) + row - n] -= reach * one(value);
        }
        for state in 2 * n..n_states {
            matrix.by_state[state * (n_states - n) + state - n] += 1.0;
        }
    }
}

/// The largest entry, each in units of its scale.
fn largest(values: &[f64], scales: &[f64]) -> f64 {
    values.iter().zip(scales).fold(0.0, |most: f64, (value, scale)| {
        let own = (value / scale).abs();
        // Not even infinity is larger than what is no number.
        if own.is_nan() { f64::INFINITY } else { most.max(own) }
    })
}

/// The derivative of a stage's residual, the rows of the speeds times D. Its rows of the positions are known, `dq - reach d(dq)`, which
/// leaves equations of the speeds and the effects' states alone.
#[derive(Debug, Clone)]
struct Matrix {
    n_free: usize,
    reach: f64,
    /// D, row by row.
    inertia: Vec<f64>,
    /// The other rows, column by column: a column for each state.
    by_state: Vec<f64>,
    /// Triangular factors of what is left of them without the positions, column by column, reciprocals on the diagonal.
    factors: Vec<f64>,
    pivots: Vec<usize>,
    by_row: Vec<f64>,
}

impl Matrix {
    fn new(n_free: usize, n_states: usize) -> Self {
        let n = n_states - n_free;
        Self {
            n_free,
            reach: 0.0,
            inertia: vec![0.0; n_free * n_free],
            by_state: vec![0.0; n * n_states],
            factors: vec![0.0; n * n],
            pivots: vec![0; n],
            by_row: vec![0.0; n_free],
        }
    }

    /// Elimination with the largest pivot of each column; `false` where there is none.
    fn factorise(&mut self) -> bool {
        let Self { n_free, reach, by_state, factors, pivots, .. } = self;
        let n = pivots.len();
        let (by_position, by_rest) = by_state.split_at(*n_free * n);
        factors.copy_from_slice(by_rest);
        // The columns of the speeds come first.
        factors.iter_mut().zip(by_position).for_each(|(entry, by_position)| *entry += *reach * by_position);
        for k in 0..n {
            let size = |row: &usize| factors[k * n + row].abs();
            let pivot = (k..n).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(k);
            pivots[k] = pivot;
            if pivot != k {
                (0..n).for_each(|column| factors.swap(column * n + k, column * n + pivot));
            }
            let reciprocal = factors[k * n + k].recip();
            if !reciprocal.is_finite() {
                return false;
            }
            let (done, later) = factors.split_at_mut((k + 1) * n);
            let column = &mut done[k * n..];
            column[k] = reciprocal;
            column[k + 1..].iter_mut().for_each(|entry| *entry *= reciprocal);
            for other in later.chunks_exact_mut(n) {
                let factor = other[k];
                other[k + 1..].iter_mut().zip(&column[k + 1..]).for_each(|(entry, own)| *entry -= factor * own);
            }
        }
        true
    }

    /// The states that the matrix takes to `b`.
    fn solve(&mut self, b: &mut [f64]) {
        let n = self.pivots.len();
        let (positions, rest) = b.split_at_mut(self.n_free);
        let speeds = &mut rest[..self.n_free];
        for (sum, row) in self.by_row.iter_mut().zip(self.inertia.chunks_exact(self.n_free)) {
            *sum = row.iter().zip(&*speeds).map(|(inertia, speed)| inertia * speed).sum();
        }
        speeds.copy_from_slice(&self.by_row);
        for (position, column) in positions.iter().zip(self.by_state.chunks_exact(n)) {
            rest.iter_mut().zip(column).for_each(|(value, entry)| *value -= entry * position);
        }
        for (k, pivot) in self.pivots.iter().enumerate() {
            rest.swap(k, *pivot);
        }
        for (k, column) in self.factors.chunks_exact(n).enumerate() {
            let (known, later) = rest.split_at_mut(k + 1);
            later.iter_mut().zip(&column[k + 1..]).for_each(|(value, entry)| *value -= entry * known[k]);
        }
        for (k, column) in self.factors.chunks_exact(n).enumerate().rev() {
            rest[k] *= column[k];
            let (earlier, known) = rest.split_at_mut(k);
            earlier.iter_mut().zip(column).for_each(|(value, entry)| *value -= entry * known[0]);
        }
        positions.iter_mut().zip(rest).for_each(|(position, speed)| *position += self.reach * *speed);
    }
}

/// The derivative of a state's rate by the state: `factor` is D as [`Linear`] holds it, `torque_by_state` n_free x n_states, and
/// `rate_by_state` are the entries of the effects' states.
pub fn state_matrix(
    n: usize,
    factor: &[f64],
    torque_by_state: &[f64],
    rate_by_state: impl Iterator<Item = (usize, usize, f64)>,
) -> DMatrix<f64> {
    let n_states = torque_by_state.len() / n;
    let mut matrix = DMatrix::zeros(n_states, n_states);
    let mut column = vec![0.0; n];
    for state in 0..n_states {
        for (row, entry) in column.iter_mut().enumerate() {
            *entry = torque_by_state[row * n_states + state];
        }
        substitute(n, |place| factor[place], &mut column);
        for (row, entry) in column.iter().enumerate() {
            matrix[(n + row, state)] = *entry;
        }
    }
    for slot in 0..n {
        matrix[(slot, n + slot)] = 1.0;
    }
    for (row, state, value) in rate_by_state {
        matrix[(row, state)] += value;
    }
    matrix
}
