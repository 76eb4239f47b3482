//! The plant's own physical effects: what stands between commanded torque and motion.
//!
//! A command passes the [`drive`], then the [`transmission`]; what arrives is the joint's `torque`. Against it stand the
//! friction laws ([`friction`]), whose sum is scaled by `bias` where `q < qeq`, and the other [`load`]s. The [`outside`]
//! effects are in no library: they are there to be found missing by a program that cannot name them.

pub mod drive;
pub mod friction;
pub mod load;
pub mod outside;
pub mod transmission;

use std::collections::BTreeMap;

use dynid_model::{Device, Link};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use drive::Drive;
use friction::Friction;
use load::Load;
use outside::Outside;
use transmission::Transmission;

/// An effect as a recipe writes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectEntry {
    /// Id of the effect, as in the library of effects or one of [`outside::IDS`].
    pub id: String,
    /// Joint that it acts on.
    pub joint: usize,
    /// The other joint of a pair.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<usize>,
    /// Values by symbol; all must be given.
    #[serde(flatten)]
    pub values: BTreeMap<String, f64>,
}

/// What a law sees of the moment.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a> {
    /// The joint that the law is at.
    pub joint: usize,
    /// Positions of all joints.
    pub q: &'a [f64],
    /// Speeds of all joints.
    pub dq: &'a [f64],
    /// Time since the start of the run (s).
    pub time: f64,
    /// Torque that arrives at the joint through drive and transmission.
    pub torque: f64,
    /// What is commanded at all joints, as the log shows it.
    pub commands: &'a [f64],
}

impl Moment<'_> {
    /// Position of the law's joint.
    pub fn position(&self) -> f64 {
        self.q[self.joint]
    }

    /// Speed of the law's joint.
    pub fn speed(&self) -> f64 {
        self.dq[self.joint]
    }
}

/// All effects at one joint.
#[derive(Debug, Clone, Default)]
pub struct JointEffects {
    /// From the command to the motor's torque.
    pub drive: Drive,
    transmissions: Vec<Transmission>,
    frictions: Vec<Friction>,
    bias: Option<f64>,
    gears: Vec<Gear>,
    loads: Vec<Load>,
    outside: Vec<Outside>,
    /// Added to the joint's diagonal entry of D.
    pub rotor_inertia: f64,
    /// (other joint, inertia): added to both off-diagonal entries of D; held at one joint of the pair.
    pub rotor_couplings: Vec<(usize, f64)>,
    /// Bodies that the joint's last link carries.
    pub payloads: Vec<Payload>,
    sensor_scale: f64,
    sensor_offset: f64,
}

/// Friction that grows with the torque which a gear passes on.
#[derive(Debug, Clone, Copy)]
struct Gear {
    mu: f64,
    /// 0: the drive's torque counts; 1: what the gear passes on, after all friction.
    behind: f64,
    /// Inertia of what turns before the gear (kg m^2).
    rotor_inertia: f64,
    /// Time constant of the lag whose state tells the acceleration (s); without one it is not asked for.
    lag: Option<f64>,
    v_eps: f64,
}

impl Gear {
    fn n_states(&self) -> usize {
        usize::from(self.lag.is_some())
    }

    /// The loss, found from what goes in: `passed = arriving - loss`, where with `behind` = 1 the loss is `mu |passed|`.
    /// The state is the speed behind a lag.
    fn torque(&self, drive: f64, friction: f64, speed: f64, states: &[f64], rates: &mut [f64]) -> f64 {
        let acceleration = self.lag.map_or(0.0, |lag| {
            rates[0] = (speed - states[0]) / lag;
            rates[0]
        });
        let arriving = drive - self.behind * friction - self.rotor_inertia * acceleration;
        let direction = (speed / self.v_eps).tanh();
        // A gear that is driven loses of what arrives; one that is held back passes on more than that.
        let share = self.mu * direction.abs() * self.behind;
        let passed = if arriving * direction > 0.0 {
            arriving.abs() / (1.0 + share)
        } else {
            arriving.abs() / (1.0 - share).max(0.1)
        };
        self.mu * passed * direction
    }
}

/// A body that is held by a link, in the link's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// kg
    pub mass: f64,
    /// Of its centroid (m).
    pub centroid: Vector3<f64>,
}

/// The values of an entry, asked for by symbol.
pub(crate) struct Values<'a> {
    entry: &'a EffectEntry,
    place: &'a str,
}

impl Values<'_> {
    pub(crate) fn get(&self, symbol: &str) -> Result<f64, String> {
        self.entry.values.get(symbol).copied().ok_or_else(|| format!("{}: `{symbol}` is missing", self.place))
    }

    pub(crate) fn from(&self) -> Result<usize, String> {
        self.entry.from.ok_or_else(|| format!("{}: `from` is missing", self.place))
    }
}

/// Sorts the entries of a recipe by joint. An unknown effect or a missing value is an error that says so.
pub fn by_joint(entries: &[EffectEntry], n_joints: usize) -> Result<Vec<JointEffects>, String> {
    let mut joints = vec![JointEffects::default(); n_joints];
    for entry in entries {
        let place = format!("effect `{}` at joint {}", entry.id, entry.joint);
        if entry.joint >= n_joints || entry.from.is_some_and(|from| from >= n_joints) {
            return Err(format!("{place}: the device has joints 0..={}", n_joints - 1));
        }
        let values = Values { entry, place: &place };
        let value = |symbol: &str| values.get(symbol);
        if let Some((friction, other)) = Friction::read(&entry.id, &values)? {
            joints[entry.joint].frictions.push(friction);
            if let Some((joint, friction)) = other {
                joints[joint].frictions.push(friction);
            }
            continue;
        }
        if let Some((outside, other)) = Outside::read(&entry.id, entry.joint, &values)? {
            joints[entry.joint].outside.push(outside);
            if let Some((joint, outside)) = other {
                joints[joint].outside.push(outside);
            }
            continue;
        }
        let joint = &mut joints[entry.joint];
        if joint.drive.read(&entry.id, &values)? {
            continue;
        }
        if let Some(load) = Load::read(&entry.id, &values)? {
            joint.loads.push(load);
            continue;
        }
        if let Some(transmission) = Transmission::read(&entry.id, &values)? {
            joint.transmissions.push(transmission);
            continue;
        }
        match entry.id.as_str() {
            "rotor_inertia" => joint.rotor_inertia += value("Ia")?,
            "rotor_coupling" => joint.rotor_couplings.push((values.from()?, value("Ia")?)),
            "friction_bias" => joint.bias = Some(value("bias")?),
            "friction_load" => joint.gears.push(Gear {
                mu: value("mu")?,
                behind: entry.values.get("behind").copied().unwrap_or(0.0),
                rotor_inertia: entry.values.get("Ia").copied().unwrap_or(0.0),
                lag: entry.values.get("T_ddq").copied(),
                v_eps: value("v_eps")?,
            }),
            "payload" => joint
                .payloads
                .push(Payload { mass: value("m")?, centroid: Vector3::new(value("x")?, value("y")?, value("z")?) }),
            "sensor_scale" => joint.sensor_scale += value("scale")?,
            "sensor_offset" => joint.sensor_offset += value("shift")?,
            other => return Err(format!("{place}: the plant knows no effect `{other}`")),
        }
    }
    Ok(joints)
}

impl JointEffects {
    /// Number of states of the laws and of the transmissions; all are zero at the start of a run.
    pub fn n_states(&self) -> usize {
        let laws: usize = self.frictions.iter().map(Friction::n_states).sum();
        let loads: usize = self.loads.iter().map(Load::n_states).sum();
        let outside: usize = self.outside.iter().map(Outside::n_states).sum();
        let gears: usize = self.gears.iter().map(Gear::n_states).sum();
        laws + gears + loads + outside + self.n_transmission_states()
    }

    fn n_transmission_states(&self) -> usize {
        self.transmissions.iter().map(Transmission::n_states).sum()
    }

    /// Torque that moves the joint: what comes of `motor` (the drive's torque) through the transmission, less what
    /// resists. Writes the rates of the states.
    pub fn torque(&self, moment: &Moment<'_>, motor: f64, states: &[f64], rates: &mut [f64]) -> f64 {
        let mut arriving = motor;
        let mut used = 0;
        for transmission in &self.transmissions {
            let range = used..used + transmission.n_states();
            used = range.end;
            arriving = transmission.torque(arriving, moment, &states[range.clone()], &mut rates[range]);
        }
        let moment = Moment { torque: arriving, ..*moment };
        arriving - self.load(&moment, &states[used..], &mut rates[used..])
    }

    /// Torque that resists the motion; writes the rates of the laws' states.
    pub fn load(&self, moment: &Moment<'_>, states: &[f64], rates: &mut [f64]) -> f64 {
        let mut used = 0;
        let mut friction = 0.0;
        for law in &self.frictions {
            let range = used..used + law.n_states();
            used = range.end;
            friction += law.torque(moment, &states[range.clone()], &mut rates[range]);
        }
        let plain = friction;
        let rest = self.rest_position();
        if let Some(bias) = self.bias
            && moment.position() < rest
        {
            friction *= bias;
        }
        let mut load = friction;
        for gear in &self.gears {
            let range = used..used + gear.n_states();
            used = range.end;
            load += gear.torque(moment.torque, plain, moment.speed(), &states[range.clone()], &mut rates[range]);
        }
        for law in &self.loads {
            let range = used..used + law.n_states();
            used = range.end;
            load += law.torque(moment, rest, &states[range.clone()], &mut rates[range]);
        }
        for law in &self.outside {
            let range = used..used + law.n_states();
            used = range.end;
            load += law.torque(moment, &states[range.clone()], &mut rates[range]);
        }
        load
    }

    /// Of the joint's spring; 0 without one.
    fn rest_position(&self) -> f64 {
        self.loads.iter().find_map(Load::rest_position).unwrap_or(0.0)
    }

    /// What the encoder shows of a position.
    pub fn seen(&self, q: f64) -> f64 {
        q + self.sensor_scale * q + self.sensor_offset
    }
}

/// Lets every payload join the last link that its joint moves: masses add, first moments add, and inertias about the
/// common centroid follow from the parallel axis theorem. `values` holds `link.*` by name.
pub fn carry(joints: &[JointEffects], device: &Device, values: &mut BTreeMap<String, f64>) -> Result<(), String> {
    for (joint, effects) in joints.iter().enumerate() {
        for payload in &effects.payloads {
            let link = device.last_link_moved_by(joint).ok_or_else(|| format!("joint {joint} moves no link"))?;
            let name = |symbol: &str| format!("link.{}.{symbol}", link + 1);
            let [m, x, y, z, xx, xy, xz, yy, yz, zz] = Link::SYMBOLS.map(|symbol| values[&name(symbol)]);
            let own = Vector3::new(x, y, z);
            let mass = m + payload.mass;
            let common = (own * m + payload.centroid * payload.mass) / mass;
            let steiner = |mass: f64, arm: Vector3<f64>| {
                (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * mass
            };
            let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
                + steiner(m, own - common)
                + steiner(payload.mass, payload.centroid - common);
            let joined = [
                mass,
                common.x,
                common.y,
                common.z,
                inertia[(0, 0)],
                inertia[(0, 1)],
                inertia[(0, 2)],
                inertia[(1, 1)],
                inertia[(1, 2)],
                inertia[(2, 2)],
            ];
            for (symbol, value) in Link::SYMBOLS.iter().zip(joined) {
                values.insert(name(symbol), value);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
