//! Positions of a run and their derivatives by the unknowns, integrated along (forward sensitivities).
//!
//! The columns of `S = dx/du` obey `dS/dt = f_x S + f_u`, integrated by the same Runge-Kutta steps as the state, so that
//! S is the exact derivative of the numeric solution; where an effect jumps at a joint's rest position, S jumps as that of
//! the exact solution does. Columns are, in this order: the wanted effect parameters, the
//! kernel's lumps (all unknown inertial parameters act through them: `ds/dp = ds/dlump dlump/dp`), and the initial
//! positions of the free joints. A row of S holds all columns of one state, padded to whole blocks. [`transitions`] has other
//! columns: the state at the sample before, and torques from there on.
//!
//! A few steps at a time are taken in three passes, for there are many more unknowns than states:
//! 1. the states alone, as in any simulation, keeping what every stage saw;
//! 2. the equations linearised at these stages, several side by side in the lanes of vector registers;
//! 3. backwards through the stages (the transpose of the scheme), `S_end = W S_begin + G`: W has a row per state, and an
//!    unknown costs only its own few entries of `f_u`.
//!
//! Implicit steps are taken one by one: each stage's equations are linearised at its solution, and the third pass goes back through the
//! inverses of the stages' matrices.

use dynid_generated::{LANES, Lanes, Scalar};
use pulp::bytemuck::{cast_slice, cast_slice_mut};

use dynid_dynamics::{
    simulate::Commands, simulate::Gains, simulate::Grid, simulate::Input, simulate::Intersample, simulate::Options,
    simulate::Predictor, simulate::Scheme, simulate::SimulationError, simulate::check, simulate::check_state,
    simulate::implicit, simulate::implicit::Implicit, simulate::interpolate, simulate::step_bounds, system::Linear,
    system::NONE, system::Scratch, system::Switch, system::System, system::substitute,
};
use nalgebra::DMatrix;

/// Columns come in blocks of this many: what one cache line holds, and whole vector registers of any width.
const BLOCK: usize = 8;

/// Steps that are linearised together, at most: their equations should stay in the cache.
const MOST_STEPS: usize = 12;

/// Stages of a Runge-Kutta step.
const STAGES: usize = 4;

/// Which derivative stands in which column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Columns {
    /// Column of each effect parameter of the system, or `usize::MAX`.
    of_effect: Vec<usize>,
    first_lump: usize,
    n_lumps: usize,
    n_initial: usize,
    n_rates: usize,
    n_torques: usize,
    width: usize,
}

impl Columns {
    /// Columns for those effect parameters of `system` that `wanted` names, and with `lumps` those of the rigid body.
    pub fn new(system: &System, wanted: impl Fn(&str) -> bool, lumps: Lumps) -> Self {
        let mut count = 0;
        let of_effect = system
            .effect_names()
            .iter()
            .map(|name| {
                if wanted(name) {
                    count += 1;
                    count - 1
                } else {
                    NONE
                }
            })
            .collect();
        let n_lumps = if lumps == Lumps::Wanted { system.kernel().n_lumps } else { 0 };
        let n_initial = system.n_free();
        let width = (count + n_lumps + n_initial).next_multiple_of(BLOCK);
        Self { of_effect, first_lump: count, n_lumps, n_initial, n_rates: 0, n_torques: 0, width }
    }

    /// Columns for all states at the sample before, then for two torques on each free joint until the next: one that falls from 1 to 0,
    /// one that rises from 0 to 1.
    pub fn of_transitions(system: &System) -> Self {
        let (n_initial, n_torques) = (system.n_states(), 2 * system.n_free());
        let of_effect = vec![NONE; system.effect_parameters().len()];
        let width = (n_initial + n_torques).next_multiple_of(BLOCK);
        Self { of_effect, first_lump: 0, n_lumps: 0, n_initial, n_rates: 0, n_torques, width }
    }

    /// With columns for the initial speeds of the `n_free` joints too.
    #[must_use]
    pub fn moving(self, n_free: usize) -> Self {
        let n_initial = 2 * n_free;
        let width = (self.first_lump + self.n_lumps + n_initial).next_multiple_of(BLOCK);
        Self { n_initial, width, ..self }
    }

    /// With columns for the rates of a [`Predictor`] of `n_free` joints too.
    #[must_use]
    pub fn predicting(self, n_free: usize) -> Self {
        let width = (self.initial().end + n_free).next_multiple_of(BLOCK);
        Self { n_rates: n_free, width, ..self }
    }

    /// Column of an effect parameter, by its index in [`System::effect_parameters`].
    pub fn effect(&self, parameter: usize) -> Option<usize> {
        self.of_effect.get(parameter).copied().filter(|column| *column != NONE)
    }

    /// Columns of the lumps; empty where they are not wanted.
    pub fn lumps(&self) -> std::ops::Range<usize> {
        self.first_lump..self.first_lump + self.n_lumps
    }

    /// Columns of the initial positions, then of the initial speeds where they are unknown.
    pub fn initial(&self) -> std::ops::Range<usize> {
        let first = self.first_lump + self.n_lumps;
        first..first + self.n_initial
    }

    /// Columns of the rates of a predictor.
    pub fn rates(&self) -> std::ops::Range<usize> {
        let first = self.initial().end;
        first..first + self.n_rates
    }

    /// Columns of the torques between two samples.
    pub fn torques(&self) -> std::ops::Range<usize> {
        let first = self.rates().end;
        first..first + self.n_torques
    }

    /// Number of columns in use.
    pub fn count(&self) -> usize {
        self.torques().end
    }

    /// Length of a row of S: [`Columns::count`], padded.
    pub fn width(&self) -> usize {
        self.width
    }
}

/// Whether the lumps get columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lumps {
    /// Some inertial parameter is unknown.
    Wanted,
    /// All are known.
    Known,
}

/// Simulates from `q0` (positions of the free joints, at rest; or positions, then speeds), and
/// hands every sample to `observe`: its index, the logged positions of the free joints
/// and their derivatives, n_free x width.
pub fn simulate(
    system: &System,
    columns: &Columns,
    input: &Input<'_>,
    q0: &[f64],
    options: &Options,
    observe: impl FnMut(usize, &[f64], &[f64]),
) -> Result<(), SimulationError> {
    along(system, columns, input, None, q0, options, observe)
}

/// One-step predictions and their derivatives, those by the predictor's rates included: as [`simulate`].
pub fn predict(
    system: &System,
    columns: &Columns,
    input: &Input<'_>,
    predictor: &Predictor<'_>,
    q0: &[f64],
    options: &Options,
    observe: impl FnMut(usize, &[f64], &[f64]),
) -> Result<(), SimulationError> {
    along(system, columns, input, Some(predictor), q0, options, observe)
}

fn along(
    system: &System,
    columns: &Columns,
    input: &Input<'_>,
    predictor: Option<&Predictor<'_>>,
    q0: &[f64],
    options: &Options,
    mut observe: impl FnMut(usize, &[f64], &[f64]),
) -> Result<(), SimulationError> {
    check(system, input, q0)?;
    let mut motion = Variation::new(system, columns, q0);
    let mut view = View::new(system, columns);
    let mut show = |motion: &mut Variation, sample: usize, t: f64| {
        check_state(system, t, &motion.x, options)?;
        view.take(system, columns, t, motion);
        observe(sample, &view.position, &view.by_column);
        if let Some(predictor) = predictor {
            motion.correct(system, columns, predictor, (input.time, sample), &view);
        }
        Ok(())
    };
    show(&mut motion, 0, input.time.first().copied().unwrap_or(0.0))?;
    let grid = Grid::of(input.time, options.steps);
    for sample in 0..input.time.len().saturating_sub(1) {
        let scheme = predictor.map(|predictor| predictor.scheme(sample));
        let steps = scheme.map_or_else(|| grid.steps(input.time[sample], input.time[sample + 1]), Scheme::steps);
        let is_implicit = matches!(scheme, Some(Scheme::Implicit(_)));
        motion.across(system, columns, input, Span::new(input, sample, steps), is_implicit);
        show(&mut motion, sample + 1, input.time[sample + 1])?;
    }
    Ok(())
}

/// How the prediction of a sample hangs on the state after the sample before and on torques between the two.
pub struct Transition<'a> {
    /// State after the sample before was compared.
    pub begin: &'a [f64],
    /// State at the next sample, before it is compared.
    pub end: &'a [f64],
    /// Derivatives of `end` by [`Columns::of_transitions`], n_states x width.
    pub end_by: &'a [f64],
    /// Derivatives of what is logged of it, n_free x width.
    pub shown_by: &'a [f64],
}

/// As [`predict`], but `observe` is handed the derivatives of each interval alone.
pub fn transitions(
    system: &System,
    columns: &Columns,
    input: &Input<'_>,
    predictor: &Predictor<'_>,
    q0: &[f64],
    mut observe: impl FnMut(&Transition<'_>),
) -> Result<(), SimulationError> {
    check(system, input, q0)?;
    let options = Options::default();
    let mut motion = Variation::new(system, columns, q0);
    let mut view = View::new(system, columns);
    let mut begin = motion.x.clone();
    for sample in 0..input.time.len() {
        let t = input.time[sample];
        check_state(system, t, &motion.x, &options)?;
        view.take(system, columns, t, &motion);
        if sample > 0 {
            let (end, end_by) = (motion.x.as_slice(), motion.s.as_slice());
            observe(&Transition { begin: &begin, end, end_by, shown_by: &view.by_column });
        }
        predictor.correct(system, input.time, sample, &view.position, &mut motion.x);
        if sample + 1 < input.time.len() {
            begin.copy_from_slice(&motion.x);
            motion.s.fill(0.0);
            (0..columns.n_initial).for_each(|state| motion.s[state * columns.width + state] = 1.0);
            let scheme = predictor.scheme(sample);
            let is_implicit = matches!(scheme, Scheme::Implicit(_));
            motion.across(system, columns, input, Span::new(input, sample, scheme.steps()), is_implicit);
        }
    }
    Ok(())
}

/// What acts between two samples.
struct Span<'a> {
    sample: usize,
    /// s
    start: f64,
    /// s
    end: f64,
    steps: usize,
    intersample: Intersample,
    now: &'a [f64],
    next: &'a [f64],
    late: Commands<'a>,
}

impl<'a> Span<'a> {
    fn new(input: &Input<'a>, sample: usize, steps: usize) -> Self {
        let n_joints = input.command.len() / input.time.len();
        let (now, next) = input.around(sample, n_joints);
        Self {
            sample,
            start: input.time[sample],
            end: input.time[sample + 1],
            steps,
            intersample: input.intersample,
            now,
            next,
            late: input.commands(n_joints),
        }
    }

    fn step(&self) -> f64 {
        (self.end - self.start) / self.steps as f64
    }

    /// What arrives at `t` within step `index`; `slopes` takes its derivatives by the delays.
    fn command(&self, system: &System, index: usize, t: f64, command: &mut [f64], slopes: Option<&mut [f64]>) {
        match self.intersample {
            Intersample::ZeroOrder => command.copy_from_slice(self.now),
            Intersample::FirstOrder => {
                interpolate((t - self.start) / (self.end - self.start), self.now, self.next, command)
            }
        }
        if !system.delays().is_empty() {
            let bounds = step_bounds(self.start, self.end, self.steps, index);
            self.late.arrive(system, t, bounds, command, slopes);
        }
    }
}

/// What the log shows of a state and its derivatives.
struct View {
    linear: Linear,
    position: Vec<f64>,
    by_column: Vec<f64>,
}

impl View {
    fn new(system: &System, columns: &Columns) -> Self {
        let n = system.n_free();
        Self { linear: Linear::new(system), position: vec![0.0; n], by_column: vec![0.0; n * columns.width] }
    }

    fn take(&mut self, system: &System, columns: &Columns, t: f64, motion: &Variation) {
        let n = system.n_free();
        self.by_column.copy_from_slice(&motion.s[..n * columns.width]);
        if system.has_sensors() {
            let (position, by_column) = (&mut self.position, &mut self.by_column);
            self.linear.measure(system, t, &motion.x, position, by_column, &columns.of_effect);
        } else {
            self.position.copy_from_slice(&motion.x[..n]);
        }
    }
}

/// State and sensitivities on their way, with the room that a chunk of steps needs.
struct Variation {
    linear: Linear<Lanes>,
    scratch: Scratch,
    command: Vec<f64>,
    x: Vec<f64>,
    x_sum: Vec<f64>,
    s: Vec<f64>,
    s_next: Vec<f64>,
    /// Number of steps in the chunk.
    steps: usize,
    /// Which step of the interval is its first.
    first_step: usize,
    /// Time (s), states and their rates at every stage of the chunk.
    stage_t: Vec<f64>,
    stage_x: Vec<f64>,
    stage_rate: Vec<f64>,
    /// What the linearised equations of a pair of stages hold, one after the other.
    slopes: Vec<Lanes>,
    places: Places,
    switches: Vec<Switch>,
    /// Tells the two sides of a switch apart.
    sides: Linear,
    /// Positions at the start of the last step.
    q_before: Vec<f64>,
    jump: Vec<f64>,
    x_lanes: Vec<Lanes>,
    ddq_lanes: Vec<Lanes>,
    command_lanes: Vec<Lanes>,
    rate_lanes: Vec<Lanes>,
    implicit: Option<Box<Implicit>>,
}

/// Where the linearised equations of a stage stand in its slopes: first LDL^T of D, n_free x n_free, then `Q_x`,
/// n_free x n_states, then Y, n_free x n_lumps, and then one entry each for what is listed here.
#[derive(Default)]
struct Places {
    /// Number of slopes of a stage; 0 before the first.
    count: usize,
    /// Free joint and column: what a parameter does to the torque.
    torque_by_parameter: Vec<(usize, usize, usize)>,
    /// State and state.
    rate_by_state: Vec<(usize, usize, usize)>,
    /// State and column.
    rate_by_parameter: Vec<(usize, usize, usize)>,
    /// Column, free joint and place of those entries of Y that are not always zero, column by column.
    regressor: Vec<(usize, usize, usize)>,
}

impl Variation {
    fn new(system: &System, columns: &Columns, q0: &[f64]) -> Self {
        let x = system.rest(q0);
        let n_states = x.len();
        let mut s = vec![0.0; n_states * columns.width];
        for (slot, column) in columns.initial().enumerate() {
            s[slot * columns.width + column] = 1.0;
        }
        for &(state, slot) in system.states_at_speed() {
            if let Some(column) = columns.initial().nth(system.n_free() + slot) {
                s[state * columns.width + column] = 1.0;
            }
        }
        let stages = MOST_STEPS * STAGES;
        Self {
            linear: Linear::new(system),
            scratch: system.scratch(),
            command: vec![0.0; system.n_joints()],
            x_sum: x.clone(),
            s_next: s.clone(),
            s,
            steps: 0,
            first_step: 0,
            stage_t: vec![0.0; stages],
            stage_x: vec![0.0; stages * n_states],
            stage_rate: vec![0.0; stages * n_states],
            slopes: Vec::new(),
            places: Places::default(),
            switches: system.switches(),
            sides: Linear::new(system),
            q_before: q0[..system.n_free()].to_vec(),
            jump: vec![0.0; system.n_free()],
            x_lanes: vec![Lanes::constant(0.0); n_states],
            ddq_lanes: vec![Lanes::constant(0.0); system.n_free()],
            command_lanes: vec![Lanes::constant(0.0); system.n_joints()],
            rate_lanes: vec![Lanes::constant(0.0); n_states],
            implicit: None,
            x,
        }
    }

    /// Takes states and sensitivities over a span; where no implicit steps have a solution, in explicit ones.
    fn across(&mut self, system: &System, columns: &Columns, input: &Input<'_>, mut span: Span<'_>, is_implicit: bool) {
        if is_implicit {
            for steps in Scheme::implicit_steps(span.steps) {
                span.steps = steps;
                if self.implicit_steps(system, columns, input, &span) {
                    return;
                }
            }
            span.steps = Scheme::UNSOLVED;
        }
        // As even as they come.
        let most = span.steps.div_ceil(span.steps.div_ceil(MOST_STEPS));
        let mut done = 0;
        while done < span.steps {
            let passed = self.states(system, &span, done..span.steps.min(done + most));
            self.linearise(system, columns, &span);
            self.sensitivities(system, columns, &span);
            done += self.steps;
            if passed {
                self.jumps(system, columns, span.start + done as f64 * span.step(), span.step());
            }
        }
    }

    /// Integrates the states over these steps of the span, or up to the first in which a joint passes a rest position
    /// where something switches; says whether one did.
    fn states(&mut self, system: &System, span: &Span<'_>, steps: std::ops::Range<usize>) -> bool {
        /// Where a stage stands, what its slope weighs in the sum, and how far the next stage goes with it.
        const SCHEME: [(f64, f64, f64); STAGES] = [(0.0, 1.0, 0.5), (0.5, 2.0, 0.5), (0.5, 2.0, 1.0), (1.0, 1.0, 0.0)];
        let (n, n_states, step) = (system.n_free(), self.x.len(), span.step());
        self.steps = 0;
        self.first_step = steps.start;
        let mut stage = 0;
        for index in steps {
            let begin = span.start + index as f64 * step;
            self.q_before.copy_from_slice(&self.x[..n]);
            self.stage_x[stage * n_states..(stage + 1) * n_states].copy_from_slice(&self.x);
            for (number, (share, weight, reach)) in SCHEME.into_iter().enumerate() {
                let t = begin + share * step;
                let (before, after) = self.stage_x.split_at_mut((stage + 1) * n_states);
                let x = &before[stage * n_states..];
                let rate = &mut self.stage_rate[stage * n_states..(stage + 1) * n_states];
                self.stage_t[stage] = t;
                if stage == 0 || span.intersample == Intersample::FirstOrder || !system.steady_drive() {
                    span.command(system, index, t, &mut self.command, None);
                    system.drive(&mut self.scratch, t, x, &self.command, rate);
                }
                system.motion(&mut self.scratch, t, x, rate);
                let ahead = reach * step;
                let sum = &mut self.x_sum;
                if number == 0 {
                    sum.copy_from_slice(rate);
                } else if number < 3 {
                    sum.iter_mut().zip(&*rate).for_each(|(sum, rate)| *sum += weight * rate);
                }
                if number < 3 {
                    let next = &mut after[..n_states];
                    for ((next, x), rate) in next.iter_mut().zip(&self.x).zip(&*rate) {
                        *next = x + ahead * rate;
                    }
                } else {
                    for ((x, rate), sum) in self.x.iter_mut().zip(&*rate).zip(sum) {
                        *x += step / 6.0 * (*sum + rate);
                    }
                }
                stage += 1;
            }
            self.steps += 1;
            if self.switches.iter().any(|switch| self.passed(system, *switch).is_some()) {
                return true;
            }
        }
        false
    }

    /// Takes states and sensitivities over a span in implicit steps; where one has no solution, says so and leaves both as they were.
    fn implicit_steps(&mut self, system: &System, columns: &Columns, input: &Input<'_>, span: &Span<'_>) -> bool {
        let (n, n_states) = (system.n_free(), self.x.len());
        let (x, s) = (self.x.clone(), self.s.clone());
        let mut implicit = self.implicit.take().unwrap_or_else(|| Box::new(Implicit::new(system)));
        let mut is_solved = true;
        for index in 0..span.steps {
            self.q_before.copy_from_slice(&self.x[..n]);
            is_solved = implicit.step_of(system, input, span.sample, (index, span.steps), &mut self.x);
            if !is_solved {
                (self.x, self.s) = (x, s);
                break;
            }
            (self.steps, self.first_step) = (1, index);
            // An explicit step has one stage more.
            for stage in 0..STAGES {
                let from = stage.min(implicit::STAGES - 1);
                let (to, from_states) =
                    (stage * n_states..(stage + 1) * n_states, from * n_states..(from + 1) * n_states);
                self.stage_t[stage] = implicit.time[from];
                self.stage_x[to.clone()].copy_from_slice(&implicit.states[from_states.clone()]);
                self.stage_rate[to].copy_from_slice(&implicit.rates[from_states]);
            }
            self.linearise(system, columns, span);
            self.implicit_sensitivities(columns, n, span.step());
            if self.switches.iter().any(|switch| self.passed(system, *switch).is_some()) {
                let end = span.start + (index + 1) as f64 * span.step();
                // Drive and friction of this step, which the implicit one keeps to itself.
                span.command(system, index, end, &mut self.command, None);
                system.derivative(&mut self.scratch, end, &self.x, &self.command, &mut self.x_sum);
                self.jumps(system, columns, end, span.step());
            }
        }
        self.implicit = Some(implicit);
        is_solved
    }

    /// `S` over one implicit step. With `K_i = A_i V_i + B_i` the slopes of its stages, `V_i = S + h (sum of the slopes before, own K_i)`
    /// and `T_i = 1 / (1 - h OWN A_i)`, its end is `V_last + h OWN K_last = P S + sum of C_i B_i`: from the last stage to the first,
    /// and an unknown costs only its own few entries of B.
    fn implicit_sensitivities(&mut self, columns: &Columns, n: usize, step: f64) {
        let (n_states, width) = (self.x.len(), columns.width);
        let unit = DMatrix::<f64>::identity(n_states, n_states);
        let (slopes, count) = (&self.slopes, self.places.count);
        let stage_of =
            |stage: usize| move |place: usize| slopes[stage / LANES * count + place].to_array()[stage % LANES];
        let own = step * implicit::OWN;
        // D, `T` and `T A` of each stage.
        let mut solved: Vec<(Vec<f64>, DMatrix<f64>, DMatrix<f64>)> = Vec::with_capacity(implicit::STAGES);
        for stage in 0..implicit::STAGES {
            let slope = stage_of(stage);
            let factor: Vec<f64> = (0..n * n).map(&slope).collect();
            let torque_by_state: Vec<f64> = (n * n..n * n + n * n_states).map(&slope).collect();
            let rate_by_state =
                self.places.rate_by_state.iter().map(|(row, state, place)| (*row, *state, slope(*place)));
            let by_state = implicit::state_matrix(n, &factor, &torque_by_state, rate_by_state);
            // The state had a solution here, so its derivative has one; else it is no number, which every caller refuses.
            let inverse = (&unit - &by_state * own).lu().try_inverse();
            let inverse = inverse.unwrap_or_else(|| DMatrix::repeat(n_states, n_states, f64::NAN));
            let by_state = &inverse * by_state;
            solved.push((factor, inverse, by_state));
        }
        // Derivatives of the end by each stage's slopes: what is known of them so far.
        let last = &unit + &solved[implicit::STAGES - 1].2 * own;
        let mut by_slopes: Vec<DMatrix<f64>> =
            implicit::BEFORE[implicit::STAGES - 1].iter().map(|weight| &last * (step * weight)).collect();
        by_slopes.push(&unit * own);
        let mut by_begin = last;
        for stage in (0..implicit::STAGES - 1).rev() {
            let through = &by_slopes[stage] * &solved[stage].2;
            for (before, weight) in implicit::BEFORE[stage].iter().enumerate().take(stage) {
                by_slopes[before] += &through * (step * weight);
            }
            by_begin += through;
        }
        for row in 0..n_states {
            let next = &mut self.s_next[row * width..(row + 1) * width];
            next.fill(0.0);
            for (state, source) in self.s.chunks_exact(width).enumerate() {
                let factor = by_begin[(row, state)];
                if factor != 0.0 {
                    next.iter_mut().zip(source).for_each(|(next, source)| *next += factor * source);
                }
            }
        }
        let mut by_torque = vec![0.0; n];
        for (stage, (factor, inverse, _)) in solved.iter().enumerate() {
            let slope = stage_of(stage);
            let by_rate = &by_slopes[stage] * inverse;
            for row in 0..n_states {
                by_torque.iter_mut().enumerate().for_each(|(slot, by)| *by = by_rate[(row, n + slot)]);
                substitute(n, |place| factor[place], &mut by_torque);
                let next = &mut self.s_next[row * width..(row + 1) * width];
                for &(slot, column, place) in &self.places.torque_by_parameter {
                    next[column] += by_torque[slot] * slope(place);
                }
                for &(column, slot, place) in &self.places.regressor {
                    next[column] -= by_torque[slot] * slope(place);
                }
                for &(rate, column, place) in &self.places.rate_by_parameter {
                    next[column] += by_rate[(row, rate)] * slope(place);
                }
            }
        }
        std::mem::swap(&mut self.s, &mut self.s_next);
    }

    /// Corrects states and sensitivities after a sample of which `view` holds the prediction.
    fn correct(
        &mut self,
        system: &System,
        columns: &Columns,
        predictor: &Predictor<'_>,
        (time, sample): (&[f64], usize),
        view: &View,
    ) {
        let (n, width, span) = (system.n_free(), columns.width, Predictor::span(time, sample));
        let shown = &view.position;
        predictor.correct(system, time, sample, shown, &mut self.x);
        for (slot, row) in view.by_column.chunks_exact(width).enumerate() {
            let gains = Gains::of(predictor.rates[slot], span);
            let error = predictor.error(sample, slot, shown);
            let at_speed = system.states_at_speed().iter().filter(|(_, at)| *at == slot).map(|(state, _)| *state);
            let by_speed =
                std::iter::once(n + slot).chain(at_speed).map(|state| (state, gains.speed, gains.speed_by_rate));
            for (state, gain, by_rate) in
                std::iter::once((slot, gains.position, gains.position_by_rate)).chain(by_speed)
            {
                let sensitivities = &mut self.s[state * width..(state + 1) * width];
                for (sensitivity, by) in sensitivities.iter_mut().zip(row) {
                    *sensitivity -= gain * by;
                }
                if let Some(column) = columns.rates().nth(slot) {
                    sensitivities[column] += by_rate * error;
                }
            }
        }
    }

    /// Whether the last step passed this switch, and then whether upwards.
    fn passed(&self, system: &System, switch: Switch) -> Option<bool> {
        let rest = system.effect_parameters()[switch.qeq];
        let (before, after) = (self.q_before[switch.slot], self.x[switch.slot]);
        ((before < rest) != (after < rest)).then_some(after > before)
    }

    /// Where the last step, which ended at `t`, passed a rest position at which an effect jumps, S jumps along.
    fn jumps(&mut self, system: &System, columns: &Columns, t: f64, step: f64) {
        let n = system.n_free();
        let width = columns.width;
        for switch in self.switches.clone() {
            let Switch { slot, qeq, .. } = switch;
            let Some(rising) = self.passed(system, switch) else { continue };
            if !self.sides.jump(system, switch, t, &self.x, &self.scratch, rising, &mut self.jump) {
                continue;
            }
            // A joint that merely grazes its rest position within the step has no derivative there; this bounds it.
            let speed = (self.x[slot] - self.q_before[slot]) / step;
            let within_step = self.jump[slot] * step;
            let per_position = speed / (speed * speed + within_step * within_step);
            let (positions, speeds) = self.s.split_at_mut(n * width);
            let passing = &positions[slot * width..(slot + 1) * width];
            for (row, jump) in speeds.chunks_exact_mut(width).zip(&self.jump) {
                let factor = jump * per_position;
                row.iter_mut().zip(passing).for_each(|(row, passing)| *row += factor * passing);
                let column = columns.of_effect[qeq];
                if column != NONE {
                    row[column] -= factor;
                }
            }
        }
    }

    /// Linearises the equations at all stages, [`LANES`] at a time.
    fn linearise(&mut self, system: &System, columns: &Columns, span: &Span<'_>) {
        let (n, n_states) = (system.n_free(), self.x.len());
        self.slopes.clear();
        let mut commands = [self.command.clone(), self.command.clone()];
        let has_delays = !system.delays().is_empty();
        let mut slopes = [vec![0.0; system.delays().len()], vec![0.0; system.delays().len()]];
        for first in (0..self.steps * STAGES).step_by(LANES) {
            let pair = |values: &[f64], width: usize, k: usize| {
                Lanes::new([values[first * width + k], values[(first + 1) * width + k]])
            };
            for k in 0..n_states {
                self.x_lanes[k] = pair(&self.stage_x, n_states, k);
            }
            for slot in 0..n {
                self.ddq_lanes[slot] = pair(&self.stage_rate, n_states, n + slot);
            }
            if first == 0 || span.intersample == Intersample::FirstOrder || has_delays {
                self.linear.renew_drive();
                // Both stages are of one step.
                let index = self.first_step + first / STAGES;
                for ((command, slopes), t) in commands.iter_mut().zip(&mut slopes).zip(&self.stage_t[first..]) {
                    span.command(system, index, *t, command, Some(slopes));
                }
                if has_delays {
                    let [first, second] = &slopes;
                    self.linear.set_late(first.iter().zip(second).map(|(a, b)| Lanes::new([*a, *b])));
                }
                for (joint, lanes) in self.command_lanes.iter_mut().enumerate() {
                    *lanes = Lanes::new([commands[0][joint], commands[1][joint]]);
                }
            }
            let t = pair(&self.stage_t, 1, 0);
            self.linear.at(system, t, &self.x_lanes, &self.ddq_lanes, &self.command_lanes, &mut self.rate_lanes);
            if self.places.count == 0 {
                self.places = Places::new(&self.linear, system, columns);
            }
            let share = |k: usize| (self.stage_t[first + k] - span.start) / (span.end - span.start);
            self.keep(columns, Lanes::new([share(0), share(1)]));
        }
    }

    /// Appends the slopes of the equations as they are linearised now, at this share of the way between two samples.
    fn keep(&mut self, columns: &Columns, share: Lanes) {
        let Self { linear, slopes, places, .. } = self;
        let start = slopes.len();
        slopes.extend_from_slice(&linear.factor);
        slopes.extend_from_slice(&linear.torque_by_state);
        if columns.n_lumps > 0 {
            slopes.extend_from_slice(&linear.regressor);
        }
        let wanted = |parameter: usize| columns.of_effect[parameter] != NONE;
        slopes.extend(linear.torque_by_parameter.iter().filter(|entry| wanted(entry.1)).map(|entry| entry.2));
        slopes.extend(linear.rate_by_state.iter().map(|entry| entry.2));
        slopes.extend(linear.rate_by_parameter.iter().filter(|entry| wanted(entry.1)).map(|entry| entry.2));
        slopes.extend((0..columns.n_torques).map(|k| if k % 2 == 0 { Lanes::constant(1.0) - share } else { share }));
        assert_eq!(slopes.len() - start, places.count, "the places of the slopes are the same at every state");
    }

    /// Takes the sensitivities over the steps of the chunk.
    fn sensitivities(&mut self, system: &System, columns: &Columns, span: &Span<'_>) {
        pulp::Arch::new().dispatch(Sweep {
            variation: self,
            n: system.n_free(),
            width: columns.width,
            step: span.step(),
        });
        std::mem::swap(&mut self.s, &mut self.s_next);
    }
}

impl Places {
    fn new(linear: &Linear<Lanes>, system: &System, columns: &Columns) -> Self {
        let n = system.n_free();
        let first_regressor = n * n + linear.torque_by_state.len();
        let mut count = first_regressor + if columns.n_lumps > 0 { linear.regressor.len() } else { 0 };
        let mut place = |(row, other): (usize, usize)| {
            count += 1;
            (row, other, count - 1)
        };
        let column = |(row, parameter, _): &(usize, usize, Lanes)| {
            let column = columns.of_effect[*parameter];
            (column != NONE).then_some((*row, column))
        };
        let mut torque_by_parameter: Vec<_> =
            linear.torque_by_parameter.iter().filter_map(column).map(&mut place).collect();
        let states = linear.rate_by_state.iter().map(|(row, state, _)| (*row, *state));
        let rate_by_state = states.map(&mut place).collect();
        let rate_by_parameter = linear.rate_by_parameter.iter().filter_map(column).map(&mut place).collect();
        let torques = columns.torques().enumerate().map(|(k, column)| (k / 2, column));
        torque_by_parameter.extend(torques.map(&mut place));
        let regressor = if columns.n_lumps > 0 { occurring(system) } else { Vec::new() };
        let regressor = regressor
            .into_iter()
            .map(|(lump, slot)| (columns.first_lump + lump, slot, first_regressor + slot * columns.n_lumps + lump))
            .collect();
        Self { count, torque_by_parameter, rate_by_state, rate_by_parameter, regressor }
    }
}

/// Lump and free joint of the entries of the regressor that are not zero in every motion: those that are not at states
/// without any symmetry.
fn occurring(system: &System) -> Vec<(usize, usize)> {
    let (n, n_lumps) = (system.n_free(), system.kernel().n_lumps);
    let mut seen = vec![false; n * n_lumps];
    let mut regressor = vec![0.0; n * n_lumps];
    // Multiples of the golden ratio, modulo 1: they go on from state to state.
    let mut number = 0.0_f64;
    for _ in 0..3 {
        let mut vector = || -> Vec<f64> {
            let next = |_| {
                number = (number + 0.618_033_988_749_895).fract();
                number + 0.3
            };
            (0..n).map(next).collect()
        };
        let (q, dq, ddq) = (vector(), vector(), vector());
        system.kernel().functions.regressor(system.prepared(), &q, &dq, &ddq, &mut regressor);
        seen.iter_mut().zip(&regressor).for_each(|(seen, value)| *seen |= *value != 0.0);
    }
    let all = (0..n_lumps).flat_map(|lump| (0..n).map(move |slot| (lump, slot)));
    all.filter(|(lump, slot)| seen[slot * n_lumps + lump]).collect()
}

/// `S_next = W S + G`, by the widest vectors of rows that `pulp` knows of the processor (on x86 from AVX2 on): a row is the same bits in
/// any. With `k_i = A_i X_i + B_i` the slopes of the scheme, and `X_2 = S + h/2 k_1`, `X_3 = S + h/2 k_2`, `X_4 = S + h k_3`, a row w of
/// the result needs `w k_i` with the weights below, from the last slope to the first.
struct Sweep<'a> {
    variation: &'a mut Variation,
    /// Number of free joints.
    n: usize,
    /// Columns of the sensitivities.
    width: usize,
    /// Length of a step (s).
    step: f64,
}

impl pulp::WithSimd for Sweep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        // One pass where it can be: what a pass needs besides its rows is the same for all.
        match self.variation.x.len().div_ceil(S::F64_LANES) {
            1 => self.rows::<S, 1>(simd),
            2 => self.rows::<S, 2>(simd),
            3 => self.rows::<S, 3>(simd),
            _ => self.rows::<S, 4>(simd),
        }
    }
}

impl Sweep<'_> {
    /// `B` vectors of rows at a time.
    #[inline(always)]
    fn rows<S: pulp::Simd, const B: usize>(self, simd: S) {
        let Self { variation, n, width, step } = self;
        let (n_states, per_pass) = (variation.x.len(), B * S::F64_LANES);
        let [sixth, third, half] = [step / 6.0, step / 3.0, step / 2.0];
        let mut rows = Rows::<S, B>::new(simd, n, n_states, width);
        let places = &variation.places;
        let slopes_of = |stage: usize| {
            let first = stage / LANES * places.count;
            &variation.slopes[first..first + places.count]
        };
        for first_row in (0..n_states).step_by(per_pass) {
            rows.begin(first_row);
            for index in (0..variation.steps).rev() {
                let (late, early) = (slopes_of(index * STAGES + 2), slopes_of(index * STAGES));
                rows.stage::<1>(late, places, [sixth, 0.0]);
                rows.stage::<0>(late, places, [third, step]);
                rows.stage::<1>(early, places, [third, half]);
                rows.stage::<0>(early, places, [sixth, half]);
                rows.end_step();
            }
            let (by_column, w): (&[f64], &[f64]) =
                (cast_slice(rows.by_column.as_flattened()), cast_slice(rows.w.as_flattened()));
            for (row, next) in variation.s_next.chunks_exact_mut(width).enumerate().skip(first_row).take(per_pass) {
                for (next, by_column) in next.iter_mut().zip(by_column.chunks_exact(per_pass)) {
                    *next = by_column[row - first_row];
                }
                for (w, source) in w.chunks_exact(per_pass).zip(variation.s.chunks_exact(width)) {
                    let factor = w[row - first_row];
                    next.iter_mut().zip(source).for_each(|(next, source)| *next += factor * source);
                }
            }
        }
    }
}

/// A block of rows on their way back through the steps: what each depends on at the stage that was reached.
struct Rows<S: pulp::Simd, const B: usize> {
    simd: S,
    n: usize,
    /// By the states at the end of the current step.
    w: Vec<[S::f64s; B]>,
    /// By the states at its beginning, as far as known.
    w_next: Vec<[S::f64s; B]>,
    /// By the slope of the stage.
    by_slope: Vec<[S::f64s; B]>,
    /// By the states at the stage.
    by_state: Vec<[S::f64s; B]>,
    /// By the torques at the stage.
    by_torque: Vec<[S::f64s; B]>,
    /// By the unknowns.
    by_column: Vec<[S::f64s; B]>,
}

impl<S: pulp::Simd, const B: usize> Rows<S, B> {
    #[inline(always)]
    fn new(simd: S, n: usize, n_states: usize, width: usize) -> Self {
        let room = |length: usize| vec![[simd.splat_f64s(0.0); B]; length];
        Self {
            simd,
            n,
            w: room(n_states),
            w_next: room(n_states),
            by_slope: room(n_states),
            by_state: room(n_states),
            by_torque: room(n),
            by_column: room(width),
        }
    }

    /// Rows of the unit matrix from `first_row` on.
    #[inline(always)]
    fn begin(&mut self, first_row: usize) {
        let zero = [self.simd.splat_f64s(0.0); B];
        self.w.fill(zero);
        self.by_column.fill(zero);
        let per_pass = B * S::F64_LANES;
        let unit = cast_slice_mut::<_, f64>(self.w.as_flattened_mut())
            .chunks_exact_mut(per_pass)
            .skip(first_row)
            .take(per_pass);
        unit.enumerate().for_each(|(row, w)| w[row] = 1.0);
        self.w_next.copy_from_slice(&self.w);
    }

    /// Through one stage, whose slopes are in lane `LANE`. Its own slope counts `weights[0]` in the rows and
    /// `weights[1]` in the states of the stage after it.
    #[inline(always)]
    fn stage<const LANE: usize>(&mut self, slopes: &[Lanes], places: &Places, weights: [f64; 2]) {
        let (simd, n, n_states) = (self.simd, self.n, self.w.len());
        let [own, later] = weights.map(|weight| simd.splat_f64s(weight));
        for ((by_slope, w), by_state) in self.by_slope.iter_mut().zip(&self.w).zip(&self.by_state) {
            for k in 0..B {
                by_slope[k] = simd.mul_f64s(own, w[k]);
                if LANE == 0 || weights[1] != 0.0 {
                    by_slope[k] = simd.add_f64s(by_slope[k], simd.mul_f64s(later, by_state[k]));
                }
            }
        }
        let slope = |place: usize| simd.splat_f64s(slopes[place].to_array()[LANE]);
        let add_scaled = |target: &mut [S::f64s; B], factor: S::f64s, source: &[S::f64s; B]| {
            for k in 0..B {
                target[k] = simd.add_f64s(target[k], simd.mul_f64s(factor, source[k]));
            }
        };
        let subtract_scaled = |target: &mut [S::f64s; B], factor: S::f64s, source: &[S::f64s; B]| {
            for k in 0..B {
                target[k] = simd.sub_f64s(target[k], simd.mul_f64s(factor, source[k]));
            }
        };

        self.by_torque.copy_from_slice(&self.by_slope[n..2 * n]);
        for row in 1..n {
            let (above, below) = self.by_torque.split_at_mut(row);
            for (k, solved) in above.iter().enumerate() {
                subtract_scaled(&mut below[0], slope(row * n + k), solved);
            }
        }
        for row in (0..n).rev() {
            let (above, below) = self.by_torque.split_at_mut(row + 1);
            let reciprocal = slope(row * n + row);
            above[row].iter_mut().for_each(|value| *value = simd.mul_f64s(*value, reciprocal));
            for (k, solved) in below.iter().enumerate() {
                subtract_scaled(&mut above[row], slope((row + 1 + k) * n + row), solved);
            }
        }

        let zero = [simd.splat_f64s(0.0); B];
        self.by_state[..n].fill(zero);
        self.by_state[n..2 * n].copy_from_slice(&self.by_slope[..n]);
        self.by_state[2 * n..].fill(zero);
        for (row, torque) in self.by_torque.iter().enumerate() {
            let factors = &slopes[n * n + row * n_states..n * n + (row + 1) * n_states];
            for (by_state, factor) in self.by_state.iter_mut().zip(factors) {
                let factor = factor.to_array()[LANE];
                if factor != 0.0 {
                    add_scaled(by_state, simd.splat_f64s(factor), torque);
                }
            }
        }
        for &(row, state, place) in &places.rate_by_state {
            add_scaled(&mut self.by_state[state], slope(place), &self.by_slope[row]);
        }

        for &(slot, column, place) in &places.torque_by_parameter {
            add_scaled(&mut self.by_column[column], slope(place), &self.by_torque[slot]);
        }
        for &(row, column, place) in &places.rate_by_parameter {
            add_scaled(&mut self.by_column[column], slope(place), &self.by_slope[row]);
        }
        for of_column in places.regressor.chunk_by(|one, other| one.0 == other.0) {
            let column = of_column[0].0;
            let mut by_column = self.by_column[column];
            for &(_, slot, place) in of_column {
                subtract_scaled(&mut by_column, slope(place), &self.by_torque[slot]);
            }
            self.by_column[column] = by_column;
        }
        for (w_next, by_state) in self.w_next.iter_mut().zip(&self.by_state) {
            for k in 0..B {
                w_next[k] = simd.add_f64s(w_next[k], by_state[k]);
            }
        }
    }

    #[inline(always)]
    fn end_step(&mut self) {
        self.w.copy_from_slice(&self.w_next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_dynamics::system::fixtures::full_arm;

    /// Positions of the arm at the samples, with one number of the model or the start changed.
    fn positions(change: impl Fn(&mut [f64], &mut [f64], &mut [f64]), input: &Input<'_>) -> Vec<f64> {
        let mut system = full_arm();
        let mut links = system.link_parameters().to_vec();
        let mut effects = system.effect_parameters().to_vec();
        let mut q0 = [0.3, -0.5];
        change(&mut links, &mut effects, &mut q0);
        system.set_parameters(&links, &effects);
        dynid_dynamics::simulate::simulate(&system, input, &q0, &Options::per_sample(60)).unwrap().q
    }

    fn central(index: usize, size: f64, what: Which, input: &Input<'_>) -> Vec<f64> {
        let shifted = |sign: f64| {
            positions(
                |links, effects, q0| {
                    let target = match what {
                        Which::Link => links,
                        Which::Effect => effects,
                        Which::Start => q0,
                    };
                    target[index] += sign * size;
                },
                input,
            )
        };
        // Richardson's extrapolation of two central differences: the error is of fourth order.
        let (plus, minus) = (shifted(1.0), shifted(-1.0));
        let (plus2, minus2) = (shifted(2.0), shifted(-2.0));
        (0..plus.len()).map(|k| (8.0 * (plus[k] - minus[k]) - (plus2[k] - minus2[k])) / (12.0 * size)).collect()
    }

    #[derive(Clone, Copy, Debug)]
    enum Which {
        Link,
        Effect,
        Start,
    }

    #[test]
    fn sensitivities_are_the_derivatives_of_the_positions() {
        let system = full_arm();
        let samples = 61;
        let time: Vec<f64> = (0..samples).map(|k| f64::from(k) * 0.01).collect();
        let command: Vec<f64> = time.iter().flat_map(|t| [4.0 + (9.0 * t).sin(), 3.0 * (5.0 * t).cos()]).collect();
        for intersample in [Intersample::ZeroOrder, Intersample::FirstOrder] {
            let input = Input { time: &time, command: &command, intersample };
            let columns = Columns::new(&system, |_| true, Lumps::Wanted);
            let mut s = Vec::new();
            let mut q = Vec::new();
            simulate(&system, &columns, &input, &[0.3, -0.5], &Options::per_sample(60), |_, position, rows| {
                q.extend_from_slice(position);
                s.extend(rows.chunks(columns.width()).map(<[f64]>::to_vec));
            })
            .unwrap();
            for (with, plain) in q.iter().zip(positions(|_, _, _| {}, &input)) {
                assert!((with - plain).abs() < 1e-12, "{with} is not {plain}");
            }
            let compare = |which: Which, index: usize, size: f64, exact: Vec<f64>| {
                let difference = central(index, size, which, &input);
                let scale = exact.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
                assert!(scale > 0.0, "{which:?} {index} matters");
                let error = exact.iter().zip(&difference).fold(0.0_f64, |e, (a, b)| e.max((a - b).abs()));
                assert!(error <= 1e-5 * scale, "{which:?} {index}: {error} of {scale} ({intersample:?})");
            };
            for (index, value) in system.effect_parameters().iter().enumerate() {
                let column = columns.effect(index).unwrap();
                compare(Which::Effect, index, 1e-5 * value.abs(), s.iter().map(|row| row[column]).collect());
            }
            let n_links = system.link_parameters().len();
            let mut by_link = vec![0.0; system.kernel().prepared.len() * n_links];
            system.kernel().functions.prepare_gradient(system.link_parameters(), &[], &mut by_link);
            for (index, value) in system.link_parameters().iter().enumerate() {
                let chain = |row: &Vec<f64>| {
                    columns
                        .lumps()
                        .enumerate()
                        .map(|(lump, column)| row[column] * by_link[lump * n_links + index])
                        .sum()
                };
                compare(Which::Link, index, 1e-5 * value.abs(), s.iter().map(chain).collect());
            }
            for (slot, column) in columns.initial().enumerate() {
                compare(Which::Start, slot, 1e-4, s.iter().map(|row| row[column]).collect());
            }
        }
    }

    /// Both kinds of steps, in turn.
    const SCHEMES: [Scheme; 12] = [
        Scheme::Explicit(1),
        Scheme::Implicit(1),
        Scheme::Explicit(16),
        Scheme::Implicit(2),
        Scheme::Explicit(4),
        Scheme::Implicit(8),
        Scheme::Explicit(16),
        Scheme::Implicit(2),
        Scheme::Explicit(16),
        Scheme::Implicit(4),
        Scheme::Explicit(16),
        Scheme::Explicit(16),
    ];

    /// Predictions of the arm's samples, against positions that no model explains, at these rates.
    fn predictions(rates: &[f64; 2], viscous: f64, q0: &[f64; 2]) -> Vec<f64> {
        let (system, time, command, position) = predicted_arm(viscous);
        let predictor = Predictor { position: &position, rates, schemes: &SCHEMES };
        let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
        dynid_dynamics::simulate::predict(&system, &input, &predictor, q0, &Options::per_sample(60)).unwrap().q
    }

    fn predicted_arm(change: f64) -> (System, Vec<f64>, Vec<f64>, Vec<f64>) {
        let mut system = full_arm();
        let links = system.link_parameters().to_vec();
        let mut effects = system.effect_parameters().to_vec();
        effects[0] += change;
        system.set_parameters(&links, &effects);
        let time: Vec<f64> = (0..61).map(|k| f64::from(k) * 0.01).collect();
        let command = time.iter().flat_map(|t| [4.0 + (9.0 * t).sin(), 3.0 * (5.0 * t).cos()]).collect();
        let position = time.iter().flat_map(|t| [0.3 + 0.2 * (4.0 * t).sin(), -0.5 + 0.1 * (7.0 * t).cos()]).collect();
        (system, time, command, position)
    }

    #[test]
    fn predictions_have_exact_derivatives_by_parameters_rates_and_starts() {
        let (rates, q0) = ([20.0, 90.0], [0.31, -0.42]);
        let (system, time, command, position) = predicted_arm(0.0);
        let columns = Columns::new(&system, |_| true, Lumps::Wanted).predicting(2);
        let predictor = Predictor { position: &position, rates: &rates, schemes: &SCHEMES };
        let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
        let (mut q, mut s) = (Vec::new(), Vec::new());
        predict(&system, &columns, &input, &predictor, &q0, &Options::default(), |_, position, rows| {
            q.extend_from_slice(position);
            s.extend(rows.chunks(columns.width()).map(<[f64]>::to_vec));
        })
        .unwrap();
        for (with, plain) in q.iter().zip(predictions(&rates, 0.0, &q0)) {
            assert!((with - plain).abs() < 1e-12, "{with} is not {plain}");
        }
        let compare = |column: usize, size: f64, at: &dyn Fn(f64) -> Vec<f64>| {
            let (plus, minus) = (at(size), at(-size));
            let exact: Vec<f64> = s.iter().map(|row| row[column]).collect();
            let scale = exact.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
            assert!(scale > 0.0, "column {column} matters");
            for ((plus, minus), exact) in plus.iter().zip(&minus).zip(&exact) {
                let difference = (plus - minus) / (2.0 * size);
                assert!((difference - exact).abs() <= 1e-4 * scale, "column {column}: {difference} is not {exact}");
            }
        };
        let first_effect = columns.effect(0).unwrap();
        compare(first_effect, 1e-5, &|step| predictions(&rates, step, &q0));
        for slot in 0..2 {
            let rate = columns.rates().nth(slot).unwrap();
            compare(rate, 1e-3, &|step| {
                let mut rates = rates;
                rates[slot] += step;
                predictions(&rates, 0.0, &q0)
            });
            let start = columns.initial().nth(slot).unwrap();
            compare(start, 1e-5, &|step| {
                let mut q0 = q0;
                q0[slot] += step;
                predictions(&rates, 0.0, &q0)
            });
        }
    }

    /// The numeric solution has small steps of its own where the friction jumps, so the difference is a wide one of fine
    /// integration. Without the jumps of S the error would be a third of the derivative.
    #[test]
    fn sensitivities_jump_where_friction_does() {
        /// Where the first joint hangs.
        const REST: f64 = -1.5;
        let mut system = full_arm();
        let mut effects = system.effect_parameters().to_vec();
        let named = |name: &str| system.effect_names().iter().position(|known| known == name).unwrap();
        let (rest, bias) = (named("joint.0.spring.qeq"), named("joint.0.friction_bias.bias"));
        effects[rest] = REST;
        effects[bias] = 3.0;
        let links = system.link_parameters().to_vec();
        system.set_parameters(&links, &effects);
        let time: Vec<f64> = (0..=400).map(|k| f64::from(k) * 0.01).collect();
        let command: Vec<f64> = time.iter().flat_map(|t| [3.0 * (4.0 * t).sin(), 0.5 * (5.0 * t).cos()]).collect();
        let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
        let fine = Options::per_sample(400);
        let q0 = [-1.2, -0.5];
        let positions = |change: f64| {
            let mut effects = effects.clone();
            effects[rest] += change;
            let mut system = system.clone();
            system.set_parameters(&links, &effects);
            dynid_dynamics::simulate::simulate(&system, &input, &q0, &fine).unwrap().q
        };
        let (plus, minus) = (positions(1e-3), positions(-1e-3));
        let columns = Columns::new(&system, |_| true, Lumps::Wanted);
        let measured = vec![0.0; 2 * time.len()];
        // A simulation, and predictions that nothing corrects: their rates are 0.
        for scheme in [None, Some(Scheme::Explicit(256)), Some(Scheme::Implicit(256))] {
            let schemes = scheme.map(|scheme| vec![scheme; time.len() - 1]);
            let predictor =
                schemes.as_ref().map(|schemes| Predictor { position: &measured, rates: &[0.0; 2], schemes });
            let mut exact = Vec::new();
            let mut crossings = 0;
            let mut below = q0[0] < REST;
            along(&system, &columns, &input, predictor.as_ref(), &q0, &Options::default(), |_, position, rows| {
                crossings += usize::from((position[0] < REST) != below);
                below = position[0] < REST;
                exact.extend(rows.chunks(columns.width()).map(|row| row[columns.effect(rest).unwrap()]));
            })
            .unwrap();
            assert!(crossings >= 3, "{crossings} crossings");
            let scale = exact.iter().fold(0.0_f64, |scale, value| scale.max(value.abs()));
            let error = exact
                .iter()
                .zip(plus.iter().zip(&minus))
                .fold(0.0_f64, |error, (exact, (plus, minus))| error.max((exact - (plus - minus) / 2e-3).abs()));
            println!("{scheme:?}: {error:.2e} of {scale:.2e}, {crossings} crossings");
            assert!(error <= 5e-3 * scale, "{scheme:?}: {error} of {scale}");
        }
    }
}
