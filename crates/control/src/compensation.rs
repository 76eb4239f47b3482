//! Torques that carry the device, so that the hand does not have to.
//!
//! `torque = phi + s + a (D ddq + C dq) + f (load - s)`, and the commands that make it by the inverse of the drive path.
//! phi is gravity, `load` the sum of the joint effects along the motion, s what they are at rest without memory (springs),
//! a the share of the inertia and f that of the friction. Coriolis torques go with the inertia: what is left to feel is
//! then `(1 - a) (D ddq + C dq)`, a lighter body of the same kind, whose energy a motion neither makes nor takes.
//!
//! # Friction at rest
//!
//! Friction is largest where its speed is known least. Three things keep its compensation still:
//! - memory is kept, not replaced by the sign of a noisy speed: the states of the effects (LuGre's bristles) are integrated
//!   along with the estimated motion, as in the friction observer of Canudas de Wit, Olsson, Astrom & Lischinsky 1995.
//!   Before the contact slides their torque depends on travel, not on speed;
//! - each tick integrates `dz/dt = r(z)` over its sample by the exponential Euler step `z + T phi_1(T r') r`,
//!   `phi_1(x) = (e^x - 1) / x` (Hochbruck & Ostermann 2010). For LuGre, which is linear in z, that is exact while the speed
//!   is held, and no stiffness of bristles makes it unstable;
//! - what a resting encoder flickers is no motion ([`super::Estimator`]), and only a share of the friction is taken: the
//!   device keeps some of its own. More than it has would be a drive, and limit cycles (Canudas de Wit, Noel, Aubin &
//!   Brogliato 1991). The share that is left is also how far the model's friction may be off.
//!
//! # How much inertia
//!
//! With an acceleration `H(s) s^2 q` of the sampled motion the hand feels `Z = J s (1 - a H)`. H must fall off, for
//! encoders have counts; so it has `Im H < 0` somewhere, and there the device gives energy: the real part of Z is
//! `a J omega Im H`. That cannot be had otherwise: H is causal and `H(0) = 1`, so
//! `integral of Im H / omega over all omega > 0 = -pi / 2` (Kramers-Kronig), whatever the filter; only where the debt is
//! paid can be chosen. At `a = 1` the loop is unstable in any hand and in none; the free device bears about 0.9, a device in
//! a hand as much as the hand damps ([`largest_inertia_share`](super::largest_inertia_share) says it for a given hand), and
//! the finer the encoder the higher the frequency to which the debt can be moved. For 0.045 kg m^2 at 1 kHz with a delay
//! of one sample, in a hand of 0.03 kg m^2 with a grip of 40 N m/rad and 0.1 N m s/rad and an arm of 4 and 0.8, and in
//! hands that differ from it by a factor 1.5 either way:
//!
//! | poles | noise of counts of 1e-4 rad | this hand bears | the worst hand bears |
//! | --- | --- | --- | --- |
//! | 20 Hz | 0.3 rad/s^2 | 0.40 | 0.24 |
//! | 40 Hz | 1.6 rad/s^2 | 0.55 | 0.40 |
//! | 80 Hz | 9 rad/s^2 (1e-5 rad: 0.9) | 0.72 | 0.60 |
//!
//! So with counts of 1e-4 rad a device of this size cannot be made half as heavy in every hand; with counts of 1e-5 it can.

use dynid_dynamics::{system::InverseError, system::Scratch, system::System};

/// How much of the device is carried, from 0 to 1. Gravity and springs are always carried whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompensationRatios {
    /// Of inertia and Coriolis torques.
    pub inertia: f64,
    /// Of friction: what joint effects do beyond what they do at rest.
    pub friction: f64,
}

impl CompensationRatios {
    /// Gravity and springs alone.
    pub const WEIGHT: Self = Self { inertia: 0.0, friction: 0.0 };
}

impl Default for CompensationRatios {
    /// Leaves the hand less than half of the inertia and a fifth of the friction.
    fn default() -> Self {
        Self { inertia: 0.6, friction: 0.8 }
    }
}

/// Why a model cannot be carried.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CompensationError {
    /// A share that is none.
    #[error("the share of the {of} is {value}; give a number from 0 (none of it) to 1 (all of it)")]
    Share {
        /// Inertia or friction.
        of: &'static str,
        /// As given.
        value: f64,
    },
    /// A time between ticks that is none.
    #[error("the time between two ticks is {value} s; give a positive number")]
    Sample {
        /// As given.
        value: f64,
    },
    /// Drives or sensors that cannot be inverted.
    #[error(transparent)]
    Inverse(#[from] InverseError),
}

/// The identified model at work in a controller.
#[derive(Debug, Clone)]
pub struct Compensation {
    system: System,
    shares: CompensationRatios,
    sample_s: f64,
    /// Commands per torque, n_free x n_free.
    inverse_drive: Vec<f64>,
    drive_offset: Vec<f64>,
    /// Slope and offset of each free joint's sensor.
    sensors: Vec<(f64, f64)>,
    ticks: u64,
    /// `[q, dq, z]`, the same before the first tick, and the same at rest without memory.
    x: Vec<f64>,
    initial: Vec<f64>,
    at_rest: Vec<f64>,
    /// Room for a state beside `x`.
    aside: Vec<f64>,
    rates: Vec<f64>,
    rate_slopes: Vec<f64>,
    ddq: Vec<f64>,
    scratch: Scratch,
    load: Vec<f64>,
    gravity: Vec<f64>,
    rigid: Vec<f64>,
    torque: Vec<f64>,
    /// Of all joints, of this tick.
    command: Vec<f64>,
}

impl Compensation {
    /// Makes `system` ready to be carried in ticks of `sample_s`.
    ///
    /// # Errors
    /// A share or sample time out of range; a drive path or sensor that cannot be inverted.
    pub fn new(system: System, shares: CompensationRatios, sample_s: f64) -> Result<Self, CompensationError> {
        for (of, value) in [("inertia", shares.inertia), ("friction", shares.friction)] {
            if !(0.0..=1.0).contains(&value) {
                return Err(CompensationError::Share { of, value });
            }
        }
        if !(sample_s > 0.0 && sample_s.is_finite()) {
            return Err(CompensationError::Sample { value: sample_s });
        }
        let n = system.n_free();
        let inverse_drive = system.inverse_drive()?;
        let sensors = system.sensor_map()?;
        let room = vec![0.0; n];
        let x = system.rest(&room);
        Ok(Self {
            shares,
            sample_s,
            inverse_drive,
            drive_offset: system.drive_map().offset,
            sensors,
            ticks: 0,
            at_rest: vec![0.0; x.len()],
            aside: vec![0.0; x.len()],
            rates: vec![0.0; x.len()],
            rate_slopes: vec![0.0; x.len()],
            ddq: room.clone(),
            scratch: system.scratch(),
            load: room.clone(),
            gravity: room.clone(),
            rigid: room.clone(),
            torque: room.clone(),
            command: vec![0.0; system.n_joints()],
            initial: x.clone(),
            x,
            system,
        })
    }

    /// The system that is carried.
    pub fn system(&self) -> &System {
        &self.system
    }

    /// How much of the device is carried.
    pub fn shares(&self) -> CompensationRatios {
        self.shares
    }

    /// Forgets all memory of the effects, as before the first tick.
    pub fn restart(&mut self) {
        self.ticks = 0;
        self.x.copy_from_slice(&self.initial);
        self.command.fill(0.0);
    }

    /// The commands of all joints of the device (0 for those that are not free) that carry it at positions `q`, speeds `dq`
    /// and accelerations `ddq` of the free joints, as their sensors show them. A tick with anything in it that is no number
    /// commands nothing and leaves the memory of the effects as it was.
    pub fn tick(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> &[f64] {
        self.command_torques(q, dq, ddq);
        &self.command
    }

    /// Torques at the free joints that the last tick asked for.
    pub fn torques(&self) -> &[f64] {
        &self.torque
    }

    fn command_torques(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) {
        let n = self.system.n_free();
        let known = [q, dq, ddq].iter().all(|own| own.len() == n && own.iter().all(|value| value.is_finite()));
        if !known {
            return self.command.fill(0.0);
        }
        for (slot, &(slope, offset)) in self.sensors.iter().enumerate() {
            self.x[slot] = slope * q[slot] + offset;
            self.x[n + slot] = slope * dq[slot];
            self.ddq[slot] = slope * ddq[slot];
        }
        if self.ticks == 0 {
            for &(state, slot) in self.system.states_at_speed() {
                self.x[state] = self.x[n + slot];
            }
        }
        let t = self.ticks as f64 * self.sample_s;
        self.ticks += 1;
        self.wanted(t);
        if !self.torque.iter().all(|torque| torque.is_finite()) {
            return self.command.fill(0.0);
        }
        self.remember();
        for (slot, &joint) in self.system.kernel().free.iter().enumerate() {
            let row = &self.inverse_drive[slot * n..(slot + 1) * n];
            let needed = self.torque.iter().zip(&self.drive_offset).map(|(torque, offset)| torque - offset);
            self.command[joint] = row.iter().zip(needed).map(|(per_torque, torque)| per_torque * torque).sum();
        }
        if !self.command.iter().all(|command| command.is_finite()) {
            self.command.fill(0.0);
        }
    }

    /// Fills `torque` for the motion in `x` and `ddq`, and the rates of the effects' states with their slopes.
    fn wanted(&mut self, t: f64) {
        let Self { system, x, aside, at_rest, ddq, scratch, load, gravity, rigid, command, rates, rate_slopes, .. } =
            self;
        let n = system.n_free();
        // Friction that grows with the drive's torque reads that of the last tick.
        system.effects_alone(scratch, t, x, command, rates);
        load.copy_from_slice(&scratch.load);
        // The rates are linear in the states, or nearly: every state is moved a little, each changes its own rate only.
        aside.copy_from_slice(x);
        aside[2 * n..].iter_mut().for_each(|state| *state += ASIDE);
        system.loads(scratch, t, aside, rate_slopes);
        for (slope, rate) in rate_slopes[2 * n..].iter_mut().zip(&rates[2 * n..]) {
            *slope = (*slope - rate) / ASIDE;
        }
        at_rest[..n].copy_from_slice(&x[..n]);
        system.loads(scratch, t, at_rest, aside);
        let kernel = system.kernel();
        let (q, dq) = (&x[..n], &x[n..2 * n]);
        kernel.functions.gravity(system.prepared(), q, gravity);
        kernel.functions.inverse_dynamics(system.prepared(), q, dq, ddq, rigid);
        system.add_inertia_torque(ddq, rigid);
        for slot in 0..n {
            let at_rest = scratch.load[slot];
            self.torque[slot] = gravity[slot]
                + at_rest
                + self.shares.inertia * (rigid[slot] - gravity[slot])
                + self.shares.friction * (load[slot] - at_rest);
        }
    }

    /// Takes the states of the effects over one sample at the speeds of this tick.
    fn remember(&mut self) {
        let first = 2 * self.system.n_free();
        let rates = self.rates.iter().zip(&self.rate_slopes);
        for (state, (rate, slope)) in self.x.iter_mut().zip(rates).skip(first) {
            let next = *state + self.sample_s * phi_1(self.sample_s * slope) * rate;
            if next.is_finite() {
                *state = next;
            }
        }
    }
}

/// How far states are moved to see how their rates change: a numerical choice. For rates that are linear in their state it
/// only sets the rounding, 1e-10 of the rate.
const ASIDE: f64 = 1e-6;

/// `(e^x - 1) / x`. A state that runs away by itself is held to the rate of growth at `x = 1`.
fn phi_1(x: f64) -> f64 {
    /// Below this the series is as exact as the quotient, which loses digits.
    const SMALL: f64 = 1e-3;
    let x = x.min(1.0);
    if x.abs() < SMALL {
        1.0 + x * (0.5 + x / 6.0 * (1.0 + 0.25 * x))
    } else {
        (dynid_generated::Scalar::exp(x) - 1.0) / x
    }
}

#[cfg(test)]
mod tests;
