//! The equations along a given motion, for the torque error: nothing is integrated but the effects' own states.

use dynid_generated::Signal;

use super::{Element, Linear, MAX_OUTPUTS, N_SIGNALS, NONE, Scratch, System};

/// States of effects that depend on each other and on nothing but the motion and the commands.
#[derive(Clone)]
pub struct StateGroup<'a> {
    /// Which, counted from the first state of an effect.
    pub states: Vec<usize>,
    of: Owner<'a>,
}

/// Whose states they are.
#[derive(Clone, Copy)]
enum Owner<'a> {
    /// All effects'.
    All,
    /// The drive path's.
    Drive,
    /// A single effect's, which reads the motion only.
    Element(&'a Element),
}

impl StateGroup<'_> {
    /// Whether the states depend on the commands.
    pub fn reads_commands(&self) -> bool {
        !matches!(self.of, Owner::Element(_))
    }
}

/// What the track of a state that follows a motion by itself depends on, besides the motion: equal keys, equal tracks.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct StateKey {
    effect: &'static str,
    joint: usize,
    from: usize,
    values: Vec<u64>,
}

impl Linear {
    /// Evaluates the equations and their gradient at the state `x = [q, dq, z]` and the given accelerations `ddq`:
    /// drive and load torques, the regressor, `torque_by_parameter`, `torque_by_state` (that of the effects only), and
    /// the rates of the effects' states (in `dx`) with their gradients. `ddq = None` leaves the rigid body out.
    pub fn along(&mut self, system: &System, t: f64, x: &[f64], ddq: Option<&[f64]>, command: &[f64], dx: &mut [f64]) {
        self.renew_drive();
        self.effects(system, t, x, command, dx);
        let Some(ddq) = ddq else { return };
        let n = system.n_free();
        if system.kernel.n_lumps > 0 {
            let (q, dq) = (&x[..n], &x[n..2 * n]);
            system.kernel.functions.regressor(&system.prepared, q, dq, ddq, &mut self.regressor);
        }
        self.inertias(system, ddq);
    }

    /// The rates of a group's states (in `dx`) and their gradients alone. Leaves the load as it was, unless the group is that of
    /// all effects.
    pub fn follow(
        &mut self,
        system: &System,
        group: &StateGroup<'_>,
        t: f64,
        x: &[f64],
        command: &[f64],
        dx: &mut [f64],
    ) {
        self.rate_by_state.clear();
        self.rate_by_parameter.clear();
        match group.of {
            Owner::All => self.along(system, t, x, None, command, dx),
            Owner::Drive => self.drive_path(system, t, x, command, dx),
            Owner::Element(element) => {
                let signals = system.signals(element, t, x);
                self.evaluate(system, element, &signals, x, dx);
                self.rates(system, element);
            }
        }
    }

    /// Torque that the drive path delivers to each free joint, at the last [`Linear::along`].
    pub fn drive(&self) -> &[f64] {
        &self.drive
    }

    /// Torque of the joint effects on each free joint, positive along `dq` when it resists, at the last
    /// [`Linear::along`].
    pub fn load(&self) -> &[f64] {
        &self.load
    }
}

impl System {
    /// Adds to `torque` what the link effects need for the accelerations `ddq`.
    pub fn add_inertia_torque(&self, ddq: &[f64], torque: &mut [f64]) {
        for &(row, column, value) in &self.added_inertia {
            torque[row] += value * ddq[column];
        }
    }

    /// Whether the states of all joint effects follow positions, speeds and time only, each effect's by itself.
    pub fn states_follow_motion(&self) -> bool {
        const MOTION: [Signal; 6] = [Signal::Q, Signal::Dq, Signal::T, Signal::Qeq, Signal::QFrom, Signal::DqFrom];
        let mut joint = self.frictions.iter().chain(&self.loads);
        joint.all(|element| element.nz == 0 || element.uses.only(&MOTION))
    }

    /// The states of the effects, parted into as many groups as do not depend on each other.
    pub fn state_groups(&self) -> Vec<StateGroup<'_>> {
        if !self.states_follow_motion() {
            return vec![StateGroup { states: (0..self.n_effect_states).collect(), of: Owner::All }];
        }
        let first = 2 * self.n_free();
        let states = |element: &Element| element.z - first..element.z - first + element.nz;
        let mut groups = Vec::new();
        if self.drive_has_states() {
            let drive = self.actuators.iter().chain(&self.transmissions).filter(|element| element.nz > 0);
            groups.push(StateGroup { states: drive.flat_map(states).collect(), of: Owner::Drive });
        }
        let joint = self.frictions.iter().chain(&self.loads).filter(|element| element.nz > 0);
        groups
            .extend(joint.map(|element| StateGroup { states: states(element).collect(), of: Owner::Element(element) }));
        groups
    }

    /// What a group's states depend on besides the motion; `None` where that is more than a single effect.
    pub fn state_key(&self, group: &StateGroup<'_>) -> Option<StateKey> {
        let Owner::Element(element) = group.of else { return None };
        let own = &self.effect_parameters[element.p..element.p + element.np];
        let rest = (element.qeq != NONE).then(|| self.effect_parameters[element.qeq]);
        let initial = group.states.iter().map(|state| self.initial_states[*state]);
        let locked = [element.joint.angle, element.from.angle];
        let values = own.iter().copied().chain(rest).chain(initial).chain(locked).map(f64::to_bits).collect();
        Some(StateKey { effect: element.kernel.id, joint: element.joint.joint, from: element.from.joint, values })
    }

    /// The rates of a group's states (in `dx`) alone.
    pub fn follow(
        &self,
        group: &StateGroup<'_>,
        scratch: &mut Scratch,
        t: f64,
        x: &[f64],
        command: &[f64],
        dx: &mut [f64],
    ) {
        match group.of {
            Owner::All => {
                self.drive(scratch, t, x, command, dx);
                self.loads(scratch, t, x, dx);
            }
            Owner::Drive => self.drive(scratch, t, x, command, dx),
            Owner::Element(element) => {
                let signals = self.signals(element, t, x);
                self.evaluate(element, &signals, x, &mut [0.0; MAX_OUTPUTS], dx);
            }
        }
    }

    /// Whether the drive path remembers anything.
    pub fn drive_has_states(&self) -> bool {
        self.actuators.iter().chain(&self.transmissions).any(|element| element.nz > 0)
    }

    /// For each state of the effects, which effect parameters it may depend on.
    pub fn state_parameters(&self) -> Vec<Vec<usize>> {
        if !self.states_follow_motion() {
            return vec![(0..self.effect_parameters.len()).collect(); self.n_effect_states];
        }
        let first = 2 * self.n_free();
        let mut parameters = vec![Vec::new(); self.n_effect_states];
        // What enters the drive path anywhere may reach all of its states; they have one list, in one order.
        let drive = || self.actuators.iter().chain(&self.transmissions);
        let delays = self.delays.iter().flat_map(|delay| delay.by_parameter.iter().map(|(parameter, _)| *parameter));
        let entering: Vec<usize> =
            delays.chain(drive().flat_map(|element| element.p..element.p + element.np)).collect();
        for state in drive().flat_map(|element| element.z..element.z + element.nz) {
            parameters[state - first].clone_from(&entering);
        }
        for element in self.frictions.iter().chain(&self.loads) {
            for state in element.z..element.z + element.nz {
                let own = &mut parameters[state - first];
                own.extend(element.p..element.p + element.np);
                own.extend((element.qeq != NONE).then_some(element.qeq));
            }
        }
        parameters
    }

    /// Parameters of the joint effects that read the drive's torque.
    pub fn readers_of_load(&self) -> Vec<usize> {
        let joint = self.frictions.iter().chain(&self.loads);
        let readers = joint.filter(|element| element.uses.contains(Signal::Load));
        readers.flat_map(|element| element.p..element.p + element.np).collect()
    }

    /// Number of states of the effects.
    pub fn n_effect_states(&self) -> usize {
        self.n_effect_states
    }

    /// How much torque at each free joint a unit of its command makes: the product of the slopes of those actuator
    /// stages that are linear in the command over the commands of typical size `typical` (one per free joint). With
    /// the slopes come their derivatives: free joint, effect parameter, value.
    pub fn drive_slope(&self, typical: &[f64]) -> (Vec<f64>, Vec<(usize, usize, f64)>) {
        let mut slopes = vec![1.0; self.n_free()];
        let mut relative = Vec::new();
        let mut linear = Linear::new(self);
        let mut probe = self.clone();
        let mut dx = vec![0.0; self.n_states()];
        for element in &self.actuators {
            let slot = element.joint.slot;
            let size = if typical[slot] > 0.0 { typical[slot] } else { 1.0 };
            let x = self.rest(&vec![0.0; self.n_free()]);
            let mut slope = |system: &System, command: f64| {
                let mut signals = [0.0; N_SIGNALS];
                signals[Signal::Command as usize] = command;
                signals[Signal::Load as usize] = command;
                linear.evaluate(system, element, &signals, &x, &mut dx);
                let by = |signal: Signal| linear.entry(element, element.torque, element.np + signal as usize);
                by(Signal::Command) + by(Signal::Load)
            };
            let here = slope(self, size);
            let is_linear = element.nz == 0
                && here != 0.0
                && here.is_finite()
                && [-2.0, -0.5, 0.5, 2.0].iter().all(|factor| slope(self, factor * size) == here);
            if !is_linear || slot == NONE {
                continue;
            }
            slopes[slot] *= here;
            for parameter in element.p..element.p + element.np {
                // A linear stage's slope is at most bilinear in its parameters, so the difference is exact.
                let value = self.effect_parameters[parameter];
                let step = if value == 0.0 { 1.0 } else { 0.5 * value.abs() };
                let mut at = |value: f64| {
                    probe.effect_parameters[parameter] = value;
                    slope(&probe, size)
                };
                let by = (at(value + step) - at(value - step)) / (2.0 * step);
                probe.effect_parameters[parameter] = value;
                if by != 0.0 {
                    relative.push((slot, parameter, by / here));
                }
            }
        }
        let gradient = relative.into_iter().map(|(slot, parameter, by)| (slot, parameter, by * slopes[slot])).collect();
        (slopes, gradient)
    }
}
