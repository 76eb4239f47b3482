//! An error of one joint in one run, with the signals that it could follow; all at the same, uniform times.

use super::{Finding, FindingKind, Signal, units};
use crate::compare::RunComparison;
use dynid_logs::{experiment::Run, motion::Motion};
use dynid_signal::{first_derivative, straight};
use dynid_user_model::Model;

/// Longer errors are looked at in every second, third, .. sample.
const MOST_SAMPLES: usize = 20_000;

/// One joint's motion and command. Vectors have one entry a sample; `q` is empty for a locked joint.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signals {
    /// The device's joint index.
    pub joint: usize,
    /// rad or m
    pub q: Vec<f64>,
    /// rad/s or m/s
    pub dq: Vec<f64>,
    /// rad/s^2 or m/s^2
    pub ddq: Vec<f64>,
    /// Unit of the command.
    pub command: Vec<f64>,
}

/// An error with what it could follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    pub run: String,
    /// Index of the run.
    pub run_index: usize,
    pub joint: usize,
    pub error: Signal,
    /// Unit of the error.
    pub unit: String,
    /// Unit of the joint's position.
    pub position_unit: String,
    /// Time of the first sample, as the log counts it (s).
    pub start_s: f64,
    /// s
    pub step: f64,
    /// Whether it is asked what it follows of its own joint: the torque error, and the position error where there is no other.
    pub is_local: bool,
    /// Highest frequency that the error can hold (Hz).
    pub bandwidth_hz: f64,
    /// The error; zero where it does not count.
    pub residual: Vec<f64>,
    /// Whether the sample counts.
    pub used: Vec<bool>,
    /// The joint's own motion and command; its `q` is empty where the run has no motion to differentiate.
    pub own: Signals,
    /// The other joints that move or are commanded.
    pub others: Vec<Signals>,
    /// Where the joint rests: its spring's, or the middle of its motion [rad or m].
    pub rest: f64,
}

impl Trace {
    pub fn n_used(&self) -> usize {
        self.used.iter().filter(|used| **used).count()
    }

    /// Sum of squares.
    pub fn power(&self) -> f64 {
        self.residual.iter().map(|value| value * value).sum()
    }

    pub fn mean(&self) -> f64 {
        self.residual.iter().sum::<f64>() / self.n_used().max(1) as f64
    }

    /// The error freed of its mean; zero where it does not count.
    pub fn centred(&self) -> Vec<f64> {
        let mean = self.mean();
        self.residual.iter().zip(&self.used).map(|(value, used)| if *used { value - mean } else { 0.0 }).collect()
    }

    pub fn finding(&self, kind: FindingKind, share: f64, expected: f64) -> Finding {
        Finding {
            run: self.run.clone(),
            joint: self.joint,
            error: self.error,
            unit: self.unit.clone(),
            position_unit: self.position_unit.clone(),
            kind,
            share,
            expected,
            regression: None,
            twin: None,
            run_index: self.run_index,
            rank: 0.0,
        }
        .ranked()
    }
}

/// The errors of every free joint of a run: torque where there is one, position unless it has lost its log. Of a joint whose
/// position error is white noise of the log's own size there is nothing to ask: what its torque error shows then is what
/// filters do to the corners of friction.
pub fn of_run(model: &Model, run_index: usize, run: &Run, compared: &RunComparison) -> Vec<Trace> {
    let Ok(motion) = Motion::of(run) else {
        let trace = |slot| without_motion(model, run_index, run, compared, slot);
        return (0..run.free.len()).filter_map(trace).collect();
    };
    let stride = motion.kept.len().div_ceil(MOST_SAMPLES).max(1);
    let kept: Vec<usize> = motion.kept.iter().step_by(stride).copied().collect();
    let at = |values: &[f64]| -> Vec<f64> { kept.iter().map(|&k| values[k]).collect() };
    let joints: Vec<Signals> = (0..run.log.q.len())
        .map(|joint| {
            let slot = run.free.iter().position(|free| *free == joint);
            let of_slot = |values: &[Vec<f64>]| slot.map_or_else(Vec::new, |slot| at(&values[slot]));
            Signals {
                joint,
                q: of_slot(&motion.q),
                dq: of_slot(&motion.dq),
                ddq: of_slot(&motion.ddq),
                command: motion.filtered(&motion.command[joint]).into_iter().step_by(stride).collect(),
            }
        })
        .collect();
    let step = motion.grid.step * (motion.kept.get(1).copied().unwrap_or(1) * stride) as f64;
    let mut traces = Vec::new();
    for (slot, &joint) in run.free.iter().enumerate() {
        if compared.joints[slot].is_explained() {
            continue;
        }
        let (position_unit, command_unit) = units(model.device, joint);
        let trace = |error: Signal, residual: Vec<f64>, used: Vec<bool>| {
            let residual =
                residual.into_iter().zip(&used).map(|(value, used)| if *used { value } else { 0.0 }).collect();
            let nyquist = 0.5 / step;
            Trace {
                run: compared.file.clone(),
                run_index,
                joint,
                error,
                unit: if error == Signal::Torque { command_unit } else { position_unit }.to_owned(),
                position_unit: position_unit.to_owned(),
                is_local: error == Signal::Torque || compared.torque.is_empty(),
                start_s: motion.grid.start,
                step,
                bandwidth_hz: if error == Signal::Torque { motion.parallel_cutoff_hz.min(nyquist) } else { nyquist },
                residual,
                used,
                own: joints[joint].clone(),
                others: joints.iter().filter(|other| other.joint != joint).cloned().collect(),
                rest: rest_position(model, run, joint),
            }
        };
        if let Some(error) = compared.torque.get(slot) {
            let residual = error.residual.iter().step_by(stride).copied().collect();
            traces.push(trace(Signal::Torque, residual, error.used.iter().step_by(stride).copied().collect()));
        }
        if let Some(residual) = position_error(run, compared, slot) {
            let residual = at(&straight(&run.log.t, &residual, &motion.grid));
            let used = vec![true; residual.len()];
            traces.push(trace(Signal::Position, residual, used));
        }
    }
    traces
}

/// Where a run's motion cannot be filtered, its position error still has a mean, a drift and a spectrum.
fn without_motion(model: &Model, run_index: usize, run: &Run, compared: &RunComparison, slot: usize) -> Option<Trace> {
    let joint = run.free[slot];
    let residual = position_error(run, compared, slot)?;
    let (position_unit, _) = units(model.device, joint);
    let step = run.log.sample_time();
    Some(Trace {
        run: compared.file.clone(),
        run_index,
        joint,
        error: Signal::Position,
        unit: position_unit.to_owned(),
        position_unit: position_unit.to_owned(),
        is_local: true,
        start_s: run.log.t[0],
        step,
        bandwidth_hz: 0.5 / step,
        used: vec![true; residual.len()],
        own: Signals { joint, ..Signals::default() },
        others: Vec::new(),
        rest: rest_position(model, run, joint),
        residual,
    })
}

fn position_error(run: &Run, compared: &RunComparison, slot: usize) -> Option<Vec<f64>> {
    let simulated = compared.simulated.as_ref().filter(|_| !compared.lost)?.get(slot)?;
    let measured = &run.log.q[run.free[slot]];
    Some(measured.iter().zip(simulated).map(|(y, model)| y - model).collect())
}

fn rest_position(model: &Model, run: &Run, joint: usize) -> f64 {
    model.effects_at(joint).find_map(|effect| effect.value("qeq")).unwrap_or_else(|| run.log.mean_position(joint))
}

/// Rate of the commanded torque.
pub fn command_rate(signals: &Signals, step: f64) -> Vec<f64> {
    first_derivative(&signals.command, step)
}
