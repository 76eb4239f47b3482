//! Joint effects of one kind at several joints, evaluated side by side.

use dynid_generated::{EffectKernel, LANES, Lanes, N_SIGNALS, Signal};

use super::{Element, NONE};

/// Outputs and states that a block's effect has at most; one with more is evaluated by itself.
const MOST: usize = 2;

/// As many effects of one kind as there are lanes, or fewer; lanes left over repeat the last one.
#[derive(Clone)]
pub(super) struct Block {
    kernel: &'static EffectKernel,
    effects: Vec<Element>,
    /// First index of each one's parameters among those of the effects.
    first_parameter: [usize; LANES],
    parameters: Vec<Lanes>,
    reads: Vec<Read>,
    /// First index of each one's states in `x`.
    states: [usize; LANES],
    /// Free joint that it acts on.
    slots: [usize; LANES],
    torque: usize,
    /// The other free joint that it acts on, or [`NONE`].
    others: [usize; LANES],
    torque_from: usize,
}

/// Where a signal comes from, per lane.
#[derive(Clone)]
struct Read {
    signal: usize,
    source: Source,
    place: [usize; LANES],
}

#[derive(Clone, Copy)]
enum Source {
    /// A position or a speed in `x`.
    State,
    Time,
    /// Torque of the drive path at a free joint.
    Drive,
    /// Sum of the frictions of a free joint.
    Friction,
    /// An effect parameter.
    Parameter,
}

/// What a block's effects may read.
pub(super) struct View<'a> {
    pub(super) t: f64,
    pub(super) x: &'a [f64],
    pub(super) drive: &'a [f64],
    pub(super) friction: &'a [f64],
    pub(super) effect_parameters: &'a [f64],
}

impl Block {
    /// Blocks of `elements`, each kind in the order of its first; then those elements that do not fit into one.
    pub(super) fn all(elements: &[Element], n_free: usize) -> (Vec<Self>, Vec<Element>) {
        let (mut fitting, mut alone): (Vec<&Element>, Vec<Element>) = (Vec::new(), Vec::new());
        for element in elements {
            if fits(element) {
                fitting.push(element);
            } else {
                alone.push(element.clone());
            }
        }
        let mut blocks = Vec::new();
        while let Some(first) = fitting.first() {
            let id = first.kernel.id;
            let (own, rest): (Vec<&Element>, Vec<&Element>) =
                fitting.iter().copied().partition(|element| element.kernel.id == id);
            // Two of one kind may differ in what they have beside them, such as a spring.
            blocks.extend(own.chunks(LANES).map(|chunk| Self::new(chunk, n_free)));
            fitting = rest;
        }
        (blocks, alone)
    }

    fn new(elements: &[&Element], n_free: usize) -> Self {
        let lane = |k: usize| elements[k.min(elements.len() - 1)];
        let each = |of: &dyn Fn(&Element) -> usize| std::array::from_fn(|k| of(lane(k)));
        let first = elements[0];
        let mut reads = Vec::new();
        let mut read = |signal: Signal, source: Source, of: &dyn Fn(&Element) -> usize| {
            if first.uses.contains(signal) {
                reads.push(Read { signal: signal as usize, source, place: each(of) });
            }
        };
        read(Signal::Q, Source::State, &|element| element.joint.slot);
        read(Signal::Dq, Source::State, &|element| n_free + element.joint.slot);
        read(Signal::QFrom, Source::State, &|element| element.from.slot);
        read(Signal::DqFrom, Source::State, &|element| n_free + element.from.slot);
        read(Signal::T, Source::Time, &|_| 0);
        read(Signal::Load, Source::Drive, &|element| element.joint.slot);
        read(Signal::Friction, Source::Friction, &|element| element.joint.slot);
        read(Signal::Qeq, Source::Parameter, &|element| element.qeq);
        Self {
            kernel: first.kernel,
            effects: elements.iter().map(|element| (*element).clone()).collect(),
            first_parameter: each(&|element| element.p),
            parameters: vec![Lanes::new([0.0; LANES]); first.np],
            reads,
            states: each(&|element| element.z),
            slots: each(&|element| element.joint.slot),
            torque: first.torque,
            others: each(&|element| element.from.slot),
            torque_from: first.torque_from,
        }
    }

    /// Its effects, in their order.
    pub(super) fn effects(&self) -> &[Element] {
        &self.effects
    }

    /// Brings the parameters up to date.
    pub(super) fn prepare(&mut self, effect_parameters: &[f64]) {
        for (index, parameter) in self.parameters.iter_mut().enumerate() {
            *parameter = Lanes::new(self.first_parameter.map(|first| effect_parameters[first + index]));
        }
    }

    /// Adds the effects' torques to `load` and writes the rates of their states to `dx`.
    #[inline]
    pub(super) fn evaluate(&self, view: &View<'_>, load: &mut [f64], dx: &mut [f64]) {
        let mut signals = [Lanes::new([0.0; LANES]); N_SIGNALS];
        for read in &self.reads {
            let [first, second] = read.place;
            let gather = |from: &[f64]| Lanes::new([at(from, first), at(from, second)]);
            let value = match read.source {
                Source::State => gather(view.x),
                Source::Time => Lanes::new([view.t; LANES]),
                Source::Drive => gather(view.drive),
                Source::Friction => gather(view.friction),
                Source::Parameter => gather(view.effect_parameters),
            };
            if let Some(signal) = signals.get_mut(read.signal) {
                *signal = value;
            }
        }
        let mut states = [Lanes::new([0.0; LANES]); MOST];
        let mut rates = states;
        let mut outputs = states;
        let (nz, n_outputs) = (self.kernel.n_states.min(MOST), self.kernel.n_outputs.min(MOST));
        for (k, state) in states[..nz].iter_mut().enumerate() {
            let [first, second] = self.states;
            *state = Lanes::new([at(view.x, first + k), at(view.x, second + k)]);
        }
        let (outputs_used, rates_used) = (&mut outputs[..n_outputs], &mut rates[..nz]);
        self.kernel.functions.eval_lanes(&self.parameters, &signals, &states[..nz], outputs_used, rates_used);
        let mut deliver = |output: usize, slots: &[usize; LANES]| {
            if let Some(output) = outputs.get(output) {
                for (torque, slot) in output.to_array().iter().zip(slots).take(self.effects.len()) {
                    if let Some(load) = load.get_mut(*slot) {
                        *load += torque;
                    }
                }
            }
        };
        deliver(self.torque, &self.slots);
        if self.torque_from != NONE {
            deliver(self.torque_from, &self.others);
        }
        for (k, rate) in rates[..nz].iter().enumerate() {
            for (rate, first) in rate.to_array().iter().zip(self.states).take(self.effects.len()) {
                dx[first + k] = *rate;
            }
        }
    }
}

#[inline(always)]
fn at(from: &[f64], place: usize) -> f64 {
    from.get(place).copied().unwrap_or(0.0)
}

/// Whether an effect can stand in a block: all that it reads is free to move, and it is small.
fn fits(element: &Element) -> bool {
    let small = element.nz <= MOST && element.kernel.n_outputs <= MOST;
    let pair = [Signal::QFrom, Signal::DqFrom];
    let moves = element.joint.slot != NONE && (element.uses.excludes(&pair) || element.from.slot != NONE);
    small && moves && element.uses.excludes(&[Signal::Command, Signal::CommandFrom, Signal::Ddq])
}
