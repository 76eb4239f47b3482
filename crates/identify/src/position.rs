//! Fit of the position error: measured minus simulated positions, open loop (thesis Eqs 4.2, 4.3).
//!
//! The cost is `1/2 sum((w (q_measured - q_simulated) / sigma)^2)` over the samples and free joints of all runs, `sigma`
//! being the noise of the log. Unknown are the wanted parameters and every run's initial positions, which the log shows
//! only through the noise; velocities are zero unless the run says that it begins in motion, and effect states start at
//! rest. A parameter's range also enters as a weak prior
//! (its [`Unknown::spread`] as standard deviation) that decides only where the data say nothing.
//!
//! A poor start is met by an observer ([`simulate::Predictor`]): first the simulation is corrected at each sample, so that errors do not
//! pile up, then the observer is loosened and let go as soon as the simulation stays near the log by itself. Each search integrates by
//! a plan of its own: how each interval between two samples is crossed (`plan`), in cost and derivatives alike.

mod assemble;
mod evaluate;
mod motion;
pub(crate) mod physical_links;
mod plan;
mod residuals;
mod result;
pub(crate) mod run_unknowns;
mod searches;

use std::collections::BTreeMap;

use dynid_model::instance::EQUAL;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

pub(crate) use evaluate::start_of;
pub use evaluate::{first_state, noise_of};
pub use motion::{RunMotion, motions};
pub use physical_links::made_physical;
pub use residuals::PositionResiduals;
pub(crate) use result::undetermined;
pub use result::{Direction, Estimate, PositionFit, RunError};

use dynid_dynamics::{
    simulate, simulate::Input, simulate::Intersample, simulate::SimulationError, simulate::Steps, system::System,
    system::SystemError,
};
use dynid_optimise::{
    region::Entry, region::HalfSpace, region::Region, sqp, sqp::Ended, sqp::Iteration, sqp::Limits, sqp::SearchControl,
};
use evaluate::Evaluator;
use searches::{SEARCHES, Search};

/// One log with the equations that are to explain it.
#[derive(Debug, Clone)]
pub struct FitRun {
    /// For messages.
    pub name: String,
    /// The equations; their parameter values are replaced by those of the fit.
    pub system: System,
    /// Sample times (s).
    pub time: Vec<f64>,
    /// Commanded torques of all joints of the device, one row a sample.
    pub command: Vec<f64>,
    /// Measured positions of the free joints, one row a sample.
    pub position: Vec<f64>,
    /// How torques go on between samples.
    pub intersample: Intersample,
    /// Weight of each free joint's error (thesis Table 4.6); 1 is neutral.
    pub weights: Vec<f64>,
    /// Samples before this time leave the cost (s) (the thesis's transient cut).
    pub from_s: f64,
    /// Weight of the errors in the first half of the log (thesis Eq. 4.2: 0.5); 1 is neutral.
    pub first_half: f64,
    /// The log begins while the joints move: their initial speeds are unknown too.
    pub moving: bool,
}

impl FitRun {
    /// What drives its simulation.
    pub fn input(&self) -> Input<'_> {
        Input { time: &self.time, command: &self.command, intersample: self.intersample }
    }

    /// Index of the first sample that counts.
    pub fn first_sample(&self) -> usize {
        self.time.partition_point(|t| *t < self.from_s)
    }

    /// Measured positions of one free joint.
    pub fn measured(&self, slot: usize) -> Vec<f64> {
        self.position.iter().skip(slot).step_by(self.system.n_free()).copied().collect()
    }

    /// Number of unknown initial positions and speeds.
    pub fn n_initial(&self) -> usize {
        self.system.n_free() * if self.moving { 2 } else { 1 }
    }

    /// Whether the run's equations or effects have a parameter of this name.
    pub fn occurs(&self, name: &str) -> bool {
        occurs(&self.system, name)
    }
}

/// Whether the equations or effects of `system` have a parameter of this name.
pub fn occurs(system: &System, name: &str) -> bool {
    let kernel = system.kernel();
    // A recursion may name inertias that cancel in its sums.
    let takes_part = if name.starts_with("link.") { kernel.appearing } else { kernel.parameters };
    takes_part.contains(&name) || system.effect_names().iter().any(|known| known == name)
}

/// A parameter that the fit may move.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknown {
    /// E.g. `joint.4.lugre.sigma0`.
    pub name: String,
    /// Start.
    pub value: f64,
    /// What it was taken for before any data: centre of its weak prior.
    pub expected: f64,
    /// Smallest value allowed; may be `-inf`.
    pub lower: f64,
    /// Largest value allowed; may be `inf`.
    pub upper: f64,
}

impl Unknown {
    /// How far the parameter may plausibly lie from its start: half its range; without a range, twice its own size, but
    /// at least a unit, for a start next to zero says nothing of the size.
    pub fn spread(&self) -> f64 {
        /// Where neither the range nor the value says anything.
        const UNIT: f64 = 1.0;
        let half = 0.5 * (self.upper - self.lower);
        if half > 0.0 && half.is_finite() { half } else { (2.0 * self.expected.abs()).max(UNIT) }
    }
}

/// What earlier fits know of the unknowns: `(theta - mean)' information (theta - mean) / 2` joins the cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    /// Names, in the order of `mean` and `information`.
    pub names: Vec<String>,
    /// Estimates.
    pub mean: DVector<f64>,
    /// Inverse covariance.
    pub information: DMatrix<f64>,
}

/// A fit to be done.
#[derive(Debug, Clone)]
pub struct PositionProblem {
    /// The logs.
    pub runs: Vec<FitRun>,
    /// What may move.
    pub unknowns: Vec<Unknown>,
    /// Values of the parameters that do not.
    pub known: BTreeMap<String, f64>,
    /// `(larger, smaller)`: parameters of which one must not fall below the other (thesis Eq. 4.1).
    pub inequalities: Vec<(String, String)>,
    /// Earlier knowledge.
    pub prior: Option<Prior>,
}

/// How to fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Integration steps that decide, in the last search; `None` for as few as move no position by more than a small part of the noise.
    pub steps: Option<Steps>,
    /// Linearisations at most, over all horizons.
    pub iterations: usize,
    /// Converged when the foreseen decrease is below this fraction of the cost.
    pub tolerance: f64,
    /// How far the start may be off.
    pub start: Start,
    /// How exact the end has to be.
    pub end: End,
}

/// How exact the end of a fit has to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum End {
    /// As [`Options::steps`] says.
    #[default]
    Exact,
    /// Roughly integrated: another fit goes on from there.
    Rough,
}

/// How far the start may be off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// Simulated and measured motion may part: the fit is led to the minimum with an observer.
    #[default]
    Poor,
    /// The model explains the logs nearly.
    Near,
}

impl Default for Options {
    fn default() -> Self {
        Self { steps: None, iterations: 200, tolerance: 1e-6, start: Start::Poor, end: End::Exact }
    }
}

/// One iteration, for those who watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// From 1, over all horizons.
    pub iteration: usize,
    /// Cost per sample and joint; 0.5 when all that is left is noise.
    pub cost: f64,
    /// Length of the step in standard deviations.
    pub step: f64,
    /// Rate of the observer to the logs [1/s]; 0 without one.
    pub observer: f64,
}

/// Why no fit could be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PositionFitError {
    /// Whoever watched asked to stop.
    #[error("the fit was interrupted after {iterations} iterations")]
    Interrupted {
        /// Linearisations so far.
        iterations: usize,
    },
    /// Nothing to fit to.
    #[error("there is no run to fit to; give at least one run the role \"fit\"")]
    NoRun,
    /// No parameter of the runs is unknown.
    #[error("nothing is unknown: every parameter that occurs in these runs is fixed; free one of {known:?}")]
    NoUnknown {
        /// Parameters that occur.
        known: Vec<String>,
    },
    /// The model does not make equations of motion.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A log cannot be simulated at the start.
    #[error("{run}: {error}; start from other values")]
    Simulation {
        /// The run.
        run: String,
        /// What happened.
        error: SimulationError,
    },
    /// A log can be simulated, but not how it changes with the parameters.
    #[error(
        "{run}: how the simulation changes with the parameters grows beyond all bounds: with these values the model is nearly \
         unstable; start from other values"
    )]
    Sensitivities {
        /// The first of the runs.
        run: String,
    },
    /// A log of a closed loop: what moved the joints depended on where they were.
    #[error(
        "{run}: the run is in closed loop (`controller`); its position error is not fitted: fit the torque error \
         instead (--error torque), or leave the run out"
    )]
    ClosedLoop {
        /// The run.
        run: String,
    },
    /// A log without enough samples.
    #[error(
        "{run}: {samples} samples remain of the log's {span_s} s after the cut of its transient ({cut_s} s), too few for \
         {unknowns} unknowns; shorten the cut (`from_s`, --from-s) or use a longer log"
    )]
    TooShort {
        /// The run.
        run: String,
        /// How long the log is (s).
        span_s: f64,
        /// How much of it is cut (s).
        cut_s: f64,
        /// How many remain.
        samples: usize,
        /// How many it takes.
        unknowns: usize,
    },
    /// Bounds that cross.
    #[error("{name}: the lower bound {lower} lies above the upper bound {upper}")]
    CrossedBounds {
        /// The parameter.
        name: String,
        /// Its bound.
        lower: f64,
        /// Its bound.
        upper: f64,
    },
    /// A start that is not allowed.
    #[error(
        "{name} starts at {value}, outside its bounds {lower} to {upper}; start within them or clip it with --clip"
    )]
    StartOutside {
        /// The parameter.
        name: String,
        /// Its start.
        value: f64,
        /// Its bound.
        lower: f64,
        /// Its bound.
        upper: f64,
    },
    /// A start that breaks an inequality.
    #[error("{larger} = {larger_value} starts below {smaller} = {smaller_value}; it must not be smaller")]
    StartUnequal {
        /// The parameter that must not be smaller.
        larger: String,
        /// Its start.
        larger_value: f64,
        /// The other.
        smaller: String,
        /// Its start.
        smaller_value: f64,
    },
    /// A start that no body has.
    #[error(
        "link {link} starts with an inertia that no body has: its principal moments {moments:?} kg*m^2 break the \
         triangle inequality, or its mass is negative; start from a body's values"
    )]
    StartUnphysical {
        /// Its number.
        link: usize,
        /// Principal moments of inertia.
        moments: [f64; 3],
    },
    /// A parameter that only the equations' constants depend on.
    #[error("{name} cannot be fitted: only link and effect parameters can; fix it in the model")]
    NotFittable {
        /// The parameter.
        name: String,
    },
    /// A run's data of the wrong length.
    #[error("{run}: {what}: {found} values given, {expected} needed")]
    Length {
        /// The run.
        run: String,
        /// Which.
        what: &'static str,
        /// How many came.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
}

/// All that a fit carries from one iteration to the next, for [`resume`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Which search it is in, from 0.
    pub stage: usize,
    /// Where that search began; its integration steps follow from it.
    pub anchor: Vec<f64>,
    /// Linearisations before that search.
    pub iterations: usize,
    /// Where that search is.
    pub search: sqp::State,
}

impl State {
    /// Whether it is of a problem with `n` unknowns.
    fn is_of(&self, n: usize) -> bool {
        let mut terms = self.search.half_spaces.iter().flat_map(|half_space| &half_space.terms);
        self.anchor.len() == n && self.search.x.len() == n && terms.all(|(index, _)| *index < n)
    }
}

/// Fits; `watch` sees every iteration and may stop, which ends the fit with [`PositionFitError::Interrupted`].
pub fn fit(
    problem: &PositionProblem,
    options: &Options,
    watch: &mut dyn FnMut(&Progress) -> SearchControl,
) -> Result<PositionFit, PositionFitError> {
    resume(problem, options, None, &mut |progress, _| watch(progress))
}

/// As [`fit`], from a state that `watch` was shown in a fit of the same problem: ends bit-identical to a fit that never
/// stopped.
pub fn resume(
    problem: &PositionProblem,
    options: &Options,
    from: Option<State>,
    watch: &mut dyn FnMut(&Progress, &State) -> SearchControl,
) -> Result<PositionFit, PositionFitError> {
    let mut problem = problem.clone();
    keep_what_occurs(&mut problem);
    check(&problem)?;
    let moved = make_physical(&mut problem);
    let evaluator = Evaluator::new(&problem)?;
    let mut region = region(&problem, &evaluator);
    let (mut stage, mut iterations, mut x, mut search) = match from.filter(|state| state.is_of(evaluator.n())) {
        Some(state) => (state.stage, state.iterations, state.anchor, Some(state.search)),
        None => {
            let stage = if options.start == Start::Near { searches::FIRST_FREE } else { 0 };
            (stage, 0, evaluator.start(&problem), None)
        }
    };
    loop {
        let anchor = x;
        let kind = SEARCHES[stage.min(searches::LAST)];
        let at = kind.at(&evaluator, &anchor, options.steps);
        // What stays near the logs by itself needs no observer any more.
        let let_go = (kind.observer() > 0.0).then(|| at.without_observer());
        let is_near = |x: &[f64]| let_go.as_ref().is_some_and(|free| free.is_near(x));
        let begun = search.take();
        let done = begun.as_ref().map_or(0, |state| state.iterations);
        let state = begun.unwrap_or_else(|| sqp::State::start(&anchor, &region));
        if is_near(&state.x) {
            // The cuts that it met hold on.
            region.half_spaces = state.half_spaces;
            (stage, iterations, x) = (searches::FIRST_FREE, iterations + done, state.x);
            continue;
        }
        let limits = kind.limits(options, iterations);
        let samples = at.samples() as f64;
        let mut has_come_near = false;
        let mut reported = |iteration: &Iteration, search: &sqp::State| {
            let progress = Progress {
                iteration: iterations + iteration.number,
                cost: iteration.cost / samples,
                step: iteration.step,
                observer: kind.observer(),
            };
            let control =
                watch(&progress, &State { stage, iterations, anchor: anchor.clone(), search: search.clone() });
            has_come_near = control == SearchControl::Continue && is_near(&search.x);
            if has_come_near { SearchControl::GoodEnough } else { control }
        };
        let outcome = sqp::resume(&at, &mut region, state, None, &limits, &mut reported);
        iterations += outcome.iterations;
        x = outcome.x;
        if outcome.ended == Ended::Interrupted {
            return Err(PositionFitError::Interrupted { iterations });
        }
        let is_last = stage >= searches::LAST || iterations >= options.iterations;
        let is_final = match kind {
            Search::Observed(_) => false,
            Search::Rough => options.end == End::Rough && outcome.quadratic.is_some(),
            Search::Final => {
                is_last || x == anchor || options.steps.is_some() || evaluator.holds(at.resolution(), &anchor, &x)
            }
        };
        if is_final {
            let Some(quadratic) = outcome.quadratic else { return Err(at.why_not(&x)) };
            let fit = result::conclude(&problem, &evaluator, &at, &region, &x, &quadratic, outcome.ended, iterations);
            return Ok(PositionFit { moved, ..fit });
        }
        // What stiffened on the way gets shorter steps: the next search plans anew.
        stage = if has_come_near { searches::FIRST_FREE } else { stage + 1 };
    }
}

/// Initial positions of a run that was not fitted, estimated from its log with all parameters held.
///
/// The log's first sample shows the start only through its noise.
pub fn initial_positions(run: &FitRun, options: &Options) -> Result<Vec<f64>, PositionFitError> {
    started(run, options).map(|(initial, _)| initial)
}

/// A run against its log: estimates the initial positions, simulates, and tells the error of each free joint.
pub fn judge(run: &FitRun, options: &Options) -> Result<RunError, PositionFitError> {
    let (initial, planned) = started(run, options)?;
    let simulated = match options.steps {
        Some(steps) => {
            let how = simulate::Options { steps, ..simulate::Options::default() };
            let trajectory = simulate::simulate(&run.system, &run.input(), &initial, &how)
                .map_err(|error| PositionFitError::Simulation { run: run.name.clone(), error })?;
            trajectory.q
        }
        None => planned,
    };
    Ok(RunError::new(run, initial, &simulated))
}

/// The best initial positions of a run, and its simulation from there by the plan that found them.
fn started(run: &FitRun, options: &Options) -> Result<(Vec<f64>, Vec<f64>), PositionFitError> {
    let problem = PositionProblem {
        runs: vec![run.clone()],
        unknowns: Vec::new(),
        known: BTreeMap::new(),
        inequalities: Vec::new(),
        prior: None,
    };
    let evaluator = Evaluator::new(&problem)?;
    let mut region = region(&problem, &evaluator);
    let limits = Limits::of_squares(20, 1e-4);
    let mut minimised = |search: Search, x: &[f64]| {
        let at = search.at(&evaluator, x, options.steps);
        let outcome = sqp::minimise(&at, &mut region, x, &limits, &mut |_| SearchControl::Continue);
        (at, outcome)
    };
    let (_, near) = minimised(Search::Rough, &evaluator.start(&problem));
    let (at, found) = minimised(Search::Final, &near.x);
    let simulated = found.quadratic.and_then(|_| at.simulated(&found.x)?.pop());
    match simulated {
        Some(simulated) => Ok((found.x, simulated)),
        None => Err(at.why_not(&found.x)),
    }
}

/// Drops unknowns that occur in no run; those that earlier fits tie to others stay.
fn keep_what_occurs(problem: &mut PositionProblem) {
    let occurs = |name: &str| {
        problem.prior.as_ref().is_some_and(|prior| prior.names.iter().any(|known| known == name))
            || problem.runs.iter().any(|run| run.occurs(name))
    };
    let (kept, dropped): (Vec<_>, Vec<_>) = problem.unknowns.drain(..).partition(|unknown| occurs(&unknown.name));
    problem.unknowns = kept;
    problem.known.extend(dropped.into_iter().map(|unknown| (unknown.name, unknown.value)));
}

/// A start may have an inertia that no body has: values off by some per cent each easily do. It becomes that of a body near
/// by, within the bounds. Says which links were moved.
fn make_physical(problem: &mut PositionProblem) -> Vec<usize> {
    let names: Vec<&str> = problem.unknowns.iter().map(|unknown| unknown.name.as_str()).collect();
    let bodies = physical_links::bodies(&names, &problem.known);
    let column = |of: fn(&Unknown) -> f64| problem.unknowns.iter().map(of).collect::<Vec<f64>>();
    let (mut x, lower, upper) =
        (column(|unknown| unknown.value), column(|unknown| unknown.lower), column(|unknown| unknown.upper));
    let moved = physical_links::make_physical(&bodies, &mut x, &lower, &upper);
    for (unknown, value) in problem.unknowns.iter_mut().zip(&x) {
        unknown.value = *value;
    }
    moved
}

fn check(problem: &PositionProblem) -> Result<(), PositionFitError> {
    if problem.runs.is_empty() {
        return Err(PositionFitError::NoRun);
    }
    if problem.unknowns.is_empty() {
        let mut known: Vec<String> = problem
            .runs
            .iter()
            .flat_map(|run| run.system.kernel().parameters.iter().map(|name| (*name).to_owned()))
            .collect();
        known.sort();
        known.dedup();
        return Err(PositionFitError::NoUnknown { known });
    }
    for unknown in &problem.unknowns {
        let Unknown { name, value, lower, upper, .. } = unknown.clone();
        if !name.starts_with("link.") && !name.starts_with("joint.") && !name.starts_with("device.") {
            return Err(PositionFitError::NotFittable { name });
        }
        if lower > upper {
            return Err(PositionFitError::CrossedBounds { name, lower, upper });
        }
        if !(lower..=upper).contains(&value) {
            return Err(PositionFitError::StartOutside { name, value, lower, upper });
        }
    }
    // A fit before this one may have ended where both are equal, up to the tolerance of its subproblems.
    for (larger, smaller) in &problem.inequalities {
        if let (Some(larger_value), Some(smaller_value)) = (value_of(problem, larger), value_of(problem, smaller))
            && larger_value < smaller_value - EQUAL * (larger_value.abs() + smaller_value.abs())
        {
            let (larger, smaller) = (larger.clone(), smaller.clone());
            return Err(PositionFitError::StartUnequal { larger, larger_value, smaller, smaller_value });
        }
    }
    for run in &problem.runs {
        check_run(run, problem.unknowns.len())?;
    }
    Ok(())
}

fn check_run(run: &FitRun, unknowns: usize) -> Result<(), PositionFitError> {
    let n_free = run.system.n_free();
    let lengths = [
        ("commanded torques", run.command.len(), run.time.len() * run.system.n_joints()),
        ("measured positions", run.position.len(), run.time.len() * n_free),
        ("weights", run.weights.len(), n_free),
    ];
    for (what, found, expected) in lengths {
        if found != expected {
            return Err(PositionFitError::Length { run: run.name.clone(), what, found, expected });
        }
    }
    check_samples(std::slice::from_ref(run), unknowns)
}

/// Whether as many samples count in `runs` as there are unknowns.
pub(crate) fn check_samples(runs: &[FitRun], unknowns: usize) -> Result<(), PositionFitError> {
    let counted = |run: &FitRun| run.time.len() - run.first_sample();
    let Some(run) = runs.first() else { return Ok(()) };
    if runs.iter().map(|run| counted(run) * run.system.n_free()).sum::<usize>() >= unknowns.max(8) {
        return Ok(());
    }
    let first = run.time.first().copied().unwrap_or(0.0);
    let span_s = run.time.last().map_or(0.0, |last| last - first);
    let cut_s = (run.from_s - first).max(0.0);
    Err(PositionFitError::TooShort { run: run.name.clone(), span_s, cut_s, samples: counted(run), unknowns })
}

fn value_of(problem: &PositionProblem, name: &str) -> Option<f64> {
    let unknown = problem.unknowns.iter().find(|unknown| unknown.name == name).map(|unknown| unknown.value);
    unknown.or_else(|| problem.known.get(name).copied())
}

/// Orders of parameters as half-spaces, as far as one of the two is unknown.
pub(crate) fn half_spaces(
    unknowns: &[Unknown],
    known: &BTreeMap<String, f64>,
    inequalities: &[(String, String)],
) -> Vec<HalfSpace> {
    let entry = |name: &String| {
        let index = unknowns.iter().position(|unknown| unknown.name == *name);
        index.map(Entry::Unknown).or_else(|| known.get(name).copied().map(Entry::Known))
    };
    let of_order = |(larger, smaller): &(String, String)| HalfSpace::of_order(entry(larger)?, entry(smaller)?);
    inequalities.iter().filter_map(of_order).collect()
}

fn region(problem: &PositionProblem, evaluator: &Evaluator<'_>) -> Region {
    let n_initial = evaluator.n() - problem.unknowns.len();
    let bounds = |of: fn(&Unknown) -> f64, free: f64| {
        problem.unknowns.iter().map(of).chain(std::iter::repeat_n(free, n_initial)).collect()
    };
    let half_spaces = half_spaces(&problem.unknowns, &problem.known, &problem.inequalities);
    Region {
        lower: bounds(|unknown| unknown.lower, f64::NEG_INFINITY),
        upper: bounds(|unknown| unknown.upper, f64::INFINITY),
        half_spaces,
    }
}

#[cfg(test)]
mod tests;
