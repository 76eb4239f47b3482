//! A whole sequence of configurations, e.g. the thesis's isolated and coupling methods (Tables 4.2 and 4.6).
//!
//! What one configuration found goes to the next as estimate *and* information (inverse covariance), never as a frozen
//! number: a later configuration may correct an earlier one as far as that one was unsure. Parameters that occur in
//! earlier configurations only move along with those they are correlated with. At the end one fit over the runs of all
//! configurations, started from there, replaces the chain's linearised memory by the data themselves.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{
    error_budget,
    position::{self, End, Options, PositionFit, PositionFitError, PositionProblem, Prior, Progress, Start, Unknown},
};
use dynid_logs::{experiment::Role, experiment::Run};
use dynid_optimise::sqp::SearchControl;
use dynid_user_model::{ErrorShare, Model};

/// What is to be fitted, in which order.
#[derive(Debug, Clone, Copy)]
pub struct Sequence<'a> {
    /// The values before any data: the centre of the weak prior.
    pub prior: &'a Model,
    /// Where the search starts.
    pub start: &'a Model,
    /// The runs; only those for fitting count.
    pub runs: &'a [&'a Run],
    /// Configuration numbers from 1, one step each; none for a single fit of all runs.
    pub configurations: &'a [usize],
    /// Weights per step and free joint; none where every error counts by its noise.
    pub weights: &'a [Vec<f64>],
}

/// What a sequence found.
#[derive(Debug, Clone)]
pub struct SequenceFit {
    /// One fit per configuration that has runs.
    pub steps: Vec<Step>,
    /// The fit over all runs.
    pub joint: PositionFit,
    /// The model with the values of the last.
    pub model: Model,
}

/// How much of each joint's remaining error comes from which configuration, after the steps `steps` and the fit `joint`
/// of all runs.
///
/// # Errors
/// A run that cannot be simulated.
pub fn budget(
    sequence: &Sequence<'_>,
    steps: &[Step],
    joint: &PositionFit,
    options: &Options,
) -> Result<Vec<ErrorShare>, PositionFitError> {
    let used = used(sequence);
    let fitted = joint.applied_to(sequence.start);
    let problem = problem(sequence.prior, &fitted, &used)?;
    let configurations: Vec<usize> = used.iter().map(|run| run.configuration).collect();
    let free: Vec<&[usize]> = used.iter().map(|run| run.free.as_slice()).collect();
    error_budget::budget(&problem, (&configurations, &free), steps, joint, options)
}

/// A configuration's fit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Step {
    /// Its number, from 1.
    pub configuration: usize,
    /// What its runs and all before them gave; without the simulated positions.
    pub fit: PositionFit,
}

/// All that a sequence carries from one iteration to the next.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct State {
    /// Where the step under way is; `None` before its first iteration.
    pub search: Option<position::State>,
    /// The steps done.
    pub steps: Vec<Step>,
}

/// Whether the joints of interest weigh more, as in the thesis, or every error counts by its noise alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Weighting {
    /// Every error over its noise: the least uncertain estimate.
    #[default]
    ByNoise,
    /// The thesis's weights of Table 4.6 on top.
    OfMethod,
}

/// Where a sequence stands, for those who watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceProgress {
    /// The configuration being fitted; `None` in the fit over all runs.
    pub configuration: Option<usize>,
    /// Its iteration.
    pub progress: Progress,
}

/// Fits one configuration after another, then all their runs together.
///
/// Configurations without a run of the role `fit` are passed over. `from` is a state that `watch` was shown in the same
/// sequence: the result is bit-identical to one that never stopped.
pub fn fit(
    sequence: &Sequence<'_>,
    options: &Options,
    from: State,
    watch: &mut dyn FnMut(&SequenceProgress, &State) -> SearchControl,
) -> Result<SequenceFit, PositionFitError> {
    let Sequence { prior: expected, start, configurations, weights, .. } = *sequence;
    let is_method = !configurations.is_empty();
    let used = used(sequence);
    let steps: Vec<(usize, usize)> = configurations
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, configuration)| used.iter().any(|run| run.configuration == *configuration))
        .collect();
    let roughly = Options { tolerance: ROUGHLY * options.tolerance, end: End::Rough, ..*options };
    let mut prior = start.clone();
    let mut known = Knowledge::default();
    let mut state = State::default();
    let State { mut search, steps: done } = from;
    let mut done = done.into_iter();
    for (step, configuration) in steps {
        let own: Vec<&Run> = used.iter().copied().filter(|run| run.configuration == configuration).collect();
        let mut problem = problem(expected, &prior, &own)?;
        if let Some(weights) = weights.get(step) {
            for run in &mut problem.runs {
                run.weights.clone_from(weights);
            }
        }
        problem.prior = known.prior();
        let fit = match done.next() {
            Some(step) => step.fit,
            None => {
                let mut reported = |progress: &Progress, search: &position::State| {
                    state.search = Some(search.clone());
                    watch(&SequenceProgress { configuration: Some(configuration), progress: *progress }, &state)
                };
                let mut fit = position::resume(&problem, &roughly, search.take(), &mut reported)?;
                fit.runs.iter_mut().for_each(|run| run.simulated.clear());
                fit
            }
        };
        prior = fit.applied_to(&prior);
        known.add(&fit, &problem);
        state = State { search: None, steps: state.steps };
        state.steps.push(Step { configuration, fit });
    }
    let mut reported = |progress: &Progress, search: &position::State| {
        state.search = Some(search.clone());
        watch(&SequenceProgress { configuration: None, progress: *progress }, &state)
    };
    let options = if is_method { Options { start: Start::Near, ..*options } } else { *options };
    let joint = position::resume(&problem(expected, &prior, &used)?, &options, search.take(), &mut reported)?;
    let model = joint.applied_to(&prior);
    Ok(SequenceFit { steps: state.steps, joint, model })
}

/// The runs that count.
fn used<'a>(sequence: &Sequence<'a>) -> Vec<&'a Run> {
    let is_of_it =
        |run: &Run| sequence.configurations.is_empty() || sequence.configurations.contains(&run.configuration);
    sequence.runs.iter().copied().filter(|run| run.role == Role::Fit && is_of_it(run)).collect()
}

/// Starts from `prior`, with the weak prior around `start`.
fn problem(start: &Model, prior: &Model, runs: &[&Run]) -> Result<PositionProblem, PositionFitError> {
    let mut problem = PositionProblem::of_model(prior, runs.iter().copied())?;
    for unknown in &mut problem.unknowns {
        if let Some(parameter) = start.parameter(&unknown.name) {
            unknown.expected = parameter.value;
        }
    }
    Ok(problem)
}

/// What the configurations so far tell of the parameters, linearised.
#[derive(Debug, Default)]
struct Knowledge {
    names: Vec<String>,
    mean: Vec<f64>,
    spread: Vec<f64>,
    information: DMatrix<f64>,
}

/// What is carried on is no surer than this share of a parameter's spread. Logs determine some combinations to 1e-5 and
/// others hardly; along the latter the former are curved, and their linearised memory would bind the next fit to a
/// tangent that the data never meant.
const REACH_OF_LINEARISATION: f64 = 0.02;

/// The steps end at so many tolerances: the fit of all runs goes on from there.
const ROUGHLY: f64 = 30.0;

impl Knowledge {
    /// The information with every variance widened by `e = (REACH_OF_LINEARISATION * spread)^2`:
    /// `(I^-1 + E)^-1 = E^-1 - E^-1 (I + E^-1)^-1 E^-1`, which needs no inverse of the information I.
    fn prior(&self) -> Option<Prior> {
        if self.names.is_empty() {
            return None;
        }
        let floor = DVector::from_iterator(
            self.spread.len(),
            self.spread.iter().map(|spread| (REACH_OF_LINEARISATION * spread).powi(-2)),
        );
        let floor = DMatrix::from_diagonal(&floor);
        let inner = (&self.information + &floor).cholesky()?;
        let widened = &floor - &floor * inner.solve(&floor);
        Some(Prior {
            names: self.names.clone(),
            mean: DVector::from_column_slice(&self.mean),
            information: (&widened + widened.transpose()) * 0.5,
        })
    }

    /// Adds a fit's data. Its estimate, which already heeds everything earlier, becomes the mean.
    fn add(&mut self, fit: &PositionFit, problem: &PositionProblem) {
        for estimate in &fit.parameters {
            if !self.names.contains(&estimate.name) {
                self.names.push(estimate.name.clone());
                self.mean.push(estimate.value);
                let unknown = problem.unknowns.iter().find(|unknown| unknown.name == estimate.name);
                self.spread.push(unknown.map_or(1.0, Unknown::spread));
            }
        }
        let n = self.names.len();
        let mut information = DMatrix::zeros(n, n);
        let old = self.information.nrows();
        information.view_mut((0, 0), (old, old)).copy_from(&self.information);
        let places: Vec<Option<usize>> =
            fit.parameters.iter().map(|estimate| self.names.iter().position(|name| *name == estimate.name)).collect();
        for (row, place) in places.iter().enumerate() {
            let Some(place) = *place else { continue };
            self.mean[place] = fit.parameters[row].value;
            for (column, other) in places.iter().enumerate() {
                if let Some(other) = *other {
                    information[(place, other)] += fit.information[(row, column)];
                }
            }
        }
        self.information = information;
    }
}
