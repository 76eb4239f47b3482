//! Reading what a user hands in.

use std::path::Path;

use anyhow::bail;
use dynid_identify::position::made_physical;
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_model::Device;
use dynid_user_model::Model;

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
    of_device(&model, path, experiment.device, &format!("the experiment {}", experiment.path.display()))?;
    Ok(model)
}

/// Sees to it that the model in `path` is of the device of something else, and tells what its reader noted.
pub fn of_device(model: &Model, path: &Path, device: &Device, other: &str) -> anyhow::Result<()> {
    if model.device.id != device.id {
        bail!(
            "{}: the model is of device `{}`, {other} of `{}`; use files of one device",
            path.display(),
            model.device.id,
            device.id
        );
    }
    for note in &model.notes {
        eprintln!("note: {}: {note}", path.display());
    }
    Ok(())
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
