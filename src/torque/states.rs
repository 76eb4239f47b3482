//! States of effects (LuGre's bristles) that follow the measured motion, with their exact sensitivities.

use super::{Motion, Sample};
use crate::system::{Linear, System};

/// A step of the integration is at most this share of the fastest state's time constant.
const STEP_SHARE: f64 = 0.4;
/// Steps between two samples, at most.
const MOST_STEPS: usize = 400;

/// The states at every sample of a motion.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct States {
    pub(super) n_states: usize,
    n_parameters: usize,
    /// n_samples x n_states
    values: Vec<f64>,
    /// n_samples x n_states x n_parameters; empty without gradient
    by_parameter: Vec<f64>,
}

impl States {
    /// All states at sample `k`.
    pub(super) fn at(&self, k: usize) -> &[f64] {
        &self.values[k * self.n_states..(k + 1) * self.n_states]
    }

    /// Derivative of a state at sample `k` by an effect parameter.
    pub(super) fn by_parameter(&self, k: usize, state: usize, parameter: usize) -> f64 {
        self.by_parameter[(k * self.n_states + state) * self.n_parameters + parameter]
    }
}

/// The states along `motion`; `None` where no effect has any.
pub(super) fn follow(system: &System, motion: &Motion) -> Option<States> {
    integrate(system, motion, 0)
}

/// The states and their derivatives by the effect parameters along `motion`; `None` where no effect has states.
pub(super) fn follow_with_gradient(system: &System, motion: &Motion) -> Option<States> {
    integrate(system, motion, system.effect_parameters().len())
}

/// Classical Runge-Kutta on the states `z' = f(z, q(t), dq(t))` and their sensitivities `S' = f_z S + f_p`. Positions and
/// speeds run straight between samples.
fn integrate(system: &System, motion: &Motion, n_parameters: usize) -> Option<States> {
    let n_states = system.n_effect_states();
    if n_states == 0 {
        return None;
    }
    let steps = steps_between_samples(system, motion);
    let step = motion.grid.step / steps as f64;
    let width = n_states * (1 + n_parameters);
    let mut field = Field { system, motion, linear: Linear::new(system), sample: Sample::new(system), n_parameters };
    // z and S together: z first, then S row by row.
    let mut y = vec![0.0; width];
    y[..n_states].copy_from_slice(&field.sample.x[2 * system.n_free()..]);

    let mut states = States { n_states, n_parameters, values: Vec::new(), by_parameter: Vec::new() };
    let [mut k1, mut k2, mut k3, mut k4, mut at] = std::array::from_fn(|_| vec![0.0; width]);
    for k in 0..motion.len() {
        states.values.extend_from_slice(&y[..n_states]);
        states.by_parameter.extend_from_slice(&y[n_states..]);
        if k + 1 == motion.len() {
            break;
        }
        for index in 0..steps {
            let share = |part: f64| (index as f64 + part) / steps as f64;
            let moved = |at: &mut Vec<f64>, rate: &[f64], by: f64| {
                at.iter_mut().zip(y.iter().zip(rate)).for_each(|(at, (y, rate))| *at = y + by * step * rate);
            };
            field.rate(k, share(0.0), &y, &mut k1);
            moved(&mut at, &k1, 0.5);
            field.rate(k, share(0.5), &at, &mut k2);
            moved(&mut at, &k2, 0.5);
            field.rate(k, share(0.5), &at, &mut k3);
            moved(&mut at, &k3, 1.0);
            field.rate(k, share(1.0), &at, &mut k4);
            for (index, y) in y.iter_mut().enumerate() {
                *y += step / 6.0 * (k1[index] + 2.0 * (k2[index] + k3[index]) + k4[index]);
            }
        }
    }
    Some(states)
}

/// The rates of states and sensitivities.
struct Field<'a> {
    system: &'a System,
    motion: &'a Motion,
    linear: Linear,
    sample: Sample,
    n_parameters: usize,
}

impl Field<'_> {
    /// Rates at `share` of the way from sample `k` to the next.
    fn rate(&mut self, k: usize, share: f64, y: &[f64], rate: &mut [f64]) {
        let n = self.system.n_free();
        let n_states = self.system.n_effect_states();
        let between = |values: &[f64]| values[k] + share * (values[k + 1] - values[k]);
        let Sample { x, command, dx, .. } = &mut self.sample;
        for slot in 0..n {
            x[slot] = between(&self.motion.q[slot]);
            x[n + slot] = between(&self.motion.dq[slot]);
        }
        x[2 * n..].copy_from_slice(&y[..n_states]);
        command.iter_mut().zip(&self.motion.command).for_each(|(value, command)| *value = between(command));
        let time = self.motion.grid.time(k) + share * self.motion.grid.step;
        self.linear.along(self.system, time, x, None, command, dx);
        rate[..n_states].copy_from_slice(&dx[2 * n..]);
        if self.n_parameters == 0 {
            return;
        }
        let first = 2 * n;
        rate[n_states..].fill(0.0);
        let row = |state: usize| n_states + (state - first) * self.n_parameters;
        for &(state, parameter, value) in &self.linear.rate_by_parameter {
            rate[row(state) + parameter] += value;
        }
        for &(state, other, value) in &self.linear.rate_by_state {
            if other >= first {
                for parameter in 0..self.n_parameters {
                    rate[row(state) + parameter] += value * y[row(other) + parameter];
                }
            }
        }
    }
}

/// Steps between samples so that the fastest state, at its initial value, is resolved everywhere.
fn steps_between_samples(system: &System, motion: &Motion) -> usize {
    let mut linear = Linear::new(system);
    let mut sample = Sample::new(system);
    let mut fastest = 0.0_f64;
    for k in 0..motion.len() {
        sample.load(motion, None, k);
        let Sample { x, command, dx, .. } = &mut sample;
        linear.along(system, motion.grid.time(k), x, None, command, dx);
        for &(state, other, value) in &linear.rate_by_state {
            if state == other {
                fastest = fastest.max(value.abs());
            }
        }
    }
    ((fastest * motion.grid.step / STEP_SHARE).ceil() as usize).clamp(1, MOST_STEPS)
}
