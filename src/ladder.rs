//! The models of a lineage on the same runs.

use std::ops::ControlFlow;

use dynid_judge::{ladder, ladder::Judged, ladder::Ladder};
use dynid_logs::experiment::Experiment;
use dynid_user_model::Model;

use crate::progress::{Done, each};
use crate::{Error, check_device};

/// On which runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LadderSettings {
    /// Only runs in which exactly these joints are free; `None` for all runs.
    pub free: Option<Vec<usize>>,
}

/// Puts `models`, each with what it is called and the first one first, on the runs of `experiment`: does what each step added
/// pay for its parameters? `progress` hears of every model.
///
/// # Errors
/// A model of another device, or one that makes no equations for a run; no such runs; stopped by `progress`.
///
/// ```
/// use std::ops::ControlFlow;
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let addition = dynid::Addition { effect: "coulomb".to_owned(), joint: Some(4), ..Default::default() };
/// let (better, _) = dynid::add(&model, &addition)?;
/// let models = [("believed".to_owned(), model), ("with Coulomb".to_owned(), better)];
/// let ladder = dynid::ladder(&models, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
/// assert_eq!(ladder.rungs[1].added, ["joint.4.coulomb"]);
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn ladder(
    models: &[(String, Model)],
    experiment: &Experiment,
    settings: &LadderSettings,
    progress: &(dyn Fn(Done) -> ControlFlow<()> + Sync),
) -> Result<Ladder, Error> {
    models.iter().try_for_each(|(_, model)| check_device(model, experiment))?;
    let runs = experiment.runs_with_free(settings.free.as_deref())?;
    let judged = each(models, progress, |(_, model)| Ok(Judged::of(model, &runs)?))?;
    Ok(ladder::of_judged(models, &runs, judged)?)
}
