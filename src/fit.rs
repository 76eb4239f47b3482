//! Parameters from logs.

use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::PathBuf;

use dynid_diagnose::with_first_estimates;
use dynid_identify::checkpoint::{self, CheckpointError, Identity};
use dynid_identify::identify::{self, ErrorSignal, FitResult, FitTask, Progress, State};
use dynid_identify::position::Options;
use dynid_identify::sequence::Weighting;
use dynid_identify::starts::Starts;
use dynid_identify::{FitError, SearchControl};
use dynid_logs::experiment::{Experiment, Role, Run};
use dynid_user_model::Model;

use crate::{Error, check_device};

/// What to fit, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FitSettings {
    /// Which error is made small; `None` for the one that suits model and logs ([`identify::default_error`]): then a fit of
    /// the position error that comes to no minimum is followed by one of the torque error.
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
    /// Integration steps per sample of the position error.
    pub substeps: usize,
    /// Iterations at most.
    pub iterations: usize,
    /// Where the search is kept after each of its iterations, so that one that is stopped can go on; `None` for nowhere.
    /// Whoever asks for it removes the file once the result is safe.
    pub checkpoint: Option<Checkpoint>,
}

impl Default for FitSettings {
    fn default() -> Self {
        let Options { substeps, iterations, .. } = Options::default();
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
            substeps,
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
    /// This effect stands where it vanishes, and starts from a first estimate by the logs.
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
        "several starts, a transient to leave out, a weight of the first half and resuming belong to the position error, and \
         the torque error is fitted here; leave them out, or ask for the position error"
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

/// A position fit's cost per sample where it leaves nothing but noise, with a margin of a tenth of the error.
const COST_OF_NOISE: f64 = 0.5 * 1.1 * 1.1;

/// Fits `model` to the runs of `experiment` whose role is `fit`, by least squares on the position or the torque error (see
/// [`ErrorSignal`]).
///
/// An effect that stands where it vanishes starts from a first estimate by the logs; where that leads nowhere, or to one of
/// many minima, the next best estimates are tried. `progress` hears of every iteration and may stop the fit: that of the position
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
    let task = task(model, &runs, settings)?;
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
    let mut searches = Searches { experiment: &experiment, runs: &runs, progress, stopped };
    let mut found = searches.first(&first.model, &task, state, kept.as_ref())?;
    let cost_per_sample = |found: &Result<FitResult, FitError>| cost(found) / samples(&runs) as f64;
    // A new effect's first estimate may lead nowhere, or to one of many minima; the next best may not.
    for other in first.others {
        let least = cost_per_sample(&found);
        let is_done = is_minimum(&found) && (!first.is_narrow || least <= COST_OF_NOISE);
        if is_done || is_stopped(&found) {
            break;
        }
        let next = searches.further(&other, &task, least);
        if (searches.stopped && is_stopped(&next)) || cost(&next) < cost(&found) {
            found = next;
        }
    }
    let mut found = found?;
    if searches.stopped && task.error == ErrorSignal::Torque {
        return Err(Error::Stopped);
    }
    let may_fall_back = settings.error.is_none() && task.method.is_none() && task.error != ErrorSignal::Torque;
    if !found.status.may_update_model() && may_fall_back {
        let by_torque = FitTask { error: ErrorSignal::Torque, ..task };
        // Where even that comes to nothing, the first fit says why.
        if let Ok(other) = searches.further(&first.model, &by_torque, f64::INFINITY)
            && other.status.may_update_model()
        {
            found = fallen_back(&found, other);
        }
    }
    if let Some(record) = &mut found.model.fit {
        // The parent is what the user handed in, not the estimate that the search began with.
        record.parent_digest = model.digest();
    }
    Ok(found)
}

/// Whether a search that after so many iterations without an observer has come to `cost` per sample stays far above the cost that
/// another `reached`: one that can reach that is not so far from it after so many.
fn stays_far_above(free_iterations: usize, cost: f64, reached: f64) -> bool {
    const TRIES: usize = 15;
    const FAR: f64 = 30.0;
    free_iterations >= TRIES && cost > FAR * reached
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
fn task(model: &Model, runs: &[&Run], settings: &FitSettings) -> Result<FitTask, FitSettingsError> {
    if settings.method.is_some() && matches!(settings.error, Some(ErrorSignal::Torque | ErrorSignal::Both)) {
        return Err(FitSettingsError::MethodOfTorque);
    }
    let error = match (&settings.method, settings.error) {
        (Some(_), _) => ErrorSignal::Position,
        (None, Some(error)) => error,
        (None, None) => identify::default_error(model, runs),
    };
    let resumes = settings.checkpoint.as_ref().is_some_and(|checkpoint| checkpoint.begin == Begin::Resume);
    let is_of_position = settings.starts > 1 || settings.from_s.is_some() || settings.first_half.is_some() || resumes;
    if error == ErrorSignal::Torque && is_of_position {
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
            substeps: settings.substeps.max(1),
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

/// One search after another, of the same runs and with the same listener.
struct Searches<'a> {
    experiment: &'a Experiment,
    runs: &'a [&'a Run],
    progress: &'a mut dyn FnMut(FitProgress<'_>) -> ControlFlow<()>,
    /// Whether the listener asked to stop.
    stopped: bool,
}

impl Searches<'_> {
    /// The search that is kept, and goes on from `state`.
    fn first(
        &mut self,
        start: &Model,
        task: &FitTask,
        state: State,
        kept: Option<&Kept<'_>>,
    ) -> Result<Result<FitResult, FitError>, Error> {
        let mut unsaved = None;
        let found = identify::identify_as(start, self.experiment, self.runs, task, state, &mut |reported, state| {
            self.hear(reported);
            if let (Some(kept), Some(state)) = (kept, state)
                && let Err(error) = checkpoint::write(&kept.checkpoint.path, &kept.identity, state)
            {
                unsaved = Some(error);
                return SearchControl::Stop;
            }
            if self.stopped { SearchControl::Stop } else { SearchControl::Continue }
        });
        match unsaved {
            Some(error) => Err(error.into()),
            None => Ok(found),
        }
    }

    /// A further search, which is not kept. One that stays far above the cost per sample `least` that another came to is left.
    fn further(&mut self, start: &Model, task: &FitTask, least: f64) -> Result<FitResult, FitError> {
        let mut free = 0;
        self.begin(task);
        identify::identify_as(start, self.experiment, self.runs, task, State::default(), &mut |reported, _| {
            self.hear(reported);
            // What further starts or configurations come to is not comparable, and stopping there would lose the first's end.
            let is_first = reported.start == 0 && reported.configuration.is_none();
            free += usize::from(is_first && reported.observer == 0.0);
            let is_hopeless = is_first && stays_far_above(free, reported.cost, least);
            if self.stopped || is_hopeless { SearchControl::Stop } else { SearchControl::Continue }
        })
    }

    fn begin(&mut self, task: &FitTask) {
        self.stopped |= (self.progress)(FitProgress::Search(task.error)).is_break();
    }

    fn hear(&mut self, reported: &Progress) {
        self.stopped |= (self.progress)(FitProgress::Iteration(reported)).is_break();
    }
}

fn is_stopped(found: &Result<FitResult, FitError>) -> bool {
    found.as_ref().is_err_and(|error| error.interrupted_after().is_some())
}

fn is_minimum(found: &Result<FitResult, FitError>) -> bool {
    found.as_ref().is_ok_and(|found| found.status.may_update_model())
}

fn cost(found: &Result<FitResult, FitError>) -> f64 {
    match found {
        Ok(found) if found.status.may_update_model() => found.cost_after,
        _ => f64::INFINITY,
    }
}

/// Samples that a position fit counts, each joint's by itself.
fn samples(runs: &[&Run]) -> usize {
    let fitted = runs.iter().filter(|run| run.role == Role::Fit);
    fitted.map(|run| run.log.len().saturating_sub(run.n_cut()) * run.free.len()).sum()
}

/// The fit of the torque error in place of one of the position error that came to no minimum.
fn fallen_back(position: &FitResult, mut torque: FitResult) -> FitResult {
    torque.notes.push(format!(
        "the fit of the position error came to no minimum ({}): the model's simulation does not follow the \
         logs. The torque error was fitted instead; `dynid diagnose` may tell what the model lacks",
        position.status.as_str()
    ));
    torque
}
