//! The machine of a case, before anything is hidden in it.
//!
//! Machines are those that the library ships. A random arm would be one more source of a [`Machine`] here.

use std::collections::BTreeMap;

use dynid_model::{Device, Link, Parameter};

use super::dice::Dice;
use super::instrument::Drive;
use crate::effects::EffectEntry;
use crate::hidden::{Habits, habits, rounded};

/// A machine and what is known of it.
pub(super) struct Machine {
    pub(super) device: &'static Device,
    pub(super) free: Vec<usize>,
    pub(super) drive: Drive,
    pub(super) habits: Habits,
    /// How far closed loops move each joint (rad or m).
    pub(super) strokes: &'static [f64],
    pub(super) start: Vec<f64>,
    /// True inertial parameters.
    pub(super) parameters: BTreeMap<String, f64>,
    /// True effects.
    pub(super) effects: Vec<EffectEntry>,
    /// Values are believed to within this fraction.
    pub(super) off: f64,
    /// Links are known to within this fraction, and the believed model says so.
    pub(super) links_within: Option<f64>,
}

/// Which machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Choice {
    pub(super) device: &'static str,
    pub(super) free: Vec<usize>,
    pub(super) drive: Drive,
}

/// An arm of five joints or more, in closed loop.
pub(super) fn arm(dice: &mut Dice) -> Choice {
    let all = (0..6).collect();
    if dice.chance(0.8) {
        return Choice { device: "staubli_tx40", free: all, drive: Drive::ClosedLoop };
    }
    let free = if dice.chance(0.5) { all } else { (1..6).collect() };
    Choice { device: "freedom6s", free, drive: Drive::ClosedLoop }
}

/// Any machine that ships.
pub(super) fn any(dice: &mut Dice) -> Choice {
    let choices: [(&str, &[&[usize]]); 8] = [
        ("freedom6s", &[&[0], &[1], &[2], &[3], &[4], &[5]]),
        ("freedom6s", &[&[0, 1], &[4, 5]]),
        ("freedom6s", &[&[3, 4, 5], &[2, 3, 4, 5], &[1, 2, 3, 4, 5], &[0, 1, 2, 3, 4, 5]]),
        ("planar2r", &[&[0], &[1], &[0, 1], &[0, 1], &[0, 1]]),
        ("double_pendulum", &[&[0], &[1], &[0, 1], &[0, 1]]),
        ("servo_pendulum", &[&[0]]),
        ("oscillator", &[&[0]]),
        ("staubli_tx40", &[&[0], &[1], &[2], &[3], &[4], &[4, 5]]),
    ];
    let (device, configurations) = choices[dice.weighted(&[25.0, 15.0, 8.0, 20.0, 10.0, 12.0, 4.0, 6.0])];
    let free = dice.pick(configurations).to_vec();
    // Nothing holds the joints of the arm but its controller; a controller for a mass on a spring nobody needs.
    let drive = match device {
        "staubli_tx40" => Drive::ClosedLoop,
        "oscillator" => Drive::OpenLoop,
        _ if dice.chance(0.25) => Drive::ClosedLoop,
        _ => Drive::OpenLoop,
    };
    Choice { device, free, drive }
}

/// How far closed loops move each joint (rad or m); about as far as open ones do.
pub(super) fn strokes(device: &str) -> &'static [f64] {
    match device {
        "freedom6s" => &[0.3, 0.25, 0.3, 0.4, 0.4, 0.4],
        "planar2r" | "double_pendulum" => &[0.6, 0.7],
        "servo_pendulum" => &[0.9],
        "oscillator" => &[0.02],
        _ => &[0.5, 0.4, 0.5, 0.6, 0.5, 0.8],
    }
}

/// True values of effects that the device's file only names (their own first guess is of no size there), by joint.
fn of_the_catalogue(device: &str, id: &str, symbol: &str, joint: usize) -> Option<f64> {
    let values: &[f64] = match (device, id, symbol) {
        // Of the size that identifications of the arm find.
        ("staubli_tx40", "rotor_inertia", "Ia") => &[0.35, 0.3, 0.12, 0.03, 0.045, 0.012],
        ("staubli_tx40", "torque_offset", "offset") => &[0.5, -0.7, 0.4, 0.2, -0.15, 0.1],
        ("staubli_tx40", "friction_coupled", "Fv") => return Some(0.4),
        ("staubli_tx40", "friction_coupled", "Fc") => return Some(0.5),
        ("staubli_tx40", "rotor_coupling", "Ia") => return Some(0.009),
        ("double_pendulum", "rotor_inertia", "Ia") => &[0.01, 0.004],
        _ => return None,
    };
    values.get(joint).copied()
}

impl Machine {
    pub(super) fn draw(choice: &Choice, links: Links, dice: &mut Dice) -> Self {
        let device = crate::hidden::device(choice.device);
        let habits = habits(choice.device);
        let off = dice.log(0.02, 0.2);
        let links_within = match links {
            Links::Known => Some(0.03),
            Links::Any if dice.chance(0.4) => Some(dice.log(0.05, 0.3)),
            Links::Any => None,
        };
        let strokes = strokes(choice.device);
        let start = (habits.start.iter().zip(strokes)).map(|(q, stroke)| q + 0.15 * stroke * dice.between(-1.0, 1.0));
        let start = start.map(rounded).collect();
        let parameters = true_links(device, &habits, links_within.map_or(off, |within| off.min(0.6 * within)), dice);
        let effects = true_effects(device, &choice.free, &habits, off, dice);
        let (free, drive) = (choice.free.clone(), choice.drive);
        Self { device, free, drive, habits, strokes, start, parameters, effects, off, links_within }
    }

    pub(super) fn has(&self, id: &str, joint: usize) -> bool {
        self.effects.iter().any(|entry| entry.id == id && entry.joint == joint)
    }

    /// Whether nothing of the links is open.
    pub(super) fn links_are_known(&self) -> bool {
        self.device.links.iter().all(|link| link.inertial.iter().all(is_known))
    }
}

/// What is known of the links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Links {
    /// To a few per cent.
    Known,
    Any,
}

pub(super) fn is_known(parameter: &Parameter) -> bool {
    parameter.fixed || parameter.lower == parameter.upper
}

/// Of each link, mass, centroid and inertia are off by a factor each, so that it stays a body.
fn true_links(device: &Device, habits: &Habits, spread: f64, dice: &mut Dice) -> BTreeMap<String, f64> {
    let mut values = BTreeMap::new();
    for (number, link) in (1..).zip(&device.links) {
        let factors = [0, 1, 2].map(|_| 1.0 + spread * dice.between(-1.0, 1.0));
        for (index, (symbol, parameter)) in Link::SYMBOLS.iter().zip(&link.inertial).enumerate() {
            let name = format!("link.{number}.{symbol}");
            let stated = habits.links.iter().find(|(own, _)| *own == name).map(|(_, value)| *value);
            let value = stated.unwrap_or(parameter.value);
            if value != 0.0 && (stated.is_some() || !is_known(parameter)) {
                values.insert(name, rounded(value * factors[if index == 0 { 0 } else { 1 + usize::from(index > 3) }]));
            }
        }
    }
    values
}

/// What the device's file gives the free joints, and friction.
fn true_effects(device: &Device, free: &[usize], habits: &Habits, off: f64, dice: &mut Dice) -> Vec<EffectEntry> {
    let mut effects = Vec::new();
    let is_lugre_known = device.effects.iter().any(|effect| effect.id == "lugre");
    let is_lugre = is_lugre_known && dice.chance(0.4);
    let has_coulomb = dice.chance(0.7) || device.id == "staubli_tx40";
    for &joint in free {
        for effect in device.effects.iter().filter(|effect| effect.joint == Some(joint)) {
            let is_felt = effect.from.is_none_or(|from| free.contains(&from));
            if !is_felt || ["viscous", "coulomb"].contains(&effect.id.as_str()) || (effect.id == "lugre" && !is_lugre) {
                continue;
            }
            let law = dynid_model::effect(&effect.id).expect("a device names effects of the library");
            let values = law.parameters.iter().map(|own| {
                let symbol = &own.symbol;
                let written = effect.values.iter().find(|(name, _)| name == symbol);
                let parameter = written.map_or_else(|| own.parameter(), |(_, parameter)| *parameter);
                let stated = of_the_catalogue(&device.id, &effect.id, symbol, joint);
                let value = match symbol.as_str() {
                    _ if parameter.fixed || crate::hidden::is_numerical(&effect.id, symbol) => parameter.value,
                    "qeq" => parameter.value + 0.05 * parameter.upper.min(1.0) * dice.between(-1.0, 1.0),
                    _ => stated.unwrap_or(parameter.value) * (1.0 + off * dice.between(-1.0, 1.0)),
                };
                (symbol.clone(), rounded(value))
            });
            effects.push(EffectEntry { id: effect.id.clone(), joint, from: effect.from, values: values.collect() });
        }
        if !is_lugre {
            effects.push(viscous(joint, habits, dice));
            if has_coulomb {
                effects.push(coulomb(joint, habits, dice));
            }
        }
    }
    effects
}

/// Viscous friction of the size that the joint has.
pub(super) fn viscous(joint: usize, habits: &Habits, dice: &mut Dice) -> EffectEntry {
    let values = [("Fv".to_owned(), rounded(habits.viscous[joint] * dice.between(0.7, 1.3)))].into();
    EffectEntry { id: "viscous".to_owned(), joint, from: None, values }
}

/// Coulomb friction of the size that the joint has.
pub(super) fn coulomb(joint: usize, habits: &Habits, dice: &mut Dice) -> EffectEntry {
    let level = rounded(habits.coulomb[joint] * dice.between(0.7, 1.3));
    let values = [("Fc".to_owned(), level), ("v_eps".to_owned(), 0.01)].into();
    EffectEntry { id: "coulomb".to_owned(), joint, from: None, values }
}
