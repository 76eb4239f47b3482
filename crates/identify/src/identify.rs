//! The one way from a model and runs to a fitted model, whichever error is made small.

mod by_position;
mod by_prediction;
mod by_torque;

use std::collections::BTreeMap;
use std::fmt;

use dynid_model::Parameter;
use serde::{Deserialize, Serialize};

use dynid_format::UnknownName;

pub use crate::torque::FittedParameter;

use crate::FitError;
use crate::{
    FitStatus, position::Options, position::PositionProblem, sequence, sequence::Weighting, starts::Starts, stays_near,
};
use by_position::{by_position, cost_at};
use by_prediction::by_prediction;
use by_torque::by_torque;
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_optimise::sqp::SearchControl;
use dynid_user_model::{ErrorShare, FitRecord, Model};

/// What a fit makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorSignal {
    /// Commanded torque minus what the measured, filtered motion needs.
    Torque,
    /// Measured minus simulated position.
    Position,
    /// Torque first, then position from there.
    Both,
    /// Measured position minus what is predicted from the samples before: the likelihood of the logs
    /// ([`crate::prediction`]).
    Prediction,
}

impl fmt::Display for ErrorSignal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Torque => "torque",
            Self::Position => "position",
            Self::Both => "both",
            Self::Prediction => "prediction",
        })
    }
}

/// What a fit found.
#[derive(Debug, Clone)]
pub struct FitResult {
    /// The model with the fitted values and the record of the fit.
    pub model: Model,
    /// Which error was made small.
    pub error: ErrorSignal,
    /// How it ended.
    pub status: FitStatus,
    /// Linearisations.
    pub iterations: usize,
    /// Half the sum of squared errors in units of their standard deviation, at the start; of predictions, by how much the
    /// logarithm of the likelihood falls short of what noise alone would leave. `None` where it was
    /// not asked for.
    pub cost_before: Option<f64>,
    /// The same at the end.
    pub cost_after: f64,
    /// What moved, in the model's order.
    pub parameters: Vec<FittedParameter>,
    /// Combinations that the data leave open: parameters and their parts, largest first.
    pub open: Vec<Vec<(String, f64)>>,
    /// The pairs that move together most, strongest first; a position fit tells them.
    pub correlations: Vec<Correlation>,
    /// What came of each start, where there were several.
    pub tried: Vec<StartResult>,
    /// The start that was kept, from 0.
    pub best_start: usize,
    /// What each configuration of a method found.
    pub steps: Vec<StepSummary>,
    /// How much of each joint's remaining error comes from which configuration of a method.
    pub budget: Vec<ErrorShare>,
    /// What should be known of the fit besides.
    pub notes: Vec<String>,
}

/// A configuration's fit along a method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepSummary {
    /// Its number, from 1.
    pub configuration: usize,
    /// Its free joints.
    pub free: Vec<usize>,
    /// How it ended.
    pub status: String,
    /// Linearisations.
    pub iterations: usize,
    /// Root mean square of the position error over its runs, per free joint, before the fit of all runs.
    pub rmse: Vec<f64>,
}

/// A pair of parameters that move together.
#[derive(Debug, Clone, PartialEq)]
pub struct Correlation {
    /// One parameter.
    pub one: String,
    /// The other.
    pub other: String,
    /// From -1 to 1.
    pub value: f64,
}

/// What to fit, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FitTask {
    /// What is made small; with a method always the position error.
    pub error: ErrorSignal,
    /// One configuration of this method after another, then all together; without one, all runs at once.
    pub method: Option<String>,
    /// What counts how much along a method.
    pub weighting: Weighting,
    /// Only these parameters move: names, or patterns with `*`; empty for all that the model does not fix.
    pub only: Vec<String>,
    /// From where the position fit is tried.
    pub starts: Starts,
    /// How finely, and for how long.
    pub options: Options,
    /// Whether the cost at the start is reported; it takes a simulation of every run, and its initial positions.
    pub tell_start: bool,
}

impl FitTask {
    /// The error `error` of all runs at once, from the model as it stands.
    pub fn plain(error: ErrorSignal, options: Options) -> Self {
        Self {
            error,
            method: None,
            weighting: Weighting::default(),
            only: Vec::new(),
            starts: Starts::default(),
            options,
            tell_start: true,
        }
    }
}

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// From 1.
    pub iteration: usize,
    /// What it makes small: of the position error per sample and joint, of torque error and predictions in all.
    pub cost: f64,
    /// Length of the last step in standard deviations; `None` where it is not known.
    pub step: Option<f64>,
    /// How firmly the simulation is pulled to the logs while the start is poor [1/s]; 0 when it runs free.
    pub observer: f64,
    /// The configuration being fitted; `None` where all runs are.
    pub configuration: Option<usize>,
    /// The start under way, from 0.
    pub start: usize,
}

/// All that a fit of positions or predictions carries from one iteration to the next: continued from here it ends at the same bits.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct State {
    /// The starts that are done.
    pub tried: Vec<StartResult>,
    /// The best of them.
    pub best: Option<Best>,
    /// Where the start under way is.
    pub sequence: sequence::State,
    /// Where a fit of predictions is, by the start that it began from: some cannot be predicted.
    pub predictions: BTreeMap<usize, crate::prediction::State>,
}

/// A start that is done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StartResult {
    /// The cost that it reached; absent where it could not be simulated.
    pub cost: Option<f64>,
    /// How it ended, or why it could not begin.
    pub ended: String,
    /// Linearisations.
    pub iterations: usize,
}

/// The best start so far.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Best {
    /// Its number, from 0.
    pub start: usize,
    /// The fit of all runs.
    pub joint: crate::position::PositionFit,
    /// The configurations' fits.
    pub steps: Vec<sequence::Step>,
}

/// The error that is made small unless the user says which.
///
/// The position error where a simulation stays near the log: where the model has a rest position (a spring) at every free
/// joint, or, torque first, where the simulation of the model as it stands does not lose the log. The torque error, which
/// needs no simulation, where a controller moved the log, or where the experiment says how the torque error is to be
/// filtered or masked.
pub fn default_error(model: &Model, runs: &[&Run]) -> ErrorSignal {
    let rests = |joint: usize| model.effects_at(joint).any(|instance| instance.effect.parameter("qeq").is_some());
    if !runs.iter().all(|run| run.is_open_loop()) {
        ErrorSignal::Torque
    } else if runs.iter().all(|run| run.free.iter().all(|&joint| rests(joint))) {
        ErrorSignal::Position
    } else if !runs.iter().any(|run| run.is_prepared_for_torque_error())
        && runs.iter().all(|run| stays_near(model, run))
    {
        ErrorSignal::Both
    } else {
        ErrorSignal::Torque
    }
}

/// Fits `model` to those of `runs` that are for it, all at once.
///
/// # Errors
/// No such run, nothing to fit, a start that is not allowed or cannot be simulated.
pub fn identify(
    model: &Model,
    experiment: &Experiment,
    runs: &[&Run],
    error: ErrorSignal,
    options: &Options,
    progress: &mut dyn FnMut(&Progress),
) -> Result<FitResult, FitError> {
    let mut watch = |reported: &Progress, _: Option<&State>| {
        progress(reported);
        SearchControl::Continue
    };
    identify_as(model, &[], experiment, runs, &FitTask::plain(error, *options), State::default(), &mut watch)
}

/// Fits `model` to those of `runs` that are for it. `watch` sees every iteration and, in a fit of positions or predictions, a state
/// from which the same fit goes on bit-identically when it is handed in as `from`. Predictions are tried from `others`, too: `model`
/// with other values.
///
/// # Errors
/// As [`identify`]; the device has no such method; interrupted by `watch`.
pub fn identify_as(
    model: &Model,
    others: &[Model],
    experiment: &Experiment,
    runs: &[&Run],
    how: &FitTask,
    from: State,
    watch: &mut dyn FnMut(&Progress, Option<&State>) -> SearchControl,
) -> Result<FitResult, FitError> {
    let options = &how.options;
    let whole = model;
    let restricted = only(model, &how.only)?;
    let model = &restricted;
    let by_position =
        |model: &Model, from: State, watch: &mut dyn FnMut(&Progress, Option<&State>) -> SearchControl| {
            by_position(model, runs, how, from, &mut |reported, state| watch(reported, Some(state)))
        };
    let mut unreported = |reported: &Progress| {
        // A torque fit takes seconds and is not stopped.
        watch(reported, None);
    };
    let mut found = match how.error {
        ErrorSignal::Torque => by_torque(model, runs, options.iterations, &mut unreported)?,
        ErrorSignal::Position => by_position(model, from, watch)?,
        ErrorSignal::Prediction => {
            let others = others.iter().map(|other| only(other, &how.only));
            let starts: Vec<Model> = [Ok(model.clone())].into_iter().chain(others).collect::<Result<_, _>>()?;
            by_prediction(&starts, runs, options.iterations, from, &mut |told, state| watch(told, Some(state)))?
        }
        ErrorSignal::Both => {
            // What the second fit refuses is better refused before the first.
            PositionProblem::of_model(model, by_position::fitted(runs))?;
            let first = by_torque(model, runs, options.iterations, &mut unreported)?;
            let mut second = by_position(&first.model, from, watch)?;
            second.iterations += first.iterations;
            second.cost_before = how.tell_start.then(|| cost_at(model, runs, options)).transpose()?;
            for parameter in &mut second.parameters {
                if let Some(start) = model.parameter(&parameter.name) {
                    parameter.start = start.value;
                }
            }
            second
        }
    };
    found.error = how.error;
    for (name, parameter) in whole.parameters() {
        if let Some(fitted) = found.model.parameter(&name) {
            found.model.set(&name, Parameter { fixed: parameter.fixed, ..fitted })?;
        }
    }
    record(&mut found, whole, experiment, how.method.as_deref());
    Ok(found)
}

/// `model` with everything fixed that no pattern in `wanted` names.
fn only(model: &Model, wanted: &[String]) -> Result<Model, FitError> {
    let mut restricted = model.clone();
    if wanted.is_empty() {
        return Ok(restricted);
    }
    let parameters = model.parameters();
    for pattern in wanted {
        if !pattern.contains('*') {
            model.require(pattern)?;
        }
        let mut named = parameters.iter().filter(|(name, _)| matches(pattern, name)).peekable();
        if named.peek().is_none() {
            return Err(UnknownName {
                kind: "parameter",
                name: pattern.clone(),
                help: "no parameter of the model is named so".to_owned(),
            }
            .into());
        }
        if named.all(|(_, parameter)| parameter.fixed) {
            return Err(FitError::FixedUnknown { name: pattern.clone() });
        }
    }
    for (name, parameter) in &parameters {
        if !wanted.iter().any(|pattern| matches(pattern, name)) {
            restricted.set(name, Parameter { fixed: true, ..*parameter })?;
        }
    }
    Ok(restricted)
}

/// Whether a name is what a pattern says; `*` stands for any text.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((start, rest)) => name
            .strip_prefix(start)
            .is_some_and(|left| (0..=left.len()).any(|skip| left.get(skip..).is_some_and(|tail| matches(rest, tail)))),
    }
}

/// Writes into the fitted model how it came about.
fn record(found: &mut FitResult, parent: &Model, experiment: &Experiment, method: Option<&str>) {
    let prior = found.parameters.iter().filter_map(|own| Some((own.name.clone(), parent.prior(&own.name)?)));
    found.model.prior = parent.prior.clone();
    found.model.prior.extend(prior);
    found.model.fit = Some(FitRecord {
        error: found.error.to_string(),
        status: found.status.as_str().to_owned(),
        data_digest: experiment.digest.clone(),
        parent_digest: parent.digest(),
        cost_before: found.cost_before,
        cost_after: found.cost_after,
        not_identifiable: found
            .parameters
            .iter()
            .filter(|parameter| !parameter.identifiable)
            .map(|parameter| parameter.name.clone())
            .collect(),
        std_error: found
            .parameters
            .iter()
            .filter_map(|parameter| Some((parameter.name.clone(), parameter.std_error?)))
            .collect::<BTreeMap<String, f64>>(),
        at_bound: found
            .parameters
            .iter()
            .filter(|parameter| parameter.held)
            .map(|parameter| parameter.name.clone())
            .collect(),
        method: method.map(str::to_owned),
        budget: found.budget.clone(),
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_name_what_they_say() {
        assert!(matches("joint.4.*", "joint.4.lugre.Fs") && !matches("joint.4.*", "joint.5.lugre.Fs"));
        assert!(
            matches("*.lugre.*", "joint.4.lugre.Fs") && matches("*", "link.1.m") && matches("link.1.m", "link.1.m")
        );
        assert!(!matches("link.1.m", "link.1.mm") && !matches("*.Fs", "joint.4.lugre.Fc"));
    }

    #[test]
    fn what_is_not_named_is_fixed_and_what_is_fixed_cannot_be_named() {
        let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
        model.set("link.2.m", Parameter::known(0.8)).expect("a parameter");
        let moving = |wanted: &[&str]| -> Result<Vec<String>, FitError> {
            let wanted: Vec<String> = wanted.iter().map(|name| (*name).to_owned()).collect();
            let left = only(&model, &wanted)?.parameters();
            Ok(left.into_iter().filter(|(_, parameter)| !parameter.fixed).map(|(name, _)| name).collect())
        };
        assert_eq!(moving(&["link.1.m"]).expect("free"), ["link.1.m"]);
        assert!(!moving(&["link.2.*"]).expect("others are free").contains(&"link.2.m".to_owned()));
        let reported = moving(&["link.2.m"]).expect_err("fixed").to_string();
        assert!(reported.contains("link.2.m is fixed in the model"), "{reported}");
        let reported = moving(&["link.2.M"]).expect_err("unknown").to_string();
        assert!(reported.contains("unknown parameter `link.2.M`"), "{reported}");
    }
}
