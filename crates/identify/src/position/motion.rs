//! How a run's simulated positions move with the parameters once its initial positions take their best values.

use nalgebra::DMatrix;

use super::{Evaluator, FitRun, Options, PositionFit, PositionFitError, PositionProblem, Search};

/// One run's share in what is known and in what follows from it. Matrices are by the fit's parameters, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct RunMotion {
    /// Inverse covariance from this run alone if its errors were white noise of the log's size, initial positions
    /// eliminated.
    pub information: DMatrix<f64>,
    /// For each free joint the mean of `j' j` over the samples that count, `j` being the derivative of its simulated position when
    /// the initial positions follow the parameters as the log wants [rad^2 or m^2 over the parameters' units].
    pub by_slot: Vec<DMatrix<f64>>,
}

impl RunMotion {
    /// From `sum(j' j)` of each free joint by the run's own unknowns, of which `places` says where they stand among all;
    /// `n` parameters come first there, initial positions after them. Weights are those of the errors of each free joint,
    /// and those of their starts where the log's beginning is cut.
    pub(super) fn new(
        n: usize,
        places: &[usize],
        (weights, starts): (&[f64], &[f64]),
        samples: usize,
        sums: &[DMatrix<f64>],
    ) -> Self {
        let n_own = places.iter().filter(|place| **place < n).count();
        let n_initial = places.len() - n_own;
        let mut whole = DMatrix::zeros(places.len(), places.len());
        for (sum, weight) in sums.iter().zip(weights) {
            whole += sum * (weight * weight);
        }
        for (slot, weight) in starts.iter().enumerate() {
            whole[(n_own + slot, n_own + slot)] += weight * weight;
        }
        // Best initial positions after a small change of the parameters: -H00^-1 H0p.
        let mixed = whole.view((n_own, 0), (n_initial, n_own)).into_owned();
        let follow = whole
            .view((n_own, n_own), (n_initial, n_initial))
            .into_owned()
            .cholesky()
            .map_or_else(|| DMatrix::zeros(n_initial, n_own), |factor| -factor.solve(&mixed));
        let mut along = DMatrix::zeros(places.len(), n);
        for (own, place) in places.iter().take(n_own).enumerate() {
            along[(own, *place)] = 1.0;
            for slot in 0..n_initial {
                along[(n_own + slot, *place)] = follow[(slot, own)];
            }
        }
        let seen = |matrix: &DMatrix<f64>| along.transpose() * matrix * &along;
        Self { information: seen(&whole), by_slot: sums.iter().map(|sum| seen(sum) / samples.max(1) as f64).collect() }
    }
}

/// Every run's motion at the end of a fit.
pub fn motions(
    problem: &PositionProblem,
    fit: &PositionFit,
    options: &Options,
) -> Result<Vec<RunMotion>, PositionFitError> {
    let mut problem = problem.clone();
    problem.prior = None;
    let found = |name: &str| fit.parameters.iter().find(|estimate| estimate.name == name);
    problem.unknowns.retain(|unknown| found(&unknown.name).is_some());
    problem.runs.iter_mut().for_each(|run: &mut FitRun| run.weights.fill(1.0));
    let evaluator = Evaluator::new(&problem)?;
    let mut x: Vec<f64> =
        problem.unknowns.iter().filter_map(|unknown| found(&unknown.name)).map(|estimate| estimate.value).collect();
    x.extend(fit.runs.iter().flat_map(|run| &run.initial));
    let at = Search::Final.at(&evaluator, &x, options.steps);
    at.motions(&x).ok_or_else(|| at.why_not(&x))
}
