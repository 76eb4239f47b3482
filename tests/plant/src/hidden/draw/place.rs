//! Where an effect may be hidden so that it is there at all, and is no other effect by another name.

use dynid_model::{Place, Scope};

use super::instrument::Drive;
use super::machine::Machine;
use crate::effects::outside;

/// Effects of the library that a draw knows a place and a size for.
pub(super) const IDS: [&str; 32] = [
    "backlash",
    "cogging",
    "coulomb",
    "coulomb_asymmetric",
    "dahl",
    "dead_zone",
    "friction_bias",
    "friction_coupled",
    "friction_drift",
    "friction_load",
    "gain",
    "hysteresis",
    "input_coupling",
    "input_delay",
    "input_lag",
    "joint_elasticity",
    "lugre",
    "payload",
    "quadratic_drag",
    "rotor_coupling",
    "rotor_inertia",
    "saturation",
    "sensor_offset",
    "sensor_scale",
    "spring",
    "spring_cubic",
    "spring_polynomial",
    "stribeck",
    "torque_offset",
    "turner",
    "viscous",
    "viscous_asymmetric",
];

/// A joint, and the other one of a pair.
pub(super) type Joints = (usize, Option<usize>);

/// All places at which the effect may be hidden in that machine.
pub(super) fn places(id: &str, machine: &Machine) -> Vec<Joints> {
    let free = &machine.free;
    let pairs = || free.iter().flat_map(|&joint| free.iter().map(move |&from| (joint, from))).filter(|(a, b)| a != b);
    let is_pair = match dynid_model::effect(id) {
        Some(effect) => effect.scope == Scope::Pair,
        None => OUTSIDE_PAIRS.contains(&id),
    };
    if dynid_model::effect(id).is_none() {
        let is_possible = machine.device.id != "oscillator" && (id != "gyroscopic" || free.len() > 2);
        return match (is_possible, is_pair) {
            (false, _) => Vec::new(),
            (true, true) => pairs().map(|(joint, from)| (joint, Some(from))).collect(),
            (true, false) => free.iter().map(|&joint| (joint, None)).collect(),
        };
    }
    if is_pair {
        // Where the machine has one, that is hidden: a second one would add up to it.
        let own = |&&(joint, from): &&(usize, usize)| {
            machine.effects.iter().any(|entry| entry.id == id && (entry.joint, entry.from) == (joint, Some(from)))
        };
        let all: Vec<(usize, usize)> = pairs().collect();
        let taken: Vec<(usize, usize)> = all.iter().filter(own).copied().collect();
        let is_other = |(joint, from): &(usize, usize)| {
            let is_symmetric = dynid_model::effect(id).is_some_and(|effect| effect.place != Place::Actuator);
            taken.contains(&(*joint, *from)) || !(is_symmetric && taken.contains(&(*from, *joint)))
        };
        return all.iter().filter(|pair| is_other(pair)).map(|&(joint, from)| (joint, Some(from))).collect();
    }
    free.iter().filter(|&&joint| suits(id, machine, joint)).map(|&joint| (joint, None)).collect()
}

/// Laws outside of the library that need another joint.
const OUTSIDE_PAIRS: [&str; 7] = [
    "speed_product",
    "speed_square_from",
    "gyroscopic",
    "friction_position_from",
    "spring_between",
    "viscous_from",
    "position_product",
];

fn suits(id: &str, machine: &Machine, joint: usize) -> bool {
    let device = machine.device.id.as_str();
    let has_spring = machine.has("spring", joint);
    match id {
        // The gain that a device states is the unit of its commands.
        "gain" => !machine.has("gain", joint),
        // A spring whose rest is open takes up what is constant.
        "torque_offset" | "coulomb_asymmetric" => !has_spring,
        "friction_bias" => has_spring,
        // An angle is only felt against gravity, and only where a link's own angle is known.
        "sensor_offset" => ["planar2r", "servo_pendulum"].contains(&device),
        "sensor_scale" => ["planar2r", "servo_pendulum", "double_pendulum"].contains(&device),
        "joint_elasticity" | "backlash" => machine.drive == Drive::OpenLoop && device != "oscillator",
        "spring" => device != "oscillator",
        // About one axis without gravity a body is a rotor.
        "payload" => match device {
            "planar2r" | "double_pendulum" | "servo_pendulum" => Some(&joint) == machine.free.last(),
            "oscillator" => false,
            _ => machine.free.len() > 1 && Some(&joint) == machine.free.last(),
        },
        _ => true,
    }
}

/// Whether the effect may be hidden in an arm of five joints or more in closed loop.
pub(super) fn fits_an_arm(id: &str) -> bool {
    !["joint_elasticity", "backlash", "friction_bias", "sensor_offset", "sensor_scale"].contains(&id)
}

/// Whether links that are open would take up the effect.
pub(super) fn needs_known_links(id: &str) -> bool {
    ["gain", "payload", "rotor_inertia", "rotor_coupling", "sensor_offset", "sensor_scale"].contains(&id)
}

/// Whether two effects can be hidden at once, each being what the other is not.
pub(super) fn go_together(one: &str, other: &str) -> bool {
    let of = |id: &str| {
        let effect = dynid_model::effect(id);
        let is_friction = id.starts_with("friction") || effect.is_some_and(|effect| effect.family.is_some());
        (effect.map(|effect| effect.place as usize), is_friction)
    };
    of(one) != of(other)
}

/// Products of signals of which a formula for the law must hold one; none where no sum of products says it.
pub(super) fn terms(id: &str, (joint, from): Joints, other: Option<usize>) -> Vec<String> {
    debug_assert!(outside::IDS.contains(&id), "only laws outside of the library are discovered");
    let j = joint;
    let f = from.unwrap_or(joint);
    let o = other.unwrap_or(joint);
    match id {
        "viscous_position" => vec![format!("sin(q{j})*dq{j}"), format!("cos(q{j})*dq{j}"), format!("q{j}*dq{j}")],
        "speed_product" => vec![format!("dq{j}*dq{f}")],
        "speed_square_from" => vec![format!("dq{f}*dq{f}")],
        "gyroscopic" => vec![format!("dq{f}*dq{o}")],
        "gain_ripple" => vec![format!("tau{j}*sin(q{j})"), format!("tau{j}*cos(q{j})"), format!("tau{j}*q{j}")],
        "command_cubic" => vec![format!("tau{j}*tau{j}*tau{j}")],
        "friction_position_from" => vec![format!("q{f}*sign(dq{j})")],
        "spring_between" => vec![format!("q{f}")],
        "command_position" => vec![format!("tau{j}*q{j}")],
        "stiffness_growth" => vec![format!("q{j}*t")],
        "viscous_from" => vec![format!("dq{f}")],
        "position_product" => vec![format!("q{j}*q{f}")],
        "gain_droop" => vec![format!("tau{j}*t")],
        _ => Vec::new(),
    }
}
