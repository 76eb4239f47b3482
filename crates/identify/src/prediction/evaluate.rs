//! The likelihood of all runs, its gradient and its Gauss-Newton Hessian.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{PredictionProblem, response::Predicted};
use crate::plan::{Plan, WORTH_STEPS};
use crate::position::{FitRun, PositionFitError, physical_links, run_unknowns::RunUnknowns, start_of};
use dynid_dynamics::simulate::{self, Options, POSITION_LIMIT, Planned, Predictor, Scheme, SimulationError, Steps};
use dynid_optimise::{body::Body, quadratic::Quadratic, region::HalfSpace, sqp::Objective};

/// A run, ready to be predicted with any unknowns.
struct Ready<'a> {
    run: &'a FitRun,
    unknowns: RunUnknowns,
    /// Index of each free joint among those that have a rate.
    joints: Vec<usize>,
    /// Time between samples by which the pole of each free joint is counted (s).
    sample_s: Vec<f64>,
}

/// Sums over the samples of one joint in one run.
struct Sums {
    samples: f64,
    squares: f64,
    /// `sum(e de/du)`, by the run's own unknowns.
    gradient: DVector<f64>,
    /// `sum(de/du' de/du)`.
    hessian: DMatrix<f64>,
}

/// Sums over the samples of one joint, by the columns of its run.
#[derive(Clone)]
struct Accumulated {
    samples: f64,
    squares: f64,
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
    /// Derivatives that are not yet in `hessian`, one column an error.
    waiting: DMatrix<f64>,
    n_waiting: usize,
}

impl Accumulated {
    /// One product of matrices takes in so many errors.
    const BLOCK: usize = 64;

    fn new(width: usize) -> Self {
        Self {
            samples: 0.0,
            squares: 0.0,
            gradient: DVector::zeros(width),
            hessian: DMatrix::zeros(width, width),
            waiting: DMatrix::zeros(width, Self::BLOCK),
            n_waiting: 0,
        }
    }

    /// An error, and the derivatives of its prediction.
    fn add(&mut self, error: f64, row: &[f64]) {
        self.samples += 1.0;
        self.squares += error * error;
        self.gradient.iter_mut().zip(row).for_each(|(gradient, by)| *gradient -= error * by);
        self.waiting.column_mut(self.n_waiting).copy_from_slice(row);
        self.n_waiting += 1;
        if self.n_waiting == Self::BLOCK {
            self.take_in();
        }
    }

    fn take_in(&mut self) {
        let waiting = self.waiting.columns(0, self.n_waiting);
        self.hessian.gemm(1.0, &waiting, &waiting.transpose(), 1.0);
        self.n_waiting = 0;
    }

    fn whole(mut self) -> Self {
        self.take_in();
        self
    }
}

/// All runs at any unknowns: parameters, then every run's initial positions (and speeds), then for each joint `r = exp(-rate T)`, T
/// being the time between samples: gains are quadratic in it, and 1 is a free simulation.
pub(super) struct Evaluator<'a> {
    problem: &'a PredictionProblem,
    ready: Vec<Ready<'a>>,
    /// The device's index of each joint that has a rate.
    pub(super) joints: Vec<usize>,
    first_rate: usize,
    bodies: Vec<Body>,
    /// Time between samples of each joint (s), the shortest of its runs.
    sample_s: Vec<f64>,
    /// Variance below which an error is rounding, by joint.
    pub(super) floors: Vec<f64>,
}

/// An evaluator with these integration steps.
pub(super) struct At<'e, 'a> {
    evaluator: &'e Evaluator<'a>,
    plan: &'e Plan,
}

impl<'a> Evaluator<'a> {
    pub(super) fn new(problem: &'a PredictionProblem) -> Self {
        let mut joints: Vec<usize> =
            problem.runs.iter().flat_map(|run| run.system.kernel().free.iter().copied()).collect();
        joints.sort_unstable();
        joints.dedup();
        let first_rate = problem.unknowns.len() + problem.runs.iter().map(FitRun::n_initial).sum::<usize>();
        let (mut shortest, mut floors) = (vec![f64::INFINITY; joints.len()], vec![0.0_f64; joints.len()]);
        let mut first_initial = problem.unknowns.len();
        let mut ready = Vec::with_capacity(problem.runs.len());
        for run in &problem.runs {
            let place = |joint: &usize| joints.iter().position(|known| known == joint).unwrap_or(0);
            let own: Vec<usize> = run.system.kernel().free.iter().map(place).collect();
            let span = run.time.last().copied().unwrap_or(0.0) - run.time[0];
            let sample_s = span / (run.time.len().max(2) - 1) as f64;
            for (slot, joint) in own.iter().enumerate() {
                shortest[*joint] = shortest[*joint].min(sample_s.max(f64::MIN_POSITIVE));
                let measured = run.measured(slot);
                let (low, high) = measured
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(*value), high.max(*value)));
                floors[*joint] = floors[*joint].max((ROUNDING * (high - low)).powi(2)).max(f64::MIN_POSITIVE);
            }
            let unknowns = RunUnknowns::new(run, &problem.unknowns, first_initial)
                .predicting(own.iter().map(|joint| first_rate + joint).collect());
            first_initial += run.n_initial();
            ready.push(Ready { run, unknowns, joints: own, sample_s: Vec::new() });
        }
        for ready in &mut ready {
            ready.sample_s = ready.joints.iter().map(|joint| shortest[*joint]).collect();
        }
        let names: Vec<&str> = problem.unknowns.iter().map(|unknown| unknown.name.as_str()).collect();
        let bodies = physical_links::bodies(&names, &problem.known);
        Self { problem, ready, joints, first_rate, bodies, sample_s: shortest, floors }
    }

    /// Number of unknowns.
    pub(super) fn n(&self) -> usize {
        self.first_rate + self.joints.len()
    }

    pub(super) fn at<'e>(&'e self, plan: &'e Plan) -> At<'e, 'a> {
        At { evaluator: self, plan }
    }

    /// Whether a plan is of these runs.
    pub(super) fn is_planned(&self, plan: &Plan) -> bool {
        plan.fits(self.intervals())
    }

    /// Bounds of what stands behind the parameters.
    pub(super) fn bound_rest(&self, lower: &mut Vec<f64>, upper: &mut Vec<f64>) {
        lower.resize(self.first_rate, f64::NEG_INFINITY);
        upper.resize(self.first_rate, f64::INFINITY);
        for (joint, sample_s) in self.joints.iter().zip(&self.sample_s) {
            let kept = self.problem.rates.get(joint).filter(|_| self.problem.keeps_rates);
            let kept = kept.map(|rate| (-rate * sample_s).exp().max(LEAST_POLE));
            lower.push(kept.unwrap_or(LEAST_POLE));
            upper.push(kept.unwrap_or(1.0));
        }
    }

    /// Values of the parameters as given, bodies made physical; initial positions by the first samples; rates as given, or the
    /// likeliest of a few.
    pub(super) fn start(&self) -> Result<Vec<f64>, PositionFitError> {
        let problem = self.problem;
        let (mut lower, mut upper) = (Vec::new(), Vec::new());
        for unknown in &problem.unknowns {
            lower.push(unknown.lower);
            upper.push(unknown.upper);
        }
        let mut x: Vec<f64> =
            problem.unknowns.iter().map(|unknown| unknown.value.clamp(unknown.lower, unknown.upper)).collect();
        physical_links::make_physical(&self.bodies, &mut x, &lower, &upper);
        if let Some(body) = self.bodies.iter().find(|body| !body.is_physical(&x)) {
            return Err(PositionFitError::StartUnphysical { link: body.link, moments: body.moments(&x) });
        }
        for (index, run) in problem.runs.iter().enumerate() {
            let given = problem.initial.get(index).filter(|given| given.len() == run.n_initial());
            x.extend(given.cloned().unwrap_or_else(|| start_of(run)));
        }
        let given: Vec<Option<f64>> = self.joints.iter().map(|joint| problem.rates.get(joint).copied()).collect();
        let with = |pole: f64| -> Vec<f64> {
            let poles = given.iter().zip(&self.sample_s).map(|(given, sample_s)| match given {
                Some(rate) => (-rate * sample_s).exp().max(LEAST_POLE),
                None => pole,
            });
            x.iter().copied().chain(poles).collect()
        };
        if given.iter().all(Option::is_some) {
            return Ok(with(LEAST_POLE));
        }
        let start = with(LEAST_POLE);
        self.likeliest(POLES.into_iter().map(with)).ok_or_else(|| self.why_not(&start))
    }

    /// With rates at which a model is followed that runs away from what it was not fitted to: poles are lowered as long as that is
    /// likelier with these integration steps than `cost`; where they do for none, the likeliest with steps of its own.
    pub(super) fn followed(&self, x: &[f64], cost: Option<f64>, plan: &Plan) -> Vec<f64> {
        if self.problem.keeps_rates {
            return x.to_vec();
        }
        let at_most = |pole: f64| {
            let mut x = x.to_vec();
            x[self.first_rate..].iter_mut().for_each(|own| *own = own.min(pole));
            x
        };
        let mut best = cost.map(|cost| (cost, x.to_vec()));
        for trial in POLES.into_iter().map(at_most).filter(|trial| trial != x) {
            match (self.at(plan).cost(&trial), &best) {
                (Some(cost), Some((least, _))) if cost >= *least => break,
                (Some(cost), _) => best = Some((cost, trial)),
                (None, _) => {}
            }
        }
        best.map(|(_, x)| x).or_else(|| self.likeliest(POLES.into_iter().map(at_most))).unwrap_or_else(|| x.to_vec())
    }

    /// The likeliest; steps that do for one tell which is.
    fn likeliest(&self, trials: impl Iterator<Item = Vec<f64>>) -> Option<Vec<f64>> {
        let mut best: Option<(f64, Vec<f64>)> = None;
        let mut plan = None;
        for x in trials {
            let cost = plan.as_ref().and_then(|plan| self.at(plan).cost(&x)).or_else(|| {
                let own = self.plan(&x, &Plan::default(), ROUGHLY);
                let cost = self.at(&own).cost(&x);
                plan = cost.map(|_| own).or(plan.take());
                cost
            });
            if let Some(cost) = cost.filter(|cost| best.as_ref().is_none_or(|(least, _)| cost < least)) {
                best = Some((cost, x));
            }
        }
        best.map(|(_, x)| x)
    }

    /// A plan of runs that are the beginnings of these, made one of these.
    pub(super) fn continued(&self, plan: &Plan) -> Plan {
        plan.continued(&self.intervals().collect::<Vec<_>>())
    }

    /// The fewest integration steps, but at least those of `least`, that cost no more than `loss` of the log likelihood; where none do, the
    /// last that cost much less than those before. `least` may be of runs that begin with these.
    pub(super) fn plan(&self, x: &[f64], least: &Plan, loss: f64) -> Plan {
        let least = &least.beginning(&self.intervals().collect::<Vec<_>>());
        let planned = |least: &Plan, tolerances: &[f64]| -> Option<(Plan, Vec<Vec<f64>>)> {
            let of_run = |(index, ready): (usize, &Ready<'_>)| ready.plan(x, least.of_run(index), tolerances).ok();
            let found: Option<Vec<Planned>> = self.ready.par_iter().enumerate().map(of_run).collect();
            let (schemes, rough) =
                found?.into_iter().map(|Planned { schemes, predicted }| (schemes, predicted)).unzip();
            Some((Plan::new(schemes), rough))
        };
        let unit = |floor: &f64| floor.sqrt() * UNPLANNED / ROUNDING;
        let own = self.is_planned(least).then(|| self.predicted(x, least)).flatten();
        let begun = own
            .map(|rough| (least.clone(), rough))
            .or_else(|| planned(least, &self.floors.iter().map(unit).collect::<Vec<_>>()));
        let Some((begun, rough)) = begun else { return least.clone() };
        // Were every interval to err by so much, and each forgotten at once, that would be the loss.
        let loss_each = loss / self.joints.len().max(1) as f64;
        let tolerance = |(sum, floor): (&(f64, f64), &f64)| {
            (sum.1 / sum.0.max(1.0) + floor).sqrt() * (2.0 * loss_each / sum.0.max(1.0)).sqrt()
        };
        let mut tolerances: Vec<f64> = self.squares(&rough).iter().zip(&self.floors).map(tolerance).collect();
        let (mut plan, mut best) = (begun.clone(), (f64::INFINITY, begun));
        while let Some((next, rough)) = planned(&plan, &tolerances) {
            plan = next;
            let lost = self.loss_of(x, &plan, &rough);
            let is_of_use = lost <= loss || lost < WORTH_STEPS * best.0;
            if is_of_use {
                best = (lost, plan.clone());
            }
            if lost <= loss || !is_of_use {
                break;
            }
            // Errors add up as long as a predictor remembers.
            let share = (loss / lost).sqrt().clamp(LEAST_SHARE, MOST_SHARE);
            tolerances.iter_mut().for_each(|tolerance| *tolerance *= share);
        }
        best.1
    }

    /// Whether these integration steps cost no more than `loss` of the log likelihood.
    pub(super) fn is_fine_enough(&self, x: &[f64], plan: &Plan, loss: f64) -> bool {
        let rough = self.is_planned(plan).then(|| self.predicted(x, plan)).flatten();
        rough.is_some_and(|rough| self.loss_of(x, plan, &rough) <= loss)
    }

    /// What predictions with these integration steps may cost of the log likelihood.
    fn loss_of(&self, x: &[f64], plan: &Plan, rough: &[Vec<f64>]) -> f64 {
        self.predicted(x, &plan.halved()).map_or(f64::MAX, |fine| self.lost(rough, &fine))
    }

    /// Number of errors of all joints and runs that count.
    pub(super) fn samples(&self) -> f64 {
        let of_run = |ready: &Ready<'_>| (ready.run.time.len() - ready.run.first_sample()) * ready.joints.len();
        self.ready.iter().map(of_run).sum::<usize>() as f64
    }

    /// Number of intervals of each run.
    fn intervals(&self) -> impl Iterator<Item = usize> {
        self.ready.iter().map(|ready| ready.run.time.len().saturating_sub(1))
    }

    /// Predictions of all runs.
    fn predicted(&self, x: &[f64], plan: &Plan) -> Option<Vec<Vec<f64>>> {
        self.ready.par_iter().enumerate().map(|(run, ready)| ready.predict(x, plan.of_run(run)).ok()).collect()
    }

    /// Number of errors of each joint, and the sum of their squares.
    fn squares(&self, predicted: &[Vec<f64>]) -> Vec<(f64, f64)> {
        let mut totals = vec![(0.0, 0.0); self.joints.len()];
        for (ready, predicted) in self.ready.iter().zip(predicted) {
            let n = ready.joints.len();
            let pairs = ready.run.position.iter().zip(predicted).enumerate().skip(ready.run.first_sample() * n);
            for (index, (measured, predicted)) in pairs {
                let total = &mut totals[ready.joints[index % n]];
                *total = (total.0 + 1.0, total.1 + (measured - predicted).powi(2));
            }
        }
        totals
    }

    /// What rough predictions may cost of the log likelihood, if they differ from fine ones by noise of their own.
    fn lost(&self, rough: &[Vec<f64>], fine: &[Vec<f64>]) -> f64 {
        let mut sums = vec![(0.0, 0.0, 0.0); self.joints.len()];
        for ((ready, rough), fine) in self.ready.iter().zip(rough).zip(fine) {
            let uncounted = ready.run.first_sample() * ready.joints.len();
            for (index, (rough, fine)) in rough.iter().zip(fine).enumerate().skip(uncounted) {
                let sum = &mut sums[ready.joints[index % ready.joints.len()]];
                sum.0 += (rough - fine).powi(2);
                sum.1 += (ready.run.position[index] - fine).powi(2);
                sum.2 += 1.0;
            }
        }
        let of_joint = |((change, error, count), floor): (&(f64, f64, f64), &f64)| {
            0.5 * change / (error / f64::max(*count, 1.0) + floor)
        };
        sums.iter().zip(&self.floors).map(of_joint).sum()
    }

    /// Derivatives of the predictions of every run and free joint: one row an error as in [`Evaluator::errors`], one column an unknown
    /// of that run.
    pub(super) fn slopes(&self, x: &[f64], plan: &Plan) -> Option<Vec<Vec<DMatrix<f64>>>> {
        self.ready.par_iter().enumerate().map(|(run, ready)| ready.slopes(x, plan.of_run(run))).collect()
    }

    /// All runs, and how their predictions answer to other equations.
    pub(super) fn responses(&self, x: &[f64], plan: &Plan) -> Option<Vec<Predicted>> {
        let of_run = |(run, ready): (usize, &Ready<'_>)| {
            let (system, rates) = (ready.unknowns.system(ready.run, x), ready.rates(x));
            Predicted::new(ready.run, system, rates, plan.of_run(run), ready.unknowns.initial(x)).ok()
        };
        self.ready.par_iter().enumerate().map(of_run).collect()
    }

    /// Index of each joint that has a rate, slot by slot, and of each unknown of a run among all.
    pub(super) fn places(&self, run: usize) -> (Vec<usize>, Vec<usize>) {
        (self.ready[run].joints.clone(), self.ready[run].unknowns.places())
    }

    pub(super) fn prior_cost(&self, x: &[f64]) -> f64 {
        let unknowns = self.problem.unknowns.iter().zip(&self.problem.spreads).zip(x);
        0.5 * unknowns.map(|((unknown, spread), x)| ((x - unknown.expected) / spread).powi(2)).sum::<f64>()
    }

    pub(super) fn why_not(&self, x: &[f64]) -> PositionFitError {
        let failure = self.ready.iter().find_map(|ready| {
            let error = ready.plan(x, &[], &vec![0.0; self.joints.len()]).err()?;
            Some(PositionFitError::Simulation { run: ready.run.name.clone(), error })
        });
        let first = || self.ready.first().map(|ready| ready.run.name.clone());
        failure.or_else(|| Some(PositionFitError::Sensitivities { run: first()? })).unwrap_or(PositionFitError::NoRun)
    }

    /// Variance of a joint's errors: their mean square, but never less than rounding.
    pub(super) fn variance(&self, joint: usize, squares: f64, samples: f64) -> f64 {
        squares / samples + self.floors[joint]
    }

    /// `x` with the distance of every pole from 1 shrunk to this share.
    pub(super) fn with_poles_nearer(&self, x: &[f64], share: f64) -> Vec<f64> {
        let mut x = x.to_vec();
        if !self.problem.keeps_rates {
            x[self.first_rate..].iter_mut().for_each(|pole| *pole = 1.0 - share * (1.0 - *pole));
        }
        x
    }

    /// What share of an innovation a joint's position is corrected by.
    pub(super) fn correction(&self, x: &[f64], joint: usize) -> f64 {
        1.0 - x[self.first_rate + joint].min(1.0).powi(2)
    }

    /// Rates of all joints that have one [1/s].
    pub(super) fn rates(&self, x: &[f64]) -> BTreeMap<usize, f64> {
        let poles = x[self.first_rate..].iter().zip(&self.sample_s);
        self.joints.iter().copied().zip(poles.map(|(pole, sample_s)| rate(*pole, *sample_s))).collect()
    }

    /// Where each run starts.
    pub(super) fn initial(&self, x: &[f64]) -> Vec<Vec<f64>> {
        self.ready.iter().map(|ready| ready.unknowns.initial(x).to_vec()).collect()
    }

    /// Errors of the predictions of every run, joint by joint; those of samples that do not count are left out.
    pub(super) fn errors(&self, x: &[f64], plan: &Plan) -> Option<Vec<Vec<Vec<f64>>>> {
        let of_run = |(ready, predicted): (&Ready<'_>, Vec<f64>)| -> Vec<Vec<f64>> {
            let n = ready.joints.len();
            let first = ready.run.first_sample();
            let errors = |slot: usize| {
                let samples = (first..ready.run.time.len()).map(|sample| sample * n + slot);
                samples.map(|index| ready.run.position[index] - predicted[index]).collect()
            };
            (0..n).map(errors).collect()
        };
        Some(self.ready.iter().zip(self.predicted(x, plan)?).map(of_run).collect())
    }

    /// The device's index of each free joint of a run.
    pub(super) fn joints_of(&self, run: usize) -> impl Iterator<Item = usize> {
        self.ready[run].joints.iter().map(|joint| self.joints[*joint])
    }
}

/// What the integration may cost of the log likelihood at the start of a search.
pub const ROUGHLY: f64 = 10.0;
/// With so small a pole a predictor takes every sample for the truth.
const LEAST_POLE: f64 = 0.05;
/// Poles that are tried at the start.
const POLES: [f64; 5] = [0.99, 0.95, 0.8, 0.4, LEAST_POLE];
/// An error of this share of a joint's range is rounding of the simulation.
const ROUNDING: f64 = 1e-6;
/// Before it is known how large errors are, steps may err by this share of a joint's range.
const UNPLANNED: f64 = 1e-4;
/// To these shares it is cut what an interval may err by.
const LEAST_SHARE: f64 = 0.1;
const MOST_SHARE: f64 = 0.25;

/// What is not said by a plan.
const PLANNED: Options = Options { steps: Steps::PerSample(1), position_limit: POSITION_LIMIT };

/// Of a pole, and the time between samples (s) [1/s].
fn rate(pole: f64, sample_s: f64) -> f64 {
    -pole.min(1.0).ln() / sample_s
}

impl Ready<'_> {
    /// Rates of the free joints [1/s].
    fn rates(&self, x: &[f64]) -> Vec<f64> {
        self.unknowns.rates(x).iter().zip(&self.sample_s).map(|(pole, sample_s)| rate(*pole, *sample_s)).collect()
    }

    /// Predicted positions, one row a sample.
    fn predict(&self, x: &[f64], schemes: &[Scheme]) -> Result<Vec<f64>, SimulationError> {
        let (system, rates) = (self.unknowns.system(self.run, x), self.rates(x));
        let predictor = Predictor { position: &self.run.position, rates: &rates, schemes };
        simulate::predict(&system, &self.run.input(), &predictor, self.unknowns.initial(x), &PLANNED)
            .map(|trajectory| trajectory.q)
    }

    /// Integration steps that err by no more than this in an interval, by joint among those that have a rate.
    fn plan(&self, x: &[f64], least: &[Scheme], tolerances: &[f64]) -> Result<Planned, SimulationError> {
        let (system, rates) = (self.unknowns.system(self.run, x), self.rates(x));
        let predictor = Predictor { position: &self.run.position, rates: &rates, schemes: least };
        let own: Vec<f64> = self.joints.iter().map(|joint| tolerances[*joint]).collect();
        simulate::plan(&system, &self.run.input(), &predictor, self.unknowns.initial(x), &own)
    }

    /// Hands each sample that counts to `observe`: its index, the predictions and their derivatives by the columns.
    fn along(&self, x: &[f64], schemes: &[Scheme], observe: impl FnMut(usize, &[f64], &[f64])) -> Option<DMatrix<f64>> {
        let (columns, n) = (self.unknowns.columns(), self.joints.len());
        let mut chain = self.unknowns.along(self.run, x, (&self.rates(x), schemes), observe)?;
        for (slot, (column, pole)) in columns.rates().zip(self.unknowns.rates(x)).enumerate() {
            let place = chain.ncols() - n + slot;
            chain[(column, place)] = -1.0 / (pole * self.sample_s[slot]);
        }
        Some(chain)
    }

    fn slopes(&self, x: &[f64], schemes: &[Scheme]) -> Option<Vec<DMatrix<f64>>> {
        let (columns, n) = (self.unknowns.columns(), self.joints.len());
        let (count, width) = (columns.count(), columns.width());
        let mut raw: Vec<Vec<f64>> = vec![Vec::new(); n];
        let chain = self.along(x, schemes, |_, _, rows| {
            for (slot, row) in rows.chunks_exact(width).enumerate() {
                raw[slot].extend_from_slice(&row[..count]);
            }
        })?;
        Some(raw.into_iter().map(|rows| DMatrix::from_row_slice(rows.len() / count, count, &rows) * &chain).collect())
    }

    fn sums(&self, x: &[f64], schemes: &[Scheme]) -> Option<Vec<Sums>> {
        let columns = self.unknowns.columns();
        let (n, count, width) = (self.joints.len(), columns.count(), columns.width());
        let mut raw = vec![Accumulated::new(width); n];
        let observe = |sample: usize, position: &[f64], rows: &[f64]| {
            for (slot, row) in rows.chunks_exact(width).enumerate() {
                raw[slot].add(self.run.position[sample * n + slot] - position[slot], row);
            }
        };
        let chain = self.along(x, schemes, observe)?;
        let by_unknown = |accumulated: Accumulated| {
            let Accumulated { samples, squares, gradient, hessian, .. } = accumulated.whole();
            let (gradient, hessian) = (gradient.rows(0, count), hessian.view((0, 0), (count, count)));
            let (gradient, hessian) = (chain.transpose() * gradient, chain.transpose() * hessian * &chain);
            Sums { samples, squares, gradient, hessian }
        };
        Some(raw.into_iter().map(by_unknown).collect())
    }
}

impl Objective for At<'_, '_> {
    fn cost(&self, x: &[f64]) -> Option<f64> {
        let evaluator = self.evaluator;
        let totals = evaluator.squares(&evaluator.predicted(x, self.plan)?);
        let of_joint = |(joint, (samples, squares)): (usize, &(f64, f64))| {
            0.5 * samples * evaluator.variance(joint, *squares, *samples).ln()
        };
        let total = totals.iter().enumerate().map(of_joint).sum::<f64>() + evaluator.prior_cost(x);
        total.is_finite().then_some(total)
    }

    fn quadratic(&self, x: &[f64]) -> Option<Quadratic> {
        let evaluator = self.evaluator;
        let n = evaluator.n();
        let parts: Option<Vec<Vec<Sums>>> =
            evaluator.ready.par_iter().enumerate().map(|(run, ready)| ready.sums(x, self.plan.of_run(run))).collect();
        let parts = parts?;
        let mut totals = vec![(0.0, 0.0); evaluator.joints.len()];
        for (ready, part) in evaluator.ready.iter().zip(&parts) {
            for (joint, sums) in ready.joints.iter().zip(part) {
                totals[*joint].0 += sums.samples;
                totals[*joint].1 += sums.squares;
            }
        }
        let mut total =
            Quadratic { cost: evaluator.prior_cost(x), gradient: DVector::zeros(n), hessian: DMatrix::zeros(n, n) };
        let mut variances = Vec::with_capacity(totals.len());
        for (joint, (samples, squares)) in totals.iter().enumerate() {
            let variance = evaluator.variance(joint, *squares, *samples);
            total.cost += 0.5 * samples * variance.ln();
            variances.push(variance);
        }
        // In the order of the runs, whichever thread was first: the same bits every time.
        for (ready, part) in evaluator.ready.iter().zip(&parts) {
            let places = ready.unknowns.places();
            for (joint, sums) in ready.joints.iter().zip(part) {
                let information = variances[*joint].recip();
                for (own, place) in places.iter().enumerate() {
                    total.gradient[*place] += information * sums.gradient[own];
                    for (other, second) in places.iter().enumerate() {
                        total.hessian[(*place, *second)] += information * sums.hessian[(own, other)];
                    }
                }
            }
        }
        for (k, (unknown, spread)) in evaluator.problem.unknowns.iter().zip(&evaluator.problem.spreads).enumerate() {
            total.gradient[k] += (x[k] - unknown.expected) / (spread * spread);
            total.hessian[(k, k)] += spread.powi(-2);
        }
        let finite = total.cost.is_finite() && total.hessian.iter().all(|value| value.is_finite());
        finite.then_some(total)
    }

    fn metric(&self, unknown: usize) -> Option<f64> {
        /// Share of its range that a parameter goes along a direction the data hardly know, at a damping of one.
        const STRIDE: f64 = 0.1;
        self.evaluator.problem.spreads.get(unknown).map(|spread| (STRIDE * spread).powi(-2))
    }

    fn cuts(&self, x: &[f64]) -> Vec<HalfSpace> {
        self.evaluator.bodies.iter().flat_map(|body| body.cuts(x)).collect()
    }
}

#[cfg(test)]
mod tests {
    use dynid_dynamics::simulate::Intersample;
    use dynid_dynamics::system::System;
    use dynid_dynamics::system::fixtures::{ARM, GAIN, SPRING, VISCOUS, full_arm, placed};

    use super::*;
    use crate::position::Unknown;

    fn arm() -> System {
        let effects =
            [placed(&GAIN, 0, None, &[1.4]), placed(&SPRING, 0, None, &[0.9, 2.5]), placed(&VISCOUS, 1, None, &[0.3])];
        System::new(&ARM, 2, full_arm().link_parameters().to_vec(), Vec::new(), &effects).expect("an arm")
    }

    /// So many samples that no model explains, the first ones of which do not count.
    fn run(samples: u32, from_s: f64, phase: f64) -> FitRun {
        let time: Vec<f64> = (0..samples).map(|k| f64::from(k) * 0.01).collect();
        let command = time.iter().flat_map(|t| [4.0 + (9.0 * t + phase).sin(), 3.0 * (5.0 * t).cos()]).collect();
        let position =
            time.iter().flat_map(|t| [0.3 + 0.2 * (4.0 * t + phase).sin(), -0.5 + 0.1 * (7.0 * t).cos()]).collect();
        FitRun {
            name: String::new(),
            system: arm(),
            time,
            command,
            position,
            intersample: Intersample::ZeroOrder,
            weights: vec![1.0; 2],
            from_s,
            first_half: 1.0,
            moving: false,
        }
    }

    /// A spring's and a damper's values are unknown; the runs have 81 and 61 samples, of which 71 and all count.
    fn problem() -> PredictionProblem {
        let names: Vec<String> = arm().effect_names().to_vec();
        let unknown = |index: usize, value: f64| Unknown {
            name: names[index].clone(),
            value,
            expected: 0.9 * value,
            lower: 0.0,
            upper: 10.0 * value,
        };
        PredictionProblem {
            unknowns: vec![unknown(1, 0.9), unknown(3, 0.3)],
            spreads: vec![0.5, 0.2],
            rates: BTreeMap::from([(0, 20.0), (1, 60.0)]),
            ..PredictionProblem::of_values(vec![run(81, 0.1, 0.0), run(61, 0.0, 1.0)])
        }
    }

    /// Half of the logarithm of each joint's mean square, for each of its samples, and what is known beforehand; and its slopes.
    #[test]
    fn the_cost_is_that_of_its_errors_and_the_quadratic_touches_it() {
        let problem = problem();
        let evaluator = Evaluator::new(&problem);
        let x = evaluator.start().expect("a start");
        let plan = evaluator.plan(&x, &Plan::default(), 1e-3);
        assert!(evaluator.is_planned(&plan) && !evaluator.is_planned(&Plan::default()));
        assert_eq!(evaluator.samples(), 2.0 * (71.0 + 61.0));
        let errors = evaluator.errors(&x, &plan).expect("predictions");
        let counts: Vec<Vec<usize>> = errors.iter().map(|run| run.iter().map(Vec::len).collect()).collect();
        assert_eq!(counts, [[71, 71], [61, 61]]);
        let of_joint = |joint: usize| {
            let own = || errors.iter().flat_map(move |run| &run[joint]);
            let squares: f64 = own().map(|error| error * error).sum();
            0.5 * own().count() as f64 * (squares / own().count() as f64).ln()
        };
        // 0.09 and 0.03 from what is expected, of spreads 0.5 and 0.2
        let prior = 0.5 * (0.18_f64.powi(2) + 0.15_f64.powi(2));
        assert!((evaluator.prior_cost(&x) - prior).abs() < 1e-12);
        let cost = evaluator.at(&plan).cost(&x).expect("a cost");
        assert!((cost - (of_joint(0) + of_joint(1) + prior)).abs() < 1e-6 * cost.abs(), "{cost}");
        let quadratic = evaluator.at(&plan).quadratic(&x).expect("a quadratic");
        assert!((quadratic.cost - cost).abs() < 1e-9 * cost.abs());
        for k in 0..evaluator.n() {
            let at = |step: f64| {
                let mut x = x.clone();
                x[k] += step;
                evaluator.at(&plan).cost(&x).expect("a cost")
            };
            let h = 1e-5 * x[k].abs().max(0.1);
            let slope = (at(h) - at(-h)) / (2.0 * h);
            let own = quadratic.gradient[k];
            assert!((own - slope).abs() < 1e-4 * slope.abs().max(1.0), "unknown {k}: {own}, not {slope}");
        }
        // Gauss and Newton's: the slopes of the errors over their variance, and the prior's.
        let slopes = evaluator.slopes(&x, &plan).expect("slopes");
        let mut information = 0.5_f64.powi(-2);
        for joint in 0..2 {
            let squares: f64 = errors.iter().flat_map(|run| &run[joint]).map(|error| error * error).sum();
            let own: f64 = slopes.iter().map(|run| run[joint].column(0).norm_squared()).sum();
            information += own * 132.0 / squares;
        }
        assert!((quadratic.hessian[(0, 0)] / information - 1.0).abs() < 1e-4, "{information}");
    }

    #[test]
    fn poles_are_rates_by_the_shortest_time_between_samples() {
        let mut problem = problem();
        problem.runs[1].time.iter_mut().for_each(|t| *t *= 0.5);
        let evaluator = Evaluator::new(&problem);
        let x = evaluator.start().expect("a start");
        let (first, n) = (evaluator.first_rate, evaluator.n());
        assert_eq!((first, n), (2 + 4, 2 + 4 + 2), "the values, where each run starts, and a pole each");
        for (pole, rate) in x[first..].iter().zip([20.0, 60.0]) {
            assert!((pole - (-rate * 0.005_f64).exp()).abs() < 1e-12, "{pole}");
        }
        assert_eq!(evaluator.rates(&x).keys().collect::<Vec<_>>(), [&0, &1]);
        assert!((evaluator.rates(&x)[&1] - 60.0).abs() < 1e-9);
        assert!((evaluator.correction(&x, 0) - (1.0 - (-0.2_f64).exp())).abs() < 1e-12, "1 - r^2");
        let nearer = evaluator.with_poles_nearer(&x, 0.25);
        assert_eq!(nearer[..first], x[..first]);
        assert!((nearer[first] - (1.0 - 0.25 * (1.0 - x[first]))).abs() < 1e-12);
        let bounds = |problem: &PredictionProblem| {
            let evaluator = Evaluator::new(problem);
            let (mut lower, mut upper) = (vec![0.0; 2], vec![9.0; 2]);
            evaluator.bound_rest(&mut lower, &mut upper);
            (lower[first..].to_vec(), upper[first..].to_vec(), lower[2], upper[5])
        };
        assert_eq!(bounds(&problem), (vec![0.05; 2], vec![1.0; 2], f64::NEG_INFINITY, f64::INFINITY));
        problem.keeps_rates = true;
        let (lower, upper, ..) = bounds(&problem);
        assert_eq!((&lower, &*upper), (&upper, &x[first..]), "they stay");
        let kept = Evaluator::new(&problem);
        assert_eq!(kept.with_poles_nearer(&x, 0.25), x);
        assert_eq!(kept.followed(&x, None, &Plan::default()), x);
    }

    #[test]
    fn integration_steps_cost_no_more_than_they_may() {
        let problem = problem();
        let evaluator = Evaluator::new(&problem);
        let x = evaluator.start().expect("a start");
        let (rough, fine) = (evaluator.plan(&x, &Plan::default(), 1.0), evaluator.plan(&x, &Plan::default(), 1e-6));
        assert!(rough.mean_steps() < fine.mean_steps(), "{} {}", rough.mean_steps(), fine.mean_steps());
        for (plan, loss) in [(&rough, 1.0), (&fine, 1e-6)] {
            assert!(evaluator.is_fine_enough(&x, plan, loss));
        }
        let lost = evaluator.loss_of(&x, &rough, &evaluator.predicted(&x, &rough).expect("predictions"));
        assert!(lost > 0.0 && !evaluator.is_fine_enough(&x, &rough, 0.99 * lost));
        assert!(evaluator.is_fine_enough(&x, &rough, 1.01 * lost));
        // Half of what the change of each joint's predictions is of its mean square error; what does not count costs nothing.
        let predicted = evaluator.predicted(&x, &fine).expect("predictions");
        let mut moved = predicted.clone();
        moved[0][..20].iter_mut().for_each(|q| *q += 1.0);
        assert_eq!(evaluator.lost(&moved, &predicted), 0.0);
        moved[0][21] += 0.01;
        let (samples, squares) = evaluator.squares(&predicted)[1];
        let expected = 0.5 * 1e-4 / (squares / samples + evaluator.floors[1]);
        assert!((evaluator.lost(&moved, &predicted) / expected - 1.0).abs() < 1e-9);
        // What does for more goes on from there.
        assert_eq!(evaluator.plan(&x, &fine, 1.0).mean_steps(), fine.mean_steps());
    }

    /// Rates that are not given are the likeliest of a few; a model that runs away is held to its logs as firmly as is likelier.
    #[test]
    fn poles_are_lowered_as_long_as_that_is_likelier() {
        let given = problem();
        let open = PredictionProblem { rates: BTreeMap::new(), ..given.clone() };
        let evaluator = Evaluator::new(&open);
        let start = evaluator.start().expect("a start");
        let first = evaluator.first_rate;
        let with = |pole: f64| {
            let mut x = start.clone();
            x[first..].fill(pole);
            x
        };
        let plan = evaluator.plan(&with(0.99), &Plan::default(), 0.01);
        let cost = |x: &[f64]| evaluator.at(&plan).cost(x).expect("a cost");
        let costs = POLES.map(|pole| cost(&with(pole)));
        let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(cost(&start) <= least + ROUGHLY, "with steps that may cost so much: {costs:?}");
        assert!(start[first..].iter().all(|pole| *pole == start[first]) && POLES.contains(&start[first]));
        // No model explains these logs: the more firmly it is held to them the likelier, unless nothing is.
        assert!(costs.is_sorted_by(|a, b| a > b), "{costs:?}");
        let free = with(0.999);
        assert_eq!(evaluator.followed(&free, Some(cost(&free)), &plan), with(LEAST_POLE));
        assert_eq!(evaluator.followed(&free, Some(costs[2] - 1.0), &plan), free, "the first is no likelier");
        assert_eq!(evaluator.followed(&with(LEAST_POLE), None, &plan), with(LEAST_POLE), "there is none below");
    }
}
