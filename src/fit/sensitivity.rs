//! Positions of a run and their derivatives by the unknowns, integrated along (forward sensitivities).
//!
//! The columns of `S = dx/du` obey `dS/dt = f_x S + f_u`, integrated by the same Runge-Kutta steps as the state, so that
//! S is the exact derivative of the numeric solution; where an effect jumps at a joint's rest position, S jumps as that of
//! the exact solution does. Columns are, in this order: the wanted effect parameters, the
//! kernel's lumps (all unknown inertial parameters act through them: `ds/dp = ds/dlump dlump/dp`), and the initial
//! positions of the free joints. A row of S holds all columns of one state, padded to whole blocks.

use crate::{
    simulate::{Grid, Hold, Input, Options, SimulationError, Tether, check, check_state, interpolate},
    system::{Linear, NONE, Switch, System, solve_columns},
};

/// Columns come in blocks of this many: what one cache line holds, and whole vector registers of any width.
const BLOCK: usize = 8;

/// Which derivative stands in which column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Columns {
    /// Column of each effect parameter of the system, or `usize::MAX`.
    of_effect: Vec<usize>,
    first_lump: usize,
    n_lumps: usize,
    n_free: usize,
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
        let n_free = system.n_free();
        let width = (count + n_lumps + n_free).next_multiple_of(BLOCK);
        Self { of_effect, first_lump: count, n_lumps, n_free, width }
    }

    /// Column of an effect parameter, by its index in [`System::effect_parameters`].
    pub fn effect(&self, parameter: usize) -> Option<usize> {
        self.of_effect.get(parameter).copied().filter(|column| *column != NONE)
    }

    /// Columns of the lumps; empty where they are not wanted.
    pub fn lumps(&self) -> std::ops::Range<usize> {
        self.first_lump..self.first_lump + self.n_lumps
    }

    /// Columns of the initial positions.
    pub fn initial(&self) -> std::ops::Range<usize> {
        let first = self.first_lump + self.n_lumps;
        first..first + self.n_free
    }

    /// Number of columns in use.
    pub fn count(&self) -> usize {
        self.initial().end
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

/// Simulates from rest at `q0`, on a tether if one is given, and hands every sample to `observe`: its index, the logged positions of the free joints
/// and their derivatives, n_free x width.
pub fn simulate(
    system: &System,
    columns: &Columns,
    input: &Input<'_>,
    tether: Option<&Tether<'_>>,
    q0: &[f64],
    options: &Options,
    mut observe: impl FnMut(usize, &[f64], &[f64]),
) -> Result<(), SimulationError> {
    check(system, input, q0)?;
    let n = system.n_free();
    let n_joints = system.n_joints();
    let mut motion = Variation::new(system, columns, q0);
    let mut view = View::new(system, columns);
    check_state(system, 0.0, &motion.x, options)?;
    view.show(system, columns, input.time.first().copied().unwrap_or(0.0), &mut motion, 0, &mut observe);
    let grid = Grid::new(input.time, options.substeps);
    let mut command = vec![0.0; n_joints];
    for (sample, rows) in input.command.windows(2 * n_joints).step_by(n_joints).enumerate() {
        let (now, next) = rows.split_at(n_joints);
        let (start, end) = (input.time[sample], input.time[sample + 1]);
        let steps = grid.steps(start, end);
        let step = (end - start) / steps as f64;
        motion.linear.renew_drive();
        for k in 0..steps {
            let commanded = |t: f64, command: &mut [f64]| match input.hold {
                Hold::Zero => command.copy_from_slice(now),
                Hold::Linear => interpolate((t - start) / (end - start), now, next, command),
            };
            let pull = |t: f64, x: &[f64], dx: &mut [f64]| match tether {
                Some(tether) => {
                    for slot in 0..n {
                        let (q, dq) = tether.target(slot, n, sample, (t - start) / (end - start), end - start);
                        dx[n + slot] += tether.rate * (tether.rate * (q - x[slot]) + 2.0 * (dq - x[n + slot]));
                    }
                    tether.rate
                }
                None => 0.0,
            };
            motion.step(system, columns, start + k as f64 * step, step, input.hold, &mut command, commanded, pull);
        }
        check_state(system, end, &motion.x, options)?;
        view.show(system, columns, end, &mut motion, sample + 1, &mut observe);
    }
    Ok(())
}

/// What the log shows of a state and its derivatives.
struct View {
    position: Vec<f64>,
    by_column: Vec<f64>,
}

impl View {
    fn new(system: &System, columns: &Columns) -> Self {
        let room = if system.has_sensors() { system.n_free() * columns.width } else { 0 };
        Self { position: vec![0.0; system.n_free()], by_column: vec![0.0; room] }
    }

    fn show(
        &mut self,
        system: &System,
        columns: &Columns,
        t: f64,
        motion: &mut Variation,
        sample: usize,
        observe: &mut impl FnMut(usize, &[f64], &[f64]),
    ) {
        let n = system.n_free();
        let rows = &motion.s[..n * columns.width];
        if system.has_sensors() {
            self.by_column.copy_from_slice(rows);
            let (position, by_column) = (&mut self.position, &mut self.by_column);
            motion.linear.measure(system, t, &motion.x, position, by_column, &columns.of_effect);
            observe(sample, &self.position, &self.by_column);
        } else {
            observe(sample, &motion.x[..n], rows);
        }
    }
}

/// State and sensitivities on their way, with the room that a step needs.
struct Variation {
    linear: Linear,
    x: Vec<f64>,
    x_stage: Vec<f64>,
    x_rate: Vec<f64>,
    x_sum: Vec<f64>,
    s: Vec<f64>,
    s_stage: Vec<f64>,
    s_rate: Vec<f64>,
    s_sum: Vec<f64>,
    switches: Vec<Switch>,
    /// Positions of the switching joints at the start of a step.
    q_before: Vec<f64>,
    jump: Vec<f64>,
}

impl Variation {
    fn new(system: &System, columns: &Columns, q0: &[f64]) -> Self {
        let x = system.rest(q0);
        let mut s = vec![0.0; x.len() * columns.width];
        for (slot, column) in columns.initial().enumerate() {
            s[slot * columns.width + column] = 1.0;
        }
        Self {
            linear: Linear::new(system),
            x_stage: x.clone(),
            x_rate: x.clone(),
            x_sum: x.clone(),
            x,
            s_stage: s.clone(),
            s_rate: s.clone(),
            s_sum: s.clone(),
            s,
            switches: system.switches(),
            q_before: q0.to_vec(),
            jump: vec![0.0; system.n_free()],
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn step(
        &mut self,
        system: &System,
        columns: &Columns,
        t: f64,
        step: f64,
        hold: Hold,
        command: &mut [f64],
        commanded: impl Fn(f64, &mut [f64]),
        pull: impl Fn(f64, &[f64], &mut [f64]) -> f64,
    ) {
        /// Where a stage stands, what its slope weighs in the sum, and how far the next stage goes with it.
        const STAGES: [(f64, f64, f64); 4] = [(0.0, 1.0, 0.5), (0.5, 2.0, 0.5), (0.5, 2.0, 1.0), (1.0, 1.0, 0.0)];
        self.q_before.copy_from_slice(&self.x[..system.n_free()]);
        self.x_stage.copy_from_slice(&self.x);
        self.s_stage.copy_from_slice(&self.s);
        for (stage, (share, weight, reach)) in STAGES.into_iter().enumerate() {
            let now = t + share * step;
            commanded(now, command);
            if hold == Hold::Linear {
                self.linear.renew_drive();
            }
            self.linear.update(system, now, &self.x_stage, command, &mut self.x_rate);
            let tether_rate = pull(now, &self.x_stage, &mut self.x_rate);
            rates(&self.linear, system, columns, &self.s_stage, &mut self.s_rate);
            if tether_rate > 0.0 {
                let n = system.n_free() * columns.width;
                let (q, dq) = self.s_stage[..2 * n].split_at(n);
                for ((rate, q), dq) in self.s_rate[n..2 * n].iter_mut().zip(q).zip(dq) {
                    *rate -= tether_rate * (tether_rate * q + 2.0 * dq);
                }
            }
            let ahead = reach * step;
            if stage == 0 {
                begin(&self.x, &self.x_rate, &mut self.x_sum, ahead, &mut self.x_stage);
                begin(&self.s, &self.s_rate, &mut self.s_sum, ahead, &mut self.s_stage);
            } else if stage < 3 {
                proceed(&self.x, &self.x_rate, weight, &mut self.x_sum, ahead, &mut self.x_stage);
                proceed(&self.s, &self.s_rate, weight, &mut self.s_sum, ahead, &mut self.s_stage);
            } else {
                conclude(&mut self.x, &self.x_rate, &self.x_sum, step / 6.0);
                conclude(&mut self.s, &self.s_rate, &self.s_sum, step / 6.0);
            }
        }
        for index in 0..self.switches.len() {
            self.switch(system, columns, self.switches[index], t + step, step);
        }
    }

    /// Where the last step passed a rest position at which an effect jumps, S jumps along.
    fn switch(&mut self, system: &System, columns: &Columns, switch: Switch, t: f64, step: f64) {
        let n = system.n_free();
        let width = columns.width;
        let Switch { slot, qeq, .. } = switch;
        let rest = system.effect_parameters()[qeq];
        let (before, after) = (self.q_before[slot], self.x[slot]);
        if (before < rest) == (after < rest) {
            return;
        }
        if !self.linear.jump(system, switch, t, &self.x, after > before, &mut self.jump) {
            return;
        }
        // A joint that merely grazes its rest position within the step has no derivative there; this bounds it.
        let speed = (after - before) / step;
        let within_step = self.jump[slot] * step;
        let per_position = speed / (speed * speed + within_step * within_step);
        let (positions, speeds) = self.s.split_at_mut(n * width);
        let passing = &positions[slot * width..(slot + 1) * width];
        for (row, jump) in self.jump.iter().enumerate() {
            let factor = jump * per_position;
            add_scaled(&mut speeds[row * width..(row + 1) * width], factor, passing);
            let column = columns.of_effect[qeq];
            if column != NONE {
                speeds[row * width + column] -= factor;
            }
        }
    }
}

fn begin(base: &[f64], rate: &[f64], sum: &mut [f64], ahead: f64, stage: &mut [f64]) {
    for (((base, rate), sum), stage) in base.iter().zip(rate).zip(sum).zip(stage) {
        *sum = *rate;
        *stage = base + ahead * rate;
    }
}

fn proceed(base: &[f64], rate: &[f64], weight: f64, sum: &mut [f64], ahead: f64, stage: &mut [f64]) {
    for (((base, rate), sum), stage) in base.iter().zip(rate).zip(sum).zip(stage) {
        *sum += weight * rate;
        *stage = base + ahead * rate;
    }
}

fn conclude(base: &mut [f64], rate: &[f64], sum: &[f64], share: f64) {
    for ((base, rate), sum) in base.iter_mut().zip(rate).zip(sum) {
        *base += share * (sum + rate);
    }
}

/// `dS/dt` from the linearised equations.
fn rates(linear: &Linear, system: &System, columns: &Columns, s: &[f64], s_rate: &mut [f64]) {
    let n = system.n_free();
    let n_states = system.n_states();
    let width = columns.width;
    let (position_rates, rest) = s_rate.split_at_mut(n * width);
    let (speed_rates, effect_rates) = rest.split_at_mut(n * width);
    position_rates.copy_from_slice(&s[n * width..2 * n * width]);

    for (factors, row) in linear.torque_by_state.chunks_exact(n_states).zip(speed_rates.chunks_exact_mut(width)) {
        combine(factors, s, row);
    }
    for &(slot, parameter, value) in &linear.torque_by_parameter {
        let column = columns.of_effect[parameter];
        if column != NONE {
            speed_rates[slot * width + column] += value;
        }
    }
    if columns.n_lumps > 0 {
        for (regressor, row) in linear.regressor.chunks_exact(columns.n_lumps).zip(speed_rates.chunks_exact_mut(width))
        {
            for (value, by_lump) in row[columns.lumps()].iter_mut().zip(regressor) {
                *value -= by_lump;
            }
        }
    }
    solve_columns(n, &linear.factor, speed_rates, width);

    effect_rates.fill(0.0);
    for &(state, variable, value) in &linear.rate_by_state {
        let row = state - 2 * n;
        let target = &mut effect_rates[row * width..(row + 1) * width];
        add_scaled(target, value, &s[variable * width..(variable + 1) * width]);
    }
    for &(state, parameter, value) in &linear.rate_by_parameter {
        let column = columns.of_effect[parameter];
        if column != NONE {
            effect_rates[(state - 2 * n) * width + column] += value;
        }
    }
}

/// `row = factors . s`, block by block, so that a block's sum stays in registers.
fn combine(factors: &[f64], s: &[f64], row: &mut [f64]) {
    let width = row.len();
    let (blocks, _) = row.as_chunks_mut::<BLOCK>();
    for (block, target) in blocks.iter_mut().enumerate() {
        let mut sum = [0.0; BLOCK];
        for (factor, source) in factors.iter().zip(s.chunks_exact(width)) {
            if *factor == 0.0 {
                continue;
            }
            if let Some(source) = source.as_chunks::<BLOCK>().0.get(block) {
                for (sum, source) in sum.iter_mut().zip(source) {
                    *sum += factor * source;
                }
            }
        }
        *target = sum;
    }
}

fn add_scaled(target: &mut [f64], factor: f64, source: &[f64]) {
    let (targets, sources) = (target.as_chunks_mut::<BLOCK>().0, source.as_chunks::<BLOCK>().0);
    for (target, source) in targets.iter_mut().zip(sources) {
        for (target, source) in target.iter_mut().zip(source) {
            *target += factor * source;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::tests::full_arm;

    /// Positions of the arm at the samples, with one number of the model or the start changed.
    fn positions(change: impl Fn(&mut [f64], &mut [f64], &mut [f64]), input: &Input<'_>) -> Vec<f64> {
        let mut system = full_arm();
        let mut links = system.link_parameters().to_vec();
        let mut effects = system.effect_parameters().to_vec();
        let mut q0 = [0.3, -0.5];
        change(&mut links, &mut effects, &mut q0);
        system.set_parameters(&links, &effects);
        crate::simulate::simulate(&system, input, &q0, &Options::default()).unwrap().q
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
        for hold in [Hold::Zero, Hold::Linear] {
            let input = Input { time: &time, command: &command, hold };
            let columns = Columns::new(&system, |_| true, Lumps::Wanted);
            let mut s = Vec::new();
            let mut q = Vec::new();
            simulate(&system, &columns, &input, None, &[0.3, -0.5], &Options::default(), |_, position, rows| {
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
                assert!(error <= 1e-5 * scale, "{which:?} {index}: {error} of {scale} ({hold:?})");
            };
            for (index, value) in system.effect_parameters().iter().enumerate() {
                let column = columns.effect(index).unwrap();
                compare(Which::Effect, index, 1e-5 * value.abs(), s.iter().map(|row| row[column]).collect());
            }
            let n_links = system.link_parameters().len();
            let mut by_link = vec![0.0; system.kernel().prepared.len() * n_links];
            (system.kernel().prepare_gradient)(system.link_parameters(), &[], &mut by_link);
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
        system.set_parameters(&system.link_parameters().to_vec(), &effects);
        let time: Vec<f64> = (0..=400).map(|k| f64::from(k) * 0.01).collect();
        let command: Vec<f64> = time.iter().flat_map(|t| [3.0 * (4.0 * t).sin(), 0.5 * (5.0 * t).cos()]).collect();
        let input = Input { time: &time, command: &command, hold: Hold::Zero };
        let fine = Options { substeps: 400, ..Options::default() };
        let q0 = [-1.2, -0.5];
        let positions = |change: f64| {
            let mut effects = effects.clone();
            effects[rest] += change;
            let mut system = system.clone();
            system.set_parameters(&system.link_parameters().to_vec(), &effects);
            crate::simulate::simulate(&system, &input, &q0, &fine).unwrap().q
        };
        let (plus, minus) = (positions(1e-3), positions(-1e-3));
        let columns = Columns::new(&system, |_| true, Lumps::Wanted);
        let mut exact = Vec::new();
        let mut crossings = 0;
        let mut below = q0[0] < REST;
        simulate(&system, &columns, &input, None, &q0, &Options::default(), |_, position, rows| {
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
        println!("{error:.2e} of {scale:.2e}, {crossings} crossings");
        assert!(error <= 5e-3 * scale, "{error} of {scale}");
    }
}
