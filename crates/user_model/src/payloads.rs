//! What the runs of an experiment carry, and what a model knows of it.

use std::{collections::BTreeSet, path::PathBuf};

use dynid_logs::experiment::Experiment;
use dynid_model::did_you_mean;

use crate::Model;

/// A run carries what no effect of the model is of, though the model knows other payloads.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: run `{run}` carries `{payload}`, which no effect of the model is of; {help}", experiment.display())]
pub struct UnknownPayload {
    /// The experiment.
    pub experiment: PathBuf,
    /// The run's file.
    pub run: String,
    /// What it carries.
    pub payload: String,
    /// What to do.
    pub help: String,
}

impl Model {
    /// Sees to it that a model that knows payloads knows those of an experiment.
    ///
    /// # Errors
    /// The first run that carries another.
    pub fn check_payloads(&self, experiment: &Experiment) -> Result<(), UnknownPayload> {
        let known: BTreeSet<&str> = self.effects.iter().filter_map(|own| own.payload.as_deref()).collect();
        let is_unknown = |payload: &String| !known.is_empty() && !known.contains(payload.as_str());
        let unknown = experiment.runs.iter().find_map(|run| Some((run, run.payload.clone().filter(is_unknown)?)));
        match unknown {
            None => Ok(()),
            Some((run, payload)) => Err(UnknownPayload {
                experiment: experiment.path.clone(),
                run: run.file.clone(),
                help: format!(
                    "{}; give an effect `payload = \"{payload}\"`, or leave it out of the run",
                    did_you_mean(&payload, known.iter().copied())
                ),
                payload,
            }),
        }
    }
}
