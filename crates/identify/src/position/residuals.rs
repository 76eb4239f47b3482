//! The position error and its derivatives at any values of the unknowns, for optimisers outside of this crate.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::evaluate::{Evaluator, Ready, Resolution};
use super::searches::Search;
use super::{PositionFitError, PositionProblem, Unknown, check, keep_what_occurs, make_physical, region};
use crate::evaluated::{Bounds, Evaluated};
use crate::plan::Plan;
use dynid_dynamics::simulate::{Scheme, Steps};

/// Measured minus simulated positions of all runs over the noise of their log; for a log whose transient is cut, how far its start is from
/// the logged one; then the weak prior about what was expected. They are integrated by one plan everywhere, so that they are smooth.
pub struct PositionResiduals {
    problem: PositionProblem,
    names: Vec<String>,
    start: Vec<f64>,
    bounds: Bounds,
    plan: Plan,
}

impl PositionResiduals {
    /// Integrated in these steps; without, as a fit that starts from the problem's values ends.
    ///
    /// # Errors
    /// As [`super::fit`].
    pub fn new(mut problem: PositionProblem, steps: Option<Steps>) -> Result<Self, PositionFitError> {
        keep_what_occurs(&mut problem);
        check(&problem)?;
        make_physical(&mut problem);
        let evaluator = Evaluator::new(&problem)?;
        let start = evaluator.start(&problem);
        let at = Search::Final.at(&evaluator, &start, steps);
        if at.simulated(&start).is_none() {
            return Err(at.why_not(&start));
        }
        let Resolution { plan, .. } = at.resolution().clone();
        let region = region(&problem, &evaluator);
        let parameters = problem.unknowns.iter().map(|Unknown { name, .. }| name.clone());
        let starts = problem.runs.iter().flat_map(|run| {
            let free = run.system.kernel().free;
            let of_kind = move |kind: &'static str| {
                free.iter().map(move |joint| format!("{}: {kind}{joint} at the start", run.name))
            };
            of_kind("q").chain(of_kind("dq")).take(run.n_initial())
        });
        let names = parameters.chain(starts).collect();
        let bounds = (region.lower, region.upper);
        Ok(Self { names, start, bounds, plan, problem })
    }

    /// Names of the unknowns: parameters, then the first position (and speed) of each free joint of each run.
    pub fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    /// The values of the model, and where the logs begin.
    pub fn start(&self) -> &[f64] {
        &self.start
    }

    /// Between which values each unknown may lie.
    pub fn bounds(&self) -> Bounds {
        self.bounds.clone()
    }

    /// All of them at `x`; `None` where a run cannot be simulated.
    pub fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
        let evaluator = Evaluator::new(&self.problem).ok()?;
        let of_run = |(run, ready): (usize, &Ready<'_>)| ready.residuals(x, self.plan.of_run(run));
        let runs: Option<Vec<Vec<f64>>> = evaluator.ready.par_iter().enumerate().map(of_run).collect();
        Some(runs?.into_iter().flatten().chain(self.prior(x)).collect())
    }

    /// All of them at `x`, with their derivatives by the unknowns; `None` where a run cannot be simulated.
    pub fn with_jacobian(&self, x: &[f64]) -> Option<Evaluated> {
        let evaluator = Evaluator::new(&self.problem).ok()?;
        let of_run = |(run, ready): (usize, &Ready<'_>)| ready.residuals_with_jacobian(x, self.plan.of_run(run));
        let runs: Option<Vec<(Vec<f64>, DMatrix<f64>)>> = evaluator.ready.par_iter().enumerate().map(of_run).collect();
        let n = x.len();
        let (mut residuals, mut jacobian) = (Vec::new(), Vec::new());
        for (ready, (own, by_own)) in evaluator.ready.iter().zip(runs?) {
            let first = jacobian.len();
            jacobian.resize(first + own.len() * n, 0.0);
            for (row, entries) in jacobian[first..].chunks_exact_mut(n).enumerate() {
                ready.places().iter().enumerate().for_each(|(own, place)| entries[*place] = by_own[(row, own)]);
            }
            residuals.extend(own);
        }
        residuals.extend(self.prior(x));
        for (row, unknown) in self.problem.unknowns.iter().enumerate() {
            jacobian.extend((0..n).map(|column| if column == row { 1.0 / unknown.spread() } else { 0.0 }));
        }
        Some(Evaluated { residuals, jacobian })
    }

    fn prior(&self, x: &[f64]) -> impl Iterator<Item = f64> {
        self.problem.unknowns.iter().zip(x).map(|(unknown, x)| (x - unknown.expected) / unknown.spread())
    }
}

impl Ready<'_> {
    /// The errors of this run over the noise, then those of its start.
    fn residuals(&self, x: &[f64], schemes: &[Scheme]) -> Option<Vec<f64>> {
        let simulated = self.simulate(x, 0.0, schemes).ok()?;
        let n_free = self.run.system.n_free();
        let skip = self.run.first_sample() * n_free;
        let errors = self.run.position.iter().zip(&simulated).enumerate().skip(skip);
        let errors = errors.map(|(index, (y, q))| (y - q) * self.weight(index / n_free, index % n_free));
        Some(errors.chain(self.errors_of_start(x)).collect())
    }

    /// As [`Ready::residuals`], with derivatives by this run's own unknowns.
    fn residuals_with_jacobian(&self, x: &[f64], schemes: &[Scheme]) -> Option<(Vec<f64>, DMatrix<f64>)> {
        let n_free = self.run.system.n_free();
        let (count, width) = (self.columns().count(), self.columns().width());
        let mut residuals = Vec::new();
        let mut slopes = Vec::new();
        let observe = |sample: usize, position: &[f64], rows: &[f64]| {
            for (slot, row) in rows.chunks_exact(width).enumerate() {
                let weight = self.weight(sample, slot);
                residuals.push((self.run.position[sample * n_free + slot] - position[slot]) * weight);
                slopes.extend(row[..count].iter().map(|by| -weight * by));
            }
        };
        let by_unknown = self.along(x, schemes, observe)?;
        let data = DMatrix::from_row_slice(residuals.len(), count, &slopes) * by_unknown;
        let n_data = residuals.len();
        residuals.extend(self.errors_of_start(x));
        let mut jacobian = data.resize_vertically(residuals.len(), 0.0);
        for (slot, weight) in self.weights_of_start().enumerate() {
            jacobian[(n_data + slot, self.n_parameters() + slot)] = -weight;
        }
        Some((residuals, jacobian))
    }
}
