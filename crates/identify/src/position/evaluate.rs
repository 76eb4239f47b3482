//! Cost and Gauss-Newton Hessian of the position error over all runs.

use dynid_logs::noise::noise_of_log;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{FitRun, PositionFitError, PositionProblem, motion::RunMotion, physical_links, run_unknowns::RunUnknowns};
use crate::plan::Plan;
use crate::sensitivity::Columns;
use dynid_dynamics::{
    simulate, simulate::Options, simulate::Planned, simulate::Predictor, simulate::Scheme, simulate::SimulationError,
};
use dynid_optimise::{body::Body, quadratic::Quadratic, region::HalfSpace, sqp::Objective};

/// A run, ready to be evaluated at any unknowns.
pub(super) struct Ready<'a> {
    pub(super) run: &'a FitRun,
    unknowns: RunUnknowns,
    /// Factor on each free joint's error: weight over noise.
    pub(super) weights: Vec<f64>,
    /// Where each free joint started and the weight of that, if the log's transient is cut; else none.
    starts: Vec<(f64, f64)>,
}

/// All runs at any unknowns: parameters first, then every run's initial positions (and speeds if it moves).
pub(super) struct Evaluator<'a> {
    pub(super) ready: Vec<Ready<'a>>,
    n_parameters: usize,
    n: usize,
    bodies: Vec<Body>,
    spread: Vec<f64>,
    /// Weak and earlier knowledge of the parameters.
    prior_mean: DVector<f64>,
    prior_information: DMatrix<f64>,
}

/// How the runs are simulated.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Resolution {
    /// How each interval is integrated: cost and derivatives are of the same discrete function.
    pub(super) plan: Plan,
    /// Rate of the observer to the log [1/s]; 0 without one.
    pub(super) observer: f64,
}

/// An evaluator at one resolution.
pub(super) struct At<'e, 'a> {
    evaluator: &'e Evaluator<'a>,
    resolution: Resolution,
}

impl<'a> Evaluator<'a> {
    pub(super) fn new(problem: &'a PositionProblem) -> Result<Self, PositionFitError> {
        let n_parameters = problem.unknowns.len();
        let mut n = n_parameters;
        let mut ready = Vec::with_capacity(problem.runs.len());
        for run in &problem.runs {
            ready.push(Ready::new(problem, run, n));
            n += run.n_initial();
        }
        let names: Vec<&str> = problem.unknowns.iter().map(|unknown| unknown.name.as_str()).collect();
        let bodies = physical_links::bodies(&names, &problem.known);
        let start: Vec<f64> = problem.unknowns.iter().map(|unknown| unknown.value).collect();
        if let Some(body) = bodies.iter().find(|body| !body.is_physical(&start)) {
            return Err(PositionFitError::StartUnphysical { link: body.link, moments: body.moments(&start) });
        }
        let (prior_mean, prior_information) = prior(problem);
        let spread = problem.unknowns.iter().map(super::Unknown::spread).collect();
        Ok(Self { ready, n_parameters, n, bodies, spread, prior_mean, prior_information })
    }

    /// Number of unknowns, initial positions included.
    pub(super) fn n(&self) -> usize {
        self.n
    }

    pub(super) fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    pub(super) fn prior_information(&self) -> &DMatrix<f64> {
        &self.prior_information
    }

    /// Starts of the parameters; the median of a run's first samples for its initial positions. Of a run that begins in
    /// motion, the line through its first samples.
    pub(super) fn start(&self, problem: &PositionProblem) -> Vec<f64> {
        let mut x: Vec<f64> = problem.unknowns.iter().map(|unknown| unknown.value).collect();
        for run in &problem.runs {
            x.extend(start_of(run));
        }
        x
    }

    pub(super) fn at(&self, resolution: Resolution) -> At<'_, 'a> {
        At { evaluator: self, resolution }
    }

    /// Simulated positions of every run.
    pub(super) fn simulated(&self, x: &[f64], resolution: &Resolution) -> Option<Vec<Vec<f64>>> {
        let Resolution { plan, observer } = resolution;
        let of_run = |(run, ready): (usize, &Ready<'_>)| ready.simulate(x, *observer, plan.of_run(run)).ok();
        self.ready.par_iter().enumerate().map(of_run).collect()
    }

    fn prior_cost(&self, x: &[f64]) -> f64 {
        let away = DVector::from_column_slice(&x[..self.n_parameters]) - &self.prior_mean;
        0.5 * away.dot(&(&self.prior_information * &away))
    }
}

/// Where a run starts by its first samples: positions of the free joints, then speeds where it begins in motion.
pub(crate) fn start_of(run: &FitRun) -> Vec<f64> {
    let slots = 0..run.system.n_free();
    if !run.moving {
        return slots.map(|slot| first_position(run, slot)).collect();
    }
    let lines: Vec<[f64; 2]> = slots.map(|slot| first_line(run, slot)).collect();
    lines.iter().map(|line| line[0]).chain(lines.iter().map(|line| line[1])).collect()
}

/// Median of a joint's first samples.
fn first_position(run: &FitRun, slot: usize) -> f64 {
    /// At rest the first samples differ by noise only; later ones show motion.
    const SAMPLES: usize = 3;
    let mut first = run.measured(slot);
    first.truncate(SAMPLES);
    first.sort_by(f64::total_cmp);
    first.get(first.len() / 2).copied().unwrap_or(0.0)
}

/// How well a log whose transient is cut still shows where it started, as a share of its motion's range. What is cut is
/// not trusted to the noise, but without it nothing may be left that says where the start was.
const START_OF_CUT_LOG: f64 = 0.02;

impl<'a> Ready<'a> {
    fn new(problem: &PositionProblem, run: &'a FitRun, first_initial: usize) -> Self {
        let unknowns = RunUnknowns::new(run, &problem.unknowns, first_initial);
        let n_free = run.system.n_free();
        // What is cut says nothing of the noise either.
        let first = run.first_sample();
        let weights = (0..n_free).map(|slot| run.weights[slot] / noise_of(&run.measured(slot)[first..])).collect();
        let start = |slot: usize| {
            let measured = run.measured(slot);
            let (low, high) = range(&measured);
            (first_position(run, slot), (START_OF_CUT_LOG * (high - low)).max(noise_of(&measured)).recip())
        };
        let is_cut = run.time.first().is_some_and(|first| *first < run.from_s);
        let starts = if is_cut { (0..n_free).map(start).collect() } else { Vec::new() };
        Self { run, unknowns, weights, starts }
    }

    /// Simulated positions, one row a sample.
    pub(super) fn simulate(&self, x: &[f64], observer: f64, schemes: &[Scheme]) -> Result<Vec<f64>, SimulationError> {
        let (system, rates) = (self.unknowns.system(self.run, x), self.rates(observer));
        let predictor = Predictor { position: &self.run.position, rates: &rates, schemes };
        simulate::predict(&system, &self.run.input(), &predictor, self.unknowns.initial(x), &Options::default())
            .map(|trajectory| trajectory.q)
    }

    /// How each interval is integrated that may err by this much, free joint by free joint, and the positions that come of it.
    pub(super) fn plan(&self, x: &[f64], observer: f64, tolerance: &[f64]) -> Result<Planned, SimulationError> {
        let (system, rates) = (self.unknowns.system(self.run, x), self.rates(observer));
        let predictor = Predictor { position: &self.run.position, rates: &rates, schemes: &[] };
        simulate::plan_across_gaps(&system, &self.run.input(), &predictor, self.unknowns.initial(x), tolerance)
    }

    /// All free joints are pulled to the log alike; at a rate of 0 the simulation runs free.
    fn rates(&self, observer: f64) -> Vec<f64> {
        vec![observer; self.run.system.n_free()]
    }

    /// Factor on the error of a free joint at a sample (thesis Eq. 4.2: by time; Eq. 4.3: by joint).
    pub(super) fn weight(&self, sample: usize, slot: usize) -> f64 {
        let by_time = if 2 * sample < self.run.time.len() { self.run.first_half } else { 1.0 };
        self.weights[slot] * by_time
    }

    /// Where the log's transient is cut: how far the start of each free joint is from the logged one, over what that is known to.
    pub(super) fn errors_of_start(&self, x: &[f64]) -> impl Iterator<Item = f64> {
        self.starts.iter().zip(self.unknowns.initial(x)).map(|((q0, weight), q)| (q0 - q) * weight)
    }

    /// The weights of [`Ready::errors_of_start`].
    pub(super) fn weights_of_start(&self) -> impl Iterator<Item = f64> {
        self.starts.iter().map(|(_, weight)| *weight)
    }

    /// What is unknown in this run is integrated for these columns.
    pub(super) fn columns(&self) -> &Columns {
        self.unknowns.columns()
    }

    /// Number of this run's own parameters.
    pub(super) fn n_parameters(&self) -> usize {
        self.unknowns.n_parameters()
    }

    /// Index among all unknowns of each of this run's own.
    pub(super) fn places(&self) -> Vec<usize> {
        self.unknowns.places()
    }

    /// As [`RunUnknowns::along`], free of the log.
    pub(super) fn along(
        &self,
        x: &[f64],
        schemes: &[Scheme],
        observe: impl FnMut(usize, &[f64], &[f64]),
    ) -> Option<DMatrix<f64>> {
        self.unknowns.along(self.run, x, (&self.rates(0.0), schemes), observe)
    }

    fn cost(&self, x: &[f64], observer: f64, schemes: &[Scheme]) -> Result<f64, SimulationError> {
        let simulated = self.simulate(x, observer, schemes)?;
        let n_free = self.run.system.n_free();
        let skip = self.run.first_sample() * n_free;
        let errors = self.run.position.iter().zip(&simulated).enumerate().skip(skip);
        let weight = |index: usize| self.weight(index / n_free, index % n_free);
        let of_start: f64 = self.errors_of_start(x).map(|error| error.powi(2)).sum();
        Ok(0.5 * (errors.map(|(index, (y, q))| ((y - q) * weight(index)).powi(2)).sum::<f64>() + of_start))
    }

    /// Cost, gradient and Hessian by this run's own unknowns.
    fn quadratic(&self, x: &[f64], observer: f64, schemes: &[Scheme]) -> Option<Quadratic> {
        let n_free = self.run.system.n_free();
        let count = self.unknowns.columns().count();
        let width = self.unknowns.columns().width();
        let mut cost = 0.0;
        let mut gradient = vec![0.0; width];
        let mut hessian = vec![0.0; width * width];
        let observe = |sample: usize, position: &[f64], rows: &[f64]| {
            for (slot, row) in rows.chunks_exact(width).enumerate() {
                let weight = self.weight(sample, slot);
                let error = (self.run.position[sample * n_free + slot] - position[slot]) * weight;
                cost += 0.5 * error * error;
                for (gradient, by) in gradient.iter_mut().zip(row) {
                    *gradient -= error * weight * by;
                }
                for (index, line) in hessian.chunks_exact_mut(width).enumerate().take(count) {
                    let factor = weight * weight * row[index];
                    for (entry, by) in line.iter_mut().zip(row) {
                        *entry += factor * by;
                    }
                }
            }
        };
        let by_unknown = self.unknowns.along(self.run, x, (&self.rates(observer), schemes), observe)?;
        let initial = self.unknowns.initial(x);
        let gradient = DVector::from_fn(count, |k, _| gradient[k]);
        let hessian = DMatrix::from_fn(count, count, |row, column| hessian[row * width + column]);
        let mut gradient = by_unknown.transpose() * gradient;
        let mut hessian = by_unknown.transpose() * hessian * &by_unknown;
        for (slot, ((q0, weight), q)) in self.starts.iter().zip(initial).enumerate() {
            let place = self.unknowns.n_parameters() + slot;
            cost += 0.5 * ((q - q0) * weight).powi(2);
            gradient[place] += (q - q0) * weight * weight;
            hessian[(place, place)] += weight * weight;
        }
        Some(Quadratic { cost, gradient, hessian })
    }

    /// `sum(j' j)` over the samples that count for each free joint, `j` being the derivative of its simulated position by this run's
    /// unknowns.
    fn motion(&self, x: &[f64], schemes: &[Scheme]) -> Option<Vec<DMatrix<f64>>> {
        let (count, width) = (self.unknowns.columns().count(), self.unknowns.columns().width());
        let mut sums = vec![DMatrix::<f64>::zeros(count, count); self.run.system.n_free()];
        let observe = |_: usize, _: &[f64], rows: &[f64]| {
            for (sum, row) in sums.iter_mut().zip(rows.chunks_exact(width)) {
                let row = DVector::from_column_slice(&row[..count]);
                sum.ger(1.0, &row, &row, 1.0);
            }
        };
        let by_unknown = self.unknowns.along(self.run, x, (&self.rates(0.0), schemes), observe)?;
        Some(sums.into_iter().map(|sum| by_unknown.transpose() * sum * &by_unknown).collect())
    }
}

impl At<'_, '_> {
    pub(super) fn resolution(&self) -> &Resolution {
        &self.resolution
    }

    /// How each interval of a run is integrated.
    fn schemes(&self, run: usize) -> &[Scheme] {
        self.resolution.plan.of_run(run)
    }

    /// With the same steps, but free.
    pub(super) fn without_observer(&self) -> Self {
        let plan = self.resolution.plan.clone();
        self.evaluator.at(Resolution { plan, observer: 0.0 })
    }

    /// Whether the simulations stay near the logs.
    pub(super) fn is_near(&self, x: &[f64]) -> bool {
        /// Root mean square of the error over the noise.
        const NEAR: f64 = 10.0;
        self.data_cost(x).is_some_and(|cost| 2.0 * cost <= NEAR * NEAR * self.samples() as f64)
    }

    /// Number of errors in the cost.
    pub(super) fn samples(&self) -> usize {
        let ready = &self.evaluator.ready;
        let used = |ready: &Ready<'_>| ready.run.time.len().saturating_sub(ready.run.first_sample());
        ready.iter().map(|ready| used(ready) * ready.run.system.n_free()).sum()
    }

    /// Simulated positions of every run.
    pub(super) fn simulated(&self, x: &[f64]) -> Option<Vec<Vec<f64>>> {
        self.evaluator.simulated(x, &self.resolution)
    }

    /// Cost of the data alone, without any prior.
    pub(super) fn data_cost(&self, x: &[f64]) -> Option<f64> {
        let ready = &self.evaluator.ready;
        let costs: Option<Vec<f64>> = (0..ready.len())
            .into_par_iter()
            .map(|run| ready[run].cost(x, self.resolution.observer, self.schemes(run)).ok())
            .collect();
        costs.map(|costs| costs.iter().sum::<f64>())
    }

    /// Cost and derivatives of the data alone, without any prior.
    pub(super) fn data(&self, x: &[f64]) -> Option<Quadratic> {
        let evaluator = self.evaluator;
        let parts: Option<Vec<Quadratic>> = (0..evaluator.ready.len())
            .into_par_iter()
            .map(|run| evaluator.ready[run].quadratic(x, self.resolution.observer, self.schemes(run)))
            .collect();
        let mut total = Quadratic {
            cost: 0.0,
            gradient: DVector::zeros(evaluator.n),
            hessian: DMatrix::zeros(evaluator.n, evaluator.n),
        };
        // In the order of the runs, whichever thread was first: the same bits every time.
        for (ready, part) in evaluator.ready.iter().zip(parts?) {
            let places = ready.unknowns.places();
            total.cost += part.cost;
            for (own, place) in places.iter().enumerate() {
                total.gradient[*place] += part.gradient[own];
                for (other, second) in places.iter().enumerate() {
                    total.hessian[(*place, *second)] += part.hessian[(own, other)];
                }
            }
        }
        Some(total)
    }

    /// What each run tells of the parameters, and how its simulated positions move with them.
    pub(super) fn motions(&self, x: &[f64]) -> Option<Vec<RunMotion>> {
        self.evaluator
            .ready
            .par_iter()
            .enumerate()
            .map(|(run, ready)| {
                let by_slot = ready.motion(x, self.schemes(run))?;
                let starts: Vec<f64> = ready.starts.iter().map(|(_, weight)| *weight).collect();
                let samples = ready.run.time.len() - ready.run.first_sample();
                let n = self.evaluator.n_parameters;
                Some(RunMotion::new(n, &ready.unknowns.places(), (&ready.weights, &starts), samples, &by_slot))
            })
            .collect()
    }

    /// Why the runs cannot be simulated at `x`.
    pub(super) fn why_not(&self, x: &[f64]) -> PositionFitError {
        let failure = self.evaluator.ready.iter().find_map(|ready| {
            let error = ready.plan(x, self.resolution.observer, &ready.tolerance(1.0)).err()?;
            Some(PositionFitError::Simulation { run: ready.run.name.clone(), error })
        });
        let first = || self.evaluator.ready.first().map(|ready| ready.run.name.clone());
        failure.or_else(|| Some(PositionFitError::Sensitivities { run: first()? })).unwrap_or(PositionFitError::NoRun)
    }
}

impl Objective for At<'_, '_> {
    fn cost(&self, x: &[f64]) -> Option<f64> {
        let total = self.data_cost(x)? + self.evaluator.prior_cost(x);
        total.is_finite().then_some(total)
    }

    fn quadratic(&self, x: &[f64]) -> Option<Quadratic> {
        let evaluator = self.evaluator;
        let mut quadratic = self.data(x)?;
        quadratic.cost += evaluator.prior_cost(x);
        let n = evaluator.n_parameters;
        let away = DVector::from_column_slice(&x[..n]) - &evaluator.prior_mean;
        let pull = &evaluator.prior_information * away;
        for row in 0..n {
            quadratic.gradient[row] += pull[row];
            for column in 0..n {
                quadratic.hessian[(row, column)] += evaluator.prior_information[(row, column)];
            }
        }
        let finite = quadratic.cost.is_finite() && quadratic.hessian.iter().all(|value| value.is_finite());
        finite.then_some(quadratic)
    }

    fn metric(&self, unknown: usize) -> Option<f64> {
        /// Share of its range that a parameter goes along a direction the data hardly know, at a damping of one.
        const STRIDE: f64 = 0.1;
        self.evaluator.spread.get(unknown).map(|spread| (STRIDE * spread).powi(-2))
    }

    fn cuts(&self, x: &[f64]) -> Vec<HalfSpace> {
        self.evaluator.bodies.iter().flat_map(|body| body.cuts(x)).collect()
    }
}

/// The first positions of a run; where it begins in motion, then the speeds over its first samples.
pub fn first_state(run: &FitRun) -> Vec<f64> {
    let n = run.system.n_free();
    let mut state: Vec<f64> = run.position.iter().take(n).copied().collect();
    if run.moving {
        state.extend((0..n).map(|slot| first_line(run, slot)[1]));
    }
    state
}

/// Position and speed at the first sample by the line of least squares through the first few.
fn first_line(run: &FitRun, slot: usize) -> [f64; 2] {
    const SAMPLES: usize = 6;
    let n = run.time.len().min(SAMPLES);
    let position = |k: usize| run.position[k * run.system.n_free() + slot];
    let (time, mean) = (run.time[..n].iter().sum::<f64>() / n as f64, (0..n).map(position).sum::<f64>() / n as f64);
    let (moment, product) = (0..n).fold((0.0, 0.0), |(moment, product), k| {
        let away = run.time[k] - time;
        (moment + away * away, product + away * (position(k) - mean))
    });
    let speed = if moment > 0.0 { product / moment } else { 0.0 };
    [mean + speed * (run.time[0] - time), speed]
}

/// Noise of a log as `compare` has it; a log without noise counts as one of a millionth of its range.
pub fn noise_of(measured: &[f64]) -> f64 {
    let (low, high) = range(measured);
    noise_of_log(measured).max(1e-6 * (high - low)).max(1e-12)
}

fn range(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(*value), high.max(*value)))
}

/// Mean and information of what is known before the data: ranges, and earlier fits.
fn prior(problem: &PositionProblem) -> (DVector<f64>, DMatrix<f64>) {
    let n = problem.unknowns.len();
    let start = DVector::from_fn(n, |k, _| problem.unknowns[k].expected);
    let mut information = DMatrix::zeros(n, n);
    for (k, unknown) in problem.unknowns.iter().enumerate() {
        information[(k, k)] = unknown.spread().powi(-2);
    }
    let Some(earlier) = &problem.prior else {
        return (start, information);
    };
    // Two Gaussians multiply: informations add, means weigh by them.
    let places: Vec<Option<usize>> =
        earlier.names.iter().map(|name| problem.unknowns.iter().position(|unknown| unknown.name == *name)).collect();
    let mut pull = &information * &start;
    for (row, place) in places.iter().enumerate() {
        let Some(place) = *place else { continue };
        for (column, other) in places.iter().enumerate() {
            let weight = earlier.information[(row, column)];
            pull[place] += weight * earlier.mean[column];
            if let Some(other) = *other {
                information[(place, other)] += weight;
            } else {
                pull[place] -= weight * earlier.mean[column];
            }
        }
    }
    let mean = information.clone().cholesky().map_or(start, |factor| factor.solve(&pull));
    (mean, information)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::position::tests::problem;

    /// Half of the squares of the weighed errors that count, and of the start of a run whose beginning is cut; and its slopes.
    #[test]
    fn the_cost_is_that_of_its_errors_and_the_quadratic_touches_it() {
        let mut problem = problem(3, 4.0, 0.1);
        (problem.runs[0].from_s, problem.runs[1].first_half) = (0.995, 0.5);
        let evaluator = Evaluator::new(&problem).expect("physical links");
        let mut x = evaluator.start(&problem);
        x[problem.unknowns.len()] += 0.01;
        let intervals = problem.runs.iter().map(|run| vec![Scheme::Explicit(60); run.time.len() - 1]);
        let at = evaluator.at(Resolution { plan: Plan::new(intervals.collect()), observer: 0.0 });
        assert_eq!(at.samples(), 301 + 401);
        let simulated = at.simulated(&x).expect("a motion");
        let squares = |run: usize, samples: std::ops::Range<usize>, weight: f64| -> f64 {
            let measured = &problem.runs[run].position;
            let noise = noise_of(&measured[problem.runs[run].first_sample()..]);
            samples.map(|k| ((measured[k] - simulated[run][k]) * weight / noise).powi(2)).sum()
        };
        let (low, high) = range(&problem.runs[0].position);
        let start = 0.01 / (START_OF_CUT_LOG * (high - low));
        let expected = squares(0, 100..401, 1.0) + squares(1, 0..201, 0.5) + squares(1, 201..401, 1.0) + start * start;
        let cost = at.data_cost(&x).expect("a cost");
        assert!((cost / (0.5 * expected) - 1.0).abs() < 1e-9, "{cost} {expected}");
        let data = at.data(&x).expect("a quadratic");
        assert!((data.cost / cost - 1.0).abs() < 1e-9, "{} {cost}", data.cost);
        for k in 0..evaluator.n() {
            let cost = |step: f64| {
                let mut x = x.clone();
                x[k] += step;
                at.data_cost(&x).expect("a cost")
            };
            let h = 1e-6 * x[k].abs().max(1e-3);
            let slope = (cost(h) - cost(-h)) / (2.0 * h);
            let own = data.gradient[k];
            assert!((own - slope).abs() < 1e-3 * slope.abs(), "unknown {k}: {own}, not {slope}");
        }
    }

    #[test]
    fn a_log_without_noise_has_a_millionth_of_its_range() {
        let line: Vec<f64> = (0..100).map(|k| 3.0 + 0.5 * f64::from(k)).collect();
        let found = noise_of(&line);
        assert!((found / (1e-6 * 49.5) - 1.0).abs() < 1e-6, "{found}");
        assert_eq!(noise_of(&[0.3; 100]), 1e-12, "and one that stands still as good as none");
        let rough: Vec<f64> = (0..100).map(|k| if k % 2 == 0 { 0.1 } else { -0.1 }).collect();
        assert!(noise_of(&rough) > 0.05, "what changes with every sample is noise");
    }
}
