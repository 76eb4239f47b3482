//! Fits of the position error, of all runs at once or along a method's sequence, told like every other.

use dynid_model::{Method, did_you_mean};

use super::{ErrorKind, Found, Identified, Progress};
use crate::{
    error::Error,
    experiment::{Role, Run},
    fit::{
        position::{self, FitRun, Options, PositionFit, PositionProblem, RunError},
        sequence::{self, SequenceFit, Weighting},
        sqp::Watch,
    },
    model::Model,
};

/// Fits `model` to the position error of those of `runs` that are for it.
///
/// # Errors
/// As [`position::fit`].
pub(super) fn by_position(
    model: &Model,
    runs: &[&Run],
    options: &Options,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Identified, Error> {
    let problem = PositionProblem::of_model(model, fitted(runs))?;
    let fit = position::fit(&problem, options, &mut |told| {
        progress(&Progress { iteration: told.iteration, cost: told.cost, tether: told.tether, configuration: None });
        Watch::Continue
    })?;
    let after = fit.applied_to(model);
    Ok(told(model, after, fit, cost_at(model, runs, options)?))
}

/// Fits `model` to the position error, one configuration of `method` after another.
///
/// # Errors
/// The device has no such method; as [`position::fit`].
pub(super) fn by_method(
    model: &Model,
    runs: &[&Run],
    method: &str,
    weighting: Weighting,
    options: &Options,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Identified, Error> {
    let methods = &model.device.methods;
    let Some(Method { sequence, weights, .. }) = methods.iter().find(|known| known.name == method) else {
        return Err(Error::UnknownName {
            kind: "method",
            name: method.to_owned(),
            help: did_you_mean(method, methods.iter().map(|known| known.name.as_str())),
        });
    };
    let weights: &[Vec<f64>] = match weighting {
        Weighting::ByNoise => &[],
        Weighting::OfMethod => weights,
    };
    let SequenceFit { steps, joint, model: after } =
        sequence::fit(model, runs, sequence, weights, options, &mut |told| {
            progress(&Progress {
                iteration: told.progress.iteration,
                cost: told.progress.cost,
                tether: told.progress.tether,
                configuration: told.configuration,
            });
            Watch::Continue
        })?;
    let used: Vec<&Run> = runs.iter().copied().filter(|run| sequence.contains(&run.configuration)).collect();
    let mut found = told(model, after, joint, cost_at(model, &used, options)?);
    found.iterations += steps.iter().map(|(_, fit)| fit.iterations).sum::<usize>();
    Ok(found)
}

pub(super) fn fitted<'a>(runs: &[&'a Run]) -> impl Iterator<Item = &'a Run> {
    runs.iter().copied().filter(|run| run.role == Role::Fit)
}

fn told(before: &Model, after: Model, fit: PositionFit, cost_before: f64) -> Identified {
    let PositionFit { status, parameters, undetermined, iterations, runs, .. } = fit;
    let parameters = parameters
        .into_iter()
        .map(|estimate| Found {
            start: before.parameter(&estimate.name).map_or(f64::NAN, |parameter| parameter.value),
            name: estimate.name,
            value: estimate.value,
            std_error: estimate.std_error,
            identifiable: estimate.identifiable,
            held: estimate.at_bound,
        })
        .collect();
    Identified {
        model: after,
        error: ErrorKind::Position,
        status,
        iterations,
        cost_before,
        cost_after: cost(&runs),
        parameters,
        open: undetermined.into_iter().map(|direction| direction.parts).collect(),
    }
}

/// Cost of the runs that are fitted to; infinite where one cannot be simulated to its end, for then it is larger than
/// any number says.
pub(super) fn cost_at(model: &Model, runs: &[&Run], options: &Options) -> Result<f64, Error> {
    let mut errors = Vec::new();
    for run in fitted(runs) {
        match position::judge(&FitRun::of_run(model, run)?, options) {
            Ok(error) => errors.push(error),
            Err(_) => return Ok(f64::INFINITY),
        }
    }
    Ok(cost(&errors))
}

/// Half the sum of squared position errors, each joint's over the noise of its log.
fn cost(runs: &[RunError]) -> f64 {
    let of_run = |run: &RunError| -> f64 {
        run.rmse.iter().zip(&run.noise).map(|(rmse, noise)| (rmse / noise).powi(2)).sum::<f64>() * run.samples as f64
    };
    0.5 * runs.iter().map(of_run).sum::<f64>()
}
