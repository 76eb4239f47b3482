//! First-order change of the equations of motion by state and parameters, exact (no differences).
//!
//! With `Q(x, p) = drive - load - (D ddq + h)` held at zero, a change of state `dx` and parameters `dp` changes the
//! accelerations by `D d(ddq) = Q_x dx + Q_p dp`, where `Q_x`, `Q_p` are taken at fixed `ddq`. The part of the rigid
//! body by the lumps of the kernel is `-Y`, its regressor.

use dynid_generated::Signal;

use super::{Element, MAX_OUTPUTS, N_SIGNALS, NONE, Scratch, System, factorise};

/// A scalar's gradient: index and value; states come first, effect parameter `p` is at `n_states + p`.
type Gradient = Vec<(usize, f64)>;

/// The equations linearised at one state, and the room to do it.
#[derive(Debug, Clone)]
pub(crate) struct Linear {
    /// D as [`factorise`] leaves it.
    pub(crate) factor: Vec<f64>,
    /// `Q_x`, n_free x n_states.
    pub(crate) torque_by_state: Vec<f64>,
    /// `Q_p` of the effects: free joint, effect parameter, value.
    pub(crate) torque_by_parameter: Vec<(usize, usize, f64)>,
    /// Rates of the effect states: state, state, value.
    pub(crate) rate_by_state: Vec<(usize, usize, f64)>,
    /// Rates of the effect states: state, effect parameter, value.
    pub(crate) rate_by_parameter: Vec<(usize, usize, f64)>,
    /// Y, n_free x n_lumps.
    pub(crate) regressor: Vec<f64>,
    pub(super) scratch: Scratch,
    /// Gradient of each free joint's drive torque.
    drives: Vec<Gradient>,
    /// Gradient of each free joint's friction, where another effect reads it.
    frictions: Vec<Gradient>,
    friction_is_read: Vec<bool>,
    drive_is_known: bool,
    row: Gradient,
    jacobian: Vec<f64>,
    tau: Vec<f64>,
    by_q: Vec<f64>,
    by_dq: Vec<f64>,
}

impl Linear {
    /// Room for linearising `system`.
    pub(crate) fn new(system: &System) -> Self {
        let n = system.n_free();
        let elements = [
            &system.actuators,
            &system.transmissions,
            &system.frictions,
            &system.loads,
            &system.links,
            &system.sensors,
        ];
        let widest = elements
            .into_iter()
            .flatten()
            .map(|element| (element.kernel.n_outputs + element.nz) * (element.np + N_SIGNALS + element.nz))
            .max()
            .unwrap_or(0);
        Self {
            factor: vec![0.0; n * n],
            torque_by_state: vec![0.0; n * system.n_states()],
            torque_by_parameter: Vec::with_capacity(64),
            rate_by_state: Vec::with_capacity(64),
            rate_by_parameter: Vec::with_capacity(64),
            regressor: vec![0.0; n * system.kernel.n_lumps],
            scratch: system.scratch(),
            drives: vec![Vec::with_capacity(16); n],
            frictions: vec![Vec::with_capacity(16); n],
            friction_is_read: (0..n)
                .map(|slot| {
                    let reads = |element: &Element| element.uses.contains(Signal::Friction);
                    system.loads.iter().any(|element| element.joint.slot == slot && reads(element))
                })
                .collect(),
            drive_is_known: false,
            row: Vec::with_capacity(64),
            jacobian: vec![0.0; widest],
            tau: vec![0.0; n],
            by_q: vec![0.0; n * n],
            by_dq: vec![0.0; n * n],
        }
    }

    /// The commands change: what depends on them alone is computed anew at the next update.
    pub(crate) fn renew_drive(&mut self) {
        self.drive_is_known = false;
    }

    /// Linearises at `x` and writes its time derivative to `dx`.
    pub(crate) fn update(&mut self, system: &System, t: f64, x: &[f64], command: &[f64], dx: &mut [f64]) {
        self.effects(system, t, x, command, dx);
        self.rigid_body(system, x, dx);
    }

    /// Linearises the effects at `x` and writes the rates of their states to `dx`.
    pub(super) fn effects(&mut self, system: &System, t: f64, x: &[f64], command: &[f64], dx: &mut [f64]) {
        self.torque_by_state.fill(0.0);
        self.torque_by_parameter.clear();
        self.rate_by_state.clear();
        self.rate_by_parameter.clear();
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

    fn drive_path(&mut self, system: &System, t: f64, x: &[f64], command: &[f64], dx: &mut [f64]) {
        for (slot, &joint) in system.kernel.free.iter().enumerate() {
            self.scratch.drive[slot] = command[joint];
            self.drives[slot].clear();
        }
        for element in system.actuators.iter().chain(&system.transmissions) {
            let slot = element.joint.slot;
            let mut signals = system.signals(element, t, x);
            signals[Signal::Load as usize] = self.scratch.drive[slot];
            signals[Signal::Command as usize] = self.scratch.drive[slot];
            signals[Signal::CommandFrom as usize] = command.get(element.from.joint).copied().unwrap_or(0.0);
            let outputs = self.evaluate(system, element, &signals, x, dx);
            self.rates(system, element);
            self.collect(element, element.torque);
            self.scratch.drive[slot] = outputs[element.torque];
            std::mem::swap(&mut self.drives[slot], &mut self.row);
        }
    }

    fn joint_effects(&mut self, system: &System, t: f64, x: &[f64], dx: &mut [f64]) {
        self.scratch.load.fill(0.0);
        self.frictions.iter_mut().for_each(Vec::clear);
        for element in &system.frictions {
            let mut signals = system.signals(element, t, x);
            signals[Signal::Load as usize] = self.scratch.drive.get(element.joint.slot).copied().unwrap_or(0.0);
            let outputs = self.evaluate(system, element, &signals, x, dx);
            self.rates(system, element);
            for (slot, output) in torques(element) {
                self.scratch.load[slot] += outputs[output];
                if self.friction_is_read[slot] {
                    self.collect(element, output);
                    self.frictions[slot].extend_from_slice(&self.row);
                }
                self.subtract_load(system, element, slot, output);
            }
        }
        self.scratch.friction.copy_from_slice(&self.scratch.load);
        for element in &system.loads {
            let slot = element.joint.slot;
            let mut signals = system.signals(element, t, x);
            signals[Signal::Load as usize] = self.scratch.drive.get(slot).copied().unwrap_or(0.0);
            signals[Signal::Friction as usize] = self.scratch.friction.get(slot).copied().unwrap_or(0.0);
            let outputs = self.evaluate(system, element, &signals, x, dx);
            self.rates(system, element);
            for (slot, output) in torques(element) {
                self.scratch.load[slot] += outputs[output];
                self.subtract_load(system, element, slot, output);
            }
        }
    }

    fn rigid_body(&mut self, system: &System, x: &[f64], dx: &mut [f64]) {
        let n = system.n_free();
        let n_states = system.n_states();
        let kernel = system.kernel;
        let (q, dq) = (&x[..n], &x[n..2 * n]);
        (kernel.inertia_and_bias)(&system.prepared, q, dq, &mut self.factor, &mut self.scratch.bias);
        for &(row, column, value) in &system.added_inertia {
            self.factor[row * n + column] += value;
        }
        factorise(n, &mut self.factor);
        dx[..n].copy_from_slice(dq);
        let ddq = &mut dx[n..2 * n];
        for slot in 0..n {
            ddq[slot] = self.scratch.drive[slot] - self.scratch.load[slot] - self.scratch.bias[slot];
        }
        super::solve_columns(n, &self.factor, ddq, 1);
        let ddq = &dx[n..2 * n];
        (kernel.inverse_dynamics_gradient)(
            &system.prepared,
            q,
            dq,
            ddq,
            &mut self.tau,
            &mut self.by_q,
            &mut self.by_dq,
        );
        for row in 0..n {
            for column in 0..n {
                self.torque_by_state[row * n_states + column] -= self.by_q[row * n + column];
                self.torque_by_state[row * n_states + n + column] -= self.by_dq[row * n + column];
            }
        }
        if kernel.n_lumps > 0 {
            (kernel.regressor)(&system.prepared, q, dq, ddq, &mut self.regressor);
        }
        self.inertias(system, ddq);
    }

    /// Link effects add `inertia * ddq` to the torque that the motion needs.
    pub(super) fn inertias(&mut self, system: &System, ddq: &[f64]) {
        for element in &system.links {
            self.evaluate(system, element, &[0.0; N_SIGNALS], &[], &mut []);
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

    /// What the log shows (`position`) and its gradient (`by_column`, n_free x width) from that of the state.
    pub(crate) fn measure(
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

    pub(super) fn evaluate(
        &mut self,
        system: &System,
        element: &Element,
        signals: &[f64; N_SIGNALS],
        x: &[f64],
        dx: &mut [f64],
    ) -> [f64; MAX_OUTPUTS] {
        let mut outputs = [0.0; MAX_OUTPUTS];
        let parameters = &system.effect_parameters[element.p..element.p + element.np];
        let rows = element.kernel.n_outputs + element.nz;
        let jacobian = &mut self.jacobian[..rows * (element.np + N_SIGNALS + element.nz)];
        let (states, rates) = if element.nz == 0 {
            (&[][..], &mut [][..])
        } else {
            let range = element.z..element.z + element.nz;
            (&x[range.clone()], &mut dx[range])
        };
        let outputs_used = &mut outputs[..element.kernel.n_outputs];
        (element.kernel.eval_gradient)(parameters, signals, states, outputs_used, rates, jacobian);
        outputs
    }

    pub(super) fn entry(&self, element: &Element, row: usize, column: usize) -> f64 {
        self.jacobian[row * (element.np + N_SIGNALS + element.nz) + column]
    }

    /// The gradient of one row of the element's Jacobian, by states and effect parameters, into `self.row`.
    fn collect(&mut self, element: &Element, row: usize) {
        let width = element.np + N_SIGNALS + element.nz;
        let values = &self.jacobian[row * width..(row + 1) * width];
        self.row.clear();
        self.row.extend(element.columns.iter().map(|(column, variable)| (*variable, values[*column])));
        let slot = element.joint.slot;
        let signal = |signal: Signal| values[element.np + signal as usize];
        if slot != NONE && element.reads_torques {
            let driven = signal(Signal::Load) + signal(Signal::Command);
            self.row.extend(self.drives[slot].iter().map(|(variable, value)| (*variable, driven * value)));
            let friction = signal(Signal::Friction);
            self.row.extend(self.frictions[slot].iter().map(|(variable, value)| (*variable, friction * value)));
        }
    }

    pub(super) fn rates(&mut self, system: &System, element: &Element) {
        let n_states = system.n_states();
        for state in 0..element.nz {
            self.collect(element, element.kernel.n_outputs + state);
            for &(variable, value) in &self.row {
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
        self.collect(element, output);
        let n_states = system.n_states();
        for &(variable, value) in &self.row {
            if variable < n_states {
                self.torque_by_state[slot * n_states + variable] -= value;
            } else {
                self.torque_by_parameter.push((slot, variable - n_states, -value));
            }
        }
    }

    fn add_torque(&mut self, system: &System, slot: usize, gradient: &[(usize, f64)]) {
        let n_states = system.n_states();
        for &(variable, value) in gradient {
            if variable < n_states {
                self.torque_by_state[slot * n_states + variable] += value;
            } else {
                self.torque_by_parameter.push((slot, variable - n_states, value));
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
