//! How far a model is from its logs, and where.

use std::ops::ControlFlow;

use dynid_judge::compare::{self as judge, Comparison, Finding, locate::locate};
use dynid_judge::predictions::{Predictions, predictions};
use dynid_logs::experiment::Experiment;
use dynid_user_model::Model;

use crate::progress::{Done, each};
use crate::{Error, check_device};

/// What to compare.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CompareSettings {
    /// Only runs in which exactly these joints are free; `None` for all runs.
    pub free: Option<Vec<usize>>,
}

/// How far a model is from its logs, and where.
#[derive(Debug, Clone)]
pub struct Compared {
    /// Position and torque error of every joint of every run, in the order of the experiment.
    pub errors: Comparison,
    /// How likely the logs are under its one-step predictions.
    pub predictions: Predictions,
    /// What the errors follow and where they lie, the most telling first.
    pub findings: Vec<Finding>,
}

/// Compares `model` with the runs of `experiment`; `progress` hears of every run.
///
/// # Errors
/// A model of another device, or one that makes no equations for a run; no such runs; stopped by `progress`.
///
/// ```
/// use std::ops::ControlFlow;
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let compared = dynid::compare(&model, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
/// for joint in compared.errors.runs.iter().flat_map(|run| &run.joints) {
///     println!("joint {}: {:?} rad RMS, the log's noise is {:.1e}", joint.joint, joint.rmse, joint.noise_floor);
/// }
/// assert!(!compared.findings.is_empty(), "an effect is missing in this model");
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn compare(
    model: &Model,
    experiment: &Experiment,
    settings: &CompareSettings,
    progress: &(dyn Fn(Done) -> ControlFlow<()> + Sync),
) -> Result<Compared, Error> {
    check_device(model, experiment)?;
    let runs = experiment.runs_with_free(settings.free.as_deref())?;
    let compared = each(&runs, progress, |run| Ok(judge::compare(model, &[*run])?.runs))?;
    let errors = Comparison::of(compared.into_iter().flatten().collect(), &runs);
    let findings = locate(model, &runs, &errors);
    let predictions = predictions(model, &runs)?;
    Ok(Compared { errors, predictions, findings })
}
