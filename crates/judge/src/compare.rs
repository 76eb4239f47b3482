//! How far a model is from the logs: position error and torque error of every free joint of every run.
//!
//! The *position error* is the measured position minus the one simulated from the commanded torque, or through the
//! controller where the run has one and its references are logged. The simulation starts from rest, or in motion where the
//! run says so, at positions that are estimated from the log, for the log shows them only through its noise. A mechanism
//! that nothing holds drifts away from its log in such a simulation; then the numbers say so, or, where the motion leaves
//! all bounds, a note takes their place. The *torque error* needs no simulation (see [`dynid_torque`]).

mod inputs;
pub mod locate;

use rayon::prelude::*;
use serde::Serialize;

pub use inputs::{CorrelationOutcome, InputCorrelation};
pub use locate::{Finding, FindingKind, locate, spans};

use dynid_identify::{steps_beside, strays};

use crate::CompareError;
use dynid_dynamics::{
    simulate, simulate::Input, simulate::SimulationError, simulate::Trajectory, simulate::control, system::System,
};
use dynid_identify::{position, position::FitRun, position::RunError, position::first_state};
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion, motion::MotionError, noise::noise_of_log};
use dynid_signal::{WHITENESS_BOUND, is_white, statistics::rms, whiteness};
use dynid_torque::{self as torque, JointTorqueError};
use dynid_user_model::Model;

/// A simulation whose error is larger than this share of the motion's own spread has lost its log; where it started
/// from does not matter then.
pub const LOST: f64 = 0.5;

/// All runs against a model.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// In the order of the runs.
    pub runs: Vec<RunComparison>,
    /// Root mean square of the position error over all runs to fit to [rad or m]; `None` where one has none.
    pub rmse_fit: Option<f64>,
    /// The same over the held-out runs.
    pub rmse_validate: Option<f64>,
    /// `100 |torque error| / |torque|` over all runs to fit to.
    pub torque_percent_fit: Option<f64>,
    /// The same over the held-out runs.
    pub torque_percent_validate: Option<f64>,
}

/// One run against a model.
#[derive(Debug, Clone, Serialize)]
pub struct RunComparison {
    /// The log, as the experiment names it.
    pub file: String,
    /// `fit` or `validate`.
    pub role: String,
    /// Its free joints.
    pub joints: Vec<JointComparison>,
    /// Cut-off of the positions' filter in the torque error (Hz).
    pub cutoff_hz: Option<f64>,
    /// Cut-off of the filter that torque and model pass (Hz).
    pub torque_cutoff_hz: Option<f64>,
    /// Why an error is missing or means little.
    #[serde(rename = "typed_notes")]
    pub notes: Vec<RunNote>,
    /// Whether the simulation from the commanded torque drifts away from the log, so that the position error means little.
    pub lost: bool,
    /// Simulated positions of the free joints, one vector each, at the log's samples.
    #[serde(skip)]
    pub simulated: Option<Vec<Vec<f64>>>,
    /// The torque error of the free joints.
    #[serde(skip)]
    pub torque: Vec<JointTorqueError>,
}

/// One joint of one run against a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointComparison {
    /// The device's joint index.
    pub joint: usize,
    /// Root mean square of the position error [rad or m].
    pub rmse: Option<f64>,
    /// `100 (1 - |y - yh| / |y - mean(y)|)` of the position.
    pub fit_percent: Option<f64>,
    /// Largest position error [rad or m].
    pub max_abs: Option<f64>,
    /// Standard deviation of the log's own noise, from the log alone [rad or m].
    pub noise_floor: f64,
    /// Whether the position error is white noise beside its mean (Ljung-Box, 1 %), so that no pattern is left to explain.
    /// False without one.
    pub white: bool,
    /// Root mean square of the torque error [unit of the command].
    pub torque_rmse: Option<f64>,
    /// `100 |torque error| / |torque|`.
    pub torque_percent: Option<f64>,
    /// Ljung-Box statistic of the position error over 20 lags; white noise stays below 37.6 in 99 of 100 cases.
    pub whiteness: Option<f64>,
    /// How the errors go along with each commanded torque.
    pub inputs: Vec<InputCorrelation>,
    /// What the numbers mean.
    #[serde(rename = "typed_means")]
    pub means: Vec<Meaning>,
}

/// Why an error of a run is missing or means little.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum RunNote {
    /// Its motion cannot be filtered.
    NoTorqueError {
        /// Why.
        reason: MotionError,
    },
    /// The torque error takes the logged positions for the true ones, though the model has sensor effects.
    SensorsNotInTorqueError,
    /// It cannot be simulated to its end.
    NoPositionError {
        /// What the simulation or the search for its start says.
        error: String,
    },
    /// The simulation from the commanded torque drifts away from the log.
    SimulationLost,
}

/// What a number of a joint means.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Meaning {
    /// The simulation has lost the log, so that the size of the position error means nothing.
    SimulationLost,
    /// The position error beside the noise of the log.
    PositionError {
        /// Error over noise; infinite where the log shows no noise.
        times_noise: f64,
        /// How much that leaves.
        left: Remainder,
    },
    /// The position error has no pattern in time.
    White {
        /// Ljung-Box statistic.
        statistic: f64,
        /// What white noise stays below.
        bound: f64,
    },
    /// The position error has a pattern in time.
    Patterned {
        /// Ljung-Box statistic.
        statistic: f64,
        /// What white noise stays below.
        bound: f64,
    },
    /// The model leaves a part of the commanded torque unexplained.
    TorqueUnexplained {
        /// That part (%).
        percent: f64,
    },
    /// No error goes along with a commanded torque more than chance would.
    FollowsNoInput,
    /// An error goes along with a commanded torque.
    FollowsInput {
        /// Which and how.
        correlation: InputCorrelation,
    },
}

/// How much a position error leaves to explain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Remainder {
    /// Noise of the log's own size.
    Nothing,
    /// Less than twice the noise.
    Little,
    /// The model misses something.
    Something,
}

/// Position errors below so many times the log's noise leave nothing to explain.
const NOTHING_LEFT: f64 = 1.2;
/// Below so many times little.
const LITTLE_LEFT: f64 = 2.0;

impl JointComparison {
    /// The position error over the noise of the log: 0 without any error, infinite where the log shows no noise.
    pub fn times_noise(&self) -> Option<f64> {
        self.rmse.map(|rmse| if rmse == 0.0 { 0.0 } else { rmse / self.noise_floor })
    }

    /// Whether the position error is white noise of the log's own size.
    pub fn is_explained(&self) -> bool {
        self.white && self.times_noise().is_some_and(|ratio| ratio < NOTHING_LEFT)
    }
}

/// Compares `model` with `runs`; one result a run, in their order.
///
/// # Errors
/// A model that makes no equations for a run.
pub fn compare(model: &Model, runs: &[&Run]) -> Result<Comparison, CompareError> {
    let systems = runs.iter().map(|run| Ok(model.system_of(run)?)).collect::<Result<Vec<System>, CompareError>>()?;
    let compared: Vec<RunComparison> = runs
        .par_iter()
        .zip(&systems)
        .map(|(run, system)| compare_run(model, run, system))
        .collect::<Result<_, CompareError>>()?;
    Ok(Comparison::of(compared, runs))
}

impl Comparison {
    /// Puts together what was compared with each of `runs`.
    pub fn of(compared: Vec<RunComparison>, runs: &[&Run]) -> Self {
        let of = |role: Role| {
            compared.iter().zip(runs).filter(move |(_, run)| run.role == role).map(|(reported, _)| reported)
        };
        Self {
            rmse_fit: pooled(of(Role::Fit)),
            rmse_validate: pooled(of(Role::Validate)),
            torque_percent_fit: torque::total_percent(of(Role::Fit).flat_map(|run| &run.torque)),
            torque_percent_validate: torque::total_percent(of(Role::Validate).flat_map(|run| &run.torque)),
            runs: compared,
        }
    }
}

/// Root mean square over all samples of all joints; `None` without runs or where one lacks its position error.
fn pooled<'a>(runs: impl Iterator<Item = &'a RunComparison>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for run in runs {
        let samples = run.simulated.as_ref()?.first()?.len() as f64;
        for joint in &run.joints {
            sum += samples * joint.rmse?.powi(2);
            count += samples;
        }
    }
    (count > 0.0).then(|| (sum / count).sqrt())
}

fn compare_run(model: &Model, run: &Run, system: &System) -> Result<RunComparison, CompareError> {
    let mut notes = Vec::new();
    let motion = Motion::of(run);
    let torque = match &motion {
        Ok(motion) => torque::along(system, motion),
        Err(reason) => {
            notes.push(RunNote::NoTorqueError { reason: reason.clone() });
            Vec::new()
        }
    };
    if system.has_sensors() && !torque.is_empty() {
        notes.push(RunNote::SensorsNotInTorqueError);
    }
    let mut lost = false;
    let simulated = match simulated(model, run, &mut lost)? {
        Ok(simulated) => Some(simulated),
        Err(error) => {
            notes.push(RunNote::NoPositionError { error });
            None
        }
    };
    if lost {
        notes.push(RunNote::SimulationLost);
    }
    let joints = run
        .free
        .iter()
        .enumerate()
        .map(|(slot, &joint)| {
            let measured = &run.log.q[joint];
            let residual: Option<Vec<f64>> = simulated
                .as_ref()
                .map(|simulated| measured.iter().zip(&simulated[slot]).map(|(y, model)| y - model).collect());
            let inputs = motion.as_ref().map_or_else(
                |_| Vec::new(),
                |motion| {
                    let position = residual.as_deref().filter(|_| !lost);
                    inputs::correlations(run, motion, position, torque.get(slot))
                },
            );
            let mut reported = JointComparison {
                joint,
                rmse: residual.as_deref().map(rms),
                fit_percent: residual.as_deref().and_then(|residual| fit_percent(measured, residual)),
                max_abs: residual.as_deref().map(|residual| residual.iter().fold(0.0_f64, |size, e| size.max(e.abs()))),
                noise_floor: noise_of_log(measured),
                white: residual.as_deref().is_some_and(is_white),
                torque_rmse: torque.get(slot).and_then(JointTorqueError::rms),
                torque_percent: torque.get(slot).and_then(JointTorqueError::percent),
                whiteness: residual.as_deref().and_then(whiteness),
                inputs,
                means: Vec::new(),
            };
            reported.means = means(&reported, lost);
            reported
        })
        .collect();
    Ok(RunComparison {
        file: run.file.clone(),
        role: run.role.to_string(),
        joints,
        cutoff_hz: motion.as_ref().ok().map(|motion| motion.cutoff_hz),
        torque_cutoff_hz: motion.as_ref().ok().map(|motion| motion.parallel_cutoff_hz),
        notes,
        lost,
        simulated,
        torque,
    })
}

/// What the numbers of a joint mean.
fn means(joint: &JointComparison, lost: bool) -> Vec<Meaning> {
    let mut means = Vec::new();
    if lost {
        means.push(Meaning::SimulationLost);
    } else if let Some(times_noise) = joint.times_noise() {
        let has_pattern = joint.whiteness.is_some() && !joint.white;
        let left = match times_noise {
            ratio if ratio < NOTHING_LEFT && !has_pattern => Remainder::Nothing,
            ratio if ratio < LITTLE_LEFT => Remainder::Little,
            _ => Remainder::Something,
        };
        means.push(Meaning::PositionError { times_noise, left });
    }
    if let (Some(statistic), false) = (joint.whiteness, lost) {
        let bound = WHITENESS_BOUND;
        means.push(if joint.white {
            Meaning::White { statistic, bound }
        } else {
            Meaning::Patterned { statistic, bound }
        });
    }
    if let Some(percent) = joint.torque_percent {
        means.push(Meaning::TorqueUnexplained { percent });
    }
    let significant = joint.inputs.iter().filter(|input| input.outcome == CorrelationOutcome::Significant);
    let along: Vec<Meaning> = significant.map(|input| Meaning::FollowsInput { correlation: input.clone() }).collect();
    if along.is_empty() && !joint.inputs.is_empty() {
        means.push(Meaning::FollowsNoInput);
    }
    means.extend(along);
    means
}

/// What [`control::simulate`] returns.
type Played = Result<(Trajectory, Vec<f64>), SimulationError>;

/// Motion and commands of `system` under the run's controller, from the first logged positions; `None` for a run without
/// controller.
///
/// # Errors
/// A controller that cannot be read.
pub fn closed_loop(system: &System, run: &Run, options: &simulate::Options) -> Result<Option<Played>, CompareError> {
    let (Some(path), Some(reference)) = (&run.settings.controller, &run.log.reference) else { return Ok(None) };
    let controller = dynid_logs::controller::read(path, &run.file, system.n_joints(), run.log.sample_time())?;
    let rows = 0..run.log.len();
    let reference: Vec<f64> = rows.flat_map(|k| reference.iter().map(move |joint| joint[k])).collect();
    let first: Vec<f64> = run.free.iter().map(|&joint| run.log.q[joint][0]).collect();
    Ok(Some(control::simulate(system, &controller, &run.elapsed_s(), &reference, &first, options)))
}

/// Positions of the free joints that `model` shows under the run's commands, or under its controller where it has one: one
/// vector a joint, or why there are none.
fn simulated(model: &Model, run: &Run, lost: &mut bool) -> Result<Result<Vec<Vec<f64>>, String>, CompareError> {
    // What a fit leaves out or weighs less is judged all the same.
    let fit_run = FitRun { from_s: f64::NEG_INFINITY, first_half: 1.0, ..FitRun::of_run(model, run)? };
    let input = Input { time: &fit_run.time, command: &fit_run.command, intersample: fit_run.intersample };
    let options = simulate::Options { steps: steps_beside(run), ..simulate::Options::default() };
    let by_joint = |values: &[f64]| -> Vec<Vec<f64>> {
        let n_free = run.free.len();
        (0..n_free).map(|slot| values.iter().skip(slot).step_by(n_free).copied().collect()).collect()
    };
    if let Some(played) = closed_loop(&fit_run.system, run, &options)? {
        return Ok(played.map(|(trajectory, _)| by_joint(&trajectory.q)).map_err(|error| error.to_string()));
    }
    // From the first sample first: where that loses the log, a better start does not bring it back.
    let from_first = match simulate::simulate(&fit_run.system, &input, &first_state(&fit_run), &options) {
        Ok(trajectory) => by_joint(&trajectory.q),
        Err(error) => return Ok(Err(error.to_string())),
    };
    if strays(run, &from_first, LOST) {
        *lost = true;
        return Ok(Ok(from_first));
    }
    let options = position::Options { steps: Some(options.steps), ..position::Options::default() };
    Ok(match position::judge(&fit_run, &options) {
        Ok(RunError { simulated, .. }) => Ok(by_joint(&simulated)),
        Err(error) => Err(error.to_string()),
    })
}

/// MATLAB's normalised root mean square fit; `None` for a position that does not move.
fn fit_percent(measured: &[f64], residual: &[f64]) -> Option<f64> {
    // The mean of equal numbers is theirs only up to rounding.
    if measured.windows(2).all(|pair| pair[0] == pair[1]) {
        return None;
    }
    let mean = measured.iter().sum::<f64>() / measured.len() as f64;
    let spread: Vec<f64> = measured.iter().map(|y| y - mean).collect();
    let spread = rms(&spread);
    (spread > 0.0).then(|| 100.0 * (1.0 - rms(residual) / spread))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slow motion, rounded to 0.01: uniform errors within a digit have a standard deviation of digit / sqrt(12).
    fn run(q: Vec<Vec<f64>>) -> Run {
        let n_samples = q[0].len();
        let log = dynid_logs::log::Log {
            t: (0..n_samples).map(|k| 0.01 * k as f64).collect(),
            tau: vec![vec![0.0; n_samples]; q.len()],
            q,
            reference: None,
            mask: None,
            left_out: Vec::new(),
        };
        let settings = dynid_logs::experiment::Settings::default();
        Run {
            file: "made.csv".to_owned(),
            role: Role::Fit,
            free: vec![0, 1],
            payload: None,
            configuration: 1,
            log,
            settings,
        }
    }

    /// One joint swings, the other stands still: its log is noise, or one value.
    #[test]
    fn a_joint_that_stands_still_loses_no_log() {
        let swing: Vec<f64> = (0..1000).map(|k| (0.01 * f64::from(k)).sin()).collect();
        let mut random = dynid_random::Random::new(3);
        let noise: Vec<f64> = (0..1000).map(|_| 0.3 + 1e-4 * random.normal()).collect();
        let simulated = |away: f64| vec![swing.clone(), vec![0.3 + away; 1000]];
        for still in [noise.clone(), vec![0.3; 1000]] {
            assert!(!strays(&run(vec![swing.clone(), still]), &simulated(1e-4), LOST));
        }
        assert!(strays(&run(vec![swing.clone(), noise]), &simulated(1e-2), LOST), "it moves in the simulation alone");
        assert!(strays(&run(vec![vec![0.3; 1000]; 2]), &simulated(0.0), LOST), "nothing moves but the simulation");
        assert!(strays(&run(vec![swing.clone(), vec![0.3; 1000]]), &vec![vec![2.0; 1000]; 2], LOST));
    }

    /// Friction that falls as the joint warms up counts from the beginning of the run, whatever clock the log has.
    #[test]
    fn the_clock_of_a_log_does_not_matter() {
        let mut model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
        for (name, value) in [("Fd", 0.4), ("tau", 1.0), ("v_eps", 0.2)] {
            if name == "Fd" {
                model.add_effect("friction_drift", Some(0), None).expect("an effect of the library");
            }
            model.set_value(&format!("joint.0.friction_drift.{name}"), value).expect("a parameter");
        }
        let swing = |hertz: f64| (0..400).map(|k| 0.2 * (0.01 * hertz * f64::from(k)).cos()).collect::<Vec<f64>>();
        let mut early = run(vec![swing(2.0), swing(3.0)]);
        early.log.tau = vec![swing(2.0), swing(3.0)];
        early.settings.min_speed = vec![0.0; 2];
        early.settings.cutoff_hz = Some(5.0);
        let mut late = early.clone();
        late.log.t.iter_mut().for_each(|t| *t += 1e6);
        let [early, late] = [&early, &late].map(|run| compare(&model, &[run]).expect("equations").runs.remove(0));
        for (early, late) in early.joints.iter().zip(&late.joints) {
            for (early, late) in [(early.rmse, late.rmse), (early.torque_rmse, late.torque_rmse)] {
                let (early, late) = early.zip(late).expect("both errors");
                assert!((early - late).abs() < 1e-6 * early, "{early} {late}");
            }
        }
    }

    #[test]
    fn a_pattern_of_the_size_of_the_noise_leaves_little_not_nothing() {
        let joint = |rmse: f64, noise_floor: f64, white: bool| JointComparison {
            joint: 0,
            rmse: Some(rmse),
            fit_percent: None,
            max_abs: None,
            noise_floor,
            white,
            torque_rmse: None,
            torque_percent: None,
            whiteness: Some(if white { 20.0 } else { 90.0 }),
            inputs: Vec::new(),
            means: Vec::new(),
        };
        let reported = |rmse: f64, noise_floor: f64, white: bool| means(&joint(rmse, noise_floor, white), false);
        assert!(joint(1.1, 1.0, true).is_explained() && joint(0.0, 0.0, true).is_explained());
        assert!(!joint(1.1, 1.0, false).is_explained() && !joint(1.3, 1.0, true).is_explained());
        let left = |means: &[Meaning]| match means[0] {
            Meaning::PositionError { times_noise, left } => (times_noise, left),
            _ => panic!("{means:?}"),
        };
        assert_eq!(left(&reported(1.0, 1.0, true)), (1.0, Remainder::Nothing));
        assert_eq!(left(&reported(1.0, 1.0, false)), (1.0, Remainder::Little));
        assert_eq!(left(&reported(0.0, 0.0, true)), (0.0, Remainder::Nothing));
        assert_eq!(left(&reported(1.0, 0.0, false)), (f64::INFINITY, Remainder::Something));
        let pattern = |white: bool| reported(1.0, 1.0, white).remove(1);
        assert_eq!(pattern(true), Meaning::White { statistic: 20.0, bound: WHITENESS_BOUND });
        assert_eq!(pattern(false), Meaning::Patterned { statistic: 90.0, bound: WHITENESS_BOUND });
    }

    #[test]
    fn fit_percent_is_100_without_error_and_0_for_the_mean() {
        let y = [1.0, 3.0, 2.0, 6.0];
        assert_eq!(fit_percent(&y, &[0.0; 4]), Some(100.0));
        assert!(fit_percent(&y, &y.map(|y| y - 3.0)).expect("it moves").abs() < 1e-12);
        assert_eq!(fit_percent(&[2.0; 4], &[1.0; 4]), None);
        assert_eq!(fit_percent(&[0.1; 1000], &[1.0; 1000]), None, "whose mean is not 0.1");
    }
}
