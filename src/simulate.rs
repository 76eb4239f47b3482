//! The positions that a model shows under the logged torques.

use std::ops::ControlFlow;

use dynid_dynamics::{simulate as dynamics, simulate::Input, simulate::Steps};
use dynid_identify::{position, position::FitRun, position::Options, position::RunError};
use dynid_judge::compare;
use dynid_logs::experiment::{Experiment, Run};
use dynid_user_model::Model;

use crate::progress::{Done, each};
use crate::{Error, check_device};

/// How finely.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SimulateSettings {
    /// Integration steps per sample; `None` for as few as keep every joint within some millionths of its motion.
    pub substeps: Option<usize>,
}

/// What a model shows of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// Positions of the free joints, one row a sample [rad or m].
    pub position: Vec<f64>,
    /// Commanded torques of all joints, one row a sample [N*m or N]: the log's, or those of the run's controller.
    pub command: Vec<f64>,
    /// Root mean square off the log, per free joint [rad or m]; `None` for a run that is only planned.
    pub rmse: Option<Vec<f64>>,
}

/// Plays the commanded torques of every run on `model`, or lets the run's controller command; one result a run, in their order.
/// A run starts at the positions that explain its log best; one that is only planned (`Experiment::load_planned`) where it says.
/// `progress` hears of every run.
///
/// # Errors
/// A model of another device, or one that makes no equations for a run; a simulation that does not come to its end; stopped by
/// `progress`.
///
/// ```
/// use std::ops::ControlFlow;
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
/// let model = dynid::Model::load(format!("{folder}/believed.toml"))?;
/// let simulated = dynid::simulate(&model, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
/// assert_eq!(simulated[0].position.len(), 2 * experiment.runs[0].log.len(), "two joints are free");
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn simulate(
    model: &Model,
    experiment: &Experiment,
    settings: &SimulateSettings,
    progress: &(dyn Fn(Done) -> ControlFlow<()> + Sync),
) -> Result<Vec<Simulated>, Error> {
    check_device(model, experiment)?;
    let steps = settings.substeps.map_or(Steps::ADAPTIVE, |steps| Steps::PerSample(steps.max(1)));
    let options = Options { steps, ..Options::default() };
    each(&experiment.runs, progress, |run| played(model, run, &options))
}

fn played(model: &Model, run: &Run, options: &Options) -> Result<Simulated, Error> {
    let fit_run = FitRun::of_run(model, run)?;
    let integration = dynamics::Options { steps: options.steps, ..dynamics::Options::default() };
    let of_run = |error| Error::Simulation { run: run.file.clone(), error };
    if let Some(played) = compare::closed_loop(&fit_run.system, run, &integration)? {
        let (trajectory, command) = played.map_err(of_run)?;
        let n_free = run.free.len();
        let rmse = (0..n_free).map(|slot| {
            let errors = fit_run.position.iter().zip(&trajectory.q).skip(slot).step_by(n_free);
            (errors.map(|(y, q)| (y - q).powi(2)).sum::<f64>() / run.log.len() as f64).sqrt()
        });
        let rmse = run.settings.start.is_none().then(|| rmse.collect());
        return Ok(Simulated { rmse, position: trajectory.q, command });
    }
    if run.settings.start.is_some() {
        let input = Input { time: &fit_run.time, command: &fit_run.command, intersample: fit_run.intersample };
        let start: Vec<f64> = run.free.iter().map(|&joint| run.log.q[joint][0]).collect();
        let trajectory = dynamics::simulate(&fit_run.system, &input, &start, &integration).map_err(of_run)?;
        return Ok(Simulated { rmse: None, position: trajectory.q, command: fit_run.command });
    }
    let RunError { simulated, rmse, .. } =
        position::judge(&fit_run, options).map_err(dynid_identify::FitError::from)?;
    Ok(Simulated { position: simulated, command: fit_run.command, rmse: Some(rmse) })
}
