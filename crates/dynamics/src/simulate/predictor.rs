//! The steady-state observer of the prediction-error method.

use super::{Grid, Input, Options, Recorder, Scheme, SimulationError, Stepper, adapt::Adaptation, adapt::Tolerance};
use crate::system::System;

/// Corrects a simulation at each sample by the error of its prediction (innovation), and so makes one-step predictions of it.
///
/// The gains are those of the stationary Kalman filter of a joint whose acceleration is disturbed by white noise (Kalata 1984,
/// *The tracking index*; Ljung, *System Identification*, section 7.4 for the method): with `r = exp(-rate T)` a sample moves the
/// position by `1 - r^2` of the error and the speed by `2 (1 - r)^2 / T` of it. `rate` [1/s] says how little the model is trusted:
/// at 0 the simulation runs free. The correction is causal: no sample has a part in its own prediction.
#[derive(Debug, Clone, Copy)]
pub struct Predictor<'a> {
    /// Measured positions of the free joints [rad or m], one row a sample.
    pub position: &'a [f64],
    /// Rate of each free joint [1/s].
    pub rates: &'a [f64],
    /// How each interval from a sample to the next is integrated; by one explicit step where it is not said.
    pub schemes: &'a [Scheme],
}

/// How much of a prediction's error goes into the state, and how that changes with the rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Onto the position.
    pub position: f64,
    /// Onto the speed [1/s].
    pub speed: f64,
    /// Derivative of the first by the rate (s).
    pub position_by_rate: f64,
    /// Derivative of the second by the rate.
    pub speed_by_rate: f64,
}

impl Gains {
    /// Of a rate [1/s] and the time between samples (s).
    pub fn of(rate: f64, sample_s: f64) -> Self {
        let r = (-rate * sample_s).exp();
        Self {
            position: 1.0 - r * r,
            speed: 2.0 * (1.0 - r).powi(2) / sample_s,
            position_by_rate: 2.0 * sample_s * r * r,
            speed_by_rate: 4.0 * (1.0 - r) * r,
        }
    }
}

impl Predictor<'_> {
    /// The time that a prediction of this sample spans (s).
    pub fn span(time: &[f64], sample: usize) -> f64 {
        let last = sample.max(1).min(time.len() - 1);
        time[last] - time[last.saturating_sub(1)]
    }

    /// How the interval after this sample is integrated.
    pub fn scheme(&self, sample: usize) -> Scheme {
        self.schemes.get(sample).copied().unwrap_or(Scheme::PLAIN)
    }

    /// Error of the prediction `shown` of one free joint.
    pub fn error(&self, sample: usize, slot: usize, shown: &[f64]) -> f64 {
        self.position[sample * shown.len() + slot] - shown[slot]
    }

    /// Corrects the state `x` after a sample of which `shown` was predicted. States that begin at their joint's speed (the drive
    /// side of a transmission) are corrected as that is.
    pub fn correct(&self, system: &System, time: &[f64], sample: usize, shown: &[f64], x: &mut [f64]) {
        correct_by(system, self.rates, Self::span(time, sample), |slot| self.error(sample, slot, shown), x);
    }
}

/// Adds to the state `x` what errors of the free joints come to, a sample `span` (s) after the one before, with gains of these rates [1/s].
pub fn correct_by(system: &System, rates: &[f64], span: f64, error: impl Fn(usize) -> f64, x: &mut [f64]) {
    let n = system.n_free();
    for (slot, rate) in rates.iter().enumerate() {
        let (gains, error) = (Gains::of(*rate, span), error(slot));
        x[slot] += gains.position * error;
        x[n + slot] += gains.speed * error;
        for &(state, _) in system.states_at_speed().iter().filter(|(_, at)| *at == slot) {
            x[state] += gains.speed * error;
        }
    }
}

/// Predictions, and how their intervals are to be integrated.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// As [`Predictor::schemes`].
    pub schemes: Vec<Scheme>,
    /// The predicted positions of the free joints, one row a sample.
    pub predicted: Vec<f64>,
}

/// Looks for the cheapest way to integrate each interval that is estimated to err by no more than `tolerance` [rad or m], one of each
/// free joint, in its end and by its end's speed within the time of another sample together. Schemes are tried in the order of
/// [`Scheme::LADDER`], from that of `predictor` on, which a new plan so never takes shorter.
///
/// # Errors
/// The motion diverges with the finest.
pub fn plan(
    system: &System,
    input: &Input<'_>,
    predictor: &Predictor<'_>,
    q0: &[f64],
    tolerance: &[f64],
) -> Result<Planned, SimulationError> {
    planned(system, input, predictor, q0, tolerance, |_| None)
}

/// As [`plan`], but gaps between samples take explicit steps, at least one for each of their sample times: of what is lost in a gap, nothing
/// tells a simulation that no sample corrects.
///
/// # Errors
/// As [`plan`].
pub fn plan_across_gaps(
    system: &System,
    input: &Input<'_>,
    predictor: &Predictor<'_>,
    q0: &[f64],
    tolerance: &[f64],
) -> Result<Planned, SimulationError> {
    let grid = Grid::new(input.time, 1);
    planned(system, input, predictor, q0, tolerance, |sample| grid.gap(input.time[sample], input.time[sample + 1]))
}

/// Plans each interval; `gap` says of how many sample times it is where it is a gap.
fn planned(
    system: &System,
    input: &Input<'_>,
    predictor: &Predictor<'_>,
    q0: &[f64],
    tolerance: &[f64],
    gap: impl Fn(usize) -> Option<usize>,
) -> Result<Planned, SimulationError> {
    super::check(system, input, q0)?;
    system.announce(super::EVALUATIONS * input.time.len());
    let options = Options::default();
    let mut recorder = Recorder::new(system, input.time.len());
    let mut stepper = Stepper::new(system, &system.rest(q0));
    let mut adaptation = Adaptation::new(system, Tolerance::of_positions(tolerance), predictor.schemes, true);
    let mut schemes = Vec::with_capacity(input.time.len().saturating_sub(1));
    recorder.take(system, input.time.first().copied().unwrap_or(0.0), &stepper.x, &options)?;
    predictor.correct(system, input.time, 0, recorder.last(), &mut stepper.x);
    for sample in 0..input.time.len().saturating_sub(1) {
        schemes.push(match gap(sample) {
            Some(samples) => adaptation.cross_gap(&mut stepper, system, (input, sample), samples),
            None => adaptation.cross(&mut stepper, system, input, sample),
        });
        recorder.take(system, input.time[sample + 1], &stepper.x, &options)?;
        predictor.correct(system, input.time, sample + 1, recorder.last(), &mut stepper.x);
    }
    Ok(Planned { schemes, predicted: recorder.finish(Vec::new()).q })
}

#[cfg(test)]
mod tests {
    use super::Gains;

    #[test]
    fn gains_are_those_of_the_stationary_filter_and_their_derivatives_differences() {
        for (rate, sample_s) in [(0.0, 0.01), (3.0, 0.01), (150.0, 0.005), (40.0, 0.05)] {
            let gains = Gains::of(rate, sample_s);
            // Kalata's relation between the two gains.
            let beta = gains.speed * sample_s;
            let kalata = 2.0 * (2.0 - gains.position) - 4.0 * (1.0 - gains.position).sqrt();
            assert!((beta - kalata).abs() < 1e-12);
            let step = 1e-5;
            let (more, less) = (Gains::of(rate + step, sample_s), Gains::of(rate - step, sample_s));
            assert!(((more.position - less.position) / (2.0 * step) - gains.position_by_rate).abs() < 1e-7);
            assert!(((more.speed - less.speed) / (2.0 * step) - gains.speed_by_rate).abs() < 1e-7);
        }
    }
}
