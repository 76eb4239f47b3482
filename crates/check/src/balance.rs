//! What the torque balance shows: the logged torque beside what the measured motion needs.
//!
//! A model's values may be far off and effects may be missing: what must not be taken for a wrong log. So sign and units are
//! judged by the model's own values, to a factor of several; shifts in time by how much of the torque a *basis* leaves
//! unexplained, which has the model's regressor with free parameters, common effects (constant, spring, viscous, Coulomb and
//! cubic terms of its joint), and the model's own torque.

use dynid_dynamics::{
    simulate::Intersample,
    system::{System, SystemError},
};
use dynid_logs::{experiment::Run, motion::Motion, motion::MotionError};
use dynid_model::{JointKind, effect::Place};
use dynid_optimise::basis::Basis;
use dynid_signal::straight;
use dynid_torque::{JointLinear, JointTorqueError, RigidColumns, along, delivered, linearise, rigid_columns};
use dynid_user_model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::{
    Finding, FindingKind,
    excitation::moves,
    finding::DegreesBecause,
    least_squares::{centred, correlation, dot, independent, square},
};

/// A run with what its motion needs.
pub struct Balance<'a> {
    /// The run.
    pub run: &'a Run,
    /// The model at its configuration and pose.
    pub system: System,
    /// Its measured motion.
    pub motion: Motion,
    /// Per free joint: logged torque and torque error at the model's values.
    pub errors: Vec<JointTorqueError>,
    /// Per free joint: regressor of the kernel's lumps.
    pub rigid: Vec<RigidColumns>,
    /// Per free joint: derivatives by the parameters of effects.
    pub linear: Vec<JointLinear>,
    /// Which parameters of effects act behind the drive path.
    behind_drive: Vec<bool>,
}

impl<'a> Balance<'a> {
    /// Of a run; the inner error where it has no measured motion.
    ///
    /// # Errors
    /// A model that makes no equations for the run.
    pub fn of(model: &Model, run: &'a Run) -> Result<Result<Self, MotionError>, SystemError> {
        let system = model.system_of(run)?;
        Ok(Self::along(model, run, system))
    }

    fn along(model: &Model, run: &'a Run, system: System) -> Result<Self, MotionError> {
        let motion = Motion::of(run)?;
        let errors = along(&system, &motion);
        let rigid = rigid_columns(&system, &motion);
        let linear = linearise(&system, &motion, &rigid);
        let behind_drive = system.effect_names().iter().map(|name| is_behind_drive(model, name)).collect();
        Ok(Self { run, system, motion, errors, rigid, linear, behind_drive })
    }

    /// Values of a signal of one entry a kept sample, where the joint's samples count.
    pub fn counted(&self, slot: usize, signal: &[f64]) -> Vec<f64> {
        signal.iter().zip(&self.motion.used[slot]).filter(|(_, used)| **used).map(|(value, _)| *value).collect()
    }

    /// What the model needs at its values, in the unit of the command, where it counts.
    fn needed(&self, slot: usize) -> Vec<f64> {
        let error = &self.errors[slot];
        let needed: Vec<f64> =
            error.delivered.iter().zip(&error.residual).map(|(torque, left)| torque - left).collect();
        self.counted(slot, &needed)
    }

    /// The logged torque where it counts.
    fn logged(&self, slot: usize) -> Vec<f64> {
        self.counted(slot, &self.errors[slot].torque)
    }

    /// Columns in which the joint's torque is linear: lumps, then parameters of effects behind the drive path.
    fn own_columns(&self, slot: usize) -> Vec<Vec<f64>> {
        let rigid = self.rigid[slot].iter().flatten();
        let effects = self.linear[slot].by_parameter.iter().zip(&self.behind_drive);
        let effects = effects.filter(|(_, behind)| **behind).filter_map(|(column, _)| column.as_ref());
        rigid.chain(effects).map(|column| self.counted(slot, column)).collect()
    }

    /// Whether the joint's samples can be judged.
    pub(crate) fn is_judged(&self, slot: usize) -> bool {
        let joint = self.run.free[slot];
        self.errors[slot].n_used() >= dynid_logs::part::LEAST_SAMPLES && moves(self.run, joint)
    }

    /// Combinations of unknowns that the torque of `joint` depends on, in this motion's configuration.
    pub fn unknowns(&self, model: &Model, joint: usize) -> usize {
        let Some(slot) = self.run.free.iter().position(|free| *free == joint) else { return 0 };
        let names = self.system.effect_names();
        let is_free = |name: &String| model.parameter(name).is_some_and(|parameter| !parameter.fixed);
        let effects = self.linear[slot].by_parameter.iter().zip(names).zip(&self.behind_drive);
        let effects = effects.filter(|((column, name), behind)| **behind && column.is_some() && is_free(name)).count();
        let links_known = model.parameters().iter().all(|(name, own)| own.fixed || !name.starts_with("link."));
        let lumps = if links_known { 0 } else { self.rigid[slot].iter().flatten().count() };
        lumps + effects
    }

    /// Everything that may explain the torque of a joint.
    fn basis(&self, slot: usize) -> Basis {
        let (q, dq) = (&self.motion.q[slot], &self.motion.dq[slot]);
        let typical = (square(dq) / dq.len() as f64).sqrt().max(f64::MIN_POSITIVE);
        let common = [
            vec![1.0; q.len()],
            q.clone(),
            q.iter().map(|q| q.powi(3)).collect(),
            dq.clone(),
            dq.iter().map(|dq| (dq / (0.05 * typical)).tanh()).collect(),
            dq.iter().map(|dq| dq * dq.abs()).collect(),
        ];
        let common = common.iter().map(|signal| self.counted(slot, &self.motion.filtered(signal)));
        Basis::new(self.own_columns(slot).into_iter().chain([self.needed(slot)]).chain(common))
    }

    /// What the basis leaves of the torque of a joint, in the unit of the command.
    pub fn left(&self, slot: usize) -> Vec<f64> {
        self.basis(slot).residual(&self.counted(slot, &self.errors[slot].delivered))
    }
}

fn is_behind_drive(model: &Model, name: &str) -> bool {
    model.effects.iter().any(|own| {
        let has = (0..own.parameters.len()).any(|index| own.parameter_name(index) == name);
        has && matches!(own.effect.place, Place::Joint | Place::Link)
    })
}

/// What looks wrong in the torque balances of runs.
pub fn findings(model: &Model, balances: &[Balance<'_>]) -> Vec<Finding> {
    let of_run = |own: &Balance<'_>| -> Vec<Finding> {
        let at = |slot: usize, kind| Finding { run: own.run.file.clone(), joint: Some(own.run.free[slot]), kind };
        let judged = || (0..own.run.free.len()).filter(|slot| own.is_judged(*slot));
        let mut kinds: Vec<(usize, FindingKind)> = Vec::new();
        for slot in judged() {
            let units = [zero_torque(own, slot), degrees(model, own, slot), thousand(model, own, slot)];
            kinds.extend(units.into_iter().flatten().map(|kind| (slot, kind)));
            kinds.extend(wrong_sign(own, slot).map(|kind| (slot, kind)));
        }
        // What is in the wrong unit has no timing.
        let wrong: Vec<usize> = kinds.iter().map(|(slot, _)| *slot).collect();
        kinds.extend(timing(own, &judged().filter(|slot| !wrong.contains(slot)).collect::<Vec<_>>()));
        kinds.into_iter().map(|(slot, kind)| at(slot, kind)).collect()
    };
    let mut findings = balances.par_iter().map(of_run).collect::<Vec<_>>().concat();
    // What is in the wrong unit in one run contradicts the others, and has been said.
    let wrong: Vec<Option<usize>> = findings.iter().map(|own| own.joint).collect();
    findings.extend(contradictions(model, balances).into_iter().filter(|own| !wrong.contains(&own.joint)));
    findings
}

/// A joint without torque that is not passive: the terms of its torque do not cancel.
fn zero_torque(own: &Balance<'_>, slot: usize) -> Option<FindingKind> {
    /// The terms of a passive joint's torque cancel up to the error of the model's values.
    const CANCELS: f64 = 0.2;
    let joint = own.run.free[slot];
    if own.run.log.tau[joint].iter().any(|tau| *tau != 0.0) || own.run.settings.controller.is_some() {
        return None;
    }
    let needed = own.needed(slot);
    let slope = own.linear[slot].slope;
    let lumps = &own.system.prepared()[..own.system.kernel().n_lumps];
    let rigid: Vec<Vec<f64>> = own.rigid[slot]
        .iter()
        .zip(lumps)
        .filter_map(|(column, lump)| Some((column.as_ref()?, lump)))
        .map(|(column, lump)| own.counted(slot, column).iter().map(|y| y * lump / slope).collect())
        .collect();
    let sum: Vec<f64> = (0..needed.len()).map(|k| rigid.iter().map(|column| column[k]).sum()).collect();
    let load: Vec<f64> = needed.iter().zip(&sum).map(|(needed, rigid)| needed - rigid).collect();
    let terms = rigid.iter().map(|column| square(column)).sum::<f64>() + square(&load);
    let needed = square(&needed);
    (needed > CANCELS * CANCELS * terms)
        .then(|| FindingKind::ZeroTorque { needed: (needed / load.len().max(1) as f64).sqrt() })
}

/// Logged torque over what the model needs for the motion, by least squares, and the correlation of the two; `None` where one
/// of them is constant. `slot` counts the run's free joints.
pub fn ratio(own: &Balance<'_>, slot: usize) -> Option<(f64, f64)> {
    let (logged, needed) = (centred(&own.logged(slot)), centred(&own.needed(slot)));
    let size = square(&needed);
    (size > 0.0 && square(&logged) > 0.0).then(|| (dot(&logged, &needed) / size, correlation(&logged, &needed)))
}

/// Whether a gain of the joint may be what another ratio of torques asks for.
fn gain_may_be(model: &Model, joint: usize, ratio: f64) -> bool {
    model.effects_at(joint).filter(|own| own.effect.id == "gain").any(|own| {
        own.parameters.iter().any(|gain| !gain.fixed && (gain.lower..=gain.upper).contains(&(gain.value / ratio)))
    })
}

/// How far from a factor a ratio of torques may be to be taken for it.
const NEAR: f64 = 3.0;

fn is_near(ratio: f64, factor: f64) -> bool {
    ratio > 0.0 && (ratio / factor).ln().abs() < NEAR.ln()
}

/// Positions whose torque is that of the motion only where they are read as degrees.
fn degrees(model: &Model, own: &Balance<'_>, slot: usize) -> Option<FindingKind> {
    const DEGREE: f64 = std::f64::consts::PI / 180.0;
    /// The torque must be the motion's to be judged by.
    const SURE: f64 = 0.7;
    let joint = own.run.free[slot];
    let largest = own.run.log.q[joint].iter().fold(0.0_f64, |most, q| most.max(q.abs()));
    let (as_radians, _) = ratio(own, slot)?;
    // A motion of less than a degree is none.
    if model.device.joints[joint].kind != JointKind::Revolute || largest < 1.0 || is_near(as_radians, 1.0) {
        return None;
    }
    if gain_may_be(model, joint, as_radians) {
        return None;
    }
    let mut run = own.run.clone();
    for &joint in run.free.iter().filter(|joint| model.device.joints[**joint].kind == JointKind::Revolute) {
        run.log.q[joint].iter_mut().for_each(|q| *q *= DEGREE);
    }
    run.settings.min_speed.iter_mut().for_each(|speed| *speed *= DEGREE);
    let read = Balance::along(model, &run, own.system.clone()).ok()?;
    let (as_degrees, sure) = ratio(&read, slot)?;
    (is_near(as_degrees, 1.0) && sure > SURE).then_some(FindingKind::Degrees {
        largest,
        because: DegreesBecause::Torque { ratio: as_radians, ratio_as_degrees: as_degrees },
    })
}

fn thousand(model: &Model, own: &Balance<'_>, slot: usize) -> Option<FindingKind> {
    /// The torque must be the motion's to be judged by.
    const SURE: f64 = 0.7;
    let (ratio, sure) = ratio(own, slot)?;
    let is_off = (is_near(ratio, 1000.0) || is_near(ratio, 1e-3)) && sure > SURE;
    (is_off && !gain_may_be(model, own.run.free[slot], ratio)).then_some(FindingKind::Thousand { factor: ratio })
}

/// A torque against the one that is needed, which takes energy out of a mechanism that has none to give.
fn wrong_sign(own: &Balance<'_>, slot: usize) -> Option<FindingKind> {
    /// The torque must be against the motion's to be judged by.
    const AGAINST: f64 = -0.5;
    let (logged, needed) = (own.logged(slot), own.needed(slot));
    let correlation = correlation(&logged, &needed);
    let speed: Vec<f64> = own.motion.kept.iter().map(|&k| own.motion.dq[slot][k]).collect();
    let power = dot(&logged, &own.counted(slot, &speed)) / logged.len() as f64;
    (correlation < AGAINST && power < 0.0).then_some(FindingKind::WrongSign { correlation, mean_power: power })
}

/// Torque at other places in time, in half samples: how much of it the motion leaves unexplained.
fn timing(own: &Balance<'_>, slots: &[usize]) -> Vec<(usize, FindingKind)> {
    /// Longest shift that is looked for (s), and in samples at least and at most.
    const LONGEST_S: f64 = 0.1;
    const SAMPLES: (f64, f64) = (4.0, 64.0);
    /// A shift must take so much off the squared error, by so much of the log likelihood, and leave little.
    const WORTH: f64 = 0.35;
    const SURE: f64 = 30.0;
    const EXPLAINED: f64 = 0.1;
    if slots.is_empty()
        || own.run.settings.controller.is_some() && own.run.log.tau.iter().flatten().all(|tau| *tau == 0.0)
    {
        return Vec::new();
    }
    let raw: Vec<Vec<f64>> =
        own.run.log.tau.iter().map(|tau| straight(&own.run.log.t, tau, &own.motion.grid)).collect();
    // A command that is held from sample to sample arrives half a sample late on average.
    let held = own.run.settings.intersample == Intersample::ZeroOrder;
    let declared: i64 = if held { 1 } else { 0 };
    let bases: Vec<Basis> = slots.iter().map(|slot| own.basis(*slot)).collect();
    let mut motion = own.motion.clone();
    // Per slot: what is left, and its share of the torque's square.
    let mut left_at = |half_samples: i64| -> Vec<(Vec<f64>, f64)> {
        for (command, raw) in motion.command.iter_mut().zip(&raw) {
            *command = late(raw, half_samples + declared);
        }
        let (torques, slopes) = delivered(&own.system, &motion);
        let of_slot = |(slot, basis): (&usize, &Basis)| {
            let torque: Vec<f64> = torques[*slot].iter().map(|torque| torque / slopes[*slot]).collect();
            let torque = own.counted(*slot, &motion.filtered(&torque));
            let left = basis.residual(&torque);
            let share = square(&left) / square(&centred(&torque)).max(f64::MIN_POSITIVE);
            (left, share)
        };
        slots.iter().zip(&bases).map(of_slot).collect()
    };
    let reach = (LONGEST_S / own.motion.grid.step).clamp(SAMPLES.0, SAMPLES.1);
    let reach = (2.0 * reach.min(own.motion.len() as f64 / 8.0)) as i64;
    // Every half sample near none, and from there on coarser, then finer about the best.
    let mut places: Vec<i64> = Vec::new();
    let mut place = 0;
    while place <= reach {
        places.extend([-place, place]);
        place += 1 + place / 8;
    }
    places.sort_unstable();
    places.dedup();
    let mut try_at = |place: i64| -> (i64, Vec<f64>) { (place, left_at(place).iter().map(|own| own.1).collect()) };
    let mut tried: Vec<(i64, Vec<f64>)> = places.iter().map(|&place| try_at(place)).collect();
    let best_of = |tried: &[(i64, Vec<f64>)], slot: usize| {
        tried.iter().min_by(|a, b| a.1[slot].total_cmp(&b.1[slot])).map_or(0, |(place, _)| *place)
    };
    let mut finer: Vec<i64> = Vec::new();
    for slot in 0..slots.len() {
        let best = best_of(&tried, slot);
        finer.extend((-best.abs() / 8..=best.abs() / 8).map(|step| best + step));
    }
    finer.sort_unstable();
    finer.dedup();
    for place in finer {
        if tried.iter().all(|(known, _)| *known != place) {
            tried.push(try_at(place));
        }
    }
    let mut kinds = Vec::new();
    for (index, &slot) in slots.iter().enumerate() {
        let best = best_of(&tried, index);
        let at = |place: i64| tried.iter().find(|(known, _)| *known == place).map(|(_, left)| left[index]);
        let (Some(as_logged), Some(shifted)) = (at(0), at(best)) else { continue };
        if best == 0 || best.abs() >= reach || shifted > WORTH * as_logged || shifted > EXPLAINED {
            continue;
        }
        // How many errors are independent costs more than all else at a place, so it is asked last.
        let gain = 0.5 * independent(&left_at(best)[index].0) * (as_logged / shifted.max(f64::MIN_POSITIVE)).ln();
        if gain < SURE {
            continue;
        }
        let percent = |share: f64| 100.0 * share.sqrt();
        let (left_percent, left_shifted) = (percent(as_logged), percent(shifted));
        let other = if held { Intersample::FirstOrder } else { Intersample::ZeroOrder };
        kinds.push((
            slot,
            if (held && best == -1) || (!held && best == 1) {
                FindingKind::Hold { looks: other, left_percent, left_percent_other: left_shifted }
            } else {
                let samples = 0.5 * best as f64;
                FindingKind::Delay {
                    samples,
                    delay_s: samples * own.motion.grid.step,
                    left_percent,
                    left_percent_shifted: left_shifted,
                }
            },
        ));
    }
    kinds
}

/// A signal so many half samples later, by the cubic through the four samples about each place.
fn late(values: &[f64], half_samples: i64) -> Vec<f64> {
    let last = values.len() as i64 - 1;
    let value = |k: i64| values[k.clamp(0, last) as usize];
    let (whole, is_half) = (half_samples.div_euclid(2), half_samples.rem_euclid(2) == 1);
    (0..=last)
        .map(|k| {
            let k = k - whole;
            if is_half { (9.0 * (value(k - 1) + value(k)) - value(k - 2) - value(k + 1)) / 16.0 } else { value(k) }
        })
        .collect()
}

/// The normal equations of one joint of one run.
struct Normal {
    index: usize,
    columns: Vec<Vec<f64>>,
    torque: Vec<f64>,
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

/// Runs whose torque is a multiple of what the other runs of the same joints and pose predict for their motion.
fn contradictions(model: &Model, balances: &[Balance<'_>]) -> Vec<Finding> {
    /// The prediction must be the motion's, and the torque another.
    const SURE: f64 = 0.9;
    const OTHER: f64 = 2.0;
    /// Locked joints closer than this stand at one pose (rad or m).
    const SAME_POSE: f64 = 0.05;
    let alike = |a: &Balance<'_>, b: &Balance<'_>| {
        let poses = a.motion.locked.iter().zip(&b.motion.locked);
        (&a.run.free, &a.run.payload) == (&b.run.free, &b.run.payload)
            && poses.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) < SAME_POSE
    };
    let mut findings: Vec<Finding> = Vec::new();
    for joint in 0..model.device.joints.len() {
        let own: Vec<usize> = (0..balances.len())
            .filter(|index| {
                let slot = balances[*index].run.free.iter().position(|free| *free == joint);
                slot.is_some_and(|slot| balances[*index].is_judged(slot))
            })
            .collect();
        let Some(&first) = own.first() else { continue };
        let group = own.into_iter().filter(|index| alike(&balances[first], &balances[*index]));
        let normals: Vec<Normal> = group.filter_map(|index| normal(&balances[index], index, joint)).collect();
        let worst = normals
            .iter()
            .filter_map(|one| predicted(one, &normals))
            .filter(|(_, factor, correlation)| {
                correlation.abs() > SURE && (*factor < 0.0 || factor.ln().abs() > OTHER.ln())
            })
            .max_by(|a, b| a.1.abs().ln().abs().total_cmp(&b.1.abs().ln().abs()));
        if let Some((index, factor, correlation)) = worst {
            let run = balances[index].run.file.clone();
            findings.push(Finding { run, joint: Some(joint), kind: FindingKind::Contradicts { factor, correlation } });
        }
    }
    findings
}

fn normal(own: &Balance<'_>, index: usize, joint: usize) -> Option<Normal> {
    let slot = own.run.free.iter().position(|free| *free == joint)?;
    let samples = own.errors[slot].n_used();
    // A column that vanishes in one run must keep its place.
    let rigid = own.rigid[slot].iter();
    let effects = own.linear[slot].by_parameter.iter().zip(&own.behind_drive).filter(|(_, behind)| **behind);
    let column = |column: &Option<Vec<f64>>| match column {
        Some(column) => own.counted(slot, column),
        None => vec![0.0; samples],
    };
    let slope = own.linear[slot].slope;
    let rigid = rigid.map(|own| column(own).iter().map(|y| y / slope).collect::<Vec<f64>>());
    let columns: Vec<Vec<f64>> = rigid.chain(effects.map(|(own, _)| column(own))).chain([vec![1.0; samples]]).collect();
    let torque = own.counted(slot, &own.errors[slot].delivered);
    let n = columns.len();
    let matrix = DMatrix::from_fn(n, n, |row, other| dot(&columns[row], &columns[other]));
    let right = DVector::from_fn(n, |row, _| dot(&columns[row], &torque));
    Some(Normal { index, columns, torque, matrix, right })
}

/// Index of the run, its torque over what all others predict of it, and their correlation.
fn predicted(one: &Normal, all: &[Normal]) -> Option<(usize, f64, f64)> {
    /// Directions that the others hardly see predict nothing.
    const SEEN: f64 = 1e-8;
    let others = || all.iter().filter(|other| other.index != one.index);
    others().next()?;
    let n = one.right.len();
    let matrix = others().fold(DMatrix::zeros(n, n), |sum, other| sum + &other.matrix);
    let right = others().fold(DVector::zeros(n), |sum, other| sum + &other.right);
    let scale: Vec<f64> = matrix.diagonal().iter().map(|own| if *own > 0.0 { 1.0 / own.sqrt() } else { 0.0 }).collect();
    let scaled = DMatrix::from_fn(n, n, |row, column| scale[row] * matrix[(row, column)] * scale[column]);
    let right = DVector::from_fn(n, |row, _| scale[row] * right[row]);
    let values = scaled.svd(true, true).solve(&right, SEEN).ok()?;
    let samples = one.torque.len();
    let predicted: Vec<f64> = (0..samples)
        .map(|k| (0..n).map(|column| values[column] * scale[column] * one.columns[column][k]).sum())
        .collect();
    let (torque, predicted) = (centred(&one.torque), centred(&predicted));
    let size = square(&predicted);
    (size > 0.0 && square(&torque) > 0.0)
        .then(|| (one.index, dot(&torque, &predicted) / size, correlation(&torque, &predicted)))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use dynid_logs::experiment::Experiment;

    /// A two-link arm that hangs and is shaken twice, made by the plant: links 5 % off the device file, friction a third.
    const RECIPE: &str = r#"
device = "planar2r"
seed = 42
sample_s = 0.01
steps_per_sample = 20
noise_rms = 1e-5
quantum = 0.0
start = [-1.5, 0.1]

[parameters]
"link.1.m" = 1.25
"link.2.m" = 0.84

[[effect]]
id = "viscous"
joint = 0
Fv = 0.067

[[effect]]
id = "coulomb"
joint = 0
Fc = 0.15
v_eps = 0.05

[[effect]]
id = "viscous"
joint = 1
Fv = 0.022

[[effect]]
id = "coulomb"
joint = 1
Fc = 0.07
v_eps = 0.05

[[run]]
file = "shaken.csv"
free = [0, 1]
role = "fit"
duration_s = 30.0
torque = [
  { joint = 0, amplitude = 1.5, hz = 0.37 },
  { joint = 0, amplitude = 1.0, hz = 0.91, phase = 1.0 },
  { joint = 1, amplitude = 0.4, hz = 0.53, phase = 0.3 },
  { joint = 1, amplitude = 0.3, hz = 1.37, phase = 2.0 },
]

[[run]]
file = "chirped.csv"
free = [0, 1]
role = "validate"
duration_s = 20.0
torque = [
  { joint = 0, amplitude = 2.0, hz = 0.2, hz_per_s = 0.05 },
  { joint = 1, amplitude = 0.5, hz = 0.4, hz_per_s = 0.04, phase = 1.0 },
]
"#;

    fn runs() -> Vec<Run> {
        let device = dynid_model::device("planar2r").expect("a shipped device");
        let recipe = toml::from_str(RECIPE).expect("a recipe");
        let folder = tempfile::tempdir().expect("a folder");
        for (name, text) in dynid_plant::recipe::make(&recipe, device).expect("it can be played") {
            std::fs::write(folder.path().join(name), text).expect("the folder is writable");
        }
        Experiment::load(folder.path().join("experiment.toml")).expect("good logs").runs
    }

    /// What is found in the shaken run after `change`, and whether at joint 1.
    fn found(change: impl FnOnce(&mut Run)) -> Vec<(Option<usize>, FindingKind)> {
        let model = Model::of_device(dynid_model::device("planar2r").expect("a shipped device"));
        let mut runs = runs();
        change(&mut runs[0]);
        let balances: Vec<Balance<'_>> =
            runs.iter().map(|run| Balance::of(&model, run).expect("equations").expect("a motion")).collect();
        let found = findings(&model, &balances);
        found.into_iter().filter(|own| own.run == "shaken.csv").map(|own| (own.joint, own.kind)).collect()
    }

    #[test]
    fn good_logs_have_nothing_wrong() {
        assert_eq!(found(|_| ()), []);
    }

    #[test]
    fn a_torque_of_wrong_sign_is_found() {
        let wrong = found(|run| run.log.tau[1].iter_mut().for_each(|tau| *tau = -*tau));
        let Some((_, FindingKind::WrongSign { correlation, mean_power })) =
            wrong.iter().find(|(joint, kind)| *joint == Some(1) && matches!(kind, FindingKind::WrongSign { .. }))
        else {
            panic!("{wrong:?}")
        };
        assert!(*correlation < -0.9 && *mean_power < 0.0, "{wrong:?}");
        assert!(wrong.iter().all(|(joint, _)| *joint == Some(1)), "the other joint is good: {wrong:?}");
    }

    #[test]
    fn units_are_found() {
        let milli = found(|run| run.log.tau[1].iter_mut().for_each(|tau| *tau *= 1000.0));
        let Some((Some(1), FindingKind::Thousand { factor })) = milli.first() else { panic!("{milli:?}") };
        assert!((factor / 1000.0 - 1.0).abs() < 0.3, "{factor}");
        let degrees = found(|run| run.log.q.iter_mut().flatten().for_each(|q| *q *= 180.0 / PI));
        let of = |joint: usize| {
            degrees.iter().any(|(own, kind)| *own == Some(joint) && matches!(kind, FindingKind::Degrees { .. }))
        };
        assert!(of(0) && of(1), "{degrees:?}");
    }

    #[test]
    fn a_delay_is_found_with_its_length_and_direction() {
        for (shift, expected) in [(3_usize, 3.0), (1, 1.0)] {
            let late = found(|run| run.log.tau[1].rotate_left(shift));
            let [(Some(1), FindingKind::Delay { samples, delay_s, .. })] = late[..] else { panic!("{late:?}") };
            assert!((samples - expected).abs() <= 0.5 && (delay_s - 0.01 * samples).abs() < 1e-9, "{late:?}");
        }
        let early = found(|run| run.log.tau[1].rotate_right(2));
        let [(Some(1), FindingKind::Delay { samples, .. })] = early[..] else { panic!("{early:?}") };
        assert!((samples + 2.0).abs() <= 0.5, "{early:?}");
    }

    #[test]
    fn another_hold_than_the_experiments_is_found() {
        let straight = found(|run| run.settings.intersample = Intersample::FirstOrder);
        assert!(
            straight.iter().any(|(_, kind)| matches!(kind, FindingKind::Hold { looks: Intersample::ZeroOrder, .. })),
            "{straight:?}"
        );
    }

    #[test]
    fn a_torque_that_is_missing_is_found() {
        let none = found(|run| run.log.tau[1].fill(0.0));
        assert!(matches!(none.first(), Some((Some(1), FindingKind::ZeroTorque { .. }))), "{none:?}");
    }

    #[test]
    fn a_run_that_contradicts_the_others_is_found() {
        let heavier = found(|run| run.log.tau[1].iter_mut().for_each(|tau| *tau *= 3.0));
        let Some((Some(1), FindingKind::Contradicts { factor, correlation })) = heavier.last() else {
            panic!("{heavier:?}")
        };
        assert!((factor - 3.0).abs() < 0.2 && *correlation > 0.9, "{heavier:?}");
    }

    #[test]
    fn half_samples_are_between_samples() {
        let line: Vec<f64> = (0..20).map(f64::from).collect();
        for half_samples in -3..=3 {
            let shifted = late(&line, half_samples);
            assert!((5..15).all(|k| (shifted[k] - (k as f64 - 0.5 * half_samples as f64)).abs() < 1e-12));
        }
    }
}
