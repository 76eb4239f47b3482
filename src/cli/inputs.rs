//! Reading what a user hands in.

use std::path::Path;

use anyhow::bail;
use dynid::{Experiment, Model};
use dynid_identify::position::made_physical;
use dynid_model::Device;

/// An experiment with all its logs.
pub fn experiment(path: &Path) -> anyhow::Result<Experiment> {
    Ok(Experiment::load(path)?)
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
    Ok(Experiment::load_planned(path)?)
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
    model.check_payloads(experiment)?;
    Ok(model)
}

/// Sees to it that the model in `path` is of the device of something else, and tells what its reader noted.
pub fn of_device(model: &Model, path: &Path, device: &Device, other: &str) -> anyhow::Result<()> {
    if !model.device.is_same_as(device) {
        bail!(
            "{}: the model is of device `{}`, {other} of `{}`; use files of one device",
            path.display(),
            model.device.id,
            device.id
        );
    }
    for note in &model.notes {
        say!("note: {}: {note}", path.display());
    }
    Ok(())
}
