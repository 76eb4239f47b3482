//! Parameters from logs.

use dynid_dynamics::simulate::Steps;
use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::PathBuf;

use dynid_diagnose::with_first_estimates;
use dynid_format::number;
use dynid_identify::checkpoint::{self, CheckpointError, Identity};
use dynid_identify::identify::{self, ErrorSignal, FitResult, FitTask, Progress, State};
use dynid_identify::position::Options;
use dynid_identify::sequence::Weighting;
use dynid_identify::starts::Starts;
use dynid_identify::{SearchControl, prediction};
use dynid_judge::compare::compare;
use dynid_logs::experiment::{Experiment, Role, Run};
use dynid_user_model::Model;

use crate::{Error, check_device};

/// What to fit, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FitSettings {
    /// Which error is made small; `None` for that of one-step predictions or, along a method, from several starts or with a weight of
    /// the first half, that of positions.
    pub error: Option<ErrorSignal>,
    /// Only runs in which exactly these joints are free; `None` for all runs.
    pub free: Option<Vec<usize>>,
    /// One configuration of this method of the device (or of `found`) after another, then all runs together.
    pub method: Option<String>,
    /// What weighs the joints' errors along a method.
    pub weighting: Weighting,
    /// Only these parameters move: names, or patterns with `*`; empty for all that the model does not fix.
    pub only: Vec<String>,
    /// From how many starts the position error is made small: the model's own, and others drawn within the bounds.
    pub starts: usize,
    /// What the other starts are drawn from.
    pub seed: u64,
    /// So much of every log's beginning leaves the position error (s); `None` for what the experiment says (thesis Eq. 4.3).
    pub from_s: Option<f64>,
    /// Weight of the position error in the first half of every log; `None` for what the experiment says (thesis Eq. 4.2).
    pub first_half: Option<f64>,
    /// Integration steps per sample of the position error; `None` for as few as move no position by more than about a hundredth of its
    /// log's noise.
    pub substeps: Option<usize>,
    /// Iterations at most.
    pub iterations: usize,
    /// Where the search is kept after each of its iterations, so that one that is stopped can go on; `None` for nowhere.
    /// Whoever asks for it removes the file once the result is safe.
    pub checkpoint: Option<Checkpoint>,
}

impl Default for FitSettings {
    fn default() -> Self {
        let Options { iterations, .. } = Options::default();
        Self {
            error: None,
            free: None,
            method: None,
            weighting: Weighting::default(),
            only: Vec::new(),
            starts: 1,
            seed: 0,
            from_s: None,
            first_half: None,
            substeps: None,
            iterations,
            checkpoint: None,
        }
    }
}

/// A file that a search is kept in while it lasts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checkpoint {
    /// The file.
    pub path: PathBuf,
    /// What to do with one that is there.
    pub begin: Begin,
}

/// How a fit with a checkpoint begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begin {
    /// From the beginning; a checkpoint that is there is an error, for it may be worth something.
    New,
    /// From the beginning; a checkpoint that is there is lost.
    Overwrite,
    /// Where the checkpoint stopped, to the same bits as a fit that was never stopped.
    Resume,
}

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FitProgress<'a> {
    /// This effect stands where it vanishes, its shape is unknown, and it starts from a first estimate by the logs.
    FirstEstimate(&'a str),
    /// A search begins that makes this error small.
    Search(ErrorSignal),
    /// An iteration of it is done.
    Iteration(&'a Progress),
}

/// Settings that do not go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FitSettingsError {
    /// A method fits the position error only.
    #[error("a method is fitted to the position error; leave the error open, or the method out")]
    MethodOfTorque,
    /// What belongs to the position error, where the torque error is made small.
    #[error(
        "several starts and a weight of the first half belong to the position error, a transient to leave out and resuming to \
         that of predictions, too, and another is fitted here; leave them out, or ask for the position error"
    )]
    PositionOnly,
    /// Weights of a method without one.
    #[error("the weights of a method weigh its steps; name a method, or weigh by noise")]
    WeightsWithoutMethod,
    /// A transient of negative length.
    #[error("`from_s` is a time after the log's first sample [s], not below 0")]
    FromBelowZero,
    /// A first half that would not count, or count negatively.
    #[error("`first_half` is a positive weight; the thesis's is 0.5")]
    FirstHalfNotPositive,
}

/// Fits `model` to the runs of `experiment` whose role is `fit`: by the likelihood of its one-step predictions, or by least squares
/// on the position or the torque error (see [`ErrorSignal`]).
///
/// An effect that stands where it vanishes starts from a first estimate by the logs; predictions are tried from the next best ones,
/// too. `progress` hears of every iteration and may stop the fit: that of the position
/// error after an iteration, that of the torque error, which takes seconds, at its end.
///
/// # Errors
/// Settings that do not go together; no run to fit to; nothing to fit; a start that is not allowed or cannot be simulated; a
/// checkpoint that cannot be used or written; stopped by `progress` ([`Error::interrupted_after`], [`Error::Stopped`]).
///
/// ```
/// use std::ops::ControlFlow;
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let settings = dynid::FitSettings { free: Some(vec![4, 5]), ..Default::default() };
/// let fitted = dynid::fit(&model, &experiment, &settings, &mut |_| ControlFlow::Continue(()))?;
/// assert!(fitted.status.may_update_model());
/// println!("cost {:?} -> {}", fitted.cost_before, fitted.cost_after);
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn fit(
    model: &Model,
    experiment: &Experiment,
    settings: &FitSettings,
    progress: &mut dyn FnMut(FitProgress<'_>) -> ControlFlow<()>,
) -> Result<FitResult, Error> {
    let experiment = overridden(experiment, settings);
    check_device(model, &experiment)?;
    let runs = experiment.runs_with_free(settings.free.as_deref())?;
    let task = task(&runs, settings)?;
    let kept = settings
        .checkpoint
        .as_ref()
        .map(|checkpoint| Kept { checkpoint, identity: Identity::new(model, &experiment, &runs, &task) });
    let state = kept.as_ref().map_or_else(|| Ok(State::default()), Kept::begin)?;
    let mut stopped = progress(FitProgress::Search(task.error)).is_break();
    let first = with_first_estimates(model, &runs);
    for label in &first.labels {
        stopped |= progress(FitProgress::FirstEstimate(label)).is_break();
    }
    let seen = match task.error {
        ErrorSignal::Prediction => first.model.looked_at(runs.iter().copied(), prediction::Settings::default().samples),
        _ => Vec::new(),
    };
    let runs = if seen.is_empty() { runs } else { seen.iter().collect() };
    let mut unsaved = None;
    let mut watch = |reported: &Progress, state: Option<&State>| {
        stopped |= progress(FitProgress::Iteration(reported)).is_break();
        if let (Some(kept), Some(state)) = (&kept, state)
            && let Err(error) = checkpoint::write(&kept.checkpoint.path, &kept.identity, state)
        {
            unsaved = Some(error);
            return SearchControl::Stop;
        }
        if stopped { SearchControl::Stop } else { SearchControl::Continue }
    };
    let found = identify::identify_as(&first.model, &first.others, &experiment, &runs, &task, state, &mut watch);
    if let Some(error) = unsaved {
        return Err(error.into());
    }
    let mut found = found?;
    if stopped && task.error == ErrorSignal::Torque {
        return Err(Error::Stopped);
    }
    if let Some(record) = &mut found.model.fit {
        // The parent is what the user handed in, not the estimate that the search began with.
        record.parent_digest = model.digest();
    }
    let held_out = experiment.runs_with_free(settings.free.as_deref())?;
    let held_out: Vec<&Run> = held_out.into_iter().filter(|run| run.role == Role::Validate).collect();
    found.notes.extend(farther(model, &found.model, &held_out));
    Ok(found)
}

/// By how much more an error of held-out runs has to grow to be told: less is the noise of a log of some seconds.
const GROWS: f64 = 1.02;

/// What is told where the runs held out are farther from the fitted model than from the one that the fit began with: it follows the
/// runs to fit to, and no others.
fn farther(before: &Model, after: &Model, held_out: &[&Run]) -> Option<String> {
    if held_out.is_empty() {
        return None;
    }
    // A model that cannot be compared has no errors that could grow.
    let errors = |model: &Model| compare(model, held_out).ok();
    let (before, after) = (errors(before)?, errors(after)?);
    let mut grown = Vec::new();
    if let (Some(before), Some(after)) = (before.rmse_validate, after.rmse_validate)
        && after > GROWS * before
    {
        grown.push(format!("position {} -> {} RMS", number(before), number(after)));
    }
    if let (Some(before), Some(after)) = (before.torque_percent_validate, after.torque_percent_validate)
        && after > GROWS * before
    {
        grown.push(format!("torque {} -> {} %", number(before), number(after)));
    }
    (!grown.is_empty()).then(|| {
        format!(
            "the held-out runs are farther from this model than from the one that the fit began with: {}; the runs to fit to do not \
             tell what moves them, or an effect is missing: `dynid compare` shows where, `dynid diagnose` asks which",
            grown.join(", ")
        )
    })
}

/// The experiment with what the settings say otherwise of its runs.
fn overridden<'a>(experiment: &'a Experiment, settings: &FitSettings) -> Cow<'a, Experiment> {
    let mut experiment = Cow::Borrowed(experiment);
    if settings.from_s.is_some() || settings.first_half.is_some() {
        for run in &mut experiment.to_mut().runs {
            run.settings.from_s = settings.from_s.or(run.settings.from_s);
            run.settings.first_half = settings.first_half.unwrap_or(run.settings.first_half);
        }
    }
    experiment
}

/// What is asked for, as the searches take it.
fn task(runs: &[&Run], settings: &FitSettings) -> Result<FitTask, FitSettingsError> {
    let is_of_position = settings.error == Some(ErrorSignal::Position) || settings.error.is_none();
    if settings.method.is_some() && !is_of_position {
        return Err(FitSettingsError::MethodOfTorque);
    }
    let is_weighed = settings.first_half.is_some() || runs.iter().any(|run| run.settings.first_half != 1.0);
    let asks_for_position = settings.method.is_some() || settings.starts > 1 || is_weighed;
    let default = if asks_for_position { ErrorSignal::Position } else { ErrorSignal::Prediction };
    let error = settings.error.unwrap_or(default);
    let resumes = settings.checkpoint.as_ref().is_some_and(|checkpoint| checkpoint.begin == Begin::Resume);
    let simulates = settings.starts > 1 || settings.first_half.is_some();
    let is_wrong = match error {
        ErrorSignal::Torque => simulates || settings.from_s.is_some() || resumes,
        ErrorSignal::Prediction => simulates,
        ErrorSignal::Position | ErrorSignal::Both => false,
    };
    if is_wrong {
        return Err(FitSettingsError::PositionOnly);
    }
    if settings.weighting == Weighting::OfMethod && settings.method.is_none() {
        return Err(FitSettingsError::WeightsWithoutMethod);
    }
    if settings.from_s.is_some_and(|span| !(span >= 0.0 && span.is_finite())) {
        return Err(FitSettingsError::FromBelowZero);
    }
    if settings.first_half.is_some_and(|weight| !(weight > 0.0 && weight.is_finite())) {
        return Err(FitSettingsError::FirstHalfNotPositive);
    }
    Ok(FitTask {
        error,
        method: settings.method.clone(),
        weighting: settings.weighting,
        only: settings.only.clone(),
        starts: Starts { count: settings.starts.max(1), seed: settings.seed, ..Starts::default() },
        options: Options {
            steps: settings.substeps.map(|steps| Steps::PerSample(steps.max(1))),
            iterations: settings.iterations.max(1),
            ..Options::default()
        },
        tell_start: true,
    })
}

/// The checkpoint of a search, with what it is of.
struct Kept<'a> {
    checkpoint: &'a Checkpoint,
    identity: Identity,
}

impl Kept<'_> {
    /// Where the search starts or goes on.
    fn begin(&self) -> Result<State, CheckpointError> {
        let Checkpoint { path, begin } = self.checkpoint;
        match begin {
            Begin::Resume => checkpoint::read(path, &self.identity),
            Begin::New if path.exists() => Err(CheckpointError::Left { path: path.clone() }),
            Begin::New | Begin::Overwrite => Ok(State::default()),
        }
    }
}
