//! A fit of the torque error, reported like every other.

use super::{ErrorSignal, FitResult, Progress};
use crate::FitError;
use crate::{orders, torque, torque::TorqueFit, torque::TorqueRun};
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion};
use dynid_user_model::Model;

/// Fits `model` to the torque error of those of `runs` that are for it.
///
/// # Errors
/// As [`torque::fit`].
pub(super) fn by_torque(
    model: &Model,
    runs: &[&Run],
    iterations: usize,
    progress: &mut dyn FnMut(&Progress),
) -> Result<FitResult, FitError> {
    let fitted: Vec<TorqueRun> = runs
        .iter()
        .filter(|run| run.role == Role::Fit)
        .map(|run| {
            Ok(TorqueRun { name: run.label(), role: run.role, system: model.system_of(run)?, motion: Motion::of(run)? })
        })
        .collect::<Result<_, FitError>>()?;
    let TorqueFit { status, iterations, cost_before, cost_after, parameters, flat, .. } =
        torque::fit(&fitted, &model.parameters(), &orders(model), iterations, &mut |iteration, cost| {
            progress(&Progress { iteration, cost, step: None, observer: 0.0, configuration: None, start: 0 });
        })?;
    let mut fitted = model.clone();
    for parameter in &parameters {
        fitted.set_value(&parameter.name, parameter.value)?;
    }
    Ok(FitResult {
        model: fitted,
        error: ErrorSignal::Torque,
        status,
        iterations,
        cost_before: Some(cost_before),
        cost_after,
        parameters,
        open: flat,
        correlations: Vec::new(),
        tried: Vec::new(),
        best_start: 0,
        steps: Vec::new(),
        budget: Vec::new(),
        notes: Vec::new(),
    })
}
