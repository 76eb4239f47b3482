//! How an error goes along with the commanded torques, over lags: what is left of a complete model does not know them.

use serde::Serialize;

use super::locate::Signal;
use dynid_logs::{experiment::Run, motion::Motion};
use dynid_signal::{statistics::effective_samples, straight};
use dynid_torque::JointTorqueError;

/// Lags to each side that are looked at, and the longest (s).
const LAGS: i64 = 25;
const LONGEST_S: f64 = 1.0;

/// What a correlation of independent signals exceeds at any of 51 lags in one case of a hundred, in standard deviations.
const LIMIT: f64 = 3.7;

/// The largest correlation of an error with a commanded torque.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InputCorrelation {
    /// Which error.
    pub error: Signal,
    /// The joint whose commanded torque it is.
    pub input: usize,
    /// The lag of the largest correlation (s): positive where the error comes after the torque.
    pub lag_s: f64,
    /// -1 to 1.
    pub value: f64,
    /// What its size stays below in 99 of 100 cases where error and torque have nothing to do with each other.
    pub bound: f64,
    /// What that means.
    pub outcome: CorrelationOutcome,
}

/// What a correlation means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CorrelationOutcome {
    /// Chance does not explain it: the model misses part of what the torque does.
    Significant,
    /// It cannot be decided: error and torque repeat too few times.
    Undecidable,
    /// Chance explains it.
    Insignificant,
}

impl CorrelationOutcome {
    fn of(value: f64, bound: f64) -> Self {
        /// A larger bound leaves next to nothing above it.
        const DECIDES: f64 = 0.5;
        if value.abs() > bound {
            Self::Significant
        } else if bound > DECIDES {
            Self::Undecidable
        } else {
            Self::Insignificant
        }
    }
}

/// The correlations of a joint's errors with every commanded torque that moves.
pub(super) fn correlations(
    run: &Run,
    motion: &Motion,
    position: Option<&[f64]>,
    torque: Option<&JointTorqueError>,
) -> Vec<InputCorrelation> {
    let mut found = Vec::new();
    let position = position.map(|residual| {
        let on_grid = straight(&run.log.t, residual, &motion.grid);
        motion.kept.iter().map(|&k| on_grid[k]).collect::<Vec<f64>>()
    });
    let torque = torque.map(|error| {
        error.residual.iter().zip(&error.used).map(|(value, used)| if *used { *value } else { 0.0 }).collect()
    });
    let step = motion.grid.step * motion.kept.get(1).copied().unwrap_or(1) as f64;
    for (joint, command) in motion.command.iter().enumerate() {
        if command.windows(2).all(|pair| pair[0] == pair[1]) {
            continue;
        }
        let input = centred(&motion.filtered(command));
        for (error, residual) in [(Signal::Torque, &torque), (Signal::Position, &position)] {
            let Some(residual) = residual else { continue };
            found.extend(largest(error, joint, &centred(residual), &input, step));
        }
    }
    found
}

/// The largest correlation over the lags. The bound is that of a t-test, `r sqrt(n / (1 - r^2)) < limit`, with the number of
/// independent samples of what the input does not explain.
fn largest(error: Signal, input: usize, residual: &[f64], command: &[f64], step: f64) -> Option<InputCorrelation> {
    let n = residual.len();
    let size = (square(residual) * square(command)).sqrt();
    // Where the samples are far apart, fewer lags reach the longest.
    let lags = LAGS.min((LONGEST_S / step) as i64).max(1);
    let stride = ((LONGEST_S / step / lags as f64).round() as i64).max(1);
    if size <= 0.0 || n < 4 * (lags * stride) as usize {
        return None;
    }
    let at = |lag: i64| -> f64 {
        let shift = lag.unsigned_abs() as usize;
        let (early, late) = if lag >= 0 { (command, residual) } else { (residual, command) };
        early.iter().zip(&late[shift..]).map(|(a, b)| a * b).sum::<f64>() / size
    };
    let (lag, value) = (-lags..=lags)
        .map(|lag| lag * stride)
        .map(|lag| (lag, at(lag)))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    // As for any regression, what the input leaves of the error is the noise that it is judged by.
    let coefficient = value * (square(residual) / square(command)).sqrt();
    let left: Vec<f64> = (0..n as i64)
        .map(|k| {
            let input = usize::try_from(k - lag).ok().and_then(|early| command.get(early)).copied().unwrap_or(0.0);
            residual[k as usize] - coefficient * input
        })
        .collect();
    let bound = LIMIT / (effective_samples(&left, n) + LIMIT * LIMIT).sqrt();
    let lag_s = lag as f64 * step;
    Some(InputCorrelation { error, input, lag_s, value, bound, outcome: CorrelationOutcome::of(value, bound) })
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|value| value - mean).collect()
}

fn square(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    #[test]
    fn a_late_copy_of_the_torque_is_found_at_its_lag_and_noise_is_not() {
        let command = Random::new(3).vector(4000, -1.0, 1.0);
        let noise = Random::new(4).vector(4000, -1.0, 1.0);
        let late: Vec<f64> = (0..4000).map(|k| noise[k] + if k >= 8 { -command[k - 8] } else { 0.0 }).collect();
        let found = largest(Signal::Torque, 2, &late, &command, 0.01).expect("long enough");
        assert!((found.lag_s - 0.08).abs() < 1e-12 && found.value < -0.6 && found.bound < 0.1, "{found:?}");
        assert_eq!(found.outcome, CorrelationOutcome::Significant);
        // The same at samples far apart: no lag beyond the longest is looked at.
        let found = largest(Signal::Torque, 2, &late, &command, 0.1).expect("long enough");
        assert!((found.lag_s - 0.8).abs() < 1e-12, "{found:?}");
        assert!(largest(Signal::Torque, 2, &late, &command, 0.2).expect("long enough").lag_s.abs() <= LONGEST_S + 1e-9);
        let found = largest(Signal::Torque, 2, &noise, &command, 0.01).expect("long enough");
        assert_eq!(found.outcome, CorrelationOutcome::Insignificant, "{found:?}");
        assert_eq!(CorrelationOutcome::of(0.4, 0.6), CorrelationOutcome::Undecidable);
    }
}
