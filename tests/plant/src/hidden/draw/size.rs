//! How large a hidden effect is: a share of what the machine does without it.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use dynid_model::{Link, Origin};

use super::dice::Dice;
use super::instrument::Drive;
use super::machine::Machine;
use super::place::Joints;
use crate::effects::EffectEntry;
use crate::hidden::rounded;
use crate::recipe::{Plant, RunEntry};

/// What a joint does while the machine is logged.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    /// Command, about its mean (rms).
    pub(super) command: f64,
    /// Largest command.
    peak: f64,
    /// Torque of the motor per command.
    gain: f64,
    /// Speed (rms).
    speed: f64,
    half_range: f64,
    middle: f64,
    /// kg m^2 or kg
    inertia: f64,
}

impl Motion {
    /// Torque of the motor, about its mean (rms).
    fn torque(&self) -> f64 {
        self.gain * self.command
    }

    /// Speed that is hardly ever reached.
    pub(super) fn fastest(&self) -> f64 {
        5.0 * self.speed
    }

    /// Whether it moves far more than its noise, and not much farther than it is meant to.
    pub(super) fn moves(&self, noise_floor: f64, stroke: f64) -> bool {
        self.half_range > 15.0 * noise_floor && self.half_range < 8.0 * stroke && self.command > 0.0
    }

    fn farthest(&self) -> f64 {
        self.middle.abs() + self.half_range
    }
}

/// Of all free joints, by joint.
pub(super) type Motions = BTreeMap<usize, Motion>;

/// Plays a run of the machine as it is and measures what its joints do.
pub(super) fn measure(plant: &Plant<'_>, run: &RunEntry, machine: &Machine, sample_s: f64) -> Result<Motions, String> {
    let trace = plant.play(run)?;
    let inertia = plant.inertia_at_start(&run.free);
    let n = trace.seen.len() as f64;
    let rms = |values: &mut dyn Iterator<Item = f64>| (values.map(|value| value * value).sum::<f64>() / n).sqrt();
    let motion = |(slot, &joint): (usize, &usize)| {
        let mean = trace.commands.iter().map(|row| row[joint]).sum::<f64>() / n;
        let (lowest, highest) = (trace.seen.iter().map(|row| row[slot]))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(q), high.max(q)));
        let gain = machine.effects.iter().find(|entry| entry.id == "gain" && entry.joint == joint);
        let motion = Motion {
            command: rms(&mut trace.commands.iter().map(|row| row[joint] - mean)),
            peak: trace.commands.iter().map(|row| row[joint].abs()).fold(0.0, f64::max),
            gain: gain.map_or(1.0, |gain| gain.values["Kp"]),
            speed: rms(&mut trace.seen.windows(2).map(|rows| (rows[1][slot] - rows[0][slot]) / sample_s)),
            half_range: 0.5 * (highest - lowest),
            middle: 0.5 * (highest + lowest),
            inertia: inertia[slot],
        };
        (joint, motion)
    };
    Ok(run.free.iter().enumerate().map(motion).collect())
}

/// The effect with values: those of the device's own where it has one there, else drawn.
pub(super) fn sized(
    id: &str,
    (joint, from): Joints,
    machine: &Machine,
    motions: &Motions,
    duration_s: f64,
    dice: &mut Dice,
) -> EffectEntry {
    let own = |entry: &&EffectEntry| (entry.id.as_str(), entry.joint, entry.from) == (id, joint, from);
    if let Some(own) = machine.effects.iter().find(own)
        && !["viscous", "coulomb"].contains(&id)
    {
        return own.clone();
    }
    let other = from.map_or(&motions[&joint], |from| &motions[&from]);
    let draw = Draw { own: &motions[&joint], other, machine, joint, from, duration_s };
    let drawn =
        if dynid_model::effect(id).is_some() { draw.library(id, dice) } else { draw.outside(id, motions, dice) };
    let mut values: BTreeMap<String, f64> =
        drawn.into_iter().map(|(symbol, value)| (symbol.to_owned(), rounded(value))).collect();
    for parameter in dynid_model::effect(id).map(|effect| effect.parameters.as_slice()).unwrap_or_default() {
        if parameter.origin == Origin::Numerical {
            values.entry(parameter.symbol.clone()).or_insert(parameter.initial);
        }
    }
    EffectEntry { id: id.to_owned(), joint, from, values }
}

struct Draw<'a> {
    own: &'a Motion,
    other: &'a Motion,
    machine: &'a Machine,
    joint: usize,
    from: Option<usize>,
    duration_s: f64,
}

type Values = Vec<(&'static str, f64)>;

impl Draw<'_> {
    fn library(&self, id: &str, dice: &mut Dice) -> Values {
        let Self { own, other, duration_s, .. } = *self;
        let (torque, speed, range) = (own.torque(), own.speed, own.half_range);
        match id {
            "viscous" => vec![("Fv", torque / speed * dice.log(0.07, 0.4))],
            "coulomb" => vec![("Fc", torque * dice.log(0.07, 0.35))],
            "viscous_asymmetric" => {
                let [forwards, backwards] = uneven(torque / speed * dice.log(0.1, 0.4), dice);
                vec![("Fv_p", forwards), ("Fv_n", backwards)]
            }
            "coulomb_asymmetric" => {
                let [forwards, backwards] = uneven(torque * dice.log(0.1, 0.35), dice);
                vec![("Fc_p", forwards), ("Fc_n", backwards)]
            }
            "stribeck" => {
                let level = torque * dice.log(0.07, 0.25);
                vec![("Fc", level), ("Fs", level * dice.log(1.5, 3.0)), ("vs", speed * dice.log(0.1, 0.5))]
            }
            "lugre" => {
                let level = torque * dice.log(0.07, 0.25);
                let stiffness = level / (range * dice.log(0.01, 0.05));
                vec![
                    ("Fc", level),
                    ("Fs", level * dice.log(1.3, 3.0)),
                    ("vs", speed * dice.log(0.1, 0.5)),
                    ("sigma0", stiffness),
                    ("sigma1", (stiffness * own.inertia).sqrt() * dice.log(0.2, 0.8)),
                    ("sigma2", torque / speed * dice.log(0.05, 0.2)),
                ]
            }
            "turner" => {
                let (level, peak) = (torque * dice.log(0.07, 0.2), speed * dice.log(0.04, 0.12));
                vec![
                    ("Fk", level),
                    ("v1", peak),
                    ("s1", level * dice.log(1.5, 3.0) / peak),
                    ("v4", speed * dice.log(0.4, 1.0)),
                    ("s2", torque / speed * dice.log(0.05, 0.25)),
                ]
            }
            "dahl" => {
                let level = torque * dice.log(0.07, 0.3);
                vec![("Fc", level), ("sigma0", level / (range * dice.log(0.02, 0.15)))]
            }
            "friction_bias" => vec![("bias", if dice.chance(0.6) { dice.log(1.4, 2.5) } else { dice.log(0.3, 0.65) })],
            "friction_load" => vec![("mu", dice.log(0.06, 0.25))],
            "friction_coupled" => vec![
                ("Fv", f64::min(torque / other.speed, other.torque() / speed) * dice.log(0.05, 0.2)),
                ("Fc", torque.min(other.torque()) * dice.log(0.07, 0.25)),
            ],
            // Friction that has warmed up must be left.
            "friction_drift" => {
                vec![("Fd", 0.7 * self.dry_friction() * dice.log(0.4, 1.0)), ("tau", duration_s * dice.log(0.1, 0.4))]
            }
            "quadratic_drag" => vec![("Cd", torque / (speed * speed) * dice.log(0.07, 0.3))],
            "spring" => {
                let rest = own.middle + range * dice.between(-0.5, 0.5);
                vec![("Ks", torque / range * dice.log(0.1, 0.5)), ("qeq", rest)]
            }
            "spring_cubic" => {
                let rest = own.middle + range * dice.between(-0.3, 0.3);
                vec![("K3", torque / range.powi(3) * dice.log(0.15, 0.8)), ("q_mid", rest)]
            }
            "spring_polynomial" => vec![
                ("K2", torque / range.powi(2) * dice.log(0.1, 0.4) * dice.sign()),
                ("K3", torque / range.powi(3) * dice.log(0.1, 0.4) * dice.sign()),
                ("K5", torque / range.powi(5) * dice.log(0.2, 1.0)),
                ("q_mid", own.middle),
            ],
            "hysteresis" => vec![("Kh", torque / range * dice.log(0.1, 0.4)), ("travel", range * dice.log(0.05, 0.3))],
            "cogging" => {
                let (sine, cosine) = dice.between(0.0, TAU).sin_cos();
                let size = torque * dice.log(0.07, 0.3);
                vec![("A", size * cosine), ("B", size * sine), ("period", range * dice.log(0.15, 0.8))]
            }
            "gain" => vec![("Kp", 1.0 + dice.sign() * dice.log(0.12, 0.35))],
            "torque_offset" => vec![("offset", own.command * dice.log(0.1, 0.4) * dice.sign())],
            "input_coupling" => vec![("gain", own.command / other.command * dice.log(0.1, 0.35) * dice.sign())],
            "input_delay" => vec![("delay", self.lateness(dice))],
            "input_lag" => vec![("T", self.lateness(dice))],
            "dead_zone" => vec![("width", own.command * dice.log(0.15, 0.6))],
            "saturation" => vec![("limit", own.peak * dice.between(0.5, 0.85))],
            "joint_elasticity" => {
                let motor = own.inertia * dice.log(0.05, 0.4);
                let shared = motor * own.inertia / (motor + own.inertia);
                let stiffness = shared * (TAU * dice.log(4.0, 15.0)).powi(2);
                let damping = dice.log(0.05, 0.3) * 2.0 * (stiffness * motor).sqrt();
                vec![("compliance", 1.0 / stiffness), ("damping", damping), ("Jm", motor)]
            }
            "backlash" => vec![("gap", range * dice.log(0.03, 0.15)), ("Jm", own.inertia * dice.log(0.02, 0.2))],
            "rotor_inertia" => vec![("Ia", own.inertia * dice.log(0.1, 0.4))],
            "rotor_coupling" => {
                vec![("Ia", (own.inertia * other.inertia).sqrt() * dice.log(0.08, 0.25) * dice.sign())]
            }
            "payload" => self.payload(dice),
            "sensor_offset" => vec![("shift", dice.log(0.03, 0.15) * dice.sign())],
            "sensor_scale" => vec![("scale", dice.log(0.02, 0.1) * dice.sign())],
            other => panic!("no size is known of `{other}`"),
        }
    }

    /// Law that no library has; larger, since a formula has to be found for them.
    fn outside(&self, id: &str, motions: &Motions, dice: &mut Dice) -> Values {
        let Self { own, other, duration_s, .. } = *self;
        let (torque, speed, range) = (own.torque(), own.speed, own.half_range);
        match id {
            "command_cubic" => vec![("k3", dice.log(0.15, 0.5) / own.command.powi(2))],
            "command_root" => vec![("c0", own.command * dice.log(0.6, 1.5))],
            "gain_ripple" => vec![("a", dice.log(0.15, 0.4)), ("k", dice.log(1.0, 3.0) / range)],
            "gain_droop" => vec![("a", dice.log(0.15, 0.35)), ("tau", duration_s * dice.log(0.15, 0.4))],
            "viscous_position" => {
                vec![("F", torque / speed * dice.log(0.15, 0.4)), ("k", dice.log(1.0, 3.0) / range)]
            }
            "speed_product" => vec![("G", torque / (speed * other.speed) * dice.log(0.15, 0.5))],
            "speed_square_from" => vec![("G", torque / other.speed.powi(2) * dice.log(0.15, 0.5))],
            "gyroscopic" => {
                let others: Vec<usize> =
                    motions.keys().copied().filter(|own| *own != self.joint && Some(*own) != self.from).collect();
                let third = *dice.pick(&others);
                let size = torque / (other.speed * motions[&third].speed) * dice.log(0.15, 0.5);
                vec![("G", size), ("other", third as f64)]
            }
            "friction_position_from" => vec![
                ("F", torque / other.half_range * dice.log(0.1, 0.3)),
                // Friction never drives.
                ("q0", other.middle - 1.2 * other.half_range),
                ("v_eps", 0.01),
            ],
            "spring_between" => {
                vec![("K", torque / (range + other.half_range) * dice.log(0.2, 0.6)), ("ratio", 1.0)]
            }
            "resonance" => {
                let body = own.inertia * dice.log(0.1, 0.4);
                let turning = TAU * dice.log(2.0, 6.0);
                let damping = 2.0 * dice.log(0.03, 0.1) * body * turning;
                vec![("J", body), ("K", body * turning * turning), ("d", damping)]
            }
            "torque_wave" => vec![("A", torque * dice.log(0.15, 0.4)), ("hz", dice.log(0.5, 4.0))],
            "command_position" => vec![("C", own.gain * dice.log(0.15, 0.4) / own.farthest())],
            "wandering_detent" => vec![
                ("A", torque * dice.log(0.1, 0.3)),
                ("period", range * dice.log(0.25, 0.7)),
                ("growth", dice.log(0.3, 0.6) / own.farthest()),
            ],
            "stiffness_growth" => {
                vec![("K", torque / (range * duration_s) * dice.log(0.3, 0.8)), ("q0", own.middle)]
            }
            "viscous_from" => vec![("F", torque / other.speed * dice.log(0.15, 0.4))],
            "position_product" => {
                let size = torque / (own.farthest() * other.farthest()) * dice.log(0.2, 0.6);
                vec![("K", size * dice.sign())]
            }
            other => panic!("no size is known of `{other}`"),
        }
    }

    /// In closed loop no later than the controller bears.
    fn lateness(&self, dice: &mut Dice) -> f64 {
        dice.log(4e-3, if self.machine.drive == Drive::ClosedLoop { 0.02 } else { 0.05 })
    }

    /// Of the joint, without what changes while it moves.
    fn dry_friction(&self) -> f64 {
        let level = |entry: &EffectEntry| entry.values.get("Fc").copied();
        let own = self.machine.effects.iter().filter(|entry| entry.joint == self.joint && entry.from.is_none());
        own.filter_map(level).fold(0.0, f64::max)
    }

    /// A body near the centroid of the link that it joins.
    fn payload(&self, dice: &mut Dice) -> Values {
        let device = self.machine.device;
        let link = device.last_link_moved_by(self.joint).unwrap_or_default();
        let value = |symbol: &str| {
            let slot = Link::SYMBOLS.iter().position(|own| *own == symbol).unwrap_or_default();
            let stated = self.machine.parameters.get(&format!("link.{}.{symbol}", link + 1));
            stated.copied().unwrap_or(device.links[link].inertial[slot].value)
        };
        let mut near = |symbol: &str| value(symbol) + 0.04 * dice.between(-1.0, 1.0);
        let (x, y, z) = (near("x"), near("y"), near("z"));
        vec![("m", value("m") * dice.log(0.12, 0.5)), ("x", x), ("y", y), ("z", z)]
    }
}

/// A size each way, one well below the other.
fn uneven(size: f64, dice: &mut Dice) -> [f64; 2] {
    let mut sizes = [size, size * dice.between(0.25, 0.65)];
    dice.shuffle(&mut sizes);
    sizes
}
