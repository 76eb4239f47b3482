//! The prediction-error method: the likelihood of a log under a model, from the errors of its one-step predictions (Ljung, *System
//! Identification*, chapter 7; Kristensen, Madsen and Jorgensen 2004).
//!
//! A [`Predictor`](dynid_dynamics::simulate::Predictor) corrects the simulation at every sample by a gain that follows from one
//! *rate* per joint: how little the model is trusted. The errors of its predictions (innovations) `e` are compared with one
//! standard deviation `s` per joint:
//!
//! ```text
//! -2 log L = sum over joints, runs and samples of  log s^2 + e^2 / s^2
//! ```
//!
//! Rates and standard deviations are estimated with the parameters. At a rate of 0 the criterion is that of a free simulation
//! (output error), at a large rate that of the torque error (equation error), and the likelihood finds what lies between: a model that
//! lacks an effect is fitted at a large rate, where its errors do not pile up, and one that lacks nothing comes to 0. With the best
//! `s`, the criterion is `n log(mean e^2)` of every joint; its gradient is exact, its Hessian Gauss and Newton's.

mod evaluate;
mod expansion;
mod held_out;
mod response;
mod result;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::position::{FitRun, PositionFitError, Unknown, half_spaces};
use dynid_dynamics::system::SystemError;
use dynid_logs::experiment::Run;
use dynid_model::Link;
use dynid_optimise::sqp::{self, Ended, Limits, Objective, SearchControl};
use dynid_optimise::{quadratic::Quadratic, region::Region};
use dynid_user_model::Model;

pub use crate::plan::Plan;
use evaluate::Evaluator;
pub use evaluate::ROUGHLY;
pub use expansion::{Change, NearRun, Promise, Reduced, Tangent};
pub use held_out::{HeldOut, held_out};
pub use response::Signals;
pub use result::{JointInnovations, PredictionFit};

/// Logs, and what is unknown of the model that is to predict them.
#[derive(Debug, Clone)]
pub struct PredictionProblem {
    /// The logs.
    pub runs: Vec<FitRun>,
    /// What may move; may be empty: initial positions and rates are always unknown.
    pub unknowns: Vec<Unknown>,
    /// Standard deviation of each unknown's prior about what is expected of it.
    pub spreads: Vec<f64>,
    /// Values of the parameters that do not move.
    pub known: BTreeMap<String, f64>,
    /// `(larger, smaller)`: parameters of which one must not fall below the other (thesis Eq. 4.1).
    pub inequalities: Vec<(String, String)>,
    /// Where each run starts: positions of the free joints, then speeds where it begins in motion; where there is none, by the first
    /// samples.
    pub initial: Vec<Vec<f64>>,
    /// Where the rate of each joint of the device begins [1/s]; of joints that it does not name, the best of a few.
    pub rates: BTreeMap<usize, f64>,
    /// Whether the rates stay where they begin.
    pub keeps_rates: bool,
    /// Integration steps to begin with, at least: those of a model that is much like this one.
    pub plan: Plan,
}

impl PredictionProblem {
    /// Everything that `model` does not fix is unknown, as far as it occurs in the runs; `expected` is what was believed of a
    /// parameter before any fit.
    ///
    /// # Errors
    /// A model that makes no equations for a run.
    pub fn of_model<'a>(
        model: &Model,
        expected: &dyn Fn(&str) -> Option<f64>,
        runs: impl IntoIterator<Item = &'a Run>,
    ) -> Result<Self, SystemError> {
        let runs = runs.into_iter().map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<_>, _>>()?;
        Ok(Self::of_runs(model, expected, runs))
    }

    /// As [`PredictionProblem::of_model`], of runs that have their equations.
    pub fn of_runs(model: &Model, expected: &dyn Fn(&str) -> Option<f64>, runs: Vec<FitRun>) -> Self {
        let (mut unknowns, mut spreads, mut known) = (Vec::new(), Vec::new(), BTreeMap::new());
        for (name, parameter) in model.parameters() {
            if parameter.fixed || !runs.iter().any(|run| run.occurs(&name)) {
                known.insert(name, parameter.value);
                continue;
            }
            let (value, lower, upper) = (parameter.value, parameter.lower, parameter.upper);
            let expected = expected(&name).unwrap_or(value);
            let unknown = Unknown { name, value, expected, lower, upper };
            let spread = unknown.spread();
            spreads.push(link_spread(model, &unknown.name).map_or(spread, |link| spread.min(link)));
            unknowns.push(unknown);
        }
        let inequalities = crate::orders(model);
        Self { unknowns, spreads, known, inequalities, ..Self::of_values(runs) }
    }

    /// Only where each run starts, and the rates, are unknown.
    pub fn of_values(runs: Vec<FitRun>) -> Self {
        Self {
            runs,
            unknowns: Vec::new(),
            spreads: Vec::new(),
            known: BTreeMap::new(),
            inequalities: Vec::new(),
            initial: Vec::new(),
            rates: BTreeMap::new(),
            keeps_rates: false,
            plan: Plan::default(),
        }
    }

    /// Where the search may go: bounds of the parameters, orders among them, and rates that are positive.
    fn region(&self, evaluator: &Evaluator<'_>) -> Region {
        let half_spaces = half_spaces(&self.unknowns, &self.known, &self.inequalities);
        let mut lower: Vec<f64> = self.unknowns.iter().map(|unknown| unknown.lower).collect();
        let mut upper: Vec<f64> = self.unknowns.iter().map(|unknown| unknown.upper).collect();
        evaluator.bound_rest(&mut lower, &mut upper);
        Region { lower, upper, half_spaces }
    }
}

/// How far a link's parameter may plausibly lie from what is believed of it: half of the link's mass, of the radius that its
/// parts lie at, or of its moment of inertia. Its bounds, where they say more, come first. `None` of what is no link's.
fn link_spread(model: &Model, name: &str) -> Option<f64> {
    const SHARE: f64 = 0.5;
    let (link, symbol) = crate::link_parameter(name)?;
    let value = |symbol: usize| model.links.get(link - 1).map(|values| values[symbol].value);
    let mass = value(0)?.max(f64::MIN_POSITIVE);
    let centroid: f64 = [1, 2, 3].into_iter().filter_map(value).map(|x| x * x).sum();
    // Principal moments add up to twice the polar one.
    let diagonal = ["Ixx", "Iyy", "Izz"].map(|axis| Link::SYMBOLS.iter().position(|symbol| *symbol == axis));
    let inertia: f64 = diagonal.into_iter().flatten().filter_map(value).sum::<f64>() / 2.0;
    let radius = (centroid + inertia / mass).sqrt();
    Some(
        SHARE
            * match symbol {
                0 => mass,
                1..=3 => radius,
                _ => mass * radius * radius,
            },
    )
    .filter(|spread| *spread > 0.0)
}

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Linearisations at most.
    pub iterations: usize,
    /// The search ends where a step promises less than this share of what the log likelihood gains by noise alone: half the number of unknowns.
    pub tolerance: f64,
    /// What the integration may cost of the log likelihood in the end.
    pub integration: f64,
    /// Samples, over all joints, of which more are thinned where fewer tell the same ([`dynid_logs::part::looked_at`]).
    pub samples: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { iterations: 60, tolerance: 0.01, integration: 0.5, samples: 60_000 }
    }
}

/// Where a search is: it goes on from here to the same bits as if it had never stopped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Integration steps.
    pub plan: Plan,
    /// Linearisations before this part of the search.
    pub iterations: usize,
    /// Where this part of the search is.
    pub search: sqp::State,
    /// Negative log likelihood, prior included; `None` before the first iteration.
    pub cost: Option<f64>,
    /// Whether no step promises more.
    pub is_done: bool,
    /// What the plan was last made for.
    planned: Option<PlannedFor>,
    /// The cost around it, with this plan; computed anew where it is not known.
    #[serde(skip)]
    known: Option<Quadratic>,
}

/// What a plan was made for: nothing needs planning anew where it still holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PlannedFor {
    /// What integration was allowed to cost.
    loss: f64,
    /// Where the search was.
    x: Vec<f64>,
    /// What it had reached.
    cost: f64,
}

/// A fit that can be advanced a few iterations at a time.
pub struct Search<'a> {
    problem: &'a PredictionProblem,
    evaluator: Evaluator<'a>,
    state: State,
}

/// Integration steps must do where the model is trusted so much more, too: errors that a rate forgets keep it from falling.
const AHEAD: f64 = 0.3;
/// Linearisations after which the rates are tried on their own.
const BETWEEN_LINES: usize = 4;

impl<'a> Search<'a> {
    /// Begins, or goes on from `state`, which may be of the beginnings of these runs.
    ///
    /// # Errors
    /// No run, or one that cannot be simulated at the start at any rate.
    pub fn new(problem: &'a PredictionProblem, state: Option<State>) -> Result<Self, PositionFitError> {
        if problem.runs.is_empty() {
            return Err(PositionFitError::NoRun);
        }
        let evaluator = Evaluator::new(problem);
        match state.filter(|state| state.search.x.len() == evaluator.n()) {
            Some(state) if evaluator.is_planned(&state.plan) => Ok(Self { problem, evaluator, state }),
            Some(state) => Ok(Self::opened(problem, evaluator, state, (1.0, evaluate::ROUGHLY))),
            None => {
                let x = evaluator.start()?;
                let plan = evaluator.plan(&x, &problem.plan, evaluate::ROUGHLY);
                let region = problem.region(&evaluator);
                let state = State {
                    plan,
                    iterations: 0,
                    search: sqp::State::start(&x, &region),
                    cost: None,
                    is_done: false,
                    planned: None,
                    known: None,
                };
                Ok(Self { problem, evaluator, state })
            }
        }
    }

    /// Takes up a search that came to its end with rougher steps, or in the beginnings of these runs.
    ///
    /// # Errors
    /// As [`Search::new`] where the state is of other unknowns; there the search begins.
    pub fn reopened(
        problem: &'a PredictionProblem,
        state: &State,
        settings: &Settings,
    ) -> Result<Self, PositionFitError> {
        let evaluator = Evaluator::new(problem);
        if state.search.x.len() != evaluator.n() {
            return Self::new(problem, None);
        }
        Ok(Self::opened(problem, evaluator, state.clone(), (AHEAD, settings.integration)))
    }

    /// A search that begins where another is, which was of a problem much like this one, its steps planned as by [`Search::plan_anew`].
    fn opened(
        problem: &'a PredictionProblem,
        evaluator: Evaluator<'a>,
        state: State,
        (share, loss): (f64, f64),
    ) -> Self {
        let is_of_these = evaluator.is_planned(&state.plan);
        let known = if is_of_these { state.plan.clone() } else { evaluator.continued(&state.plan) };
        let x = state.search.x.clone();
        let plan = evaluator.plan(&evaluator.with_poles_nearer(&x, share), &known, loss);
        let mut own = Self { problem, evaluator, state: State { cost: None, ..state } };
        own.refine(plan, loss);
        own.planned_at(x, loss);
        own
    }

    /// The rates of the joints, and where each run starts.
    pub fn nuisance(&self) -> (BTreeMap<usize, f64>, Vec<Vec<f64>>) {
        let x = &self.state.search.x;
        (self.evaluator.rates(x), self.evaluator.initial(x))
    }

    /// Negative log likelihood, prior included, where a search that is new begins; `None` of one that cannot be predicted there.
    pub fn beginning(&self) -> Option<f64> {
        if self.state.cost.is_none() {
            return self.evaluator.at(&self.state.plan).cost(&self.state.search.x);
        }
        let x = self.evaluator.start().ok()?;
        self.evaluator.at(&self.evaluator.plan(&x, &self.problem.plan, evaluate::ROUGHLY)).cost(&x)
    }

    /// Where it is.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Takes `iterations` more linearisations at most; `watch` sees the negative log likelihood after each.
    pub fn advance(&mut self, settings: &Settings, iterations: usize, watch: &mut dyn FnMut(f64) -> SearchControl) {
        let end = self.iterations() + iterations;
        while self.iterations() < end && !self.state.is_done {
            let Self { problem, evaluator, state } = self;
            let plan = state.plan.clone();
            let at = evaluator.at(&plan);
            let mut region = problem.region(evaluator);
            let line = (state.search.iterations + 1).next_multiple_of(BETWEEN_LINES);
            let left = (end - state.iterations).min(line);
            let decrease = settings.tolerance * 0.5 * evaluator.n() as f64;
            let limits = Limits { iterations: left, share: 0.0, decrease };
            let (mut search, mut cost) = (state.search.clone(), state.cost);
            let mut watched = |iteration: &sqp::Iteration, now: &sqp::State| {
                search = now.clone();
                cost = Some(iteration.cost);
                watch(iteration.cost)
            };
            let known = state.known.take();
            let outcome = sqp::resume(&at, &mut region, state.search.clone(), known, &limits, &mut watched);
            state.search = search;
            state.cost = outcome.quadratic.as_ref().map(|quadratic| quadratic.cost).or(cost);
            state.known = outcome.quadratic;
            match outcome.ended {
                Ended::Interrupted => return,
                Ended::IterationLimit if state.search.iterations < line => {}
                Ended::IterationLimit => {
                    self.slacken();
                    // The nearer it comes to the logs, the more rough steps cost.
                    if self.has_come_nearer() {
                        self.plan_anew(1.0, evaluate::ROUGHLY);
                    }
                }
                Ended::Converged | Ended::Stuck => {
                    // What has stiffened on the way needs shorter steps.
                    let loss = settings.integration;
                    let is_planned = |planned: &PlannedFor| planned.loss <= loss && planned.x == state.search.x;
                    let is_done = state.planned.as_ref().is_some_and(is_planned) || !self.plan_anew(AHEAD, loss);
                    self.state.is_done = is_done;
                }
            }
        }
    }

    /// Whether squared errors have halved since the steps were planned, so that those of the integration weigh twice as much.
    fn has_come_nearer(&self) -> bool {
        let State { planned, cost, .. } = &self.state;
        let planned = planned.as_ref().map_or(f64::INFINITY, |planned| planned.cost);
        planned - cost.unwrap_or(f64::INFINITY) > 0.5 * std::f64::consts::LN_2 * self.evaluator.samples()
    }

    /// Plans integration steps that cost no more than `loss`, the model being trusted more by `share`; whether they are others.
    fn plan_anew(&mut self, share: f64, loss: f64) -> bool {
        let Self { evaluator, state, .. } = self;
        let x = state.search.x.clone();
        let ahead = evaluator.with_poles_nearer(&x, share);
        // What was made for so little before mostly does.
        let was_as_fine = state.planned.as_ref().is_some_and(|planned| planned.loss <= loss);
        let is_enough = was_as_fine && evaluator.is_fine_enough(&ahead, &state.plan, loss);
        let other = (!is_enough).then(|| evaluator.plan(&ahead, &state.plan, loss)).filter(|plan| *plan != state.plan);
        let is_other = other.is_some();
        if let Some(plan) = other {
            self.refine(plan, loss);
        }
        self.planned_at(x, loss);
        is_other
    }

    /// Notes what the steps were planned for, unless the search went elsewhere with them.
    fn planned_at(&mut self, x: Vec<f64>, loss: f64) {
        let State { search, cost, .. } = &self.state;
        let planned = PlannedFor { loss, x, cost: cost.unwrap_or(f64::INFINITY) };
        self.state.planned = Some(planned).filter(|planned| planned.x == search.x);
    }

    /// Trusts the model more at once, where that is likelier: a valley in which the rates fall and all else follows is long.
    fn slacken(&mut self) {
        let Self { evaluator, state, .. } = self;
        let at = evaluator.at(&state.plan);
        for share in [0.5, 0.25, 0.1, 0.03] {
            let x = evaluator.with_poles_nearer(&state.search.x, share);
            let cost = at.cost(&x).filter(|cost| state.cost.is_some_and(|before| *cost < before));
            let Some(cost) = cost else { break };
            state.search.x = x;
            state.cost = Some(cost);
            state.known = None;
        }
    }

    /// With these integration steps. Where they change the cost by no more than `loss`, the search keeps its damping; else it begins anew.
    fn refine(&mut self, mut plan: Plan, loss: f64) {
        let Self { problem, evaluator, state } = self;
        let mut x = state.search.x.clone();
        let mut cost = evaluator.at(&plan).cost(&x);
        let lost = cost.unwrap_or(f64::INFINITY) - state.cost.unwrap_or(f64::NEG_INFINITY);
        // With rough steps, or in a part of the logs, a model may stay with them that runs away with fine ones, or in all: it is followed
        // closer then.
        if lost > evaluate::ROUGHLY {
            let followed = evaluator.followed(&x, cost, &plan);
            if followed != x || cost.is_none() {
                plan = evaluator.plan(&followed, &plan, evaluate::ROUGHLY);
                cost = evaluator.at(&plan).cost(&followed);
                x = followed;
            }
        }
        if lost.abs() <= loss && x == state.search.x {
            state.search.idle = 0;
        } else {
            state.iterations += state.search.iterations;
            state.search = sqp::State::start(&x, &problem.region(evaluator));
        }
        (state.plan, state.cost, state.is_done, state.planned, state.known) = (plan, cost, false, None, None);
    }

    /// Linearisations so far.
    pub fn iterations(&self) -> usize {
        self.state.iterations + self.state.search.iterations
    }

    /// What it has come to.
    ///
    /// # Errors
    /// The runs cannot be simulated there.
    pub fn result(&self) -> Result<PredictionFit, PositionFitError> {
        result::conclude(self.problem, &self.evaluator, &self.state)
    }
}
