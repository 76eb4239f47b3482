//! What a prediction-error fit has come to.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{PredictionProblem, State, evaluate::Evaluator};
use crate::FitStatus;
use crate::plan::Plan;
use crate::position::{Direction, Estimate, PositionFitError, Unknown, undetermined};
use dynid_optimise::sqp::Objective;
use dynid_signal::statistics::autocorrelation;

/// A fit, finished or not.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PredictionFit {
    /// The parameters.
    pub parameters: Vec<Estimate>,
    /// Their covariance, data and prior together.
    #[serde(with = "dynid_optimise::matrix")]
    pub covariance: DMatrix<f64>,
    /// Combinations of them that the data do not determine.
    pub undetermined: Vec<Direction>,
    /// Estimated initial positions (and speeds) of every run.
    pub initial: Vec<Vec<f64>>,
    /// Rate of each joint [1/s]: 0 where the model is trusted altogether.
    pub rates: BTreeMap<usize, f64>,
    /// The log likelihood without the prior.
    pub log_likelihood: f64,
    /// What is left, by joint.
    pub joints: Vec<JointInnovations>,
    /// Linearisations.
    pub iterations: usize,
    /// Integration steps.
    pub plan: Plan,
    /// Whether no step promises more.
    pub is_converged: bool,
}

impl PredictionFit {
    /// How it ended.
    pub fn status(&self) -> FitStatus {
        if !self.is_converged {
            FitStatus::IterationLimit
        } else if self.parameters.iter().any(|own| own.at_bound) {
            FitStatus::HeldByBound
        } else if self.parameters.iter().any(|own| !own.identifiable) {
            FitStatus::NotIdentifiable
        } else {
            FitStatus::Converged
        }
    }
}

/// The errors of the one-step predictions of a joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointInnovations {
    /// The device's index.
    pub joint: usize,
    /// How many.
    pub samples: f64,
    /// Their standard deviation [rad or m].
    pub deviation: f64,
    /// How far they are from white: 1 for white ones.
    pub whiteness: f64,
    /// What share of an innovation corrects the position: 0 where the model is trusted altogether.
    pub correction: f64,
    /// Of each tenth of each run: how many, and the sum of their squares; zeros where the joint is not free.
    #[serde(skip)]
    pub tenths: Vec<(f64, f64)>,
}

/// How many errors there are in each tenth of a run, and the sum of their squares.
fn tenths(errors: Option<&[f64]>) -> Vec<(f64, f64)> {
    const PARTS: usize = 10;
    let errors = errors.unwrap_or_default();
    let part = |k: usize| &errors[k * errors.len() / PARTS..(k + 1) * errors.len() / PARTS];
    (0..PARTS).map(|k| (part(k).len() as f64, part(k).iter().map(|error| error * error).sum())).collect()
}

/// Box and Pierce's sum `n sum rho(k)^2` over the first lags of several series, over its expectation: 1 for white ones.
fn whiteness(series: &[&[f64]]) -> f64 {
    /// Lags that are looked at.
    const LAGS: usize = 20;
    let (mut sum, mut expected) = (0.0, 0.0);
    for errors in series {
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let centred: Vec<f64> = errors.iter().map(|error| error - mean).collect();
        let rho = autocorrelation(&centred, LAGS + 1);
        sum += errors.len() as f64 * rho.iter().skip(1).map(|rho| rho * rho).sum::<f64>();
        expected += rho.len().saturating_sub(1) as f64;
    }
    if expected > 0.0 { sum / expected } else { 0.0 }
}

pub(super) fn conclude(
    problem: &PredictionProblem,
    evaluator: &Evaluator<'_>,
    state: &State,
) -> Result<PredictionFit, PositionFitError> {
    let x = &state.search.x;
    let quadratic = state.known.clone().or_else(|| evaluator.at(&state.plan).quadratic(x));
    let Some(quadratic) = quadratic else { return Err(evaluator.why_not(x)) };
    let errors = evaluator.errors(x, &state.plan).ok_or_else(|| evaluator.why_not(x))?;
    let mut joints = Vec::with_capacity(evaluator.joints.len());
    let mut log_likelihood = 0.0;
    for (index, joint) in evaluator.joints.iter().enumerate() {
        let slots = (0..errors.len()).map(|run| evaluator.joints_of(run).position(|own| own == *joint));
        let by_run: Vec<Option<&[f64]>> =
            errors.iter().zip(slots).map(|(errors, slot)| slot.map(|slot| errors[slot].as_slice())).collect();
        let series: Vec<&[f64]> = by_run.iter().copied().flatten().collect();
        let samples = series.iter().map(|errors| errors.len()).sum::<usize>() as f64;
        let squares = series.iter().flat_map(|errors| errors.iter()).map(|error| error * error).sum::<f64>();
        let variance = evaluator.variance(index, squares, samples);
        log_likelihood -= 0.5 * samples * (variance.ln() + squares / samples / variance);
        let whiteness = whiteness(&series);
        let (deviation, correction) = (variance.sqrt(), evaluator.correction(x, index));
        let tenths = by_run.iter().flat_map(|errors| tenths(*errors)).collect();
        joints.push(JointInnovations { joint: *joint, samples, deviation, whiteness, correction, tenths });
    }
    let n = problem.unknowns.len();
    let all = covariance(&quadratic.hessian);
    let covariance = all.view((0, 0), (n, n)).into_owned();
    let spread = DVector::from_column_slice(&problem.spreads);
    let data = covariance.clone().cholesky().map(|factor| {
        let mut data = factor.inverse();
        (0..n).for_each(|k| data[(k, k)] -= spread[k].powi(-2));
        data
    });
    let undetermined = data.map_or_else(Vec::new, |data| undetermined(&problem.unknowns, &data, &spread));
    let estimate = |(k, unknown): (usize, &Unknown)| {
        let bounds = (unknown.lower, unknown.upper);
        Estimate::new(&unknown.name, x[k], covariance[(k, k)], problem.spreads[k], bounds)
    };
    let parameters = problem.unknowns.iter().enumerate().map(estimate).collect();
    Ok(PredictionFit {
        parameters,
        covariance,
        undetermined,
        initial: evaluator.initial(x),
        rates: evaluator.rates(x),
        log_likelihood,
        joints,
        iterations: state.iterations + state.search.iterations,
        plan: state.plan.clone(),
        is_converged: state.is_done,
    })
}

/// Covariance of the unknowns; infinite where there is none.
fn covariance(hessian: &DMatrix<f64>) -> DMatrix<f64> {
    let all = hessian.nrows();
    let scale = DVector::from_fn(all, |k, _| hessian[(k, k)].max(f64::MIN_POSITIVE).sqrt().recip());
    let mut scaled = DMatrix::from_fn(all, all, |row, column| hessian[(row, column)] * scale[row] * scale[column]);
    // A rate that no sample depends on any more.
    (0..all).for_each(|k| scaled[(k, k)] += 1e-12);
    let Some(factor) = scaled.cholesky() else { return DMatrix::from_element(all, all, f64::INFINITY) };
    let inverse = factor.inverse();
    DMatrix::from_fn(all, all, |row, column| inverse[(row, column)] * scale[row] * scale[column])
}

#[cfg(test)]
mod tests {
    use dynid_random::Random;

    use super::*;

    /// Of a series whose sign changes with every sample, `rho(k) = (-1)^k (n - k) / n`.
    #[test]
    fn whiteness_is_box_and_pierces_sum_over_its_expectation() {
        let alternating = |n: u32| (0..n).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect::<Vec<f64>>();
        let sum = |n: u32| (1..=20).map(|lag| f64::from(n - lag).powi(2) / f64::from(n)).sum::<f64>();
        let (short, long) = (alternating(40), alternating(100));
        let close =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-9, "{found}, not {expected}");
        close(whiteness(&[&short]), sum(40) / 20.0);
        close(whiteness(&[&short, &long]), (sum(40) + sum(100)) / 40.0);
        // A mean is none of a pattern.
        let shifted: Vec<f64> = short.iter().map(|error| error + 3.0).collect();
        close(whiteness(&[&shifted]), sum(40) / 20.0);
        let of_noise = whiteness(&[&(0..4_000)
            .map({
                let mut random = Random::new(5);
                move |_| random.normal()
            })
            .collect::<Vec<f64>>()]);
        // Its standard error is the root of a tenth.
        assert!((of_noise - 1.0).abs() < 1.0, "{of_noise}");
        assert_eq!(whiteness(&[]), 0.0);
    }

    /// Of `[[4, 2], [2, 3]]` the inverse is `[[3, -2], [-2, 4]] / 8`; of a matrix that is not positive definite there is none.
    #[test]
    fn covariance_is_the_inverse_of_the_hessian() {
        let found = covariance(&DMatrix::from_row_slice(2, 2, &[4.0, 2.0, 2.0, 3.0]));
        let expected = [3.0, -2.0, -2.0, 4.0].map(|value: f64| value / 8.0);
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-9), "{found}");
        let indefinite = covariance(&DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]));
        assert!(indefinite.iter().all(|value| value.is_infinite()), "{indefinite}");
    }
}
