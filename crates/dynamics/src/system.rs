//! The equations of motion of one configuration, ready to integrate: `D(q) ddq = drive - load - h(q, dq)`.
//!
//! `h = C dq + phi` and `D` come from the configuration's kernel, `drive` is what the drive path makes of the commanded
//! torques (`command -> delay -> dead_zone -> saturation -> lag -> offset -> input_coupling -> gain -> transmission`),
//! `load` is the sum of the joint effects (friction, springs, ..), positive along `dq` when it resists motion.
//! Link effects such as `rotor_inertia` add constants to `D`.
//!
//! The state is `x = [q, dq, z]`: positions and speeds of the free joints in the kernel's order, then the states of the
//! effects. Where an effect sits is resolved once, here, so that a step only walks flat arrays.

mod along;
mod apart;
mod block;
mod body;
mod delay;
mod effects;
mod eight;
mod feedforward;
mod fused;
mod linear;
mod parts;
mod solve;
mod switch;

pub use along::{StateGroup, StateKey};
pub use delay::Delay;
pub use effects::{Output, PlacedEffect, SignalSet};
pub use eight::EightSystems;
pub use feedforward::InverseError;
pub use fused::{Fuse, Fused, Law, Laws, Source};
pub use linear::{Linear, fastest_rate};
pub use parts::Part;
pub use solve::substitute;
pub use switch::Switch;

use std::fmt;

pub use dynid_generated::N_SIGNALS;
use dynid_generated::{EffectKernel, Kernel, Scalar, Signal};
use dynid_signal_chain::{Place, Stage};

use block::{Block, View};
use body::Body;
use fused::Fusion;

/// Stands for "no such index" in the flat arrays.
pub const NONE: usize = usize::MAX;

/// Largest number of outputs of one effect: an inertia and the ten numbers of a body.
const MAX_OUTPUTS: usize = 11;

/// A model at one configuration: kernel, parameter values, effects.
#[derive(Clone)]
pub struct System {
    kernel: &'static Kernel,
    link_parameters: Vec<f64>,
    locked: Vec<f64>,
    prepared: Vec<f64>,
    n_joints: usize,
    n_effect_states: usize,
    effect_names: Vec<String>,
    effect_parameters: Vec<f64>,
    initial_states: Vec<f64>,
    /// States that start at the speed of a free joint: index in `x` and free joint.
    states_at_speed: Vec<(usize, usize)>,
    state_names: Vec<String>,
    /// Joints whose commands arrive late, locked ones too.
    delays: Vec<Delay>,
    actuators: Vec<Element>,
    transmissions: Vec<Element>,
    /// Laws of the `friction` family: their sum at a joint is the signal `friction` of the others.
    frictions: Vec<Element>,
    loads: Vec<Element>,
    /// The same again, as a simulation takes them: side by side where they are of one kind, and the others.
    friction_blocks: (Vec<Block>, Vec<Element>),
    load_blocks: (Vec<Block>, Vec<Element>),
    links: Vec<Element>,
    bodies: Vec<Body>,
    /// Derivatives of the lumps by the bodies' parameters: effect parameter and one value a lump.
    lumps_by_parameter: Vec<(usize, Vec<f64>)>,
    sensors: Vec<Element>,
    /// Constants added to D: row, column, value; one entry per element of `links`.
    added_inertia: Vec<(usize, usize, f64)>,
    /// Some effect reads the sum of the frictions.
    friction_is_read: bool,
    /// The drive depends on the commands alone, so it is constant over a held sample.
    steady_drive: bool,
    /// Whether anything reads what the drive delivers: everywhere but where [`System::loads_apart`] has left no effect that does.
    drive_is_read: bool,
    /// The joint effects as one function.
    fusion: Option<Fusion>,
}

/// Why a model and a configuration do not make a system.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// A kernel asks for a parameter that nobody gave.
    #[error("the equations need `{name}`, which the model does not give; add it to the model's values")]
    MissingParameter {
        /// Its name.
        name: String,
    },
    /// No equations for these joints, or no function for an effect.
    #[error("{why}")]
    NoKernel {
        /// What is wrong, and what to do.
        why: String,
    },
    /// The effect exists, but not in a simulation.
    #[error("effect `{id}` cannot be simulated: {why}")]
    Unsupported {
        /// Its id.
        id: String,
        /// The reason.
        why: String,
    },
    /// A vector of the wrong length.
    #[error("{what}: {found} values given, {expected} needed")]
    Length {
        /// Which vector.
        what: &'static str,
        /// How many came.
        found: usize,
        /// How many are needed.
        expected: usize,
    },
}

/// An effect, resolved to indices.
#[derive(Clone)]
pub struct Element {
    /// The law.
    pub kernel: &'static EffectKernel,
    /// First index and number of its parameters in `effect_parameters`.
    pub p: usize,
    /// See `p`.
    pub np: usize,
    /// First index and number of its states in `x`.
    pub z: usize,
    /// See `z`.
    pub nz: usize,
    /// The joint that it acts on.
    pub joint: End,
    /// The other joint of an effect between two.
    pub from: End,
    /// Index in `effect_parameters` of the rest position of the joint's spring.
    pub qeq: usize,
    /// The signals that its law reads.
    pub uses: SignalSet,
    /// Which output is the torque on `joint`, and which the one on `from`.
    pub torque: usize,
    /// See `torque`.
    pub torque_from: usize,
    /// Columns of the kernel's Jacobian that matter here, and the variable each stands for: states come first, effect
    /// parameter `p` is at `n_states + p`.
    pub columns: Vec<(usize, usize)>,
    /// Its formulas read the drive, the commands or the friction of its joint.
    pub reads_torques: bool,
}

impl Element {
    /// Its law, and where it stands: what two systems have in common that differ in values only.
    pub(super) fn place(&self) -> (&'static str, [usize; 7]) {
        let [joint, from] = [self.joint.slot, self.from.slot];
        (self.kernel.id, [self.p, self.z, joint, from, self.qeq, self.torque, self.torque_from])
    }
}

/// A joint as an effect sees it.
#[derive(Clone, Copy)]
pub struct End {
    /// The device's joint index, or [`NONE`].
    pub joint: usize,
    /// Its place among the free joints, or [`NONE`] where it is locked.
    pub slot: usize,
    /// Where it is locked.
    pub angle: f64,
}

impl End {
    fn motion<S: Scalar>(&self, x: &[S], n: usize) -> (S, S) {
        if self.slot == NONE { (S::constant(self.angle), S::constant(0.0)) } else { (x[self.slot], x[n + self.slot]) }
    }
}

/// Room for one evaluation of the equations, so that a step allocates nothing.
#[derive(Debug, Clone)]
pub struct Scratch {
    /// Torque or force that each free joint's drive delivers.
    pub drive: Vec<f64>,
    /// What resists at each free joint: the sum of its effects, friction among them.
    pub load: Vec<f64>,
    /// The friction laws' share of it, which other effects may read.
    pub friction: Vec<f64>,
    /// D, row by row.
    pub inertia: Vec<f64>,
    /// C dq + phi; the right-hand side while the equations are solved.
    pub bias: Vec<f64>,
}

impl System {
    /// Builds the system of `kernel` for a device with `n_joints` joints.
    ///
    /// `link_parameters` are in the order of `kernel.parameters`, `locked` [rad or m] in that of `kernel.locked`.
    /// Effects that touch no free joint are left out. Effects of one place keep the order given; the drive path is
    /// sorted into its fixed order.
    pub fn new(
        kernel: &'static Kernel,
        n_joints: usize,
        link_parameters: Vec<f64>,
        locked: Vec<f64>,
        effects: &[PlacedEffect],
    ) -> Result<Self, SystemError> {
        let lengths = [
            ("parameters of the kernel", link_parameters.len(), kernel.parameters.len()),
            ("positions of locked joints", locked.len(), kernel.locked.len()),
        ];
        for (what, found, expected) in lengths {
            if found != expected {
                return Err(SystemError::Length { what, found, expected });
            }
        }
        let mut system = Self {
            kernel,
            link_parameters,
            locked,
            prepared: vec![0.0; kernel.prepared.len()],
            n_joints,
            n_effect_states: 0,
            effect_names: Vec::new(),
            effect_parameters: Vec::new(),
            initial_states: Vec::new(),
            states_at_speed: Vec::new(),
            state_names: Vec::new(),
            delays: Vec::new(),
            actuators: Vec::new(),
            transmissions: Vec::new(),
            frictions: Vec::new(),
            loads: Vec::new(),
            friction_blocks: (Vec::new(), Vec::new()),
            load_blocks: (Vec::new(), Vec::new()),
            links: Vec::new(),
            bodies: Vec::new(),
            lumps_by_parameter: Vec::new(),
            sensors: Vec::new(),
            added_inertia: Vec::new(),
            friction_is_read: false,
            steady_drive: true,
            drive_is_read: true,
            fusion: None,
        };
        system.arrange(effects)?;
        system.prepare();
        Ok(system)
    }

    /// Number of free joints.
    pub fn n_free(&self) -> usize {
        self.kernel.free.len()
    }

    /// Number of joints of the device, which is the length of a command.
    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// Length of the state `[q, dq, z]`.
    pub fn n_states(&self) -> usize {
        2 * self.n_free() + self.n_effect_states
    }

    /// The kernel.
    pub fn kernel(&self) -> &'static Kernel {
        self.kernel
    }

    /// What the kernel computes from parameters and locked positions.
    pub fn prepared(&self) -> &[f64] {
        &self.prepared
    }

    /// Values of the kernel's parameters, in its order.
    pub fn link_parameters(&self) -> &[f64] {
        &self.link_parameters
    }

    /// Positions of the locked joints, in the kernel's order.
    pub fn locked(&self) -> &[f64] {
        &self.locked
    }

    /// Names of the effects' parameters, e.g. `joint.4.lugre.sigma0`.
    pub fn effect_names(&self) -> &[String] {
        &self.effect_names
    }

    /// Their values.
    pub fn effect_parameters(&self) -> &[f64] {
        &self.effect_parameters
    }

    /// Names of the effects' states, e.g. `joint.4.lugre.z`.
    pub fn state_names(&self) -> &[String] {
        &self.state_names
    }

    /// Replaces all parameter values.
    pub fn set_parameters(&mut self, link_parameters: &[f64], effect_parameters: &[f64]) {
        self.link_parameters.copy_from_slice(link_parameters);
        self.effect_parameters.copy_from_slice(effect_parameters);
        self.prepare();
    }

    /// Starts at `q`, the positions of the free joints: at rest, or with the speeds that follow the positions. Effect states
    /// are at their initial values.
    pub fn rest(&self, q: &[f64]) -> Vec<f64> {
        let n = self.n_free();
        let mut x = vec![0.0; self.n_states()];
        x[..q.len()].copy_from_slice(q);
        x[2 * n..].copy_from_slice(&self.initial_states);
        for &(state, slot) in &self.states_at_speed {
            x[state] = x[n + slot];
        }
        x
    }

    /// States of effects that start at the speed of a free joint: index in the state, and free joint.
    pub fn states_at_speed(&self) -> &[(usize, usize)] {
        &self.states_at_speed
    }

    /// Room for [`System::derivative`].
    pub fn scratch(&self) -> Scratch {
        let n = self.n_free();
        Scratch {
            drive: vec![0.0; n],
            load: vec![0.0; n],
            friction: vec![0.0; n],
            inertia: vec![0.0; n * n],
            bias: vec![0.0; n],
        }
    }

    /// Time derivative `dx` of the state `x` at time `t` (s) under the commanded torques of all joints [N*m or N], as they
    /// arrive after the joints' delays.
    pub fn derivative(&self, scratch: &mut Scratch, t: f64, x: &[f64], command: &[f64], dx: &mut [f64]) {
        self.drive(scratch, t, x, command, dx);
        self.motion(scratch, t, x, dx);
    }

    /// By how much each joint's commanded torque accelerates the free joints at once, at rest at these positions, per unit of it: a row for
    /// each free joint, a column for each joint of the device; 0 for what goes through a state of the drive. `usual` are commands of usual
    /// size, which neither a dead zone nor a limit hides; 1 stands for one that is always 0.
    pub fn accelerations_by_command(&self, position: &[f64], usual: &[f64]) -> Vec<Vec<f64>> {
        let (n, x) = (self.n_free(), self.rest(position));
        let (mut scratch, mut dx) = (self.scratch(), vec![0.0; x.len()]);
        let mut by = vec![vec![0.0; self.n_joints()]; n];
        for (joint, usual) in usual.iter().enumerate() {
            let usual = if *usual == 0.0 { 1.0 } else { usual.abs() };
            for sign in [1.0, -1.0] {
                let mut command = vec![0.0; self.n_joints()];
                command[joint] = sign * usual;
                self.derivative(&mut scratch, 0.0, &x, &command, &mut dx);
                by.iter_mut().zip(&dx[n..]).for_each(|(by, ddq)| by[joint] += sign * ddq / (2.0 * usual));
            }
        }
        by
    }

    /// As [`System::derivative`], with torques [N*m or N] that act on the free joints from outside, e.g. a hand's.
    pub fn derivative_under(
        &self,
        scratch: &mut Scratch,
        t: f64,
        x: &[f64],
        command: &[f64],
        external: &[f64],
        dx: &mut [f64],
    ) {
        self.drive(scratch, t, x, command, dx);
        scratch.drive.iter_mut().zip(external).for_each(|(drive, external)| *drive += external);
        self.motion(scratch, t, x, dx);
    }

    /// True where [`System::drive`] depends on the commands alone.
    pub fn steady_drive(&self) -> bool {
        self.steady_drive
    }

    /// The drive path: fills `scratch.drive` and the rates of its states.
    pub fn drive(&self, scratch: &mut Scratch, t: f64, x: &[f64], command: &[f64], dx: &mut [f64]) {
        for (drive, &joint) in scratch.drive.iter_mut().zip(self.kernel.free) {
            *drive = command[joint];
        }
        let mut outputs = [0.0; MAX_OUTPUTS];
        for element in self.actuators.iter().chain(&self.transmissions) {
            let slot = element.joint.slot;
            let mut signals = self.signals(element, t, x);
            signals[Signal::Load as usize] = scratch.drive[slot];
            signals[Signal::Command as usize] = scratch.drive[slot];
            signals[Signal::CommandFrom as usize] = command.get(element.from.joint).copied().unwrap_or(0.0);
            self.evaluate(element, &signals, x, &mut outputs, dx);
            scratch.drive[slot] = outputs[element.torque];
            if element.torque_from != NONE && element.from.slot != NONE {
                scratch.drive[element.from.slot] += outputs[element.torque_from];
            }
        }
    }

    /// Everything behind the drive path: loads, D, h, and the accelerations that follow from `scratch.drive`.
    pub fn motion(&self, scratch: &mut Scratch, t: f64, x: &[f64], dx: &mut [f64]) {
        let n = self.n_free();
        let (q, rest) = x.split_at(n);
        let dq = &rest[..n];
        self.loads(scratch, t, x, dx);
        let Scratch { drive, load, inertia, bias, .. } = scratch;
        let (dx_q, dx_rest) = dx.split_at_mut(n);
        dx_q.copy_from_slice(dq);
        let ddq = &mut dx_rest[..n];
        if self.added_inertia.is_empty() {
            // Elimination inside the kernel knows which entries of D are zero and overlaps with the rest.
            for (torque, (drive, load)) in bias.iter_mut().zip(drive.iter().zip(&*load)) {
                *torque = drive - load;
            }
            return self.kernel.functions.forward_dynamics(&self.prepared, q, dq, bias, ddq);
        }
        self.kernel.functions.inertia_and_bias(&self.prepared, q, dq, inertia, bias);
        for &(row, column, value) in &self.added_inertia {
            inertia[row * n + column] += value;
        }
        for slot in 0..n {
            ddq[slot] = drive[slot] - load[slot] - bias[slot];
        }
        solve::solve(n, inertia, ddq);
    }

    /// Sums the joint effects, under the drive torques in `scratch.drive`, into `scratch.load` and writes the rates of their
    /// states.
    pub fn loads(&self, scratch: &mut Scratch, t: f64, x: &[f64], dx: &mut [f64]) {
        let Self { friction_blocks, load_blocks, effect_parameters, .. } = self;
        if let Some(fused) = self.fusion.as_ref().and_then(Fusion::made) {
            let rates = &mut dx[2 * self.n_free()..];
            let Scratch { drive, load, friction, .. } = scratch;
            return fused.loads((effect_parameters, x, drive, t), [load, friction], rates);
        }
        let mut outputs = [0.0; MAX_OUTPUTS];
        scratch.load.fill(0.0);
        for block in &friction_blocks.0 {
            let view = View { t, x, drive: &scratch.drive, friction: &scratch.friction, effect_parameters };
            block.evaluate(&view, &mut scratch.load, dx);
        }
        for element in &friction_blocks.1 {
            let mut signals = self.signals(element, t, x);
            signals[Signal::Load as usize] = scratch.drive.get(element.joint.slot).copied().unwrap_or(0.0);
            self.evaluate(element, &signals, x, &mut outputs, dx);
            deliver(element, &outputs, &mut scratch.load);
        }
        if self.loads.is_empty() {
            return;
        }
        if self.friction_is_read {
            scratch.friction.copy_from_slice(&scratch.load);
        }
        for block in &load_blocks.0 {
            let view = View { t, x, drive: &scratch.drive, friction: &scratch.friction, effect_parameters };
            block.evaluate(&view, &mut scratch.load, dx);
        }
        for element in &load_blocks.1 {
            let slot = element.joint.slot;
            let mut signals = self.signals(element, t, x);
            signals[Signal::Load as usize] = scratch.drive.get(slot).copied().unwrap_or(0.0);
            signals[Signal::Friction as usize] = scratch.friction.get(slot).copied().unwrap_or(0.0);
            self.evaluate(element, &signals, x, &mut outputs, dx);
            deliver(element, &outputs, &mut scratch.load);
        }
    }

    /// What the log shows of the positions `q` of the free joints.
    pub fn measure(&self, t: f64, x: &[f64], position: &mut [f64]) {
        position.copy_from_slice(&x[..self.n_free()]);
        let mut outputs = [0.0; MAX_OUTPUTS];
        for element in &self.sensors {
            let mut signals = self.signals(element, t, x);
            signals[Signal::Q as usize] = position[element.joint.slot];
            self.evaluate(element, &signals, x, &mut outputs, &mut []);
            position[element.joint.slot] = outputs[element.torque];
        }
    }

    /// Whether any effect stands between a joint and what its sensor shows.
    pub fn has_sensors(&self) -> bool {
        !self.sensors.is_empty()
    }

    /// All effects.
    fn elements(&self) -> impl Iterator<Item = &Element> {
        let drive = self.actuators.iter().chain(&self.transmissions);
        drive.chain(&self.frictions).chain(&self.loads).chain(&self.links).chain(&self.sensors)
    }

    fn signals<S: Scalar>(&self, element: &Element, t: S, x: &[S]) -> [S; N_SIGNALS] {
        let n = self.n_free();
        let mut signals = [S::constant(0.0); N_SIGNALS];
        let (q, dq) = element.joint.motion(x, n);
        signals[Signal::Q as usize] = q;
        signals[Signal::Dq as usize] = dq;
        signals[Signal::T as usize] = t;
        if element.qeq != NONE {
            signals[Signal::Qeq as usize] = S::constant(self.effect_parameters[element.qeq]);
        }
        if element.from.joint != NONE {
            let (q, dq) = element.from.motion(x, n);
            signals[Signal::QFrom as usize] = q;
            signals[Signal::DqFrom as usize] = dq;
        }
        signals
    }

    fn evaluate(
        &self,
        element: &Element,
        signals: &[f64; N_SIGNALS],
        x: &[f64],
        outputs: &mut [f64; MAX_OUTPUTS],
        dx: &mut [f64],
    ) {
        let parameters = &self.effect_parameters[element.p..element.p + element.np];
        let outputs = &mut outputs[..element.kernel.n_outputs];
        if element.nz == 0 {
            element.kernel.functions.eval(parameters, signals, &[], outputs, &mut []);
        } else {
            let states = element.z..element.z + element.nz;
            element.kernel.functions.eval(parameters, signals, &x[states.clone()], outputs, &mut dx[states]);
        }
    }

    /// Brings everything that depends only on parameters up to date.
    fn prepare(&mut self) {
        self.kernel.functions.prepare(&self.link_parameters, &self.locked, &mut self.prepared);
        let mut outputs = [0.0; MAX_OUTPUTS];
        let Self { friction_blocks, load_blocks, effect_parameters, .. } = self;
        for block in friction_blocks.0.iter_mut().chain(&mut load_blocks.0) {
            block.prepare(effect_parameters);
        }
        self.join_bodies();
        for delay in &mut self.delays {
            delay.prepare(&self.effect_parameters);
        }
        self.added_inertia.clear();
        for element in &self.links {
            let signals = [0.0; N_SIGNALS];
            let parameters = &self.effect_parameters[element.p..element.p + element.np];
            element.kernel.functions.eval(parameters, &signals, &[], &mut outputs[..element.kernel.n_outputs], &mut []);
            let row = element.joint.slot;
            let value = outputs[element.torque];
            if element.from.joint == NONE {
                self.added_inertia.push((row, row, value));
            } else {
                self.added_inertia.push((row, element.from.slot, value));
                self.added_inertia.push((element.from.slot, row, value));
            }
        }
    }
}

/// Adds an element's torques to the joints it acts on.
fn deliver(element: &Element, outputs: &[f64; MAX_OUTPUTS], load: &mut [f64]) {
    if element.joint.slot != NONE {
        load[element.joint.slot] += outputs[element.torque];
    }
    if element.torque_from != NONE && element.from.slot != NONE {
        load[element.from.slot] += outputs[element.torque_from];
    }
}

impl fmt::Debug for System {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter
            .debug_struct("System")
            .field("device", &self.kernel.device)
            .field("free", &self.kernel.free)
            .field("effects", &self.effect_names)
            .finish_non_exhaustive()
    }
}

impl System {
    fn arrange(&mut self, effects: &[PlacedEffect]) -> Result<(), SystemError> {
        let mut sorted: Vec<&PlacedEffect> = effects.iter().collect();
        sorted.sort_by_key(|effect| effect.stage);
        let n = self.n_free();
        for effect in sorted {
            let joint = self.end(effect.joint);
            let from = self.end(effect.from);
            let is_delay = effect.stage == Some(Stage::Delay);
            let is_body = Self::is_body(effect);
            let torques_from = effect.place == Place::Joint && effect.output(Output::TorqueFrom).is_some();
            // A locked joint's load may be another's, its command too; and it may carry a body that others move.
            if joint.slot == NONE && !(is_delay || is_body || (torques_from && from.slot != NONE)) {
                continue;
            }
            effect.check()?;
            let wanted = match effect.place {
                Place::Actuator if is_delay => Output::Delay,
                Place::Actuator | Place::Transmission | Place::Joint => Output::Torque,
                Place::Link => Output::Inertia,
                Place::Sensor => Output::Position,
            };
            let torque = match effect.output(wanted) {
                Some(torque) => torque,
                None if is_body => NONE,
                None => return Err(unsupported(effect, "its outputs are not those of its place")),
            };
            let inertial = effect.place == Place::Link;
            if inertial && !is_body && from.joint != NONE && from.slot == NONE {
                continue; // couples to the acceleration of a joint that stands still
            }
            if inertial && effect.kernel.n_states > 0 {
                return Err(unsupported(effect, "an inertia with states of its own"));
            }
            if (is_delay || effect.place == Place::Sensor) && effect.kernel.n_states > 0 {
                return Err(unsupported(effect, "a sensor or a delay with states of its own"));
            }
            if effect.uses.contains(Signal::Ddq) {
                return Err(unsupported(effect, "its formula needs the acceleration"));
            }
            let element = Element {
                kernel: effect.kernel,
                p: self.effect_parameters.len(),
                np: effect.kernel.n_parameters,
                z: 2 * n + self.n_effect_states,
                nz: effect.kernel.n_states,
                joint,
                from,
                qeq: NONE,
                uses: effect.uses,
                torque,
                torque_from: effect.output(Output::TorqueFrom).unwrap_or(NONE),
                columns: Vec::new(),
                reads_torques: !effect.uses.excludes(&[
                    Signal::Load,
                    Signal::Command,
                    Signal::CommandFrom,
                    Signal::Friction,
                ]),
            };
            self.effect_parameters.extend_from_slice(&effect.parameters);
            self.effect_names.extend_from_slice(&effect.names);
            self.initial_states.extend_from_slice(&effect.initial_states);
            self.state_names.extend_from_slice(&effect.state_names);
            self.n_effect_states += element.nz;
            if joint.slot != NONE {
                let at_speed = effect.states_at_speed.iter().map(|state| (element.z + state, joint.slot));
                self.states_at_speed.extend(at_speed);
            }
            let commands_only = element.nz == 0 && element.uses.only(&[Signal::Command, Signal::CommandFrom]);
            match effect.place {
                Place::Actuator if is_delay => {
                    if self.delays.iter().any(|delay| delay.joint == joint.joint) {
                        return Err(unsupported(effect, "another effect delays the commands of its joint"));
                    }
                    self.steady_drive = false;
                    self.delays.push(Delay::new(joint.joint, element));
                }
                Place::Actuator => {
                    self.steady_drive &= commands_only;
                    self.actuators.push(element);
                }
                Place::Transmission => {
                    self.steady_drive = false;
                    self.transmissions.push(element);
                }
                Place::Joint if effect.is_friction => self.frictions.push(element),
                Place::Joint => self.loads.push(element),
                Place::Link => {
                    self.bodies.extend(Body::new(effect, &element, self.kernel));
                    let couples = from.joint == NONE || from.slot != NONE;
                    if Self::adds_inertia(&element) && couples {
                        self.links.push(element);
                    }
                }
                Place::Sensor => self.sensors.push(element),
            }
        }
        self.connect_springs();
        self.connect_columns();
        self.friction_is_read = self.loads.iter().any(|element| element.uses.contains(Signal::Friction));
        self.friction_blocks = Block::all(&self.frictions, n);
        self.load_blocks = Block::all(&self.loads, n);
        Ok(())
    }

    /// Gives every element the rest position of its joint's spring.
    fn connect_springs(&mut self) {
        let rest: Vec<(usize, usize)> = self
            .loads
            .iter()
            .filter_map(|element| {
                let names = &self.effect_names[element.p..element.p + element.np];
                let qeq = names.iter().position(|name| name.ends_with(".qeq"))?;
                Some((element.joint.joint, element.p + qeq))
            })
            .collect();
        for element in self.frictions.iter_mut().chain(&mut self.loads) {
            if let Some((_, index)) = rest.iter().find(|(joint, _)| *joint == element.joint.joint) {
                element.qeq = *index;
            }
        }
    }

    /// Which columns of an element's Jacobian lead to which variable.
    fn connect_columns(&mut self) {
        let n = self.n_free();
        let n_states = self.n_states();
        let places = [
            &mut self.actuators,
            &mut self.transmissions,
            &mut self.frictions,
            &mut self.loads,
            &mut self.links,
            &mut self.sensors,
        ];
        for element in places.into_iter().flatten() {
            let (slot, from) = (element.joint.slot, element.from.slot);
            let signals = [
                (Signal::Q, slot),
                (Signal::Dq, if slot == NONE { NONE } else { n + slot }),
                (Signal::QFrom, from),
                (Signal::DqFrom, if from == NONE { NONE } else { n + from }),
                (Signal::Qeq, if element.qeq == NONE { NONE } else { n_states + element.qeq }),
            ];
            let parameters = (0..element.np).map(|k| (k, n_states + element.p + k));
            let states = (0..element.nz).map(|k| (element.np + N_SIGNALS + k, element.z + k));
            let read = signals
                .into_iter()
                .filter(|(signal, variable)| element.uses.contains(*signal) && *variable != NONE)
                .map(|(signal, variable)| (element.np + signal as usize, variable));
            element.columns = parameters.chain(read).chain(states).collect();
        }
    }

    fn end(&self, joint: Option<usize>) -> End {
        let Some(joint) = joint else {
            return End { joint: NONE, slot: NONE, angle: 0.0 };
        };
        let slot = self.kernel.free.iter().position(|free| *free == joint).unwrap_or(NONE);
        let locked = self.kernel.locked.iter().position(|locked| *locked == joint);
        End { joint, slot, angle: locked.map_or(0.0, |index| self.locked[index]) }
    }
}

fn unsupported(effect: &PlacedEffect, why: &str) -> SystemError {
    SystemError::Unsupported { id: effect.kernel.id.to_owned(), why: why.to_owned() }
}

// Always: with a feature of the tests, all crates above this one would be compiled twice, for the tests and for the wheel.
#[doc(hidden)]
pub mod fixtures;
#[cfg(test)]
mod tests;
