//! What could be missing, where, and with which values it is tried.

use dynid_model::effect::Measure;
use dynid_model::{Effect, Origin, Parameter, Place, Scope};
use dynid_signal::statistics::rms;
use serde::{Deserialize, Serialize};

use dynid_logs::{experiment::Run, motion::Motion};
use dynid_user_model::{EffectInstance, Model};

/// An effect at a place, considered to be missing.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Candidate {
    /// Id of the effect.
    pub effect: String,
    /// The joint it would act on; `None` for an effect of the whole device.
    pub joint: Option<usize>,
    /// The other joint of a pair.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<usize>,
}

impl std::fmt::Display for Candidate {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&dynid_model::instance::instance_name(&self.effect, self.joint, self.from))
    }
}

impl Candidate {
    /// The effect of the library.
    pub fn law(&self) -> Option<&'static Effect> {
        dynid_model::effect(&self.effect)
    }

    /// Whether its law takes the place of the other's, being more general, at the same place.
    pub(super) fn contains(&self, other: &Self) -> bool {
        let is_replaced = |law: &Effect| law.replaces.iter().any(|smaller| smaller.id == other.effect);
        (self.joint, self.from) == (other.joint, other.from) && self.law().is_some_and(is_replaced)
    }
}

/// Every effect with a cause of its own at every place where `model` could take it and a free joint of `runs` would feel it.
///
/// Of a pair that acts on both joints alike only one order is listed, and of joints that move the same last link only one has
/// a body that joins it.
pub fn candidates(model: &Model, runs: &[&Run]) -> Vec<Candidate> {
    let n_joints = model.device.joints.len();
    let is_free = |joint: usize| runs.iter().any(|run| run.free.contains(&joint));
    let both_free =
        |one: usize, other: usize| runs.iter().any(|run| run.free.contains(&one) && run.free.contains(&other));
    let commanded = |joint: usize, from: usize| {
        runs.iter()
            .any(|run| run.free.contains(&joint) && run.log.tau[from].iter().any(|tau| *tau != run.log.tau[from][0]))
    };
    let mut found = Vec::new();
    for effect in dynid_model::effects().iter().filter(|effect| !effect.general) {
        let mut places = Vec::new();
        match effect.scope {
            Scope::Device => places.push((None, None)),
            Scope::Joint => {
                places.extend((0..n_joints).filter(|joint| is_free(*joint)).map(|joint| (Some(joint), None)))
            }
            Scope::Pair => {
                for joint in (0..n_joints).filter(|joint| is_free(*joint)) {
                    for from in (0..n_joints).filter(|from| *from != joint) {
                        let felt = match effect.place {
                            Place::Actuator => commanded(joint, from),
                            _ => both_free(joint, from) && (!is_symmetric(effect) || joint < from),
                        };
                        if felt {
                            places.push((Some(joint), Some(from)));
                        }
                    }
                }
            }
        }
        for (joint, from) in places {
            let there = |joint, from| model.effects.iter().any(|own| own.is(&effect.id, joint, from));
            if is_symmetric(effect) && there(from, joint) {
                continue;
            }
            if let Some(link) = joint.and_then(|joint| joined_link(model, effect, joint)) {
                let joins = |id: &str, joint: Option<usize>| {
                    id == effect.id && joint.and_then(|joint| joined_link(model, effect, joint)) == Some(link)
                };
                // Beside one that is known, and held at its values, there may be another.
                let is_open = |own: &EffectInstance| own.parameters.iter().any(|parameter| !parameter.fixed);
                if found.iter().any(|other: &Candidate| joins(&other.effect, other.joint))
                    || model
                        .effects
                        .iter()
                        .any(|own| own.payload.is_none() && joins(&own.effect.id, own.joint) && is_open(own))
                {
                    continue;
                }
            }
            if model.clone().add_effect(&effect.id, joint, from).is_ok() {
                found.push(Candidate { effect: effect.id.clone(), joint, from });
            }
        }
    }
    found
}

/// Whether a pair's effect is the same with its joints exchanged.
pub(super) fn is_symmetric(effect: &Effect) -> bool {
    effect.scope == Scope::Pair
        && (effect.place == Place::Link || effect.outputs.iter().any(|(name, _)| name == "torque_from"))
}

/// The link, from 0, that an effect at `joint` is a body of; `None` if it is none. At every joint that moves this link last
/// it is the same effect.
pub(super) fn joined_link(model: &Model, effect: &Effect, joint: usize) -> Option<usize> {
    let is_body = effect.scope == Scope::Joint
        && effect.place == Place::Link
        && effect.outputs.iter().all(|(name, _)| name != "inertia");
    is_body.then(|| model.device.last_link_moved_by(joint)).flatten()
}

/// What the logs show of a joint: the sizes that tried values are multiples of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    speed: f64,
    middle: f64,
    half_range: f64,
    command: f64,
    acceleration: f64,
    torque: f64,
    duration: f64,
}

impl Sizes {
    /// Of `joint` in the runs where it is free; their motions are in the order of the runs.
    pub fn of(model: &Model, runs: &[&Run], motions: &[Motion], joint: usize) -> Self {
        /// Positions beyond this share at either end are not typical.
        const TAIL: f64 = 0.01;
        let mut positions = Vec::new();
        let (mut speeds, mut accelerations, mut commands) = (Vec::new(), Vec::new(), Vec::new());
        let mut duration = 0.0_f64;
        for (run, motion) in runs.iter().zip(motions) {
            let Some(slot) = run.free.iter().position(|free| *free == joint) else { continue };
            positions.extend(motion.q[slot].iter().copied());
            speeds.extend(motion.dq[slot].iter().copied());
            accelerations.extend(motion.ddq[slot].iter().copied());
            commands.extend(motion.command[joint].iter().copied());
            duration = duration.max(motion.len() as f64 * motion.grid.step);
        }
        positions.sort_by(f64::total_cmp);
        let quantile = |share: f64| {
            positions.get((share * positions.len().saturating_sub(1) as f64).round() as usize).copied().unwrap_or(0.0)
        };
        let (low, high) = (quantile(TAIL), quantile(1.0 - TAIL));
        let command = rms(&commands);
        let gain = model.effects_at(joint).find_map(|own| own.value("Kp")).unwrap_or(1.0);
        Self {
            speed: rms(&speeds),
            middle: 0.5 * (low + high),
            half_range: 0.5 * (high - low),
            command,
            acceleration: rms(&accelerations),
            torque: command * gain.abs(),
            duration,
        }
    }

    fn value(&self, of: Measure, at: f64) -> f64 {
        let per = |torque: f64, by: f64| if by > 0.0 { torque / by } else { 0.0 };
        at * match of {
            Measure::Value => 1.0,
            Measure::Speed => self.speed,
            Measure::Position => return self.middle + at * self.half_range,
            Measure::PerRange => return per(2.0 * self.half_range, at),
            Measure::Range => 2.0 * self.half_range,
            Measure::Command => self.command,
            Measure::Torque => self.torque,
            Measure::Stiffness => per(self.torque, 2.0 * self.half_range),
            Measure::Compliance => per(2.0 * self.half_range, self.torque),
            Measure::Damping => per(self.torque, self.speed),
            Measure::Inertia => per(self.torque, self.acceleration),
            Measure::Duration => self.duration,
        }
    }
}

/// A model with a candidate in it at one choice of the values that no linear step finds.
#[derive(Debug, Clone)]
pub struct Probe {
    /// The model; amplitudes are where the effect does nothing.
    pub model: Model,
    /// Which of its values each parameter takes that no linear step finds.
    pub shape: Vec<usize>,
    /// Parameters in which the effect is linear: the steps to take.
    pub steps: Vec<Step>,
}

/// A linear step of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Its name.
    pub name: String,
    /// Where it starts.
    pub from: f64,
    /// How far a unit goes.
    pub unit: f64,
    /// How many units it may go down, and up.
    pub range: (f64, f64),
}

/// The candidate as it stands in a model that has it.
pub(super) fn instance<'m>(model: &'m Model, candidate: &Candidate) -> Option<&'m EffectInstance> {
    let Candidate { effect, joint, from } = candidate;
    model.effects.iter().find(|own| own.is(effect, *joint, *from))
}

/// All that a candidate is tried with.
pub fn probes(model: &Model, candidate: &Candidate, sizes: &Sizes) -> Vec<Probe> {
    let Candidate { effect: id, joint, from } = candidate;
    let mut with = model.clone();
    if with.add_effect(id, *joint, *from).is_err() {
        return Vec::new();
    }
    let Some(instance) = instance(&with, candidate).cloned() else { return Vec::new() };
    let effect = instance.effect;
    let carried = |symbol: &str| model.hands_over(effect, symbol, *joint, *from);
    let mut shapes: Vec<(usize, Vec<f64>)> = Vec::new();
    let mut amplitudes = Vec::new();
    for (index, parameter) in effect.parameters.iter().enumerate() {
        if parameter.origin == Origin::Numerical && parameter.scan.is_none() {
            continue;
        }
        match (&parameter.scan, parameter.null) {
            (Some(scan), _) if !carried(&parameter.symbol) => {
                let Parameter { lower, upper, .. } = instance.parameters[index];
                let mut values: Vec<f64> =
                    scan.at.iter().map(|at| sizes.value(scan.of, *at).clamp(lower, upper)).collect();
                values.dedup();
                shapes.push((index, values));
            }
            (None, Some(null)) => {
                if !carried(&parameter.symbol) {
                    let _ = with.set_value(&instance.parameter_name(index), null);
                }
                amplitudes.push(index);
            }
            _ => {}
        }
    }
    let mut models = vec![(with, Vec::new())];
    for (index, values) in &shapes {
        let name = instance.parameter_name(*index);
        let at = |(model, shape): &(Model, Vec<usize>), place: usize, value: f64| {
            let (mut model, mut shape) = (model.clone(), shape.clone());
            let _ = model.set_value(&name, value);
            shape.push(place);
            (model, shape)
        };
        let with_all = |own| values.iter().enumerate().map(move |(place, value)| at(own, place, *value));
        models = models.iter().flat_map(with_all).collect();
    }
    for (model, _) in &mut models {
        keep_orders(model);
    }
    let step = |model: &Model, index: usize| {
        let name = instance.parameter_name(index);
        let Parameter { value, lower, upper, .. } = model.parameter(&name)?;
        let initial = effect.parameters[index].initial;
        let typical = if initial == value { 0.1 * value.abs().max(0.1) } else { initial - value };
        let unit = if value + typical <= upper && value + typical >= lower { typical } else { -typical };
        let ends = ((lower - value) / unit, (upper - value) / unit);
        Some(Step { name, from: value, unit, range: (ends.0.min(ends.1), ends.0.max(ends.1)) })
    };
    models
        .into_iter()
        .map(|(model, shape)| {
            let steps = amplitudes.iter().filter_map(|index| step(&model, *index)).collect();
            Probe { model, shape, steps }
        })
        .collect()
}

/// Gives both values of an order the same where a candidate that takes another law's place in `before` knows only the smaller one: of
/// LuGre's stiction and Coulomb friction there is but one in Dahl's law.
pub(super) fn make_alike(model: &mut Model, before: &Model, candidate: &Candidate) {
    let Some(law) = candidate.law() else { return };
    let is_known = |name: &str| {
        let symbol = name.rsplit('.').next().unwrap_or(name);
        before.hands_over(law, symbol, candidate.joint, candidate.from)
    };
    for (larger, smaller) in dynid_identify::orders(model) {
        let is_new = super::refit::is_own(candidate, model, &larger) && is_known(&smaller) && !is_known(&larger);
        if let (true, Some(large), Some(small)) = (is_new, model.parameter(&larger), model.parameter(&smaller)) {
            let (value, lower, upper) = (small.value, large.lower.min(small.value), large.upper.max(small.value));
            let _ = model.set(&larger, Parameter { value, lower, upper, ..large });
        }
    }
}

/// Raises what an effect wants not to be below another value.
pub(super) fn keep_orders(model: &mut Model) {
    for (larger, smaller) in dynid_identify::orders(model) {
        if let (Some(large), Some(small)) = (model.parameter(&larger), model.parameter(&smaller))
            && large.value < small.value
        {
            let _ = model.set(&larger, Parameter { value: small.value, upper: large.upper.max(small.value), ..large });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{SQRT_2, TAU};
    use std::path::Path;

    use dynid_logs::experiment::{Role, Settings};
    use dynid_logs::log::Log;

    use super::*;

    /// The second joint of two swings by 0.5 about 0.3 at 1 Hz, under 0.8 of a motor that makes 2.5 times as much.
    #[test]
    fn what_is_tried_is_as_large_as_what_the_logs_show() {
        let (n, step) = (2_000, 0.01);
        let wave = |size: f64| (0..n).map(|k| size * (TAU * step * f64::from(k)).sin()).collect::<Vec<f64>>();
        let still = vec![0.0; n as usize];
        let log = Log {
            t: (0..n).map(|k| step * f64::from(k)).collect(),
            q: vec![still.clone(), wave(0.5).iter().map(|q| 0.3 + q).collect()],
            tau: vec![still, wave(0.8)],
            reference: None,
            mask: None,
            left_out: Vec::new(),
        };
        let settings = Settings { min_speed: vec![0.0; 2], ..Settings::default() };
        let run = Run {
            file: "made.csv".to_owned(),
            role: Role::Fit,
            free: vec![1],
            payload: None,
            configuration: 1,
            log,
            settings,
        };
        let text = "device = \"planar2r\"\n[[effect]]\nid = \"gain\"\njoint = 1\nKp = -2.5\n";
        let model = Model::parse(text, Path::new("made.toml")).expect("a model");
        let motion = Motion::of(&run).expect("a motion");
        let sizes = Sizes::of(&model, &[&run], std::slice::from_ref(&motion), 1);
        let (speed, acceleration) = (0.5 * TAU / SQRT_2, 0.5 * TAU * TAU / SQRT_2);
        let torque = 2.5 * 0.8 / SQRT_2;
        // Positions of a sine beyond a hundredth at either end are left out.
        let half_range = 0.5 * (std::f64::consts::PI * (0.5 - 0.01)).sin();
        for (of, expected) in [
            (Measure::Value, 1.0),
            (Measure::Speed, speed),
            (Measure::Position, 0.3 + half_range),
            (Measure::PerRange, 2.0 * half_range),
            (Measure::Range, 2.0 * half_range),
            (Measure::Command, 0.8 / SQRT_2),
            (Measure::Torque, torque),
            (Measure::Stiffness, torque / (2.0 * half_range)),
            (Measure::Compliance, 2.0 * half_range / torque),
            (Measure::Damping, torque / speed),
            (Measure::Inertia, torque / acceleration),
            (Measure::Duration, 20.0),
        ] {
            let found = sizes.value(of, 1.0);
            assert!((found / expected - 1.0).abs() < 0.01, "{of:?}: {found}, not {expected}");
            let twice = match of {
                Measure::Position => 0.3 + 2.0 * half_range,
                Measure::PerRange => half_range,
                _ => 2.0 * expected,
            };
            let found = sizes.value(of, 2.0);
            assert!((found / twice - 1.0).abs() < 0.01, "{of:?}: {found}, not {twice}");
        }
        // Of a joint that no run moves there is nothing, and nothing is divided by it.
        let none = Sizes::of(&model, &[&run], &[motion], 0);
        assert_eq!(none.value(Measure::Damping, 1.0), 0.0);
        assert_eq!(none.value(Measure::Range, 1.0), 0.0);
    }

    /// A unit of what is looked for leads from the value that was taken over to the law's usual one, as far as its bounds reach.
    #[test]
    fn steps_are_told_in_units_of_a_law() {
        let text = "device = \"planar2r\"\n[[effect]]\nid = \"coulomb\"\njoint = 1\nFc = 0.5\n";
        let model = Model::parse(text, Path::new("made.toml")).expect("a model");
        let stribeck = Candidate { effect: "stribeck".to_owned(), joint: Some(1), from: None };
        let sizes = Sizes {
            speed: 1.0,
            middle: 0.0,
            half_range: 1.0,
            command: 1.0,
            acceleration: 1.0,
            torque: 1.0,
            duration: 10.0,
        };
        let probes = probes(&model, &stribeck, &sizes);
        let usual = |symbol: &str| {
            let law = dynid_model::effect("stribeck").expect("it is of the library");
            law.parameters.iter().find(|own| own.symbol == symbol).expect("its own")
        };
        for probe in &probes {
            let step =
                |symbol: &str| probe.steps.iter().find(|step| step.name.ends_with(symbol)).expect("it has no shape");
            let (own, law) = (step(".Fc"), usual("Fc"));
            assert_eq!((own.from, own.unit), (0.5, law.initial - 0.5));
            let ends = [law.lower, law.upper].map(|end| (end - 0.5) / (law.initial - 0.5));
            assert_eq!(own.range, (ends[1], ends[0]));
            assert_eq!(step(".Fs").from, 0.5, "stiction is no less");
        }
        assert!(!probes.is_empty());
    }

    /// A pair's effect is, where one law acts on both joints alike; what one joint does to another is not.
    #[test]
    fn which_effects_are_the_same_with_their_joints_exchanged() {
        let is_same = |id: &str| is_symmetric(dynid_model::effect(id).expect("an effect of the library"));
        assert!(is_same("friction_coupled") && is_same("rotor_coupling"));
        assert!(!is_same("input_coupling"), "a motor that moves another joint is not moved by it");
        assert!(!is_same("payload") && !is_same("viscous"), "no effects of a pair");
    }
}
