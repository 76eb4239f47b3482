//! What a position fit found, and how sure it is.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::{
    FitRun, PositionProblem, Unknown,
    evaluate::{At, Evaluator, noise_of},
};
use crate::FitStatus;
use dynid_optimise::{quadratic::Quadratic, region::Region, sqp::Ended};
use dynid_signal::statistics::correlation_time;

/// The result of a position fit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PositionFit {
    /// How it ended.
    pub status: FitStatus,
    /// The unknowns that occur in the runs.
    pub parameters: Vec<Estimate>,
    /// What these runs alone say about them: inverse covariance in the order of `parameters`, the initial positions
    /// eliminated. Carried to later fits.
    #[serde(with = "dynid_optimise::matrix")]
    pub information: DMatrix<f64>,
    /// Covariance of the parameters, data and prior together.
    #[serde(with = "dynid_optimise::matrix")]
    pub covariance: DMatrix<f64>,
    /// Combinations that the data do not determine.
    pub undetermined: Vec<Direction>,
    /// Links whose start was an inertia that no body has, so that the fit started from one near by.
    pub moved: Vec<usize>,
    /// The fitted runs.
    pub runs: Vec<RunError>,
    /// `1/2 sum((w e / sigma)^2)`, prior included, at the end.
    pub cost: f64,
    /// Linearisations used.
    pub iterations: usize,
    /// The residual's variance over that of the noise; 1 when nothing but noise is left.
    pub variance_ratio: f64,
    /// By how much successive residuals repeat each other: 1 for white ones. Standard errors are widened by its root.
    pub correlation: f64,
}

/// One parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// From the Gauss-Newton Hessian and the residual's variance; `None` where the data leave it open or a bound holds
    /// it, for then the prior or the bound says how far it may be off.
    pub std_error: Option<f64>,
    /// False where the data narrow its range by less than half.
    pub identifiable: bool,
    /// Held by a bound, not by the data.
    pub at_bound: bool,
}

impl Estimate {
    /// From the variance that the fit leaves, how far the parameter might have lain before it, and its bounds.
    pub(crate) fn new(name: &str, value: f64, variance: f64, spread: f64, (lower, upper): (f64, f64)) -> Self {
        let std_error = variance.max(0.0).sqrt();
        // Of a range, and of what the data tell apart: a range may be so wide that it is far from every value.
        let reach = (1e-9 * spread).min(1e-3 * std_error);
        let identifiable = std_error < IDENTIFIED * spread;
        let at_bound = value - lower <= reach || upper - value <= reach;
        let std_error = Some(std_error).filter(|_| identifiable && !at_bound);
        Self { name: name.to_owned(), value, std_error, identifiable, at_bound }
    }
}

/// A combination of parameters, each in units of its range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Direction {
    /// Share of its range that the data leave open (1: all of it).
    pub open: f64,
    /// Parameter and component, largest first; small ones are left out.
    pub parts: Vec<(String, f64)>,
}

/// A run's error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunError {
    /// The run.
    pub name: String,
    /// Estimated initial positions of the free joints; then their speeds, where the log begins in motion.
    pub initial: Vec<f64>,
    /// Root mean square of measured minus simulated, per free joint [rad or m], over the samples that count.
    pub rmse: Vec<f64>,
    /// Noise of the log, per free joint.
    pub noise: Vec<f64>,
    /// Samples of the log that count.
    pub samples: usize,
    /// Simulated positions, one row a sample; files do not keep them.
    #[serde(skip)]
    pub simulated: Vec<f64>,
}

impl PositionFit {
    /// Factor on the variances of white noise of the logs' guessed size that [`Self::covariance`] contains.
    pub fn widening(&self) -> f64 {
        widening(self.variance_ratio, self.correlation)
    }
}

impl RunError {
    pub(super) fn new(run: &FitRun, initial: Vec<f64>, simulated: &[f64]) -> Self {
        let n_free = run.system.n_free();
        let first = run.first_sample();
        let samples = run.time.len() - first;
        let mut rmse = Vec::with_capacity(n_free);
        let mut noise = Vec::with_capacity(n_free);
        for slot in 0..n_free {
            let measured = run.measured(slot);
            let model = simulated.iter().skip(slot).step_by(n_free);
            let sum: f64 = measured.iter().zip(model).skip(first).map(|(y, q)| (y - q) * (y - q)).sum();
            rmse.push((sum / samples.max(1) as f64).sqrt());
            noise.push(noise_of(&measured[first..]));
        }
        Self { name: run.name.clone(), initial, rmse, noise, samples, simulated: simulated.to_vec() }
    }
}

/// A residual whose variance is below this multiple of the noise's has nothing left to explain.
const NOISE_ALONE: f64 = 1.2;

/// A parameter counts as identified when the data narrow its range to less than this share.
const IDENTIFIED: f64 = 0.5;

/// What every variance is multiplied by that counts the errors as white noise of the logs' guessed size.
///
/// What the residuals say of the noise counts, not what fourth differences guessed before the fit: those take abrupt
/// motion for noise.
fn widening(variance_ratio: f64, correlation: f64) -> f64 {
    /// No log is surer than this share of its noise, whatever a perfect model leaves.
    const LEAST_VARIANCE: f64 = 1e-2;
    variance_ratio.max(LEAST_VARIANCE) * correlation
}

#[allow(clippy::too_many_arguments)]
pub(super) fn conclude(
    problem: &PositionProblem,
    evaluator: &Evaluator<'_>,
    at: &At<'_, '_>,
    region: &Region,
    x: &[f64],
    quadratic: &Quadratic,
    ended: Ended,
    iterations: usize,
) -> PositionFit {
    let n = problem.unknowns.len();
    let simulated = at.simulated(x).unwrap_or_default();
    let mut first = n;
    let mut runs = Vec::with_capacity(problem.runs.len());
    for (run, simulated) in problem.runs.iter().zip(&simulated) {
        let initial = x[first..first + run.n_initial()].to_vec();
        first += run.n_initial();
        runs.push(RunError::new(run, initial, simulated));
    }
    let degrees = (at.samples() as f64 - x.len() as f64).max(1.0);
    let variance_ratio = 2.0 * quadratic.cost / degrees / mean_square_weight(problem);
    let correlation = correlation(problem, &runs);
    let widening = widening(variance_ratio, correlation);

    let mut data = quadratic.hessian.clone();
    for row in 0..n {
        for column in 0..n {
            data[(row, column)] -= evaluator.prior_information()[(row, column)];
        }
    }
    let information = information(problem, at, x, &data, n) / widening;
    let covariance = (&information + evaluator.prior_information())
        .cholesky()
        .map_or_else(|| DMatrix::from_element(n, n, f64::INFINITY), |factor| factor.inverse());
    let spread = DVector::from_fn(n, |k, _| problem.unknowns[k].spread());
    // Ranges are no data; earlier fits are.
    let mut determined = &information + evaluator.prior_information();
    for k in 0..n {
        determined[(k, k)] -= spread[k].powi(-2);
    }
    let undetermined = undetermined(&problem.unknowns, &determined, &spread);

    let parameters: Vec<Estimate> = problem
        .unknowns
        .iter()
        .enumerate()
        .map(|(k, unknown)| {
            Estimate::new(&unknown.name, x[k], covariance[(k, k)], spread[k], (region.lower[k], region.upper[k]))
        })
        .collect();
    // Where nothing but noise is left there is nothing to gain, whatever small jumps of the cost stop the search.
    let ended = if ended == Ended::Stuck && variance_ratio < NOISE_ALONE { Ended::Converged } else { ended };
    let status = match ended {
        Ended::Converged if parameters.iter().any(|parameter| parameter.at_bound) => FitStatus::HeldByBound,
        Ended::Converged if !undetermined.is_empty() => FitStatus::NotIdentifiable,
        Ended::Converged => FitStatus::Converged,
        Ended::IterationLimit | Ended::Interrupted => FitStatus::IterationLimit,
        Ended::Stuck => FitStatus::NumericalError,
    };
    debug_assert!(evaluator.bodies().iter().all(|body| body.is_physical(x)), "every iterate is physical");
    PositionFit {
        status,
        parameters,
        information,
        covariance,
        undetermined,
        moved: Vec::new(),
        runs,
        cost: quadratic.cost,
        iterations,
        variance_ratio,
        correlation,
    }
}

/// Inverse covariance of the parameters if the errors are white noise of the logs' size.
///
/// Where all errors weigh alike that is the Hessian H itself. Weights (thesis Eqs 4.2, 4.3) that are not the noise's make
/// a better fit of some errors and a worse estimate: its covariance is `H^-1 G H^-1`, G being H with every weight squared
/// (the covariance of the gradient).
fn information(
    problem: &PositionProblem,
    at: &At<'_, '_>,
    x: &[f64],
    hessian: &DMatrix<f64>,
    n: usize,
) -> DMatrix<f64> {
    let plain = eliminate_initial(hessian, n);
    let is_even = |run: &FitRun| run.first_half == 1.0 && run.weights.iter().all(|weight| *weight == 1.0);
    if problem.runs.iter().all(is_even) {
        return plain;
    }
    let mut squared = problem.clone();
    for run in &mut squared.runs {
        run.weights.iter_mut().for_each(|weight| *weight *= *weight);
        run.first_half *= run.first_half;
    }
    let Some(gradient) = Evaluator::new(&squared)
        .ok()
        .and_then(|evaluator| evaluator.at(at.resolution().clone()).data(x))
        .map(|data| data.hessian)
    else {
        return plain;
    };
    let along = along(hessian, n);
    let gradient = along.transpose() * gradient * along;
    let scale = DVector::from_fn(n, |k, _| gradient[(k, k)].max(f64::MIN_POSITIVE).sqrt().recip());
    let scaled = |matrix: &DMatrix<f64>| {
        DMatrix::from_fn(n, n, |row, column| matrix[(row, column)] * scale[row] * scale[column])
    };
    let eigen = SymmetricEigen::new(scaled(&gradient));
    // What moves no position has no part in either.
    let smallest = 1e-13 * eigen.eigenvalues.max();
    let inverse = eigen.eigenvalues.map(|value| if value > smallest { value.recip() } else { 0.0 });
    let half = eigen.eigenvectors.transpose() * scaled(&plain);
    let product = half.transpose() * DMatrix::from_diagonal(&inverse) * half;
    DMatrix::from_fn(n, n, |row, column| product[(row, column)] / (scale[row] * scale[column]))
}

/// Mean over samples and joints of the squared weights of the errors.
fn mean_square_weight(problem: &PositionProblem) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for run in &problem.runs {
        let early = run.time.len().div_ceil(2);
        let first = run.first_sample();
        let in_early = early.saturating_sub(first) as f64;
        let late = (run.time.len() - early.max(first)) as f64;
        for weight in &run.weights {
            sum += weight * weight * (in_early * run.first_half * run.first_half + late);
            count += in_early + late;
        }
    }
    if sum > 0.0 { sum / count } else { 1.0 }
}

/// Parameters, and initial positions that follow them to their best values, by the parameters.
fn along(hessian: &DMatrix<f64>, n: usize) -> DMatrix<f64> {
    let rest = hessian.nrows() - n;
    let mixed = hessian.view((n, 0), (rest, n)).into_owned();
    let mut along = DMatrix::zeros(hessian.nrows(), n);
    along.view_mut((0, 0), (n, n)).fill_with_identity();
    if let Some(factor) = hessian.view((n, n), (rest, rest)).into_owned().cholesky() {
        along.view_mut((n, 0), (rest, n)).copy_from(&-factor.solve(&mixed));
    }
    along
}

/// What remains for the parameters once the initial positions take their best values: the Schur complement.
fn eliminate_initial(hessian: &DMatrix<f64>, n: usize) -> DMatrix<f64> {
    let rest = hessian.nrows() - n;
    let parameters = hessian.view((0, 0), (n, n)).into_owned();
    let mixed = hessian.view((0, n), (n, rest)).into_owned();
    let initial = hessian.view((n, n), (rest, rest)).into_owned();
    match initial.cholesky() {
        Some(factor) => {
            let complement = parameters - &mixed * factor.solve(&mixed.transpose());
            (&complement + complement.transpose()) * 0.5
        }
        None => parameters,
    }
}

/// Eigenvectors of the information, in units of the ranges, along which the data leave most of the range open.
pub(crate) fn undetermined(unknowns: &[Unknown], information: &DMatrix<f64>, spread: &DVector<f64>) -> Vec<Direction> {
    /// Components below this share of a direction are not reported.
    const SMALL: f64 = 0.1;
    let n = spread.len();
    if n == 0 {
        return Vec::new();
    }
    let scaled = DMatrix::from_fn(n, n, |row, column| information[(row, column)] * spread[row] * spread[column]);
    let eigen = SymmetricEigen::new(scaled);
    let mut directions: Vec<Direction> = eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
        .filter_map(|(value, vector)| {
            // With the range as prior, this share of it remains.
            let open = (1.0 + value.max(0.0)).sqrt().recip();
            if open < IDENTIFIED {
                return None;
            }
            let mut parts: Vec<(String, f64)> = vector
                .iter()
                .enumerate()
                .filter(|(_, component)| component.abs() >= SMALL)
                .map(|(k, component)| (unknowns[k].name.clone(), *component))
                .collect();
            parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()).then_with(|| a.0.cmp(&b.0)));
            if parts.first().is_some_and(|(_, component)| *component < 0.0) {
                parts.iter_mut().for_each(|(_, component)| *component = -*component);
            }
            Some(Direction { open, parts })
        })
        .collect();
    directions.sort_by(|a, b| b.open.total_cmp(&a.open));
    directions
}

/// [`correlation_time`] of the residuals, the mean over runs and joints.
fn correlation(problem: &PositionProblem, runs: &[RunError]) -> f64 {
    let mut sum = 0.0;
    let mut count = 0.0;
    for (run, error) in problem.runs.iter().zip(runs) {
        let n_free = run.system.n_free();
        let first = run.first_sample() * n_free;
        for slot in 0..n_free {
            let residual: Vec<f64> = run
                .position
                .iter()
                .zip(&error.simulated)
                .skip(first + slot)
                .step_by(n_free)
                .map(|(y, q)| y - q)
                .collect();
            sum += correlation_time(&residual, residual.len());
            count += 1.0;
        }
    }
    if count == 0.0 { 1.0 } else { (sum / count).max(1.0) }
}
