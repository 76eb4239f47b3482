//! What a hand feels of a device: how heavy, how sluggish and how stiff, over frequency, bare and carried.
//!
//! A hand moves one joint as `q0 + A sin(omega t)` and holds the others. The torque that it needs for that is known
//! without integrating the motion, `D ddq + h + load - drive`; only the states of effects (bristles, lags) are integrated,
//! in steps much finer than a sample. The device is continuous; its controller ([`dynid_control`]) sees rounded positions
//! at its own rate and what it commands acts a sample later, held.
//!
//! The fundamental of the torque, divided by A, is the dynamic stiffness `K - I omega^2 + j omega b`. Stiffness and inertia
//! are both in phase with the position; what tells them apart is that only one of them grows with frequency. So every
//! frequency is played a little below and a little above: `I = -d Re / d(omega^2)`, `K = Re + I omega^2`, `b = Im / omega`. A
//! dry friction F has `b = 4 F / (pi A omega)`, as its describing function says.

use std::f64::consts::TAU;

use rayon::prelude::*;
use serde::Serialize;

use dynid_control::{Compensation, CompensationError, CompensationRatios, Estimator};
use dynid_dynamics::{
    simulate::control::round_to, system::Linear, system::System, system::SystemError, system::fastest_rate,
};
use dynid_random::Random;
use dynid_user_model::Model;

/// How it is felt.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Options {
    /// Hz, ascending.
    pub frequencies: Vec<f64>,
    /// Of the hand's motion, at every joint [rad or m].
    pub amplitude: f64,
    /// Where all joints of the device stand or move about [rad or m].
    pub pose: Vec<f64>,
    /// Time between two ticks of the controller (s).
    pub sample_s: f64,
    /// Samples after a reading at which its commands begin to act.
    pub delay_samples: usize,
    /// One count of the encoders [rad or m]; 0 for exact ones.
    pub quantum: f64,
    /// Poles of the [`Estimator`] (Hz).
    pub bandwidth_hz: f64,
    /// Share of the inertia that is carried.
    pub inertia_share: f64,
    /// Share of the friction that is carried.
    pub friction_share: f64,
    /// Steps of the integration in half a sample, at least.
    pub substeps: usize,
    /// How many models that are off by their standard errors.
    pub draws: usize,
    /// Of the draws.
    pub seed: u64,
}

impl Options {
    /// Usual ones for a device with `n_joints` joints: 1 kHz, counts of 1e-4, joints at 0.
    pub fn new(n_joints: usize) -> Self {
        let CompensationRatios { inertia, friction } = CompensationRatios::default();
        Self {
            frequencies: vec![0.2, 0.5, 1.0, 2.0, 5.0, 10.0],
            amplitude: 0.2,
            pose: vec![0.0; n_joints],
            sample_s: 1e-3,
            delay_samples: 1,
            quantum: 1e-4,
            bandwidth_hz: 20.0,
            inertia_share: inertia,
            friction_share: friction,
            substeps: 2,
            draws: 4,
            seed: 1,
        }
    }
}

/// What is felt at one frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Impedance {
    /// Hz
    pub frequency_hz: f64,
    /// kg*m^2 or kg
    pub inertia: f64,
    /// All friction, as the damping that would take as much energy [N*m*s/rad or N*s/m].
    pub damping: f64,
    /// N*m/rad or N/m
    pub stiffness: f64,
}

/// One joint, moved alone. Vectors hold one entry a frequency.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointImpedance {
    /// The device's joint index.
    pub joint: usize,
    /// The device by itself.
    pub bare: Vec<Impedance>,
    /// Carried by the model.
    pub carried: Vec<Impedance>,
    /// Carried by models that are off by their standard errors, one after the other.
    pub drawn: Vec<Vec<Impedance>>,
}

impl JointImpedance {
    /// Largest `|felt| / |felt bare|` between two frequencies, of inertia and of damping, carried by the model and, where
    /// there are any, by the worst of the models drawn.
    pub fn worst(&self, from_hz: f64, to_hz: f64) -> Worst {
        let of = |own: &[Impedance], value: fn(&Impedance) -> f64| {
            let pairs = own.iter().zip(&self.bare).filter(|(_, bare)| (from_hz..=to_hz).contains(&bare.frequency_hz));
            pairs.map(|(own, bare)| (value(own) / value(bare)).abs()).fold(0.0, f64::max)
        };
        let both = |own: &[Impedance]| (of(own, |impedance| impedance.inertia), of(own, |impedance| impedance.damping));
        let drawn = self.drawn.iter().map(|own| both(own));
        let worst = drawn.reduce(|worst, own| (worst.0.max(own.0), worst.1.max(own.1)));
        let (inertia, damping) = both(&self.carried);
        Worst { inertia, damping, inertia_drawn: worst.map(|worst| worst.0), damping_drawn: worst.map(|worst| worst.1) }
    }
}

/// What is left of a bare joint, at most.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Worst {
    /// Share of the inertia.
    pub inertia: f64,
    /// Share of the friction.
    pub damping: f64,
    /// Share of the inertia with the worst model drawn.
    pub inertia_drawn: Option<f64>,
    /// Share of the friction with the worst model drawn.
    pub damping_drawn: Option<f64>,
}

/// All free joints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Survey {
    /// How it was felt.
    pub options: Options,
    /// The free joints.
    pub joints: Vec<JointImpedance>,
}

/// Feels `plant` with the joints `free`, bare and carried by `controller_model`, and by models that are off `controller_model` by its standard
/// errors, where a fit stated some.
///
/// # Errors
/// Models without equations for these joints; a share or drive path that [`Compensation::new`] refuses; options out of
/// range.
pub fn survey(
    plant: &Model,
    controller_model: &Model,
    free: &[usize],
    options: &Options,
) -> Result<Survey, ImpedanceError> {
    options.check(plant.device.joints.len())?;
    let system = |model: &Model| model.system(free, |joint| options.pose[joint]);
    let shares = CompensationRatios { inertia: options.inertia_share, friction: options.friction_share };
    let carry = |model: &Model| -> Result<Compensation, ImpedanceError> {
        Ok(Compensation::new(system(model)?, shares, options.sample_s)?)
    };
    let plant = system(plant)?;
    let mut carriers = vec![None, Some(carry(controller_model)?)];
    let has_errors = controller_model.fit.as_ref().is_some_and(|fit| !fit.std_error.is_empty());
    if has_errors {
        let mut random = Random::new(options.seed);
        for _ in 0..options.draws {
            carriers.push(Some(carry(&controller_model.off_by_errors(&mut random))?));
        }
    }
    let n_frequencies = options.frequencies.len();
    let tasks: Vec<(usize, usize, usize)> = (0..free.len())
        .flat_map(|slot| (0..carriers.len()).map(move |carrier| (slot, carrier)))
        .flat_map(|(slot, carrier)| (0..n_frequencies).map(move |frequency| (slot, carrier, frequency)))
        .collect();
    let impedance: Vec<Impedance> = tasks
        .par_iter()
        .map(|&(slot, carrier, frequency)| {
            impedance(&plant, carriers[carrier].as_ref(), options, slot, options.frequencies[frequency])
        })
        .collect();
    let mut rows = impedance.chunks(n_frequencies).map(<[Impedance]>::to_vec);
    let mut next = || rows.next().unwrap_or_default();
    let joints = free
        .iter()
        .map(|&joint| {
            let (bare, carried) = (next(), next());
            JointImpedance { joint, bare, carried, drawn: (2..carriers.len()).map(|_| next()).collect() }
        })
        .collect();
    Ok(Survey { options: options.clone(), joints })
}

/// Why nothing was felt.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImpedanceError {
    /// A model that makes no equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A model that cannot be carried.
    #[error(transparent)]
    Compensation(#[from] CompensationError),
    /// An option out of range.
    #[error("{name} is {found}; {remedy}")]
    Option {
        /// Which one.
        name: &'static str,
        /// As given.
        found: String,
        /// What to do.
        remedy: &'static str,
    },
}

impl Options {
    fn check(&self, n_joints: usize) -> Result<(), ImpedanceError> {
        let wrong = |name, found: String, remedy| Err(ImpedanceError::Option { name, found, remedy });
        let positive = |value: f64| value > 0.0 && value.is_finite();
        if self.pose.len() != n_joints || !self.pose.iter().all(|position| position.is_finite()) {
            return wrong("the pose", format!("{:?}", self.pose), "give one position per joint of the device");
        }
        for (name, value) in [
            ("the amplitude", self.amplitude),
            ("the time between two ticks", self.sample_s),
            ("the estimator's bandwidth", self.bandwidth_hz),
        ] {
            if !positive(value) {
                return wrong(name, value.to_string(), "give a positive number");
            }
        }
        if !(self.quantum >= 0.0 && self.quantum.is_finite()) {
            return wrong(
                "the encoders' count",
                self.quantum.to_string(),
                "give a positive number, or 0 for exact ones",
            );
        }
        // A period needs enough ticks for its sine to be one.
        let fastest = 0.05 / self.sample_s;
        let sound = |frequency: &f64| positive(*frequency) && *frequency <= fastest;
        if self.frequencies.is_empty() || !self.frequencies.iter().all(sound) {
            let remedy = "give positive ones, at most a twentieth of the controller's rate";
            return wrong("the list of frequencies", format!("{:?}", self.frequencies), remedy);
        }
        Ok(())
    }
}

/// What is felt at one joint and frequency.
fn impedance(
    plant: &System,
    carrier: Option<&Compensation>,
    options: &Options,
    slot: usize,
    frequency_hz: f64,
) -> Impedance {
    /// How far off the frequency the two motions are, relative to it.
    const ASIDE: f64 = 0.1;
    let [slower, faster] =
        [1.0 - ASIDE, 1.0 + ASIDE].map(|factor| play(plant, carrier, options, slot, factor * frequency_hz));
    let square = |own: &Response| own.omega * own.omega;
    let inertia = (slower.real - faster.real) / (square(&faster) - square(&slower));
    let both = |own: &dyn Fn(&Response) -> f64| 0.5 * (own(&slower) + own(&faster));
    Impedance {
        frequency_hz,
        inertia,
        damping: both(&|own| own.imaginary / own.omega),
        stiffness: both(&|own| own.real + inertia * square(own)),
    }
}

/// The hand's torque over the joint's position, at one frequency [N*m/rad or N/m].
struct Response {
    /// rad/s
    omega: f64,
    real: f64,
    imaginary: f64,
}

/// Moves one joint and measures the fundamental of the torque that it takes.
fn play(plant: &System, carrier: Option<&Compensation>, options: &Options, slot: usize, frequency_hz: f64) -> Response {
    let n = plant.n_free();
    let period = (1.0 / (frequency_hz * options.sample_s)).round().max(1.0) as usize;
    let omega = TAU / (period as f64 * options.sample_s);
    let ticks_of = |span_s: f64| (span_s / options.sample_s).ceil() as usize;
    // What was before the motion is forgotten in a period, and in a second; then whole periods count, for a second at least.
    let settle = period * ticks_of(1.0).div_ceil(period);
    let measure = period * ticks_of(1.0).div_ceil(period).max(2);
    let motion = Motion {
        centre: plant.kernel().free.iter().map(|&joint| options.pose[joint]).collect(),
        slot,
        amplitude: options.amplitude,
        omega,
    };
    let mut x = plant.rest(&motion.centre);
    motion.at(0.0, n, &mut x);
    for &(state, slot) in plant.states_at_speed() {
        x[state] = x[n + slot];
    }
    let half_steps = half_steps(plant, &motion, options, &mut x);
    let mut hand = Hand::new(plant, x, half_steps);
    let mut controller = carrier.map(|carrier| Controller::new(carrier, options));
    let mut commands = vec![0.0; plant.n_joints() * (settle + measure)];
    let (mut sine, mut cosine) = (0.0, 0.0);
    for k in 0..settle + measure {
        let t = k as f64 * options.sample_s;
        if let Some(controller) = &mut controller {
            let row = &mut commands[k * plant.n_joints()..(k + 1) * plant.n_joints()];
            controller.tick(plant, t, &hand.x, row);
        }
        let torque = hand.sample(plant, &motion, (t, options.sample_s), options, &commands)[slot];
        if k >= settle {
            let (s, c) = (omega * (t + 0.5 * options.sample_s)).sin_cos();
            (sine, cosine) = (sine + torque * s, cosine + torque * c);
        }
    }
    let scale = 2.0 / (measure as f64 * options.amplitude);
    Response { omega, real: scale * sine, imaginary: scale * cosine }
}

/// Steps in half a sample so that the fastest state of an effect is resolved all along the motion.
fn half_steps(plant: &System, motion: &Motion, options: &Options, x: &mut [f64]) -> usize {
    /// A step is at most this share of the fastest state's time constant; Runge-Kutta is stable up to 2.8.
    const STEP_SHARE: f64 = 0.7;
    const PHASES: usize = 32;
    const MOST: usize = 400;
    let n = plant.n_free();
    let mut linear = Linear::new(plant);
    let (command, mut dx) = (vec![0.0; plant.n_joints()], vec![0.0; x.len()]);
    let mut fastest = 0.0_f64;
    for phase in (0..PHASES).rev() {
        let t = phase as f64 / PHASES as f64 * TAU / motion.omega;
        motion.at(t, n, x);
        linear.along(plant, t, x, None, &command, &mut dx);
        fastest = fastest.max(fastest_rate(&linear.rate_by_state, 2 * n));
    }
    ((0.5 * options.sample_s * fastest / STEP_SHARE).ceil() as usize).clamp(options.substeps.max(1), MOST)
}

/// A joint that is moved while the others are held.
struct Motion {
    centre: Vec<f64>,
    slot: usize,
    amplitude: f64,
    omega: f64,
}

impl Motion {
    /// Positions and speeds into `x`; the moved joint's acceleration.
    fn at(&self, t: f64, n: usize, x: &mut [f64]) -> f64 {
        let (sine, cosine) = (self.omega * t).sin_cos();
        x[self.slot] = self.centre[self.slot] + self.amplitude * sine;
        x[n + self.slot] = self.amplitude * self.omega * cosine;
        -self.amplitude * self.omega * self.omega * sine
    }
}

/// The controller of the device: readings in, commands out.
struct Controller {
    compensation: Compensation,
    estimator: Estimator,
    quantum: f64,
    readings: Vec<f64>,
    motion: [Vec<f64>; 3],
}

impl Controller {
    fn new(carrier: &Compensation, options: &Options) -> Self {
        let n = carrier.system().n_free();
        let Options { sample_s, bandwidth_hz, quantum, delay_samples, .. } = *options;
        Self {
            compensation: carrier.clone(),
            estimator: Estimator::new(n, sample_s, bandwidth_hz, quantum, delay_samples),
            quantum,
            readings: vec![0.0; n],
            motion: std::array::from_fn(|_| vec![0.0; n]),
        }
    }

    fn tick(&mut self, plant: &System, t: f64, x: &[f64], command: &mut [f64]) {
        plant.measure(t, x, &mut self.readings);
        self.readings.iter_mut().for_each(|reading| *reading = round_to(*reading, self.quantum));
        let [q, dq, ddq] = &mut self.motion;
        self.estimator.tick(&self.readings, q, dq, ddq);
        command.copy_from_slice(self.compensation.tick(q, dq, ddq));
    }
}

/// The hand that forces the motion, and the effects' states on the way.
struct Hand {
    x: Vec<f64>,
    half_steps: usize,
    scratch: dynid_dynamics::system::Scratch,
    stage: Vec<f64>,
    rate: Vec<f64>,
    sum: Vec<f64>,
    ddq: Vec<f64>,
    arriving: Vec<f64>,
    missing: Vec<f64>,
}

impl Hand {
    fn new(plant: &System, x: Vec<f64>, half_steps: usize) -> Self {
        let room = vec![0.0; x.len()];
        Self {
            scratch: plant.scratch(),
            stage: x.clone(),
            rate: room.clone(),
            sum: room,
            ddq: vec![0.0; plant.n_free()],
            arriving: vec![0.0; plant.n_joints()],
            missing: vec![0.0; plant.n_free()],
            half_steps,
            x,
        }
    }

    /// Goes on for a sample from `start_s`; the hand's torques in its middle.
    fn sample(
        &mut self,
        plant: &System,
        motion: &Motion,
        (start_s, span_s): (f64, f64),
        options: &Options,
        commands: &[f64],
    ) -> &[f64] {
        let n = plant.n_free();
        let half = self.half_steps;
        let step = 0.5 * span_s / half as f64;
        for k in 0..2 * half {
            let t = start_s + k as f64 * step;
            if k == half {
                self.arrive(plant, t, options, commands);
                self.ddq[motion.slot] = motion.at(t, n, &mut self.x);
                let Self { x, scratch, rate, ddq, arriving, missing, .. } = self;
                plant.missing_torque(scratch, t, (x, ddq), arriving, rate, missing);
            }
            self.arrive(plant, t + 0.5 * step, options, commands);
            self.step(plant, motion, t, step);
        }
        motion.at(start_s + span_s, n, &mut self.x);
        &self.missing
    }

    /// One step of the classical Runge-Kutta scheme for the states of the effects.
    fn step(&mut self, plant: &System, motion: &Motion, t: f64, step: f64) {
        let n = plant.n_free();
        let Self { x, scratch, stage, rate, sum, arriving, .. } = self;
        for (share, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            for state in 2 * n..x.len() {
                stage[state] = x[state] + share * step * rate[state];
                if share == 0.0 {
                    stage[state] = x[state];
                    sum[state] = 0.0;
                }
            }
            stage[..2 * n].copy_from_slice(&x[..2 * n]);
            motion.at(t + share * step, n, stage);
            plant.effects_alone(scratch, t + share * step, stage, arriving, rate);
            for state in 2 * n..x.len() {
                sum[state] += weight * rate[state];
            }
        }
        for state in 2 * n..x.len() {
            x[state] += step / 6.0 * sum[state];
        }
    }

    /// The commands that act at `t`: of the sample before, and later where the device's own input is late.
    fn arrive(&mut self, plant: &System, t: f64, options: &Options, commands: &[f64]) {
        let n_joints = plant.n_joints();
        let of = |joint: usize, t: f64| {
            let sample = ((t / options.sample_s + 1e-9).floor() as isize) - options.delay_samples as isize;
            usize::try_from(sample)
                .ok()
                .and_then(|sample| commands.get(sample * n_joints + joint))
                .copied()
                .unwrap_or(0.0)
        };
        for (joint, arriving) in self.arriving.iter_mut().enumerate() {
            *arriving = of(joint, t);
        }
        for delay in plant.delays() {
            self.arriving[delay.joint] = of(delay.joint, t - delay.span_s);
        }
    }
}

#[cfg(test)]
mod tests;
