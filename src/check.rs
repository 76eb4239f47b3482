//! What logs are worth before any fit.

use dynid_check::Checked;
use dynid_logs::experiment::Experiment;
use dynid_user_model::Model;

use crate::{Error, check_device};

/// What to check.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CheckSettings {
    /// Only runs in which exactly these joints are free; `None` for all runs.
    pub free: Option<Vec<usize>>,
}

/// Says what the runs of `experiment` cannot answer, what to play to change that, and what looks wrong in the logs. Nothing is
/// fitted: the values of `model` need only be of the right size.
///
/// # Errors
/// A model of another device, or one that makes no equations for a run; no such runs.
///
/// ```
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let checked = dynid::check(&model, &experiment, &Default::default())?;
/// assert!(checked.findings.is_empty(), "nothing is wrong with these logs: {:?}", checked.findings);
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn check(model: &Model, experiment: &Experiment, settings: &CheckSettings) -> Result<Checked, Error> {
    check_device(model, experiment)?;
    let runs = experiment.runs_with_free(settings.free.as_deref())?;
    Ok(dynid_check::check(model, &runs)?)
}
