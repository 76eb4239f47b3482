//! One approach: the device and the hand between the controller's ticks, the wall at them.

use super::{
    Approach, Hand, Setting, WallError,
    encounter::{Encounter, Held, Tick, refuse_delays},
    hand::{Plan, Wanted},
};
use dynid_control::{FilteredVelocity, Wall};
use dynid_dynamics::system::System;
use dynid_user_model::Model;

/// What happened, tick by tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// Time between two ticks (s).
    pub sample_s: f64,
    /// The joint's true position at every tick [rad or m].
    pub position: Vec<f64>,
    /// Its true velocity [rad/s or m/s].
    pub velocity: Vec<f64>,
    /// The wall's torque at the joint from that tick to the next [N*m or N].
    pub torque: Vec<f64>,
    /// The tick of the first contact; `None` where the hand never came so far.
    pub touched: Option<usize>,
}

/// The device of a setting, ready to meet walls.
pub(super) struct Plant {
    pub(super) system: System,
    /// Torque at the joint for one unit that the controller commands, by the model that the controller has; it knows gains, and
    /// nothing else of the drive.
    pub(super) gain: f64,
}

impl Plant {
    /// As the controller takes it to be.
    ///
    /// # Errors
    /// The model makes no equations, its command arrives late, or its drive lets nothing pass.
    pub(super) fn new(model: &Model, setting: &Setting) -> Result<Self, WallError> {
        Self::taken_for(model, model, setting)
    }

    /// A device that is as `model` says, in the hands of a controller that takes it to be as `controller_model` says.
    ///
    /// # Errors
    /// As [`Plant::new`].
    pub(super) fn taken_for(controller_model: &Model, model: &Model, setting: &Setting) -> Result<Self, WallError> {
        let of = |model: &Model| model.system(&[setting.joint], |joint| setting.posture[joint]);
        let system = of(model)?;
        refuse_delays(&system)?;
        let inverse = of(controller_model)?.inverse_drive().map_err(|_| WallError::NoDrive { joint: setting.joint })?;
        Ok(Self { system, gain: 1.0 / inverse[0] })
    }

    /// With a drive that delivers so many times what the controller takes it for.
    pub(super) fn delivering(self, factor: f64) -> Self {
        Self { gain: self.gain / factor, ..self }
    }
}

/// A hand that holds the joint itself.
struct Joint {
    plan: Plan,
}

impl Held<1> for Joint {
    fn handle(&mut self, x: &[f64]) -> [[f64; 1]; 2] {
        [[x[0]], [x[1]]]
    }

    fn torques(&mut self, _: &[f64], force: [f64; 1], torques: &mut [f64]) {
        torques.copy_from_slice(&force);
    }

    fn wanted(&self, t: f64, touched: Option<f64>) -> Wanted<1> {
        self.plan.at(t, touched)
    }

    fn distance(&self, [position]: [f64; 1]) -> f64 {
        position
    }
}

/// Plays one approach of `hand` against `wall`.
///
/// # Errors
/// [`WallError::Diverged`]; what [`WallError`] says of the model.
pub fn contact(
    model: &Model,
    setting: &Setting,
    wall: &Wall,
    hand: &Hand,
    approach: &Approach,
) -> Result<Contact, WallError> {
    played(&Plant::new(model, setting)?, setting, wall, hand, approach)
}

pub(super) fn played(
    plant: &Plant,
    setting: &Setting,
    wall: &Wall,
    hand: &Hand,
    approach: &Approach,
) -> Result<Contact, WallError> {
    let plan = Plan::new(setting.start, &setting.reaching(), approach);
    let first = vec![0.0; plant.system.n_joints() + 1];
    let mut controller = Controller::new(plant, setting, wall);
    let mut reported = Contact::begun(setting.sample_s);
    let encounter = encounter(plant, setting, hand, &plan, &first);
    reported.touched = encounter.play(
        &mut Joint { plan },
        |shown, answer| controller.answer(shown, answer),
        |tick| reported.take(tick, plant.system.n_joints()),
    )?;
    Ok(reported)
}

/// `first`: commands, then the torque that acts until the controller's first answer arrives.
pub(super) fn encounter<'a>(
    plant: &'a Plant,
    setting: &'a Setting,
    hand: &'a Hand,
    plan: &Plan,
    first: &'a [f64],
) -> Encounter<'a> {
    Encounter {
        system: &plant.system,
        sampling: setting.sampling(),
        hand,
        start: std::slice::from_ref(&setting.start),
        // An arm that does not get to the wall in three times the planned time never does.
        patience_s: 3.0 * plan.duration_s(),
        first,
    }
}

/// A wall at a joint.
pub(super) struct Controller {
    wall: Wall,
    velocity: FilteredVelocity,
    joint: usize,
    gain: f64,
}

impl Controller {
    pub(super) fn new(plant: &Plant, setting: &Setting, wall: &Wall) -> Self {
        let velocity = FilteredVelocity::new(setting.filter, setting.sample_s);
        Self { wall: wall.clone(), velocity, joint: setting.joint, gain: plant.gain }
    }

    /// Commands of all joints, then the torque.
    pub(super) fn answer(&mut self, shown: &[f64], answer: &mut [f64]) {
        let torque = self.wall.tick(shown[0], self.velocity.tick(shown[0]));
        answer[self.joint] = torque / self.gain;
        answer[answer.len() - 1] = torque;
    }
}

impl Contact {
    /// One without a tick yet.
    pub(super) fn begun(sample_s: f64) -> Self {
        Self { sample_s, position: Vec::new(), velocity: Vec::new(), torque: Vec::new(), touched: None }
    }

    /// Another tick of a device with so many joints.
    pub(super) fn take(&mut self, tick: &Tick<'_>, n_joints: usize) {
        self.position.push(tick.device[0]);
        self.velocity.push(tick.device[1]);
        self.torque.push(tick.acting[n_joints]);
    }
}
