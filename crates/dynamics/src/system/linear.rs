//! First-order change of the equations of motion by state and parameters, exact (no differences).
//!
//! With `Q(x, p) = drive - load - (D ddq + h)` held at zero, a change of state `dx` and parameters `dp` changes the
//! accelerations by `D d(ddq) = Q_x dx + Q_p dp`, where `Q_x`, `Q_p` are taken at fixed `ddq`. The part of the rigid
//! body by the lumps of the kernel is `-Y`, its regressor.

use dynid_generated::{EffectKernel, Lanes, Scalar, Signal};

use super::{Element, MAX_OUTPUTS, N_SIGNALS, NONE, System, solve};

/// A scalar's gradient: index and value; states come first, effect parameter `p` is at `n_states + p`.
type Gradient<S> = Vec<(usize, S)>;

/// Numbers that the equations are linearised in: one state at a time, or several side by side.
pub trait Number: Scalar {
    /// The effect's `eval_gradient` for these numbers.
    fn effect_gradient(
        kernel: &EffectKernel,
        inputs: [&[Self]; 3],
        outputs: &mut [Self],
        rates: &mut [Self],
        jacobian: &mut [Self],
    );
}

impl Number for f64 {
    #[inline]
    fn effect_gradient(
        kernel: &EffectKernel,
        [parameters, signals, states]: [&[f64]; 3],
        outputs: &mut [f64],
        rates: &mut [f64],
        jacobian: &mut [f64],
    ) {
        kernel.functions.eval_gradient(parameters, signals, states, outputs, rates, jacobian);
    }
}

impl Number for Lanes {
    #[inline]
    fn effect_gradient(
        kernel: &EffectKernel,
        [parameters, signals, states]: [&[Lanes]; 3],
        outputs: &mut [Lanes],
        rates: &mut [Lanes],
        jacobian: &mut [Lanes],
    ) {
        kernel.functions.eval_gradient_lanes(parameters, signals, states, outputs, rates, jacobian);
    }
}

/// The equations linearised at one state, or at several side by side, and the room to do it.
#[derive(Debug, Clone)]
pub struct Linear<S = f64> {
    /// D, n_free x n_free.
    pub inertia: Vec<S>,
    /// D as `solve::factorise_lanes` leaves it; after [`Linear::at`].
    pub factor: Vec<S>,
    /// `Q_x`, n_free x n_states.
    pub torque_by_state: Vec<S>,
    /// `Q_p` of the effects: free joint, effect parameter, value. As in the other lists, the places are the same at every
    /// state.
    pub torque_by_parameter: Vec<(usize, usize, S)>,
    /// Rates of the effect states: state, state, value.
    pub rate_by_state: Vec<(usize, usize, S)>,
    /// Rates of the effect states: state, effect parameter, value.
    pub rate_by_parameter: Vec<(usize, usize, S)>,
    /// Y, n_free x n_lumps.
    pub regressor: Vec<S>,
    pub(super) drive: Vec<S>,
    pub(super) load: Vec<S>,
    friction: Vec<S>,
    /// Gradient of each free joint's drive torque.
    drives: Vec<Gradient<S>>,
    /// Gradient of each free joint's friction, where another effect reads it.
    frictions: Vec<Gradient<S>>,
    friction_is_read: Vec<bool>,
    drive_is_known: bool,
    /// How what arrives changes with each delay; none where nothing is late.
    late: Vec<S>,
    row: Gradient<S>,
    parameters: Vec<S>,
    jacobian: Vec<S>,
    prepared: Vec<S>,
    tau: Vec<S>,
    by_q: Vec<S>,
    by_dq: Vec<S>,
}

impl<S: Number> Linear<S> {
    /// Room for linearising `system`.
    pub fn new(system: &System) -> Self {
        let n = system.n_free();
        let widest = system
            .elements()
            .map(|element| (element.kernel.n_outputs + element.nz) * (element.np + N_SIGNALS + element.nz))
            .max()
            .unwrap_or(0);
        let room = |length: usize| vec![S::constant(0.0); length];
        let most_parameters = system.elements().map(|element| element.np).max().unwrap_or(0);
        Self {
            inertia: room(n * n),
            factor: room(n * n),
            torque_by_state: room(n * system.n_states()),
            torque_by_parameter: Vec::with_capacity(64),
            rate_by_state: Vec::with_capacity(64),
            rate_by_parameter: Vec::with_capacity(64),
            regressor: room(n * system.kernel.n_lumps),
            drive: room(n),
            load: room(n),
            friction: room(n),
            drives: vec![Vec::with_capacity(16); n],
            frictions: vec![Vec::with_capacity(16); n],
            friction_is_read: (0..n)
                .map(|slot| {
                    let reads = |element: &Element| element.uses.contains(Signal::Friction);
                    system.loads.iter().any(|element| element.joint.slot == slot && reads(element))
                })
                .collect(),
            drive_is_known: false,
            late: room(system.delays.len()),
            row: Vec::with_capacity(64),
            parameters: room(most_parameters),
            jacobian: room(widest),
            prepared: system.prepared.iter().map(|value| S::constant(*value)).collect(),
            tau: room(n),
            by_q: room(n * n),
            by_dq: room(n * n),
        }
    }

    /// The commands change: what depends on them alone is computed anew at the next update.
    pub fn renew_drive(&mut self) {
        self.drive_is_known = false;
    }

    /// Linearises the effects at `x` and writes the rates of their states to `dx`.
    pub(super) fn effects(&mut self, system: &System, t: S, x: &[S], command: &[S], dx: &mut [S]) {
        self.torque_by_state.fill(S::constant(0.0));
        self.torque_by_parameter.clear();
        self.rate_by_state.clear();
        self.rate_by_parameter.clear();
        self.frictions.iter_mut().for_each(Vec::clear);
        if !(self.drive_is_known && system.steady_drive()) {
            self.drive_path(system, t, x, command, dx);
            self.drive_is_known = true;
        }
        for slot in 0..system.n_free() {
            let gradient = std::mem::take(&mut self.drives[slot]);
            self.add_torque(system, slot, &gradient);
            self.drives[slot] = gradient;
        }
        self.joint_effects(system, t, x, dx);
    }

    /// How fast what arrives changes with each of [`System::delays`] [unit of the command per s], at the next update.
    pub fn set_late(&mut self, late: impl IntoIterator<Item = S>) {
        self.late.clear();
        self.late.extend(late);
    }

    /// Gradient of the command that arrives at a joint, times `factor`, into `self.row`.
    fn collect_late(&mut self, system: &System, joint: usize, factor: S) {
        let n_states = system.n_states();
        for (delay, late) in system.delays.iter().zip(&self.late).filter(|(delay, _)| delay.joint == joint) {
            for &(parameter, by) in &delay.by_parameter {
                self.row.push((n_states + parameter, factor * *late * S::constant(by)));
            }
        }
    }

    pub(super) fn drive_path(&mut self, system: &System, t: S, x: &[S], command: &[S], dx: &mut [S]) {
        for (slot, &joint) in system.kernel.free.iter().enumerate() {
            self.drive[slot] = command[joint];
            self.row.clear();
            self.collect_late(system, joint, S::constant(1.0));
            std::mem::swap(&mut self.drives[slot], &mut self.row);
        }
        for element in system.actuators.iter().chain(&system.transmissions) {
            let slot = element.joint.slot;
            let mut signals = system.signals(element, t, x);
            signals[Signal::Load as usize] = self.drive[slot];
            signals[Signal::Command as usize] = self.drive[slot];
            signals[Signal::CommandFrom as usize] =
                command.get(element.from.joint).copied().unwrap_or(S::constant(0.0));
            let outputs = self.evaluate(system, element, &signals, x, dx);
            self.rates(system, element);
            if element.torque_from != NONE && element.from.slot != NONE {
                let other = element.from.slot;
                self.collect(system, element, element.torque_from);
                self.drive[other] = self.drive[other] + outputs[element.torque_from];
                self.drives[other].extend_from_slice(&self.row);
            }
            self.collect(system, element, element.torque);
            self.drive[slot] = outputs[element.torque];
            std::mem::swap(&mut self.drives[slot], &mut self.row);
        }
    }

    fn joint_effects(&mut self, system: &System, t: S, x: &[S], dx: &mut [S]) {
        self.load.fill(S::constant(0.0));
        for element in &system.frictions {
            let mut signals = system.signals(element, t, x);
            signals[Signal::Load as usize] = self.drive.get(element.joint.slot).copied().unwrap_or(S::constant(0.0));
            let outputs = self.evaluate(system, element, &signals, x, dx);
            self.rates(system, element);
            for (slot, output) in torques(element) {
                self.load[slot] = self.load[slot] + outputs[output];
                if self.friction_is_read[slot] {
                    self.collect(system, element, output);
                    self.frictions[slot].extend_from_slice(&self.row);
                }
                self.subtract_load(system, element, slot, output);
            }
        }
        self.friction.copy_from_slice(&self.load);
        for element in &system.loads {
            let slot = element.joint.slot;
            let mut signals = system.signals(element, t, x);
            signals[Signal::Load as usize] = self.drive.get(slot).copied().unwrap_or(S::constant(0.0));
            signals[Signal::Friction as usize] = self.friction.get(slot).copied().unwrap_or(S::constant(0.0));
            let outputs = self.evaluate(system, element, &signals, x, dx);
            self.rates(system, element);
            for (slot, output) in torques(element) {
                self.load[slot] = self.load[slot] + outputs[output];
                self.subtract_load(system, element, slot, output);
            }
        }
    }

    /// Link effects add `inertia * ddq` to the torque that the motion needs.
    pub(super) fn inertias(&mut self, system: &System, ddq: &[S]) {
        let n_lumps = system.kernel.n_lumps;
        for (parameter, lumps) in system.lumps_by_parameter() {
            for slot in 0..system.n_free() {
                let row = &self.regressor[slot * n_lumps..(slot + 1) * n_lumps];
                let zero = S::constant(0.0);
                let torque = row.iter().zip(lumps).fold(zero, |sum, (y, by)| sum + *y * S::constant(*by));
                self.torque_by_parameter.push((slot, *parameter, -torque));
            }
        }
        for element in &system.links {
            self.evaluate(system, element, &[S::constant(0.0); N_SIGNALS], &[], &mut []);
            let (row, other) = (element.joint.slot, element.from.slot);
            for parameter in 0..element.np {
                let slope = self.entry(element, element.torque, parameter);
                if other == NONE {
                    self.torque_by_parameter.push((row, element.p + parameter, -slope * ddq[row]));
                } else {
                    self.torque_by_parameter.push((row, element.p + parameter, -slope * ddq[other]));
                    self.torque_by_parameter.push((other, element.p + parameter, -slope * ddq[row]));
                }
            }
        }
    }

    pub(super) fn evaluate(
        &mut self,
        system: &System,
        element: &Element,
        signals: &[S; N_SIGNALS],
        x: &[S],
        dx: &mut [S],
    ) -> [S; MAX_OUTPUTS] {
        let mut outputs = [S::constant(0.0); MAX_OUTPUTS];
        let parameters = &mut self.parameters[..element.np];
        for (parameter, value) in parameters.iter_mut().zip(&system.effect_parameters[element.p..]) {
            *parameter = S::constant(*value);
        }
        let rows = element.kernel.n_outputs + element.nz;
        let jacobian = &mut self.jacobian[..rows * (element.np + N_SIGNALS + element.nz)];
        let (states, rates) = if element.nz == 0 {
            (&[][..], &mut [][..])
        } else {
            let range = element.z..element.z + element.nz;
            (&x[range.clone()], &mut dx[range])
        };
        let outputs_used = &mut outputs[..element.kernel.n_outputs];
        S::effect_gradient(element.kernel, [parameters, signals, states], outputs_used, rates, jacobian);
        outputs
    }

    pub(super) fn entry(&self, element: &Element, row: usize, column: usize) -> S {
        self.jacobian[row * (element.np + N_SIGNALS + element.nz) + column]
    }

    /// The gradient of one row of the element's Jacobian, by states and effect parameters, into `self.row`.
    fn collect(&mut self, system: &System, element: &Element, row: usize) {
        let width = element.np + N_SIGNALS + element.nz;
        let values = &self.jacobian[row * width..(row + 1) * width];
        self.row.clear();
        self.row.extend(element.columns.iter().map(|(column, variable)| (*variable, values[*column])));
        let slot = element.joint.slot;
        let signal = |signal: Signal| values[element.np + signal as usize];
        if slot != NONE && element.reads_torques {
            let driven = signal(Signal::Load) + signal(Signal::Command);
            self.row.extend(self.drives[slot].iter().map(|(variable, value)| (*variable, driven * *value)));
            let friction = signal(Signal::Friction);
            self.row.extend(self.frictions[slot].iter().map(|(variable, value)| (*variable, friction * *value)));
            if element.uses.contains(Signal::CommandFrom) && !self.late.is_empty() {
                let factor = signal(Signal::CommandFrom);
                self.collect_late(system, element.from.joint, factor);
            }
        }
    }

    /// Appends the gradients of the rates of the element's states.
    pub(super) fn rates(&mut self, system: &System, element: &Element) {
        let n_states = system.n_states();
        for state in 0..element.nz {
            let row = element.kernel.n_outputs + state;
            if element.reads_torques {
                self.collect(system, element, row);
                for &(variable, value) in &self.row {
                    if variable < n_states {
                        self.rate_by_state.push((element.z + state, variable, value));
                    } else {
                        self.rate_by_parameter.push((element.z + state, variable - n_states, value));
                    }
                }
                continue;
            }
            for &(column, variable) in &element.columns {
                let value = self.entry(element, row, column);
                if variable < n_states {
                    self.rate_by_state.push((element.z + state, variable, value));
                } else {
                    self.rate_by_parameter.push((element.z + state, variable - n_states, value));
                }
            }
        }
    }

    /// Takes the gradient of a load off the joint's.
    fn subtract_load(&mut self, system: &System, element: &Element, slot: usize, output: usize) {
        let n_states = system.n_states();
        if element.reads_torques {
            self.collect(system, element, output);
            let gradient = std::mem::take(&mut self.row);
            for &(variable, value) in &gradient {
                self.subtract(n_states, slot, variable, value);
            }
            self.row = gradient;
            return;
        }
        for &(column, variable) in &element.columns {
            let value = self.entry(element, output, column);
            self.subtract(n_states, slot, variable, value);
        }
    }

    #[inline(always)]
    fn subtract(&mut self, n_states: usize, slot: usize, variable: usize, value: S) {
        if variable < n_states {
            let entry = &mut self.torque_by_state[slot * n_states + variable];
            *entry = *entry - value;
        } else {
            self.torque_by_parameter.push((slot, variable - n_states, -value));
        }
    }

    fn add_torque(&mut self, system: &System, slot: usize, gradient: &[(usize, S)]) {
        let n_states = system.n_states();
        for &(variable, value) in gradient {
            if variable < n_states {
                let entry = &mut self.torque_by_state[slot * n_states + variable];
                *entry = *entry + value;
            } else {
                self.torque_by_parameter.push((slot, variable - n_states, value));
            }
        }
    }
}

impl Linear<Lanes> {
    /// Linearises at the states `x` with the accelerations `ddq` that they have under these commands.
    pub fn at(
        &mut self,
        system: &System,
        t: Lanes,
        x: &[Lanes],
        ddq: &[Lanes],
        command: &[Lanes],
        rates: &mut [Lanes],
    ) {
        self.by_state(system, t, x, ddq, command, rates, true);
        let (n, kernel) = (system.n_free(), system.kernel);
        self.factor.copy_from_slice(&self.inertia);
        solve::factorise_lanes(n, &mut self.factor);
        let (q, dq) = (&x[..n], &x[n..2 * n]);
        if kernel.n_lumps > 0 {
            kernel.functions.regressor_lanes(&self.prepared, q, dq, ddq, &mut self.regressor);
        }
        self.inertias(system, ddq);
    }

    /// As [`Linear::at`], by the states alone. The rigid body changes slowly: where `is_body_new` does not hold, D and the derivatives
    /// of its torques stay those of the last call.
    #[allow(clippy::too_many_arguments)]
    pub fn by_state(
        &mut self,
        system: &System,
        t: Lanes,
        x: &[Lanes],
        ddq: &[Lanes],
        command: &[Lanes],
        rates: &mut [Lanes],
        is_body_new: bool,
    ) {
        self.effects(system, t, x, command, rates);
        let (n, kernel) = (system.n_free(), system.kernel);
        if is_body_new {
            let (q, dq) = (&x[..n], &x[n..2 * n]);
            kernel.functions.inertia_lanes(&self.prepared, q, &mut self.inertia);
            for &(row, column, value) in &system.added_inertia {
                let entry = &mut self.inertia[row * n + column];
                *entry = *entry + Lanes::constant(value);
            }
            let (tau, by_q, by_dq) = (&mut self.tau, &mut self.by_q, &mut self.by_dq);
            kernel.functions.inverse_dynamics_gradient_lanes(&self.prepared, q, dq, ddq, tau, by_q, by_dq);
        }
        let rows = self.torque_by_state.chunks_exact_mut(system.n_states());
        for ((row, by_q), by_dq) in rows.zip(self.by_q.chunks_exact(n)).zip(self.by_dq.chunks_exact(n)) {
            for (entry, by) in row.iter_mut().zip(by_q.iter().chain(by_dq)) {
                *entry = *entry - *by;
            }
        }
    }
}

impl Linear {
    /// What the log shows (`position`) and its gradient (`by_column`, n_free x width) from that of the state.
    pub fn measure(
        &mut self,
        system: &System,
        t: f64,
        x: &[f64],
        position: &mut [f64],
        by_column: &mut [f64],
        column_of: &[usize],
    ) {
        let n = system.n_free();
        let width = by_column.len() / n;
        position.copy_from_slice(&x[..n]);
        for element in &system.sensors {
            let slot = element.joint.slot;
            let mut signals = system.signals(element, t, x);
            signals[Signal::Q as usize] = position[slot];
            let outputs = self.evaluate(system, element, &signals, x, &mut []);
            position[slot] = outputs[element.torque];
            let slope = self.entry(element, element.torque, element.np + Signal::Q as usize);
            let row = &mut by_column[slot * width..(slot + 1) * width];
            row.iter_mut().for_each(|value| *value *= slope);
            for parameter in 0..element.np {
                let column = column_of[element.p + parameter];
                if column != NONE {
                    row[column] += self.entry(element, element.torque, parameter);
                }
            }
        }
    }
}

/// The free joints that an element acts on, and which of its outputs is the torque there.
fn torques(element: &Element) -> impl Iterator<Item = (usize, usize)> {
    [(element.joint.slot, element.torque), (element.from.slot, element.torque_from)]
        .into_iter()
        .filter(|(slot, output)| *slot != NONE && *output != NONE)
}

/// The fastest rate of the states from index `first` on: of one that decays by itself, or of two that swing against each
/// other, `sqrt(f_ab f_ba)`.
pub fn fastest_rate(rate_by_state: &[(usize, usize, f64)], first: usize) -> f64 {
    let rates = || rate_by_state.iter().filter(|(_, other, _)| *other >= first);
    rates().fold(0.0, |fastest: f64, &(state, other, value)| {
        if state == other {
            return fastest.max(value.abs());
        }
        let back = rates().filter(|(a, b, _)| (*a, *b) == (other, state)).map(|(.., back)| *back).sum::<f64>();
        fastest.max((value * back).abs().sqrt())
    })
}
