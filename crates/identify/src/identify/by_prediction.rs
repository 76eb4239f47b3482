//! A fit of one-step predictions, reported like every other.

use super::by_position::{correlations, fitted};
use super::{ErrorSignal, FitResult, FittedParameter, Progress, State};
use crate::FitError;
use crate::position::{PositionFitError, check_samples, noise_of};
use crate::prediction::{self, PredictionFit, PredictionProblem, Search, Settings};
use dynid_logs::experiment::Run;
use dynid_optimise::sqp::SearchControl;
use dynid_user_model::Model;

/// Linearisations after which the start that has come furthest goes on alone.
const TRIED: usize = 8;

/// Fits the model that each of `starts` is a start of to the one-step predictions of those of `runs` that are for it, and keeps the
/// likeliest.
///
/// Its cost is `sum of n ln(deviation / noise)` over the joints: by how much the logarithm of the likelihood falls short of what the
/// noise of the logs alone would leave, noise being guessed from fourth differences.
///
/// # Errors
/// No run to fit to; one that cannot be predicted from any start; interrupted by `watch`.
pub(super) fn by_prediction(
    starts: &[Model],
    runs: &[&Run],
    iterations: usize,
    from: State,
    watch: &mut dyn FnMut(&Progress, &State) -> SearchControl,
) -> Result<FitResult, FitError> {
    let settings = Settings { iterations, ..Settings::default() };
    let problems: Vec<PredictionProblem> = starts
        .iter()
        .map(|start| PredictionProblem::of_model(start, &|name| start.prior(name), fitted(runs)))
        .collect::<Result<_, _>>()?;
    for problem in &problems {
        check_samples(&problem.runs, problem.unknowns.len())?;
    }
    let mut state = from;
    let mut failure = None;
    let mut searches: Vec<(usize, Search<'_>)> = Vec::new();
    for (start, problem) in problems.iter().enumerate() {
        match Search::new(problem, state.predictions.get(&start).cloned()) {
            Ok(search) => {
                state.predictions.entry(start).or_insert_with(|| search.state().clone());
                searches.push((start, search));
            }
            Err(error) => {
                failure.get_or_insert(error);
            }
        }
    }
    if searches.is_empty() {
        return Err(failure.unwrap_or(PositionFitError::NoRun).into());
    }
    let noise = noise_alone(&problems[0]);
    let before = searches[0].1.beginning().map(|cost| cost - noise);
    let mut follow = |(start, search): &mut (usize, Search<'_>), until: usize| {
        while search.iterations() < until && !search.state().is_done {
            search.advance(&settings, 1, &mut |_| SearchControl::Continue);
            state.predictions.insert(*start, search.state().clone());
            let progress = Progress {
                iteration: search.iterations(),
                cost: search.state().cost.map_or(f64::NAN, |cost| cost - noise),
                step: None,
                observer: search.nuisance().0.into_values().fold(0.0, f64::max),
                configuration: None,
                start: *start,
            };
            if watch(&progress, &state) == SearchControl::Stop {
                return Err(PositionFitError::Interrupted { iterations: search.iterations() });
            }
        }
        Ok(())
    };
    if searches.len() > 1 {
        for search in &mut searches {
            follow(search, TRIED.min(iterations))?;
        }
    }
    let cost = |search: &Search<'_>| search.state().cost.unwrap_or(f64::INFINITY);
    let best = (0..searches.len()).min_by(|one, other| cost(&searches[*one].1).total_cmp(&cost(&searches[*other].1)));
    let place = best.unwrap_or(0);
    follow(&mut searches[place], iterations)?;
    let (start, search) = &searches[place];
    let fit = search.result()?;
    result(&starts[*start], &problems[*start], fit, before)
}

fn result(
    start: &Model,
    problem: &PredictionProblem,
    fit: PredictionFit,
    cost_before: Option<f64>,
) -> Result<FitResult, FitError> {
    let mut model = start.clone();
    for own in &fit.parameters {
        model.set_value(&own.name, own.value)?;
    }
    let noises = noises(problem);
    let shortfall = |own: &prediction::JointInnovations| {
        let noise = noises.iter().find(|(joint, ..)| *joint == own.joint).map_or(own.deviation, |(_, noise, _)| *noise);
        own.samples * (own.deviation / noise).ln()
    };
    let (status, names) = (fit.status(), fit.parameters.iter().map(|own| own.name.as_str()).collect::<Vec<_>>());
    let correlations = correlations(&names, &fit.covariance);
    let parameters = fit
        .parameters
        .iter()
        .map(|own| FittedParameter {
            start: start.parameter(&own.name).map_or(f64::NAN, |parameter| parameter.value),
            name: own.name.clone(),
            value: own.value,
            std_error: own.std_error,
            identifiable: own.identifiable,
            held: own.at_bound,
        })
        .collect();
    Ok(FitResult {
        model,
        error: ErrorSignal::Prediction,
        status,
        iterations: fit.iterations,
        cost_before,
        cost_after: fit.joints.iter().map(shortfall).sum(),
        parameters,
        open: fit.undetermined.iter().map(|direction| direction.parts.clone()).collect(),
        correlations,
        tried: Vec::new(),
        best_start: 0,
        steps: Vec::new(),
        budget: Vec::new(),
        notes: Vec::new(),
    })
}

/// Of each joint, the noise of its logs [rad or m] and how many samples count.
fn noises(problem: &PredictionProblem) -> Vec<(usize, f64, f64)> {
    let mut found: Vec<(usize, f64, f64)> = Vec::new();
    for run in &problem.runs {
        for (slot, &joint) in run.system.kernel().free.iter().enumerate() {
            let measured = run.measured(slot);
            let counted = measured.len().saturating_sub(run.first_sample()) as f64;
            let noise = noise_of(&measured);
            match found.iter_mut().find(|(known, ..)| *known == joint) {
                Some(known) => *known = (joint, known.1.max(noise), known.2 + counted),
                None => found.push((joint, noise, counted)),
            }
        }
    }
    found
}

/// The cost of a search that leaves nothing but noise.
fn noise_alone(problem: &PredictionProblem) -> f64 {
    noises(problem).iter().map(|(_, noise, samples)| samples * noise.ln()).sum()
}
