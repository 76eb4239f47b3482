//! From a user's model and an experiment's runs to a [`PositionProblem`], and back.

use super::{FitRun, PositionFit, PositionFitError, PositionProblem, Unknown};
use dynid_dynamics::system::SystemError;
use dynid_logs::experiment::Run;
use dynid_user_model::Model;

impl FitRun {
    /// The run of an experiment as `model` sees it: locked joints stand where their log says.
    pub fn of_run(model: &Model, run: &Run) -> Result<Self, SystemError> {
        let system = model.system_of(run)?;
        let samples = 0..run.log.len();
        let time = run.elapsed_s();
        let command = samples.clone().flat_map(|k| run.log.tau.iter().map(move |tau| tau[k])).collect();
        let position = samples.flat_map(|k| run.free.iter().map(move |joint| run.log.q[*joint][k])).collect();
        Ok(Self {
            name: run.file.clone(),
            system,
            command,
            position,
            intersample: run.settings.intersample,
            weights: vec![1.0; run.free.len()],
            from_s: run.settings.from_s.map_or(f64::NEG_INFINITY, |span| time[0] + span),
            time,
            first_half: run.settings.first_half,
            moving: run.settings.moving,
        })
    }
}

impl PositionProblem {
    /// Everything that `model` does not fix is unknown, as far as it occurs in the runs.
    ///
    /// # Errors
    /// A run in closed loop; a model that makes no equations for a run.
    pub fn of_model<'a>(model: &Model, runs: impl IntoIterator<Item = &'a Run>) -> Result<Self, PositionFitError> {
        let open_loop = |run: &'a Run| match run.settings.controller {
            Some(_) => Err(PositionFitError::ClosedLoop { run: run.file.clone() }),
            None => Ok(FitRun::of_run(model, run)?),
        };
        let runs = runs.into_iter().map(open_loop).collect::<Result<Vec<_>, _>>()?;
        let mut unknowns = Vec::new();
        let mut known = std::collections::BTreeMap::new();
        for (name, parameter) in model.parameters() {
            if parameter.fixed {
                known.insert(name, parameter.value);
            } else {
                let (value, lower, upper) = (parameter.value, parameter.lower, parameter.upper);
                unknowns.push(Unknown { name, value, expected: value, lower, upper });
            }
        }
        let inequalities = crate::orders(model);
        Ok(Self { runs, unknowns, known, inequalities, prior: None })
    }
}

impl PositionFit {
    /// `model` with the values of this fit. Their bounds stay.
    #[must_use]
    pub fn applied_to(&self, model: &Model) -> Model {
        let mut fitted = model.clone();
        for estimate in &self.parameters {
            // The names come from this model's own parameters.
            let _known = fitted.set_value(&estimate.name, estimate.value);
        }
        fitted
    }
}
