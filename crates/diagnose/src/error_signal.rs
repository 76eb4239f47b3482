//! The errors that a screening looks at, as one long vector: what any model leaves of the logs, without a fit.

use rayon::prelude::*;

use dynid_dynamics::{simulate, simulate::Input, simulate::Observer, system::SystemError};
use dynid_identify::{position::FitRun, position::first_state};
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion};
use dynid_torque as torque;
use dynid_user_model::Model;

/// Errors of one joint in one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// The device's joint index.
    pub joint: usize,
    /// Independent samples that the block counts for.
    pub independent: f64,
    /// The errors, one after the other in time.
    pub values: Vec<f64>,
}

/// An error signal that can be had for any model without fitting.
pub trait View: Sync {
    /// The errors of `model`; `None` where it cannot be evaluated.
    fn errors(&self, model: &Model) -> Option<Vec<Block>>;
}

/// Samples of a filtered signal that say something new: successive errors of a wrong model repeat each other. Not counted
/// from each model's own error (`dynid_signal::statistics`): scores of models are compared, so all weigh the samples alike.
const SAMPLES_PER_INDEPENDENT: f64 = 10.0;

/// The torque error along the measured motion.
pub struct TorqueView {
    runs: Vec<TorqueRun>,
}

struct TorqueRun {
    free: Vec<usize>,
    /// Mean positions of all joints: where the locked ones stand.
    positions: Vec<f64>,
    motion: Motion,
    /// Kept samples from one that is looked at to the next.
    stride: usize,
    memory: torque::Memory,
}

impl TorqueView {
    /// Of those of `runs` that are for fitting; `motions` are theirs, in the order of the runs.
    pub fn new(runs: &[&Run], motions: &[Motion]) -> Self {
        let runs = runs
            .iter()
            .zip(motions)
            .filter(|(run, _)| run.role == Role::Fit)
            .map(|(run, motion)| {
                let positions = (0..run.log.q.len()).map(|joint| run.log.mean_position(joint)).collect();
                // What the filter has left needs no more samples than this.
                let rate = 1.0 / (motion.grid.step * run.settings.decimate.max(1) as f64);
                let stride = (rate / (4.0 * motion.parallel_cutoff_hz)).floor().max(1.0) as usize;
                let memory = torque::Memory::default();
                TorqueRun { free: run.free.clone(), positions, motion: motion.clone(), stride, memory }
            })
            .collect();
        Self { runs }
    }

    /// Of a run and a slot of its free joints, which of the kept samples are in [`View::errors`].
    pub(super) fn samples(&self, run: usize, slot: usize) -> Vec<usize> {
        let TorqueRun { motion, stride, .. } = &self.runs[run];
        let used = motion.used[slot].iter().enumerate().filter(|(_, used)| **used);
        used.map(|(index, _)| index).step_by(*stride).collect()
    }
}

impl View for TorqueView {
    fn errors(&self, model: &Model) -> Option<Vec<Block>> {
        let blocks: Vec<Vec<Block>> = self
            .runs
            .par_iter()
            .map(|run| {
                let system = model.system(&run.free, |joint| run.positions[joint]).ok()?;
                let residuals = torque::residuals(&system, &run.motion, &run.memory);
                let block = |((joint, residual), used): ((&usize, Vec<f64>), &Vec<bool>)| {
                    let used = residual.into_iter().zip(used).filter(|(_, used)| **used);
                    let values: Vec<f64> = used.map(|(value, _)| value).step_by(run.stride).collect();
                    let independent = values.len() as f64 * run.stride as f64 / SAMPLES_PER_INDEPENDENT;
                    let is_finite = values.iter().all(|value| value.is_finite());
                    is_finite.then_some(Block { joint: *joint, independent, values })
                };
                system.kernel().free.iter().zip(residuals).zip(&run.motion.used).map(block).collect()
            })
            .collect::<Option<_>>()?;
        Some(blocks.into_iter().flatten().collect())
    }
}

/// The position error of simulations that an observer holds near the log, so that errors do not pile up: each sample tells of
/// what went wrong within the last `1 / rate`.
pub struct ObserverView {
    runs: Vec<(FitRun, Vec<usize>, Vec<f64>)>,
    rate: f64,
    substeps: usize,
}

impl ObserverView {
    /// Of those of `runs` that are for fitting.
    ///
    /// # Errors
    /// A model that makes no equations for a run.
    pub fn new(model: &Model, runs: &[&Run], rate: f64, substeps: usize) -> Result<Self, SystemError> {
        let runs = runs
            .iter()
            .filter(|run| run.role == Role::Fit)
            .map(|run| {
                let positions = (0..run.log.q.len()).map(|joint| run.log.mean_position(joint)).collect();
                Ok((FitRun::of_run(model, run)?, run.free.clone(), positions))
            })
            .collect::<Result<_, SystemError>>()?;
        Ok(Self { runs, rate, substeps })
    }
}

impl View for ObserverView {
    fn errors(&self, model: &Model) -> Option<Vec<Block>> {
        let blocks: Vec<Vec<Block>> = self
            .runs
            .par_iter()
            .map(|(run, free, positions)| {
                let system = model.system(free, |joint| positions[joint]).ok()?;
                let n = free.len();
                let start = first_state(run);
                let input = Input { time: &run.time, command: &run.command, intersample: run.intersample };
                let observer = Observer { rate: self.rate, position: &run.position };
                let options = simulate::Options { substeps: self.substeps, ..simulate::Options::default() };
                let simulated = simulate::simulate_with_observer(&system, &input, &observer, &start, &options).ok()?;
                let block = |(slot, joint): (usize, &usize)| {
                    let errors = run.position.iter().zip(&simulated.q).skip(slot).step_by(n).skip(run.first_sample());
                    let values: Vec<f64> = errors.map(|(measured, model)| measured - model).collect();
                    Block { joint: *joint, independent: values.len() as f64 / SAMPLES_PER_INDEPENDENT, values }
                };
                Some(free.iter().enumerate().map(block).collect())
            })
            .collect::<Option<_>>()?;
        Some(blocks.into_iter().flatten().collect())
    }
}
