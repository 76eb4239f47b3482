//! The one way from a model and runs to a fitted model, whichever error is made small.

mod by_position;
mod by_torque;

use std::collections::BTreeMap;
use std::fmt;

use crate::{
    error::Error,
    experiment::{Experiment, Run},
    fit::{
        FitStatus,
        position::{Options, PositionProblem},
        sequence::Weighting,
    },
    model::{FitRecord, Model},
};
use by_position::{by_method, by_position, cost_at};
use by_torque::by_torque;

/// What a fit makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// Commanded torque minus what the measured, filtered motion needs.
    Torque,
    /// Measured minus simulated position.
    Position,
    /// Torque first, then position from there.
    Both,
}

impl fmt::Display for ErrorKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Torque => "torque",
            Self::Position => "position",
            Self::Both => "both",
        })
    }
}

/// What a fit found.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The model with the fitted values and the record of the fit.
    pub model: Model,
    /// Which error was made small.
    pub error: ErrorKind,
    /// How it ended.
    pub status: FitStatus,
    /// Linearisations.
    pub iterations: usize,
    /// Half the sum of squared errors in units of their standard deviation, at the start.
    pub cost_before: f64,
    /// The same at the end.
    pub cost_after: f64,
    /// What moved, in the model's order.
    pub parameters: Vec<Found>,
    /// Combinations that the data leave open: parameters and their parts, largest first.
    pub open: Vec<Vec<(String, f64)>>,
}

/// A fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Its name.
    pub name: String,
    /// Where it started.
    pub start: f64,
    /// Where it ended.
    pub value: f64,
    /// One standard deviation; `None` where there is none to state.
    pub std_error: Option<f64>,
    /// Whether the data determine it by itself.
    pub identifiable: bool,
    /// Whether a bound holds it.
    pub held: bool,
}

/// How far a fit is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// From 1.
    pub iteration: usize,
    /// What it makes small.
    pub cost: f64,
    /// How firmly the simulation is pulled to the logs while the start is poor [1/s]; 0 when it runs free.
    pub tether: f64,
    /// The configuration being fitted; `None` where all runs are.
    pub configuration: Option<usize>,
}

/// The error that is made small unless the user says which: the position error where a simulation stays near the log,
/// which it does where the model has a rest position (a spring) at every free joint and no controller moves the log;
/// else the torque error, which needs no simulation.
pub fn default_error(model: &Model, runs: &[&Run]) -> ErrorKind {
    let rests = |joint: usize| model.effects_at(joint).any(|instance| instance.effect.parameter("qeq").is_some());
    let held = |run: &&Run| {
        run.settings.controller.is_none() && run.log.reference.is_none() && run.free.iter().all(|&joint| rests(joint))
    };
    if runs.iter().all(held) { ErrorKind::Position } else { ErrorKind::Torque }
}

/// Fits `model` to those of `runs` that are for it.
///
/// # Errors
/// No such run, nothing to fit, a start that is not allowed or cannot be simulated.
pub fn identify(
    model: &Model,
    experiment: &Experiment,
    runs: &[&Run],
    error: ErrorKind,
    options: &Options,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Identified, Error> {
    let mut found = match error {
        ErrorKind::Torque => by_torque(model, runs, options.iterations, progress)?,
        ErrorKind::Position => by_position(model, runs, options, progress)?,
        ErrorKind::Both => {
            // What the second fit refuses is better refused before the first.
            PositionProblem::of_model(model, by_position::fitted(runs))?;
            let first = by_torque(model, runs, options.iterations, progress)?;
            let mut second = by_position(&first.model, runs, options, progress)?;
            second.iterations += first.iterations;
            second.cost_before = cost_at(model, runs, options)?;
            for parameter in &mut second.parameters {
                if let Some(start) = model.parameter(&parameter.name) {
                    parameter.start = start.value;
                }
            }
            second
        }
    };
    found.error = error;
    record(&mut found, model, experiment);
    Ok(found)
}

/// Fits `model` to the position error along a method of its device: one configuration after another, each with what
/// the earlier ones found, then all together.
///
/// # Errors
/// The device has no such method; else as [`identify`].
pub fn identify_method(
    model: &Model,
    experiment: &Experiment,
    runs: &[&Run],
    method: &str,
    weighting: Weighting,
    options: &Options,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Identified, Error> {
    let mut found = by_method(model, runs, method, weighting, options, progress)?;
    record(&mut found, model, experiment);
    Ok(found)
}

/// Writes into the fitted model how it came about.
fn record(found: &mut Identified, parent: &Model, experiment: &Experiment) {
    found.model.fit = Some(FitRecord {
        error: found.error.to_string(),
        status: found.status.as_str().to_owned(),
        data_digest: experiment.digest.clone(),
        parent_digest: parent.digest(),
        cost_before: found.cost_before,
        cost_after: found.cost_after,
        not_identifiable: found
            .parameters
            .iter()
            .filter(|parameter| !parameter.identifiable)
            .map(|parameter| parameter.name.clone())
            .collect(),
        std_error: found
            .parameters
            .iter()
            .filter_map(|parameter| Some((parameter.name.clone(), parameter.std_error?)))
            .collect::<BTreeMap<String, f64>>(),
    });
}
