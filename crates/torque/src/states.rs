//! States of effects (LuGre's bristles) that follow the measured motion, with their exact sensitivities.
//!
//! States that depend on nothing but the motion and their own effect's parameters are integrated effect by effect: each
//! with as many steps as it needs, and only once for all models that have the same effect ([`Memory`]).

use std::sync::Arc;

use super::{Memory, Motion, Sample};
use dynid_dynamics::{
    system::Linear, system::NONE, system::Scratch, system::StateGroup, system::System, system::fastest_rate,
};

/// A step of the integration is at most this share of the fastest state's time constant; Runge-Kutta is stable up to 2.8.
const STEP_SHARE: f64 = 0.7;
/// Steps between two samples, at most.
const MOST_STEPS: usize = 400;

/// The states at every sample of a motion.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct States {
    pub(super) n_states: usize,
    /// For each state, where it is found: group and place in it.
    places: Vec<(usize, usize)>,
    groups: Vec<Group>,
}

/// Some states at every sample, and their derivatives.
#[derive(Debug, Clone, PartialEq)]
struct Group {
    /// n_samples x the group's states
    values: Arc<Vec<f64>>,
    /// For each of the group's states, the effect parameters that it depends on.
    parameters: Vec<Vec<usize>>,
    /// For each of the group's states, where its derivatives start in a row of `gradients`.
    starts: Vec<usize>,
    /// n_samples x width; empty without gradient
    gradients: Vec<f64>,
}

impl Group {
    fn n_states(&self) -> usize {
        self.parameters.len()
    }

    /// Length of a row of `gradients`.
    fn width(&self) -> usize {
        self.parameters.iter().map(Vec::len).sum()
    }
}

impl States {
    /// Writes all states at sample `k`.
    pub(super) fn at(&self, k: usize, states: &mut [f64]) {
        for (state, &(group, place)) in states.iter_mut().zip(&self.places) {
            let group = &self.groups[group];
            *state = group.values[k * group.n_states() + place];
        }
    }

    /// Derivatives of a state at sample `k`: effect parameter and value.
    pub(super) fn gradient(&self, k: usize, state: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let (group, place) = self.places[state];
        let group = &self.groups[group];
        let row = &group.gradients[k * group.width() + group.starts[place]..];
        group.parameters[place].iter().copied().zip(row.iter().copied())
    }
}

/// The states along `motion`; `None` where no effect has any.
pub(super) fn follow(system: &System, motion: &Motion, memory: Option<&Memory>) -> Option<States> {
    integrate(system, motion, &vec![Vec::new(); system.n_effect_states()], memory)
}

/// The states and their derivatives by the effect parameters along `motion`; `None` where no effect has states.
pub(super) fn follow_with_gradient(system: &System, motion: &Motion) -> Option<States> {
    integrate(system, motion, &system.state_parameters(), None)
}

fn integrate(system: &System, motion: &Motion, parameters: &[Vec<usize>], memory: Option<&Memory>) -> Option<States> {
    let n_states = system.n_effect_states();
    if n_states == 0 {
        return None;
    }
    let mut places = vec![(NONE, NONE); n_states];
    let mut groups = Vec::new();
    for (number, group) in system.state_groups().iter().enumerate() {
        for (place, &state) in group.states.iter().enumerate() {
            places[state] = (number, place);
        }
        let own = group.states.iter().map(|&state| parameters[state].clone()).collect();
        let key = memory.zip(system.state_key(group));
        groups.push(match key {
            None => integrate_group(system, motion, group, own),
            Some((memory, key)) => Group {
                values: memory.track(key, || {
                    let group = integrate_group(system, motion, group, own.clone());
                    Arc::unwrap_or_clone(group.values)
                }),
                starts: vec![0; own.len()],
                parameters: own,
                gradients: Vec::new(),
            },
        });
    }
    Some(States { n_states, places, groups })
}

/// Classical Runge-Kutta on the states `z' = f(z, q(t), dq(t))` and their sensitivities `S' = f_z S + f_p`. Positions and
/// speeds run straight between samples.
fn integrate_group(system: &System, motion: &Motion, group: &StateGroup<'_>, parameters: Vec<Vec<usize>>) -> Group {
    let n_states = parameters.len();
    let starts: Vec<usize> = parameters
        .iter()
        .scan(0, |next, own| {
            *next += own.len();
            Some(*next - own.len())
        })
        .collect();
    let width: usize = parameters.iter().map(Vec::len).sum();
    let mut field = Field::new(system, motion, group, &parameters, &starts);
    let steps = field.steps_between_samples();
    let step = motion.grid.step / steps as f64;
    // z and S together: z first, then the entries of S, state by state.
    let mut y = vec![0.0; n_states + width];
    let start = motion.q.iter().chain(&motion.dq).map(|values| values[0]).collect::<Vec<f64>>();
    let rest = system.rest(&start);
    for (y, state) in y.iter_mut().zip(&group.states) {
        *y = rest[2 * system.n_free() + state];
    }

    let (mut values, mut gradients) = (Vec::new(), Vec::new());
    let [mut k1, mut k2, mut k3, mut k4, mut at] = std::array::from_fn(|_| vec![0.0; n_states + width]);
    for k in 0..motion.len() {
        values.extend_from_slice(&y[..n_states]);
        gradients.extend_from_slice(&y[n_states..]);
        if k + 1 == motion.len() {
            break;
        }
        for index in 0..steps {
            let share = |part: f64| (index as f64 + part) / steps as f64;
            let moved = |at: &mut Vec<f64>, rate: &[f64], by: f64| {
                at.iter_mut().zip(y.iter().zip(rate)).for_each(|(at, (y, rate))| *at = y + by * step * rate);
            };
            field.rate(k, share(0.0), &y, &mut k1);
            moved(&mut at, &k1, 0.5);
            field.rate(k, share(0.5), &at, &mut k2);
            moved(&mut at, &k2, 0.5);
            field.rate(k, share(0.5), &at, &mut k3);
            moved(&mut at, &k3, 1.0);
            field.rate(k, share(1.0), &at, &mut k4);
            for (index, y) in y.iter_mut().enumerate() {
                *y += step / 6.0 * (k1[index] + 2.0 * (k2[index] + k3[index]) + k4[index]);
            }
        }
    }
    Group { values: Arc::new(values), parameters, starts, gradients }
}

/// The rates of a group's states and sensitivities.
struct Field<'a> {
    system: &'a System,
    motion: &'a Motion,
    group: &'a StateGroup<'a>,
    parameters: &'a [Vec<usize>],
    starts: &'a [usize],
    has_gradient: bool,
    /// For each state of the effects its place in the group, or [`NONE`].
    places: Vec<usize>,
    linear: Linear,
    scratch: Scratch,
    sample: Sample,
}

impl<'a> Field<'a> {
    fn new(
        system: &'a System,
        motion: &'a Motion,
        group: &'a StateGroup<'a>,
        parameters: &'a [Vec<usize>],
        starts: &'a [usize],
    ) -> Self {
        let mut places = vec![NONE; system.n_effect_states()];
        group.states.iter().enumerate().for_each(|(place, state)| places[*state] = place);
        Self {
            system,
            motion,
            group,
            parameters,
            starts,
            has_gradient: parameters.iter().any(|own| !own.is_empty()),
            places,
            linear: Linear::new(system),
            scratch: system.scratch(),
            sample: Sample::new(system),
        }
    }

    /// The place in the group of the state with this index in `x`.
    fn place(&self, state: usize) -> Option<usize> {
        let first = 2 * self.system.n_free();
        let place = *self.places.get(state.checked_sub(first)?)?;
        (place != NONE).then_some(place)
    }

    /// Rates of the group's states at the state in `self.sample`, with their gradients in `self.linear`.
    fn linearise(&mut self, time: f64) {
        let Sample { x, command, late, dx, .. } = &mut self.sample;
        self.linear.set_late(late.iter().copied());
        self.linear.follow(self.system, self.group, time, x, command, dx);
    }

    /// Rates of the group's states at the state in `self.sample`.
    fn evaluate(&mut self, time: f64) {
        let Sample { x, command, dx, .. } = &mut self.sample;
        self.system.follow(self.group, &mut self.scratch, time, x, command, dx);
    }

    /// Rates at `share` of the way from sample `k` to the next.
    fn rate(&mut self, k: usize, share: f64, y: &[f64], rate: &mut [f64]) {
        let n = self.system.n_free();
        let between = |values: &[f64]| values[k] + share * (values[k + 1] - values[k]);
        let Sample { x, command, .. } = &mut self.sample;
        for slot in 0..n {
            x[slot] = between(&self.motion.q[slot]);
            x[n + slot] = between(&self.motion.dq[slot]);
        }
        for (state, y) in self.group.states.iter().zip(y) {
            x[2 * n + state] = *y;
        }
        if self.group.reads_commands() {
            command.iter_mut().zip(&self.motion.command).for_each(|(value, command)| *value = between(command));
            self.sample.delay(self.motion, k as f64 + share);
        }
        let time = self.motion.elapsed_s(k) + share * self.motion.grid.step;
        if self.has_gradient {
            self.linearise(time);
        } else {
            self.evaluate(time);
        }
        let n_states = self.group.states.len();
        for (rate, state) in rate.iter_mut().zip(&self.group.states) {
            *rate = self.sample.dx[2 * n + state];
        }
        self.sensitivities(&y[n_states..], &mut rate[n_states..]);
    }

    /// `S' = f_z S + f_p`
    fn sensitivities(&self, s: &[f64], rate: &mut [f64]) {
        if rate.is_empty() {
            return;
        }
        rate.fill(0.0);
        for &(state, parameter, value) in &self.linear.rate_by_parameter {
            let Some(state) = self.place(state) else { continue };
            if let Some(column) = self.parameters[state].iter().position(|own| *own == parameter) {
                rate[self.starts[state] + column] += value;
            }
        }
        for &(state, other, value) in &self.linear.rate_by_state {
            let (Some(state), Some(other)) = (self.place(state), self.place(other)) else { continue };
            // States that depend on each other have the same parameters, in the same order.
            for column in 0..self.parameters[state].len().min(self.parameters[other].len()) {
                rate[self.starts[state] + column] += value * s[self.starts[other] + column];
            }
        }
    }

    /// Steps between samples so that the fastest state, at its initial value and far from it, is resolved everywhere.
    fn steps_between_samples(&mut self) -> usize {
        let mut fastest = 0.0_f64;
        let first = 2 * self.system.n_free();
        for k in 0..self.motion.len() {
            self.sample.load(self.motion, None, k);
            self.linearise(self.motion.elapsed_s(k));
            fastest = fastest.max(fastest_rate(&self.linear.rate_by_state, first));
            if self.group.reads_commands() && self.system.drive_has_states() {
                // A contact that is open at first closes.
                self.sample.x[first..].iter_mut().for_each(|state| *state += 1.0);
                self.linearise(self.motion.elapsed_s(k));
                self.sample.x[first..].iter_mut().for_each(|state| *state -= 1.0);
                fastest = fastest.max(fastest_rate(&self.linear.rate_by_state, first));
            }
        }
        ((fastest * self.motion.grid.step / STEP_SHARE).ceil() as usize).clamp(1, MOST_STEPS)
    }
}
