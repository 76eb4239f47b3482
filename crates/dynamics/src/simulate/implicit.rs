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

/// Newton's iteration ends where a correction changes no state by more than this share of what it is made of.
const CONVERGED: f64 = 1e-10;
/// A derivative that was taken elsewhere does while each correction is smaller by this than the one before.
const CONTRACTION: f64 = 0.2;
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
    matrix: Factors,
    /// Whether `matrix` is of this step.
    is_factored: bool,
    lanes: [Vec<Lanes>; 4],
    column: Vec<f64>,
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
            matrix: Factors::new(n),
            is_factored: false,
            lanes: [lanes(n), lanes(n_free), lanes(system.n_joints()), lanes(n)],
            column: vec![0.0; n_free],
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
        self.is_factored = false;
        for stage in 0..STAGES {
            self.time[stage] = t + SHARES[stage] * step;
            command(self.time[stage], &mut self.command);
            for state in 0..n {
                let slopes = BEFORE[stage].iter().enumerate().map(|(j, weight)| weight * self.rates[j * n + state]);
                self.base[state] = if stage == 0 { x[state] } else { x[state] + step * slopes.sum::<f64>() };
            }
            let (before, own) = self.states.split_at_mut(stage * n);
            own[..n].copy_from_slice(if stage == 0 { x } else { &before[(stage - 1) * n..] });
            if !self.solve(system, stage, step * OWN) {
                return false;
            }
        }
        x.copy_from_slice(&self.states[(STAGES - 1) * n..]);
        true
    }

    /// Solves `X - base - reach f(X) = 0` for one stage.
    fn solve(&mut self, system: &System, stage: usize, reach: f64) -> bool {
        let n = system.n_states();
        let t = self.time[stage];
        self.trial.copy_from_slice(&self.states[stage * n..(stage + 1) * n]);
        self.set_residual(system, t, reach);
        let mut size_before = f64::INFINITY;
        for _ in 0..ITERATIONS {
            let is_fresh = !self.is_factored;
            if is_fresh {
                self.linearise(system, t, reach);
                self.is_factored = self.matrix.factorise();
                if !self.is_factored {
                    return false;
                }
            }
            self.correction.copy_from_slice(&self.residual);
            self.matrix.solve(&mut self.correction);
            for k in 0..n {
                self.scales[k] = self.base[k].abs() + self.trial[k].abs() + reach * self.rate[k].abs() + f64::EPSILON;
            }
            let size = largest(&self.correction, &self.scales);
            if !size.is_finite() {
                return false;
            }
            if size > CONTRACTION * size_before && !is_fresh {
                self.is_factored = false;
                continue;
            }
            size_before = size;
            self.from.copy_from_slice(&self.trial);
            let mut share = 1.0;
            for halvings in 0.. {
                for ((trial, from), correction) in self.trial.iter_mut().zip(&self.from).zip(&self.correction) {
                    *trial = from - share * correction;
                }
                if size <= CONVERGED {
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
        self.linear.at(system, Lanes::constant(t), x, ddq, command, rates);
        let one = |lanes: &Lanes| lanes.to_array()[0];
        let n_states = self.trial.len();
        self.matrix.entries.fill(0.0);
        let factor: &[Lanes] = &self.linear.factor;
        for state in 0..n_states {
            for (row, entry) in self.column.iter_mut().enumerate() {
                *entry = one(&self.linear.torque_by_state[row * n_states + state]);
            }
            substitute(n, |place| one(&factor[place]), &mut self.column);
            for (row, entry) in self.column.iter().enumerate() {
                self.matrix.entries[(n + row) * n_states + state] = -reach * entry;
            }
        }
        for slot in 0..n {
            self.matrix.entries[slot * n_states + n + slot] = -reach;
        }
        for (row, state, value) in &self.linear.rate_by_state {
            self.matrix.entries[row * n_states + state] -= reach * one(value);
        }
        for state in 0..n_states {
            self.matrix.entries[state * n_states + state] += 1.0;
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

/// A small matrix, row by row, and then its triangular factors.
#[derive(Debug, Clone)]
struct Factors {
    n: usize,
    entries: Vec<f64>,
    pivots: Vec<usize>,
}

impl Factors {
    fn new(n: usize) -> Self {
        Self { n, entries: vec![0.0; n * n], pivots: vec![0; n] }
    }

    /// Elimination with the largest pivot of each column; `false` where there is none.
    fn factorise(&mut self) -> bool {
        let n = self.n;
        for k in 0..n {
            let size = |row: &usize| self.entries[row * n + k].abs();
            let pivot = (k..n).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(k);
            self.pivots[k] = pivot;
            if pivot != k {
                (0..n).for_each(|column| self.entries.swap(k * n + column, pivot * n + column));
            }
            let reciprocal = self.entries[k * n + k].recip();
            if !reciprocal.is_finite() {
                return false;
            }
            for row in k + 1..n {
                let factor = self.entries[row * n + k] * reciprocal;
                self.entries[row * n + k] = factor;
                for column in k + 1..n {
                    self.entries[row * n + column] -= factor * self.entries[k * n + column];
                }
            }
        }
        true
    }

    fn solve(&self, b: &mut [f64]) {
        let n = self.n;
        for k in 0..n {
            b.swap(k, self.pivots[k]);
        }
        for row in 0..n {
            let known: f64 = (0..row).map(|k| self.entries[row * n + k] * b[k]).sum();
            b[row] -= known;
        }
        for row in (0..n).rev() {
            let known: f64 = (row + 1..n).map(|k| self.entries[row * n + k] * b[k]).sum();
            b[row] = (b[row] - known) / self.entries[row * n + row];
        }
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
