//! The torque error (equation error): commanded torque minus the torque that the measured motion needs.
//!
//! Along the measured motion the equations say `drive(command) = Y(q, dq, ddq) lumps + load + inertias ddq`, where
//! `load` is the sum of the joint effects. What is left over, brought back through the linear stages of the drive path
//! (so that it is in the unit of the command, and a small gain cannot make it small), is the torque error. It passes the
//! same zero-phase filter and decimation as the torque that it is compared with. Nothing is simulated but the states
//! of effects that have some (LuGre's bristles), which follow the measured speed.

mod memory;
mod states;
mod terms;

use rayon::prelude::*;

pub use dynid_logs::motion::{Motion, MotionError};
pub use memory::Memory;
pub use terms::{JointTerms, TermsError, terms};

use dynid_dynamics::{system::Linear, system::Scratch, system::System};
use dynid_logs::experiment::Run;

/// Samples that one task handles; the result does not depend on it.
const CHUNK: usize = 2048;

/// The torque error of one free joint. Vectors hold one entry a kept sample.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTorqueError {
    /// The device's joint index.
    pub joint: usize,
    /// Time (s).
    pub time: Vec<f64>,
    /// Speed of the joint [rad/s or m/s].
    pub speed: Vec<f64>,
    /// Position of the joint [rad or m].
    pub position: Vec<f64>,
    /// Commanded torque, filtered [unit of the command].
    pub torque: Vec<f64>,
    /// Commanded torque minus the model's, filtered [unit of the command].
    pub residual: Vec<f64>,
    /// Torque that the drive path delivers, filtered, brought back like the residual [unit of the command]: the command
    /// itself, but where a stage of the drive path is not linear.
    pub delivered: Vec<f64>,
    /// Whether the sample counts.
    pub used: Vec<bool>,
}

impl JointTorqueError {
    /// The delivered torque over the commanded one, root mean squares where they count: 1 but where a stage of the drive
    /// path takes torque away. `None` without torque.
    pub fn delivered_share(&self) -> Option<f64> {
        let commanded = square_sum(&self.torque, &self.used);
        (commanded > 0.0).then(|| (square_sum(&self.delivered, &self.used) / commanded).sqrt())
    }

    /// Number of samples that count.
    pub fn n_used(&self) -> usize {
        self.used.iter().filter(|used| **used).count()
    }

    /// Root mean square of the residual where it counts; `None` where nothing does.
    pub fn rms(&self) -> Option<f64> {
        let n_used = self.n_used();
        (n_used > 0).then(|| (square_sum(&self.residual, &self.used) / n_used as f64).sqrt())
    }

    /// As [`total_percent`], of this joint alone.
    pub fn percent(&self) -> Option<f64> {
        total_percent([self])
    }
}

/// `100 |residual| / |torque|` of several joints together; none where that is no number: without torque, or where an effect's states are too
/// fast to be followed.
pub fn total_percent<'a>(joints: impl IntoIterator<Item = &'a JointTorqueError>) -> Option<f64> {
    let (mut residual, mut torque) = (0.0, 0.0);
    for joint in joints {
        residual += square_sum(&joint.residual, &joint.used);
        torque += square_sum(&joint.torque, &joint.used);
    }
    let percent = 100.0 * (residual / torque).sqrt();
    percent.is_finite().then_some(percent)
}

fn square_sum(values: &[f64], used: &[bool]) -> f64 {
    values.iter().zip(used).filter(|(_, used)| **used).map(|(value, _)| value * value).sum()
}

/// The torque error of each free joint of `run`, in their order, for a system of its configuration.
///
/// # Errors
/// A filter that does not fit the log.
pub fn torque_error(system: &System, run: &Run) -> Result<Vec<JointTorqueError>, MotionError> {
    Ok(along(system, &Motion::of(run)?))
}

/// The torque error along `motion`.
pub fn along(system: &System, motion: &Motion) -> Vec<JointTorqueError> {
    let Balance { error, delivered, passed } = balance(system, motion, None);
    let residuals = filtered(motion, &error, passed.as_deref());
    residuals
        .into_par_iter()
        .enumerate()
        .map(|(slot, residual)| {
            let joint = system.kernel().free[slot];
            let kept = |values: &[f64]| motion.kept.iter().map(|&k| values[k]).collect();
            JointTorqueError {
                joint,
                time: motion.kept.iter().map(|&k| motion.grid.time(k)).collect(),
                speed: kept(&motion.dq[slot]),
                position: kept(&motion.q[slot]),
                torque: motion.filtered(&motion.command[joint]),
                residual,
                delivered: motion.filtered(&delivered[slot]),
                used: motion.used[slot].clone(),
            }
        })
        .collect()
}

/// [`JointTorqueError::residual`] of each free joint, with what `memory` has of other systems along the same `motion`.
pub fn residuals(system: &System, motion: &Motion, memory: &Memory) -> Vec<Vec<f64>> {
    let Balance { error, passed, .. } = balance(system, motion, Some(memory));
    filtered(motion, &error, passed.as_deref())
}

fn filtered(motion: &Motion, error: &[Vec<f64>], passed: Option<&[Vec<f64>]>) -> Vec<Vec<f64>> {
    let of_slot = |(slot, error): (usize, &Vec<f64>)| {
        let mut residual = motion.filtered(error);
        if let Some(passed) = passed {
            residual.iter_mut().zip(&passed[slot]).for_each(|(residual, passed)| *residual /= passed);
        }
        residual
    };
    error.par_iter().enumerate().map(of_slot).collect()
}

/// Torques of each free joint, on the grid and not filtered [unit of the command].
struct Balance {
    /// Delivered minus needed.
    error: Vec<Vec<f64>>,
    delivered: Vec<Vec<f64>>,
    /// As [`passed`] has it.
    passed: Option<Vec<Vec<f64>>>,
}

fn balance(system: &System, motion: &Motion, memory: Option<&Memory>) -> Balance {
    let n = system.n_free();
    let states = states::follow(system, motion, memory);
    let slopes = system.drive_slope(&typical_commands(system, motion)).0;
    let rigid = memory.map_or_else(|| rigid(system, motion).into(), |memory| memory.rigid(system, motion));
    let chunks: Vec<Vec<Vec<f64>>> = chunks(motion)
        .into_par_iter()
        .map(|range| {
            let mut scratch = system.scratch();
            let mut sample = Sample::new(system);
            let mut columns = vec![Vec::with_capacity(range.len()); 2 * n];
            let mut needed = vec![0.0; n];
            for k in range {
                sample.load(motion, states.as_ref(), k);
                let Sample { x, ddq, command, dx, .. } = &mut sample;
                let t = motion.elapsed_s(k);
                system.drive(&mut scratch, t, x, command, dx);
                system.loads(&mut scratch, t, x, dx);
                needed.copy_from_slice(&rigid[k * n..(k + 1) * n]);
                system.add_inertia_torque(ddq, &mut needed);
                let Scratch { drive, load, .. } = &scratch;
                for slot in 0..n {
                    columns[slot].push((drive[slot] - load[slot] - needed[slot]) / slopes[slot]);
                    columns[n + slot].push(drive[slot] / slopes[slot]);
                }
            }
            columns
        })
        .collect();
    let whole = |column: usize| chunks.iter().flat_map(|columns| columns[column].iter().copied()).collect();
    Balance {
        error: (0..n).map(whole).collect(),
        delivered: (n..2 * n).map(whole).collect(),
        passed: passed(system, motion, states.as_ref()),
    }
}

/// What the rigid body needs at each sample of the grid, n_samples x n_free, the link effects' share left out.
fn rigid(system: &System, motion: &Motion) -> Vec<f64> {
    let n = system.n_free();
    let mut torques = vec![0.0; motion.len() * n];
    torques.par_chunks_mut(CHUNK * n).enumerate().for_each(|(chunk, torques)| {
        let mut sample = Sample::new(system);
        for (index, torques) in torques.chunks_exact_mut(n).enumerate() {
            sample.load(motion, None, chunk * CHUNK + index);
            let (q, dq) = sample.x[..2 * n].split_at(n);
            system.kernel().functions.inverse_dynamics(system.prepared(), q, dq, &sample.ddq, torques);
        }
    });
    torques
}

/// The torque that the drive path delivers at each free joint, on the grid and not filtered, and the torque at the joint per
/// unit of command.
pub fn delivered(system: &System, motion: &Motion) -> (Vec<Vec<f64>>, Vec<f64>) {
    let n = system.n_free();
    let states = states::follow(system, motion, None);
    let slopes = system.drive_slope(&typical_commands(system, motion)).0;
    let mut scratch = system.scratch();
    let mut sample = Sample::new(system);
    let mut delivered = vec![Vec::with_capacity(motion.len()); n];
    for k in 0..motion.len() {
        sample.load(motion, states.as_ref(), k);
        let Sample { x, command, dx, .. } = &mut sample;
        system.drive(&mut scratch, motion.elapsed_s(k), x, command, dx);
        delivered.iter_mut().zip(&scratch.drive).for_each(|(delivered, drive)| delivered.push(*drive));
    }
    (delivered, slopes)
}

/// The linear part of the torque error of one free joint: its regressor of the kernel's lumps, filtered, at the kept
/// samples, in torque at the joint. `None` for a lump that the joint does not feel.
pub type RigidColumns = Vec<Option<Vec<f64>>>;

/// Regressor columns of each free joint. They do not depend on the model's values.
pub fn rigid_columns(system: &System, motion: &Motion) -> Vec<RigidColumns> {
    let n = system.n_free();
    let n_lumps = system.kernel().n_lumps;
    let chunks: Vec<Vec<f64>> = chunks(motion)
        .into_par_iter()
        .map(|range| {
            // Column after column, each of the chunk's length.
            let length = range.len();
            let mut columns = vec![0.0; n * n_lumps * length];
            let mut sample = Sample::new(system);
            let mut y = vec![0.0; n * n_lumps];
            for (row, k) in range.enumerate() {
                sample.load(motion, None, k);
                let (q, dq) = (&sample.x[..n], &sample.x[n..2 * n]);
                system.kernel().functions.regressor(system.prepared(), q, dq, &sample.ddq, &mut y);
                y.iter().enumerate().for_each(|(column, value)| columns[column * length + row] = *value);
            }
            columns
        })
        .collect();
    let column = |index: usize| {
        let mut column = Vec::with_capacity(motion.len());
        for chunk in &chunks {
            let length = chunk.len() / (n * n_lumps);
            column.extend_from_slice(&chunk[index * length..(index + 1) * length]);
        }
        column.iter().any(|value| *value != 0.0).then(|| motion.filtered(&column))
    };
    let columns: Vec<Option<Vec<f64>>> = (0..n * n_lumps).into_par_iter().map(column).collect();
    (0..n).map(|slot| columns[slot * n_lumps..(slot + 1) * n_lumps].to_vec()).collect()
}

/// The torque error of one free joint about the system's present values: filtered, at the kept samples, in the unit
/// of the command.
#[derive(Debug, Clone)]
pub struct JointLinear {
    /// The torque error.
    pub residual: Vec<f64>,
    /// Its derivative by each effect parameter of the system; `None` where it is zero.
    pub by_parameter: Vec<Option<Vec<f64>>>,
    /// Torque at the joint per unit of command.
    pub slope: f64,
    /// Share of the drive's torque that is left for the motion, by which all of this and the regressor are divided; none
    /// where it is 1.
    pub passed: Option<Vec<f64>>,
}

/// The torque error of each free joint about the system's present values. Its derivative by the lumps is `-Y / slope`,
/// with Y from [`rigid_columns`].
pub fn linearise(system: &System, motion: &Motion, rigid: &[RigidColumns]) -> Vec<JointLinear> {
    let n = system.n_free();
    let n_parameters = system.effect_parameters().len();
    let n_columns = n_parameters + 1;
    let states = states::follow_with_gradient(system, motion);
    let (slopes, slopes_by) = system.drive_slope(&typical_commands(system, motion));
    let chunks: Vec<Vec<f64>> = chunks(motion)
        .into_par_iter()
        .map(|range| {
            let length = range.len();
            let mut columns = vec![0.0; n * n_columns * length];
            let mut linear = Linear::new(system);
            let mut sample = Sample::new(system);
            let mut inertial = vec![0.0; n];
            for (row, k) in range.enumerate() {
                sample.load(motion, states.as_ref(), k);
                let Sample { x, ddq, command, late, dx, .. } = &mut sample;
                linear.set_late(late.iter().copied());
                linear.along(system, motion.elapsed_s(k), x, Some(ddq), command, dx);
                inertial.fill(0.0);
                system.add_inertia_torque(ddq, &mut inertial);
                let mut add = |slot: usize, column: usize, value: f64| {
                    columns[(slot * n_columns + column) * length + row] += value;
                };
                for (slot, inertial) in inertial.iter().enumerate() {
                    add(slot, n_parameters, linear.drive()[slot] - linear.load()[slot] - inertial);
                }
                for &(slot, parameter, value) in &linear.torque_by_parameter {
                    add(slot, parameter, value);
                }
                if let Some(states) = &states {
                    for slot in 0..n {
                        for state in 0..states.n_states {
                            let by_state = linear.torque_by_state[slot * system.n_states() + 2 * n + state];
                            if by_state != 0.0 {
                                for (parameter, value) in states.gradient(k, state) {
                                    add(slot, parameter, by_state * value);
                                }
                            }
                        }
                    }
                }
            }
            columns
        })
        .collect();
    let column = |index: usize| {
        let mut column = Vec::with_capacity(motion.len());
        for chunk in &chunks {
            let length = chunk.len() / (n * n_columns);
            column.extend_from_slice(&chunk[index * length..(index + 1) * length]);
        }
        column.iter().any(|value| *value != 0.0).then(|| motion.filtered(&column))
    };
    let columns: Vec<Option<Vec<f64>>> = (0..n * n_columns).into_par_iter().map(column).collect();

    let passed_here = passed(system, motion, states.as_ref());
    let passed_by = if passed_here.is_some() { passed_gradient(system, motion) } else { Vec::new() };
    let lumps = &system.prepared()[..system.kernel().n_lumps];
    (0..n)
        .map(|slot| {
            let slope = slopes[slot];
            let mut by_parameter = columns[slot * n_columns..slot * n_columns + n_parameters].to_vec();
            let mut residual =
                columns[slot * n_columns + n_parameters].clone().unwrap_or_else(|| vec![0.0; motion.kept.len()]);
            for (column, lump) in rigid[slot].iter().zip(lumps) {
                if let Some(column) = column {
                    residual.iter_mut().zip(column).for_each(|(residual, y)| *residual -= y * lump);
                }
            }
            residual.iter_mut().for_each(|value| *value /= slope);
            by_parameter.iter_mut().flatten().flatten().for_each(|value| *value /= slope);
            // The error at the joint is divided by the slope, which depends on parameters itself.
            for &(_, parameter, by) in slopes_by.iter().filter(|(other, ..)| *other == slot) {
                let column = by_parameter[parameter].get_or_insert_with(|| vec![0.0; motion.kept.len()]);
                column.iter_mut().zip(&residual).for_each(|(value, residual)| *value -= residual * by / slope);
            }
            let passed = passed_here.as_ref().map(|passed| passed[slot].clone());
            if let Some(passed) = &passed {
                let divide =
                    |values: &mut Vec<f64>| values.iter_mut().zip(passed).for_each(|(value, share)| *value /= share);
                divide(&mut residual);
                by_parameter.iter_mut().flatten().for_each(divide);
                for (parameter, by) in &passed_by {
                    let column = by_parameter[*parameter].get_or_insert_with(|| vec![0.0; motion.kept.len()]);
                    for (row, value) in column.iter_mut().enumerate() {
                        *value -= residual[row] * by[slot][row] / passed[row];
                    }
                }
            }
            JointLinear { residual, by_parameter, slope, passed }
        })
        .collect()
}

/// How much of a change of the drive's torque is left for the motion at each free joint, at the kept samples: less than 1
/// where friction grows with the torque. The torque error is divided by it, for it is stated as a command. `None` where no
/// joint effect reads the drive's torque.
fn passed(system: &System, motion: &Motion, states: Option<&states::States>) -> Option<Vec<Vec<f64>>> {
    /// Relative change of the commands: what is read of the drive's torque is proportional to it, so it may be large.
    const STEP: f64 = 1e-2;
    /// A joint that passes less is stuck, and tells nothing of its command.
    const RANGE: (f64, f64) = (0.1, 10.0);
    if system.readers_of_load().is_empty() {
        return None;
    }
    let n = system.n_free();
    let chunks: Vec<Vec<f64>> = motion
        .kept
        .par_chunks(CHUNK)
        .map(|kept| {
            let mut linear = Linear::new(system);
            let mut sample = Sample::new(system);
            let mut shares = Vec::with_capacity(n * kept.len());
            for &k in kept {
                sample.load(motion, states, k);
                let Sample { x, command, late, dx, .. } = &mut sample;
                linear.set_late(late.iter().copied());
                let mut net = |command: &[f64]| {
                    linear.along(system, motion.elapsed_s(k), x, None, command, dx);
                    (linear.drive().to_vec(), linear.load().to_vec())
                };
                let (drive, load) = net(command);
                let more: Vec<f64> = command.iter().map(|command| command * (1.0 + STEP)).collect();
                let (drive_more, load_more) = net(&more);
                for slot in 0..n {
                    let by_drive = drive_more[slot] - drive[slot];
                    let share = if by_drive == 0.0 { 1.0 } else { 1.0 - (load_more[slot] - load[slot]) / by_drive };
                    shares.push(if share.is_finite() { share.clamp(RANGE.0, RANGE.1) } else { 1.0 });
                }
            }
            shares
        })
        .collect();
    let whole: Vec<f64> = chunks.into_iter().flatten().collect();
    Some((0..n).map(|slot| whole.iter().skip(slot).step_by(n).copied().collect()).collect())
}

/// Derivative of [`passed`] by the parameters of the effects that read the drive's torque: parameter, then per free joint.
fn passed_gradient(system: &System, motion: &Motion) -> Vec<(usize, Vec<Vec<f64>>)> {
    /// Relative step of a central difference.
    const STEP: f64 = 1e-3;
    let at = |parameter: usize, value: f64| {
        let mut moved = system.clone();
        let mut values = system.effect_parameters().to_vec();
        values[parameter] = value;
        moved.set_parameters(system.link_parameters(), &values);
        passed(&moved, motion, states::follow(&moved, motion, None).as_ref())
    };
    let by = |parameter: usize| {
        let value = system.effect_parameters()[parameter];
        let step = STEP * if value == 0.0 { 1.0 } else { value.abs() };
        let (more, less) = (at(parameter, value + step)?, at(parameter, value - step)?);
        let difference = |(more, less): (Vec<f64>, Vec<f64>)| {
            more.iter().zip(&less).map(|(more, less)| (more - less) / (2.0 * step)).collect()
        };
        Some((parameter, more.into_iter().zip(less).map(difference).collect()))
    };
    system.readers_of_load().into_iter().filter_map(by).collect()
}

/// Root mean square of each free joint's command.
fn typical_commands(system: &System, motion: &Motion) -> Vec<f64> {
    let command = |joint: &usize| {
        let command = &motion.command[*joint];
        (command.iter().map(|value| value * value).sum::<f64>() / command.len() as f64).sqrt()
    };
    system.kernel().free.iter().map(command).collect()
}

fn chunks(motion: &Motion) -> Vec<std::ops::Range<usize>> {
    (0..motion.len()).step_by(CHUNK).map(|from| from..(from + CHUNK).min(motion.len())).collect()
}

/// Room for the state at one sample.
struct Sample {
    n: usize,
    x: Vec<f64>,
    ddq: Vec<f64>,
    command: Vec<f64>,
    /// Joints whose commands are late, and by how much (s).
    delays: Vec<(usize, f64)>,
    /// How what arrives changes with each delay.
    late: Vec<f64>,
    dx: Vec<f64>,
}

impl Sample {
    fn new(system: &System) -> Self {
        let n = system.n_free();
        Self {
            n,
            x: system.rest(&vec![0.0; n]),
            ddq: vec![0.0; n],
            command: vec![0.0; system.n_joints()],
            delays: system.delays().iter().map(|delay| (delay.joint, delay.span_s)).collect(),
            late: vec![0.0; system.delays().len()],
            dx: vec![0.0; system.n_states()],
        }
    }

    /// The measured state and command at sample `k`.
    fn load(&mut self, motion: &Motion, states: Option<&states::States>, k: usize) {
        for slot in 0..self.n {
            self.x[slot] = motion.q[slot][k];
            self.x[self.n + slot] = motion.dq[slot][k];
            self.ddq[slot] = motion.ddq[slot][k];
        }
        for (value, command) in self.command.iter_mut().zip(&motion.command) {
            *value = command[k];
        }
        self.delay(motion, k as f64);
        if let Some(states) = states {
            states.at(k, &mut self.x[2 * self.n..]);
        }
    }

    /// Puts what arrives late in the place of the commands, at `place` on the grid.
    fn delay(&mut self, motion: &Motion, place: f64) {
        for (late, &(joint, span_s)) in self.late.iter_mut().zip(&self.delays) {
            let (value, rate) = motion.command_at(joint, place - span_s / motion.grid.step);
            self.command[joint] = value;
            *late = -rate;
        }
    }
}

#[cfg(test)]
mod tests;
