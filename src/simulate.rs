//! The positions that a model shows under the logged torques.

use std::ops::ControlFlow;

use dynid_dynamics::{simulate as dynamics, simulate::Input, simulate::Steps, simulate::Trajectory};
use dynid_identify::{position, position::FitRun, position::Options, position::RunError};
use dynid_judge::compare;
use dynid_logs::experiment::{Experiment, Run};
use dynid_user_model::Model;

use crate::progress::{Done, each};
use crate::{Error, check_device};

/// How finely.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SimulateSettings {
    /// Integration steps per sample; `None` for as few as an estimate of each interval's error within a ten-millionth of the motion asks for.
    pub substeps: Option<usize>,
}

/// What a model shows of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// Positions of the free joints, one row a sample [rad or m].
    pub position: Vec<f64>,
    /// Commanded torques of all joints, one row a sample [N*m or N]: the log's, or those of the run's controller.
    pub command: Vec<f64>,
    /// How far shorter integration steps move the positions of each free joint at most [rad or m], which tells what the integration is off by;
    /// infinite where they come to no end.
    pub integration: Vec<f64>,
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
    let steps = settings.substeps.map_or(Steps::EXACT, |steps| Steps::PerSample(steps.max(1)));
    each(&experiment.runs, progress, |run| played(model, run, steps))
}

fn played(model: &Model, run: &Run, steps: Steps) -> Result<Simulated, Error> {
    let fit_run = FitRun::of_run(model, run)?;
    let integration = dynamics::Options { steps, ..dynamics::Options::default() };
    let finer = dynamics::Options { steps: steps.finer(), ..integration };
    let of_run = |error| Error::Simulation { run: run.file.clone(), error };
    let n_free = run.free.len();
    let apart = |rough: &[f64], fine: Option<Trajectory>| {
        let Some(fine) = fine else { return vec![f64::INFINITY; n_free] };
        let mut most = vec![0.0_f64; n_free];
        for (index, (rough, fine)) in rough.iter().zip(&fine.q).enumerate() {
            most[index % n_free] = most[index % n_free].max((rough - fine).abs());
        }
        most
    };
    let input = Input { time: &fit_run.time, command: &fit_run.command, intersample: fit_run.intersample };
    let simulated = |start: &[f64], how: &dynamics::Options| dynamics::simulate(&fit_run.system, &input, start, how);
    if let Some(played) = compare::closed_loop(&fit_run.system, run, &integration)? {
        let (trajectory, command) = played.map_err(of_run)?;
        let fine = compare::closed_loop(&fit_run.system, run, &finer)?.and_then(Result::ok);
        let integration = apart(&trajectory.q, fine.map(|(fine, _)| fine));
        let rmse = (0..n_free).map(|slot| {
            let errors = fit_run.position.iter().zip(&trajectory.q).skip(slot).step_by(n_free);
            (errors.map(|(y, q)| (y - q).powi(2)).sum::<f64>() / run.log.len() as f64).sqrt()
        });
        let rmse = run.settings.start.is_none().then(|| rmse.collect());
        return Ok(Simulated { rmse, integration, position: trajectory.q, command });
    }
    if run.settings.start.is_some() {
        let start: Vec<f64> = run.free.iter().map(|&joint| run.log.q[joint][0]).collect();
        let trajectory = simulated(&start, &integration).map_err(of_run)?;
        let integration = apart(&trajectory.q, simulated(&start, &finer).ok());
        return Ok(Simulated { rmse: None, integration, position: trajectory.q, command: fit_run.command });
    }
    let RunError { simulated: position, rmse, initial, .. } =
        position::judge(&fit_run, &Options { steps: Some(steps), ..Options::default() })
            .map_err(dynid_identify::FitError::from)?;
    let integration = apart(&position, simulated(&initial, &finer).ok());
    Ok(Simulated { position, integration, command: fit_run.command, rmse: Some(rmse) })
}
