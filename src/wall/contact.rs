//! One approach: the device and the hand between the controller's ticks, the wall at them.

use super::{
    Approach, Hand, Setting,
    hand::{Plan, Wanted},
};
use crate::{
    control::{FilteredVelocity, Wall},
    model::Model,
    simulate::{self, SimulationError, control::round_to},
    system::{Scratch, System, SystemError},
};

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

/// Why no contact could be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WallError {
    /// The model makes no equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The closed loop leaves all bounds.
    #[error(
        "the closed loop diverges at {time_s:.3} s at joint {joint}: the wall's gains are too high for this sample time (lower \
         them, or sample faster), or the simulation's steps too long (`step_s` of the setting)"
    )]
    Diverged {
        /// When (s).
        time_s: f64,
        /// The device's joint index.
        joint: usize,
    },
    /// The same, of one case among several.
    #[error("wall `{wall}`, {approach} approach, {hand}: {source}")]
    Case {
        /// The wall's name.
        wall: String,
        /// The approach's.
        approach: String,
        /// Which hand, in words.
        hand: String,
        /// What happened.
        source: Box<Self>,
    },
    /// Nothing that is commanded reaches the joint.
    #[error(
        "the model's drive lets no torque pass to joint {joint} at once; take what holds it back (a lag, a delay) out"
    )]
    NoDrive {
        /// The device's joint index.
        joint: usize,
    },
}

impl WallError {
    /// Says in which case the loop diverged; `hand` is its number, or none for the typical one. What else is wrong is so in all
    /// cases.
    #[must_use]
    pub fn in_case(self, wall: &str, approach: &Approach, hand: Option<usize>) -> Self {
        let Self::Diverged { .. } = self else { return self };
        let hand = hand.map_or_else(|| "the typical hand".to_owned(), |hand| format!("hand {hand}"));
        Self::Case { wall: wall.to_owned(), approach: approach.name.clone(), hand, source: Box::new(self) }
    }
}

/// The device of a setting, ready to meet walls.
pub(super) struct Plant {
    pub(super) system: System,
    /// Torque at the joint for one unit commanded.
    gain: f64,
}

impl Plant {
    pub(super) fn new(model: &Model, setting: &Setting) -> Result<Self, WallError> {
        let system = System::of_model(model, &[setting.joint], |joint| setting.posture[joint])?;
        let gain = system.drive_gain(0, setting.torque_limit);
        if !(gain.abs() > f64::MIN_POSITIVE && gain.is_finite()) {
            return Err(WallError::NoDrive { joint: setting.joint });
        }
        Ok(Self { system, gain })
    }

    /// With a drive that delivers so many times what the controller takes it for.
    pub(super) fn delivering(self, factor: f64) -> Self {
        Self { gain: self.gain / factor, ..self }
    }
}

/// Joint, effect states, then the hand: position, velocity, and how much the handle shakes.
struct Integrator<'a> {
    plant: &'a Plant,
    hand: &'a Hand,
    scratch: Scratch,
    x: Vec<f64>,
    rooms: [Vec<f64>; 3],
}

/// Speed of the handle against the hand at which the grip is as tight as it gets [rad/s or m/s], and how fast it follows (s).
const SHAKES: f64 = 0.5;
const GRIP_S: f64 = 0.1;

impl Integrator<'_> {
    /// Rates of everything at `t`, the wall commanding `command` and the arm wanting `wanted`.
    fn rate(
        (plant, hand, scratch): (&Plant, &Hand, &mut Scratch),
        t: f64,
        x: &[f64],
        (command, wanted): (&[f64], Wanted),
        dx: &mut [f64],
    ) {
        let n_states = plant.system.n_states();
        let (device, person) = x.split_at(n_states);
        let (d_device, d_person) = dx.split_at_mut(n_states);
        let [place, speed, shakes] = [person[0], person[1], person[2]];
        let tightness = 1.0 + hand.tightening * (shakes / SHAKES).clamp(0.0, 1.0);
        let slip = device[1] - speed;
        let grip = tightness * (hand.grip_stiffness * (device[0] - place) + hand.grip_damping * slip);
        plant.system.derivative_under(scratch, t, device, command, &[-grip], d_device);
        let arm = hand.arm_stiffness * (wanted.position - place) + hand.arm_damping * (wanted.velocity - speed);
        d_person[0] = speed;
        d_person[1] = (arm + grip - wanted.hold) / hand.inertia;
        d_person[2] = (slip.abs() - shakes) / GRIP_S;
    }

    /// One step of the classical Runge-Kutta scheme.
    fn step(&mut self, t: f64, step: f64, command: &[f64], plan: &Plan, touched: Option<f64>) {
        let Self { plant, hand, scratch, x, rooms: [stage, slope, sum] } = self;
        let mut rate = |t: f64, x: &[f64], dx: &mut [f64]| {
            Self::rate((plant, hand, scratch), t, x, (command, plan.at(t, touched)), dx);
        };
        simulate::runge_kutta(&mut rate, t, step, [x, stage, slope, sum]);
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
    let plan = Plan::new(setting, approach);
    let mut wall = wall.clone();
    let mut velocity = FilteredVelocity::new(setting.filter, setting.sample_s);
    let mut x = plant.system.rest(&[setting.start]);
    x.extend([setting.start, 0.0, 0.0]);
    let rooms = [x.clone(), x.clone(), x.clone()];
    let mut integrator = Integrator { plant, hand, scratch: plant.system.scratch(), x, rooms };
    let mut command = vec![0.0; plant.system.n_joints()];
    let mut underway = std::collections::VecDeque::from(vec![0.0; setting.delay_samples]);
    let substeps = (setting.sample_s / setting.step_s - 1e-9).ceil().max(1.0) as usize;
    // An arm that does not get to the wall in three times the planned time never does.
    let patience = (3.0 * plan.duration_s() / setting.sample_s).ceil() as usize;
    let after = (setting.after_s / setting.sample_s).round() as usize;
    let mut told = Contact {
        sample_s: setting.sample_s,
        position: Vec::new(),
        velocity: Vec::new(),
        torque: Vec::new(),
        touched: None,
    };
    let mut touched_s = None;
    for tick in 0.. {
        let t = tick as f64 * setting.sample_s;
        let (position, speed) = (integrator.x[0], integrator.x[1]);
        let bounds = simulate::Options::default();
        simulate::check_state(&plant.system, t, &integrator.x[..plant.system.n_states()], &bounds).map_err(
            |error| match error {
                SimulationError::Diverged { time_s, joint } => WallError::Diverged { time_s, joint },
                _ => WallError::Diverged { time_s: t, joint: setting.joint },
            },
        )?;
        let mut shown = [0.0];
        plant.system.measure(t, &integrator.x[..plant.system.n_states()], &mut shown);
        let shown = round_to(shown[0], setting.position_quantum);
        underway.push_back(wall.tick(shown, velocity.tick(shown)));
        let torque = underway.pop_front().unwrap_or(0.0);
        if told.touched.is_none() && position < 0.0 {
            told.touched = Some(tick);
        }
        told.position.push(position);
        told.velocity.push(speed);
        told.torque.push(torque);
        if tick >= told.touched.map_or(patience, |touched| touched + after) {
            break;
        }
        command[setting.joint] = torque / plant.gain;
        let step = setting.sample_s / substeps as f64;
        for k in 0..substeps {
            let now = t + k as f64 * step;
            if touched_s.is_none() && integrator.x[0] < 0.0 {
                touched_s = Some(now);
            }
            integrator.step(now, step, &command, &plan, touched_s);
        }
    }
    Ok(told)
}
