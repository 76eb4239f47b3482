//! Reading what a user hands in.

use std::path::Path;

use anyhow::bail;
use dynid::experiment::{Experiment, Run};
use dynid::fit::position::made_physical;
use dynid::model::Model;

/// An experiment with all its logs.
pub fn experiment(path: &Path) -> anyhow::Result<Experiment> {
    Ok(Experiment::read_with(path, dynid_model::devices())?)
}

/// What to do with a value that lies outside the bounds stated beside it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outside {
    /// Refuse the file.
    Refuse,
    /// Put it on the nearest bound, and say so.
    Clip,
}

/// An experiment whose runs may be planned only.
pub fn planned_experiment(path: &Path) -> anyhow::Result<Experiment> {
    Ok(Experiment::read_planned(path, dynid_model::devices())?)
}

/// The model of that file, or the default model of the experiment's device.
pub fn model(path: Option<&Path>, experiment: &Experiment) -> anyhow::Result<Model> {
    start(path, experiment, Outside::Refuse)
}

/// As [`model`], for a fit to start from.
pub fn start(path: Option<&Path>, experiment: &Experiment, outside: Outside) -> anyhow::Result<Model> {
    let Some(path) = path else {
        return Ok(Model::of_device(experiment.device));
    };
    let model = match outside {
        Outside::Refuse => Model::load(path)?,
        Outside::Clip => made_physical(Model::load_clipped(path)?),
    };
    if model.device.id != experiment.device.id {
        bail!(
            "{}: the model is of device `{}`, the experiment {} of `{}`; use a model and an experiment of one device",
            path.display(),
            model.device.id,
            experiment.path.display(),
            experiment.device.id
        );
    }
    for note in &model.notes {
        eprintln!("note: {}: {note}", path.display());
    }
    Ok(model)
}

/// The runs in which exactly these joints are free; all runs without a choice.
pub fn runs<'a>(experiment: &'a Experiment, free: Option<&[usize]>) -> anyhow::Result<Vec<&'a Run>> {
    let Some(free) = free else {
        return Ok(experiment.runs.iter().collect());
    };
    let mut wanted = free.to_vec();
    wanted.sort_unstable();
    wanted.dedup();
    let runs: Vec<&Run> = experiment.runs.iter().filter(|run| run.free == wanted).collect();
    if runs.is_empty() {
        let mut known: Vec<String> = experiment.runs.iter().map(|run| format!("{:?}", run.free)).collect();
        known.dedup();
        bail!(
            "{}: no run has just the joints {wanted:?} free; its runs have {}",
            experiment.path.display(),
            known.join(", ")
        );
    }
    Ok(runs)
}
