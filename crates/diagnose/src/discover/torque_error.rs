//! The torque error of a model along the measured motion, as one long vector, and how it changes with the model's own parameters.

use dynid_model::Parameter;
use nalgebra::{Cholesky, DMatrix, Dyn};
use rayon::prelude::*;

use dynid_logs::{experiment::Role, experiment::Run, motion::Motion};
use dynid_torque as torque;
use dynid_user_model::Model;

/// Errors of one joint in one run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Block {
    /// The device's joint index.
    pub(super) joint: usize,
    /// Independent samples that the block counts for.
    pub(super) independent: f64,
    /// The errors, one after the other in time.
    pub(super) values: Vec<f64>,
}

/// Samples of a filtered signal that say something new: successive errors of a wrong model repeat each other. Not counted
/// from each model's own error (`dynid_signal::statistics`): scores of models are compared, so all weigh the samples alike.
const SAMPLES_PER_INDEPENDENT: f64 = 10.0;

/// The torque error along the measured motion.
pub(super) struct TorqueView {
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
    pub(super) fn new(runs: &[&Run], motions: &[Motion]) -> Self {
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

    /// Of a run and a slot of its free joints, which of the kept samples are in [`TorqueView::errors`].
    pub(super) fn samples(&self, run: usize, slot: usize) -> Vec<usize> {
        let TorqueRun { motion, stride, .. } = &self.runs[run];
        let used = motion.used[slot].iter().enumerate().filter(|(_, used)| **used);
        used.map(|(index, _)| index).step_by(*stride).collect()
    }

    /// The errors of `model`; `None` where it cannot be evaluated.
    pub(super) fn errors(&self, model: &Model) -> Option<Vec<Block>> {
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

/// The information of the own parameters, with what is known of them beforehand.
pub(super) fn regular(own: &DMatrix<f64>, prior: &[f64]) -> Option<Cholesky<f64, Dyn>> {
    /// Smaller than this share of the largest is rounding.
    const ROUNDING: f64 = 1e-13;
    let mut information = own.clone();
    let largest = information.diagonal().iter().copied().fold(0.0, f64::max);
    for (index, prior) in prior.iter().enumerate() {
        information[(index, index)] += prior.max(ROUNDING * largest).max(f64::MIN_POSITIVE);
    }
    Cholesky::new(information)
}

/// How the errors change with one of the model's own parameters, and its range; `None` for one that is held or that
/// changes nothing.
pub(super) fn own_column(
    view: &TorqueView,
    base: &Model,
    raw: &[Block],
    name: &str,
    parameter: &Parameter,
) -> Option<(f64, Vec<f64>)> {
    /// A step is this share of the range.
    const STEP: f64 = 1e-4;
    /// Nearer to a bound than this share of the range is on it.
    const ON_BOUND: f64 = 1e-6;
    let Parameter { value, lower, upper, fixed } = *parameter;
    let half = 0.5 * (upper - lower);
    let spread = if half.is_finite() { half } else { (2.0 * value.abs()).max(1.0) };
    if fixed || spread <= 0.0 || value - lower < ON_BOUND * spread || upper - value < ON_BOUND * spread {
        return None;
    }
    // A wide range is no reason for a large step of a small value.
    let size = if value == 0.0 { spread } else { spread.min(10.0 * value.abs()) };
    let step = if value + STEP * size <= upper { STEP * size } else { -STEP * size };
    let mut moved = base.clone();
    moved.set_value(name, value + step).ok()?;
    let errors = view.errors(&moved)?;
    let mut column = Vec::new();
    for (block, base) in errors.iter().zip(raw) {
        column.extend(block.values.iter().zip(&base.values).map(|(value, base)| (value - base) / step));
    }
    column.iter().any(|value| *value != 0.0).then_some((spread, column))
}
