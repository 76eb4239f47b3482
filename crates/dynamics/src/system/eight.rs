//! The equations of eight systems of one kind at once, each with the bits that it has alone.

use dynid_generated::{Eight, N_SIGNALS, Signal, Width};

use super::{Element, End, NONE, System, solve};

/// Eight systems that differ in nothing but values, and room to evaluate them.
pub struct EightSystems<'a> {
    systems: [&'a System; 8],
    width: Width,
    /// Parameters of the effects.
    parameters: Vec<Eight>,
    /// What the kernel has prepared, then room for q, dq and torques.
    given: Vec<Eight>,
    /// What the drives deliver.
    driven: Vec<Eight>,
    /// The same, with what acts from outside.
    drive: Vec<Eight>,
    load: Vec<Eight>,
    friction: Vec<Eight>,
    /// What one effect is given: parameters, signals, states.
    of_effect: Vec<Eight>,
    /// Its outputs, then the rates of its states.
    results: Vec<Eight>,
}

impl<'a> EightSystems<'a> {
    /// `None` where they differ in more than values, or where commands come late.
    pub fn new(systems: [&'a System; 8]) -> Option<Self> {
        let first = systems[0];
        let are_alike = systems.iter().all(|system| {
            std::ptr::eq(system.kernel, first.kernel)
                && system.effect_names == first.effect_names
                && system.locked == first.locked
                && system.delays.is_empty()
                && system.elements().map(Element::place).eq(first.elements().map(Element::place))
        });
        if !are_alike {
            return None;
        }
        let row = |of: &dyn Fn(&System) -> f64| -> Eight { systems.map(of) };
        let n = first.n_free();
        let mut given: Vec<Eight> = (0..first.prepared.len()).map(|k| row(&|system| system.prepared[k])).collect();
        given.resize(given.len() + 3 * n, [0.0; 8]);
        let room = |of: &dyn Fn(&Element) -> usize| vec![[0.0; 8]; first.elements().map(of).max().unwrap_or(0)];
        Some(Self {
            systems,
            width: Width::widest(),
            parameters: (0..first.effect_parameters.len())
                .map(|k| row(&|system| system.effect_parameters[k]))
                .collect(),
            given,
            driven: vec![[0.0; 8]; n],
            drive: vec![[0.0; 8]; n],
            load: vec![[0.0; 8]; n],
            friction: vec![[0.0; 8]; n],
            of_effect: room(&|element| element.np + N_SIGNALS + element.nz),
            results: room(&|element| element.kernel.n_outputs + element.nz),
        })
    }

    /// They.
    pub fn systems(&self) -> [&'a System; 8] {
        self.systems
    }

    /// In which registers.
    pub fn width(&self) -> Width {
        self.width
    }

    /// As [`System::drive`], kept for [`EightSystems::motion`].
    pub fn drive(&mut self, t: Eight, x: &[Eight], command: &[Eight], dx: &mut [Eight]) {
        let system = self.systems[0];
        for (slot, &joint) in system.kernel.free.iter().enumerate() {
            self.driven[slot] = command[joint];
        }
        for element in system.actuators.iter().chain(&system.transmissions) {
            let slot = element.joint.slot;
            let from = command.get(element.from.joint).copied().unwrap_or([0.0; 8]);
            let driven = self.driven[slot];
            let torques = [(Signal::Load, driven), (Signal::Command, driven), (Signal::CommandFrom, from)];
            self.evaluate(element, (t, x), &torques, dx);
            self.driven[slot] = self.results[element.torque];
            if element.torque_from != NONE && element.from.slot != NONE {
                add(&mut self.driven[element.from.slot], &self.results[element.torque_from]);
            }
        }
    }

    /// As [`System::motion`], with torques [N*m or N] that act on the free joints from outside beside the drives.
    pub fn motion(&mut self, t: Eight, x: &[Eight], external: &[Eight], dx: &mut [Eight]) {
        let system = self.systems[0];
        let n = system.n_free();
        for ((drive, driven), external) in self.drive.iter_mut().zip(&self.driven).zip(external) {
            *drive = *driven;
            add(drive, external);
        }
        self.loads(t, x, dx);
        dx[..n].copy_from_slice(&x[n..2 * n]);
        let first = self.given.len() - 3 * n;
        let (moving, torques) = self.given[first..].split_at_mut(2 * n);
        moving.copy_from_slice(&x[..2 * n]);
        for (torque, (drive, load)) in torques.iter_mut().zip(self.drive.iter().zip(&self.load)) {
            *torque = std::array::from_fn(|lane| drive[lane] - load[lane]);
        }
        let ddq = &mut dx[n..2 * n];
        if system.added_inertia.is_empty() {
            return system.kernel.functions.forward_dynamics_of_eight(self.width, &self.given, ddq);
        }
        self.with_added_inertia(x, ddq);
    }

    /// The accelerations where D is more than the kernel's, one system after the other.
    fn with_added_inertia(&self, x: &[Eight], ddq: &mut [Eight]) {
        for (lane, system) in self.systems.iter().enumerate() {
            let n = system.n_free();
            let of = |rows: &[Eight]| -> Vec<f64> { rows.iter().map(|row| row[lane]).collect() };
            let (mut inertia, mut bias) = (vec![0.0; n * n], vec![0.0; n]);
            let (q, dq) = (of(&x[..n]), of(&x[n..2 * n]));
            system.kernel.functions.inertia_and_bias(&system.prepared, &q, &dq, &mut inertia, &mut bias);
            for &(row, column, value) in &system.added_inertia {
                inertia[row * n + column] += value;
            }
            let torque = |slot: usize| self.drive[slot][lane] - self.load[slot][lane] - bias[slot];
            let mut own: Vec<f64> = (0..n).map(torque).collect();
            solve::solve(n, &mut inertia, &mut own);
            ddq.iter_mut().zip(own).for_each(|(row, own)| row[lane] = own);
        }
    }

    /// As [`System::loads`], in the same order.
    fn loads(&mut self, t: Eight, x: &[Eight], dx: &mut [Eight]) {
        let system = self.systems[0];
        self.load.fill([0.0; 8]);
        for (place, (blocks, alone)) in [&system.friction_blocks, &system.load_blocks].into_iter().enumerate() {
            for element in blocks.iter().flat_map(|block| block.effects()).chain(alone) {
                let at = |rows: &[Eight]| rows.get(element.joint.slot).copied().unwrap_or([0.0; 8]);
                let friction = if place == 0 { [0.0; 8] } else { at(&self.friction) };
                let torques = [(Signal::Load, at(&self.drive)), (Signal::Friction, friction)];
                self.evaluate(element, (t, x), &torques, dx);
                for (end, output) in [(element.joint, element.torque), (element.from, element.torque_from)] {
                    if end.slot != NONE && output != NONE {
                        add(&mut self.load[end.slot], &self.results[output]);
                    }
                }
            }
            if place == 0 {
                self.friction.copy_from_slice(&self.load);
            }
        }
    }

    /// Leaves an effect's outputs at the beginning of `results`, and the rates of its states in `dx`.
    fn evaluate(
        &mut self,
        element: &Element,
        (t, x): (Eight, &[Eight]),
        torques: &[(Signal, Eight)],
        dx: &mut [Eight],
    ) {
        let n = self.systems[0].n_free();
        let &Element { kernel, p, np, z, nz, joint, from, qeq, .. } = element;
        let given = &mut self.of_effect[..np + N_SIGNALS + nz];
        given[..np].copy_from_slice(&self.parameters[p..p + np]);
        given[np + N_SIGNALS..].copy_from_slice(&x[z..z + nz]);
        let signals = &mut given[np..np + N_SIGNALS];
        signals.fill([0.0; 8]);
        let mut show = |signal: Signal, value: Eight| signals[signal as usize] = value;
        let motion = |end: End| match end.slot {
            NONE => ([end.angle; 8], [0.0; 8]),
            slot => (x[slot], x[n + slot]),
        };
        let (q, dq) = motion(joint);
        show(Signal::Q, q);
        show(Signal::Dq, dq);
        show(Signal::T, t);
        if qeq != NONE {
            show(Signal::Qeq, self.parameters[qeq]);
        }
        if from.joint != NONE {
            let (q, dq) = motion(from);
            show(Signal::QFrom, q);
            show(Signal::DqFrom, dq);
        }
        torques.iter().for_each(|(signal, value)| show(*signal, *value));
        let results = &mut self.results[..kernel.n_outputs + nz];
        kernel.functions.eval_of_eight(self.width, given, results);
        dx[z..z + nz].copy_from_slice(&results[kernel.n_outputs..]);
    }
}

fn add(sum: &mut Eight, term: &Eight) {
    sum.iter_mut().zip(term).for_each(|(sum, term)| *sum += term);
}
