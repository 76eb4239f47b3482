//! What other equations would change about predictions, to first order: torques that they make beside those of the model pass through
//! the model's own linearised predictor.
//!
//! Between two samples the state obeys `dx_next = A dx + B f` and what is logged of it `dy = C dx_next + m`; the predictor then takes
//! `K dy` off. `A`, `B` and `C` are the model's ([`sensitivity::transitions`]) and serve for whatever is asked. `f` are the torques by
//! which the other equations miss the model's motion, and `m` what their sensors show differently. That is the derivative by
//! anything that a torque, an inertia or a sensor is linear in, but for how a torque bends within an interval. States that the model
//! has too are taken to go on as they do in it.

use dynid_dynamics::simulate::{Predictor, Scheme, SimulationError, correct_by, runge_kutta_estimated};
use dynid_dynamics::system::{Scratch, System};
use dynid_signal::statistics::rms;
use nalgebra::DMatrix;

use crate::position::FitRun;
use crate::sensitivity::{self, Columns, Transition};

/// Two points of Gauss in an interval: a torque that runs straight is found from its values there.
const POINTS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// Steps of an effect's own states to the first point, between the points, and to the end, at most; fewer where a formula of third order
/// differs by no more than this share of the largest that a state was so far.
const MOST_STEPS: usize = 4;
const ERROR: f64 = 1e-4;
/// What a state that was always smaller counts as.
const SMALL_STATE: f64 = 1e-9;

/// A predicted run, and how its predictions answer to torques.
pub(super) struct Predicted {
    run: FitRun,
    /// The model's equations.
    system: System,
    rates: Vec<f64>,
    columns: Columns,
    /// States at both ends of each interval.
    begin: Vec<f64>,
    end: Vec<f64>,
    /// States at its two points, accelerations there, and by what torque these equations miss them: by rounding.
    states: Vec<f64>,
    ddq: Vec<f64>,
    missed: Vec<f64>,
    /// Derivatives of each interval's end, n_states rows of all columns; and of what is logged of it, n_free rows, where a sensor shows
    /// something else than the position.
    end_by: Vec<f64>,
    shown_by: Option<Vec<f64>>,
}

/// Torques of the free joints at both ends of each interval, and what is logged differently at each sample.
struct Forces {
    torques: Vec<f64>,
    shown: Option<Vec<f64>>,
}

impl Forces {
    fn are_none(&self) -> bool {
        self.torques.iter().chain(self.shown.iter().flatten()).all(|value| *value == 0.0)
    }
}

impl Predicted {
    pub(super) fn new(
        run: &FitRun,
        system: System,
        rates: Vec<f64>,
        schemes: &[Scheme],
        initial: &[f64],
    ) -> Result<Self, SimulationError> {
        let columns = Columns::of_transitions(&system);
        let (mut begin, mut end, mut end_by) = (Vec::new(), Vec::new(), Vec::new());
        let mut shown_by = system.has_sensors().then(Vec::new);
        let count = columns.count();
        let observe = |transition: &Transition<'_>| {
            begin.extend_from_slice(transition.begin);
            end.extend_from_slice(transition.end);
            let rows = transition.end_by.chunks_exact(columns.width());
            rows.for_each(|row| end_by.extend_from_slice(&row[..count]));
            if let Some(shown_by) = &mut shown_by {
                let rows = transition.shown_by.chunks_exact(columns.width());
                rows.for_each(|row| shown_by.extend_from_slice(&row[..count]));
            }
        };
        let predictor = Predictor { position: &run.position, rates: &rates, schemes };
        sensitivity::transitions(&system, &columns, &run.input(), &predictor, initial, observe)?;
        let (states, ddq, missed) = (Vec::new(), Vec::new(), Vec::new());
        let run = run.clone();
        let mut predicted = Self { run, system, rates, columns, begin, end, states, ddq, missed, end_by, shown_by };
        predicted.look_between();
        Ok(predicted)
    }

    fn intervals(&self) -> usize {
        self.run.time.len().saturating_sub(1)
    }

    /// The model's state at a share of the way through an interval.
    fn state(&self, interval: usize, share: f64, x: &mut [f64]) {
        let (n, n_states) = (self.system.n_free(), self.system.n_states());
        let places = interval * n_states..(interval + 1) * n_states;
        let (begin, end) = (&self.begin[places.clone()], &self.end[places]);
        for state in n..n_states {
            x[state] = begin[state] + share * (end[state] - begin[state]);
        }
        let span = self.run.time[interval + 1] - self.run.time[interval];
        for slot in 0..n {
            let (speed, change) = (begin[n + slot], end[n + slot] - begin[n + slot]);
            let gone = |share: f64| span * share * (speed + 0.5 * share * change);
            x[slot] = begin[slot] + gone(share) + share * (end[slot] - begin[slot] - gone(1.0));
        }
    }

    fn time(&self, interval: usize, share: f64) -> f64 {
        let (begin, end) = (self.run.time[interval], self.run.time[interval + 1]);
        begin + share * (end - begin)
    }

    fn look_between(&mut self) {
        let (n, n_states) = (self.system.n_free(), self.system.n_states());
        let (mut x, mut missed) = (vec![0.0; n_states], vec![0.0; n]);
        let mut room = Room::new(&self.system);
        for interval in 0..self.intervals() {
            for (point, share) in POINTS.into_iter().enumerate() {
                let t = self.time(interval, share);
                self.state(interval, share, &mut x);
                let Room { scratch, command, dx, .. } = &mut room;
                self.run.input().command_at(&self.system, interval, (point, POINTS.len()), t, command);
                self.system.derivative(scratch, t, &x, command, dx);
                let ddq = dx[n..2 * n].to_vec();
                self.system.missing_torque(scratch, t, (&x, &ddq), command, dx, &mut missed);
                self.states.extend_from_slice(&x);
                self.ddq.extend_from_slice(&ddq);
                self.missed.extend_from_slice(&missed);
            }
        }
    }

    /// What `changed`, equations of the same run, makes differently; `None` where a number is none.
    fn forces(&self, changed: &System) -> Option<Forces> {
        if self.intervals() == 0 {
            return Some(Forces { torques: Vec::new(), shown: None });
        }
        let aligned = self.aligned(changed);
        // What both have alike takes the same torque of both.
        let apart = aligned.loads_apart(&self.system);
        let (changed, without) = match &apart {
            Some([with, without]) => (with, Some(without)),
            None => (&aligned, None),
        };
        let n = self.system.n_free();
        let input = self.run.input();
        // Where the model has the same state, it goes along; what is new starts as it does.
        let known: Vec<Option<usize>> = changed
            .state_names()
            .iter()
            .map(|name| Some(2 * n + self.system.state_names().iter().position(|own| own == name)?))
            .collect();
        let mut own = vec![0.0; self.system.n_states()];
        let mut x = changed.rest(&self.begin[..2 * n]);
        let take = |own: &[f64], x: &mut [f64]| {
            x[..2 * n].copy_from_slice(&own[..2 * n]);
            let places = known.iter().enumerate();
            places.filter_map(|(k, known)| Some((2 * n + k, (*known)?))).for_each(|(to, from)| x[to] = own[from]);
        };
        let has_new = known.iter().any(Option::is_none);
        /// Evaluations that a part of an interval takes to follow new states, at least.
        const FOLLOWED: usize = 5;
        let followed = if has_new { FOLLOWED * (POINTS.len() + 1) } else { 0 };
        changed.announce((POINTS.len() + followed) * self.intervals());
        without.iter().for_each(|without| {
            without.announce(POINTS.len() * self.intervals());
        });
        let (mut room, mut own_room) = (Room::new(changed), Room::new(&self.system));
        room.states.begin.copy_from_slice(&x[2 * n..]);
        let mut missing = vec![0.0; n];
        let mut torques = Vec::with_capacity(self.intervals() * 2 * n);
        let mut at = [vec![0.0; n], vec![0.0; n]];
        for interval in 0..self.intervals() {
            let mut share_before = 0.0;
            for (point, share) in POINTS.into_iter().enumerate() {
                if has_new {
                    self.follow(changed, interval, (share_before, share), &take, &mut own, &mut x, &mut room);
                }
                share_before = share;
                let t = self.time(interval, share);
                let place = interval * POINTS.len() + point;
                let n_own = own.len();
                let own_x = &self.states[place * n_own..(place + 1) * n_own];
                take(own_x, &mut x);
                let ddq = &self.ddq[place * n..(place + 1) * n];
                let Room { scratch, command, dx, .. } = &mut room;
                input.command_at(changed, interval, (point, POINTS.len()), t, command);
                match without {
                    Some(without) => {
                        changed.effects_alone(scratch, t, &x, command, dx);
                        without.effects_alone(&mut own_room.scratch, t, own_x, command, &mut own_room.dx);
                        for slot in 0..n {
                            at[point][slot] = own_room.scratch.load[slot] - scratch.load[slot];
                        }
                    }
                    None => {
                        changed.missing_torque(scratch, t, (&x, ddq), command, dx, &mut missing);
                        for slot in 0..n {
                            at[point][slot] = self.missed[place * n + slot] - missing[slot];
                        }
                    }
                }
            }
            if has_new {
                self.follow(changed, interval, (share_before, 1.0), &take, &mut own, &mut x, &mut room);
            }
            for slot in 0..n {
                torques.extend(to_ends(at[0][slot], at[1][slot]));
            }
        }
        let shown = (changed.has_sensors() || self.system.has_sensors()).then(|| {
            let mut shown = vec![0.0; (self.intervals() + 1) * n];
            let (mut with, mut without) = (vec![0.0; n], vec![0.0; n]);
            for (sample, shown) in shown.chunks_exact_mut(n).enumerate() {
                match sample.checked_sub(1) {
                    Some(interval) => self.state(interval, 1.0, &mut own),
                    None => {
                        let n_own = own.len();
                        own.copy_from_slice(&self.begin[..n_own]);
                    }
                }
                take(&own, &mut x);
                let t = self.run.time[sample];
                changed.measure(t, &x, &mut with);
                self.system.measure(t, &own, &mut without);
                (0..n).for_each(|slot| shown[slot] = with[slot] - without[slot]);
            }
            shown
        });
        torques.iter().chain(shown.iter().flatten()).all(|value| value.is_finite()).then_some(Forces { torques, shown })
    }

    /// Other equations with the model's own values, where they name the same.
    fn aligned(&self, changed: &System) -> System {
        let mut aligned = changed.clone();
        let own = self.system.effect_names().iter().zip(self.system.effect_parameters());
        let mut values = changed.effect_parameters().to_vec();
        for (name, value) in own {
            if let Some(place) = changed.effect_names().iter().position(|other| other == name) {
                values[place] = *value;
            }
        }
        aligned.set_parameters(self.system.link_parameters(), &values);
        aligned
    }

    /// Takes the new states of `changed` over a part of an interval, along the motion of the model.
    #[expect(clippy::too_many_arguments, reason = "room that is used again and again")]
    fn follow(
        &self,
        changed: &System,
        interval: usize,
        (from, to): (f64, f64),
        take: &impl Fn(&[f64], &mut [f64]),
        own: &mut [f64],
        x: &mut [f64],
        room: &mut Room,
    ) {
        let n = self.system.n_free();
        let input = self.run.input();
        let Room { scratch, command, dx, states } = room;
        let States { begin, z, stage, slope, sum, last_slope, error, largest, steps } = states;
        let (start, span) = (self.run.time[interval], self.run.time[interval + 1] - self.run.time[interval]);
        let mut rate = |_: usize, t: f64, z: &[f64], dz: &mut [f64]| {
            self.state(interval, (t - start) / span, own);
            x[2 * n..].copy_from_slice(z);
            take(own, x);
            input.command_at(changed, interval, (0, 1), t, command);
            changed.effects_alone(scratch, t, x, command, dx);
            dz.copy_from_slice(&dx[2 * n..]);
        };
        largest.iter_mut().zip(&*begin).for_each(|(largest, z)| *largest = largest.max(z.abs()));
        *steps = (*steps / 2).max(1);
        loop {
            let step = (to - from) * span / *steps as f64;
            z.copy_from_slice(begin);
            let room = [&mut *z, &mut *stage, &mut *slope, &mut *sum];
            let estimate = [&mut *last_slope, &mut *error];
            runge_kutta_estimated(&mut rate, (start + from * span, step, *steps), true, room, estimate);
            if *steps >= MOST_STEPS || error.iter().zip(&*largest).all(|(error, largest)| *error <= ERROR * largest) {
                break;
            }
            *steps *= 2;
        }
        begin.copy_from_slice(z);
        x[2 * n..].copy_from_slice(z);
    }

    /// Whether the equations `changed` make anything differently.
    pub(super) fn is_changed_by(&self, changed: &System) -> bool {
        !self.forces(changed).is_some_and(|forces| forces.are_none())
    }

    /// How the predictions of the samples that count change with the equations `changed`, one column a free joint; `None` where they make
    /// no numbers, and where they are no others, no columns.
    pub(super) fn to(&self, changed: &System) -> Option<Option<DMatrix<f64>>> {
        let forces = self.forces(changed)?;
        if forces.are_none() {
            return Some(None);
        }
        self.answer(&forces).map(Some)
    }

    /// As [`Predicted::to`], for a torque at one free joint, given at the two points of each interval.
    pub(super) fn to_torque(&self, slot: usize, torque: &[f64]) -> Option<DMatrix<f64>> {
        let n = self.system.n_free();
        let mut torques = vec![0.0; self.intervals() * 2 * n];
        for (interval, at) in torque.chunks_exact(2).enumerate() {
            let ends = to_ends(at[0], at[1]);
            torques[(interval * n + slot) * 2..][..2].copy_from_slice(&ends);
        }
        self.answer(&Forces { torques, shown: None })
    }

    fn answer(&self, forces: &Forces) -> Option<DMatrix<f64>> {
        let Forces { torques, shown } = forces;
        let (n, n_states, count) = (self.system.n_free(), self.system.n_states(), self.columns.count());
        let (first, samples) = (self.run.first_sample(), self.run.time.len());
        let mut answer = DMatrix::zeros(samples - first, n);
        // The states, then the torques of an interval.
        let mut cause = vec![0.0; count];
        let mut after = vec![0.0; n_states];
        let mut error = vec![0.0; n];
        let dot = |row: &[f64], cause: &[f64]| row.iter().zip(cause).map(|(by, cause)| by * cause).sum::<f64>();
        for sample in 0..samples {
            if let Some(interval) = sample.checked_sub(1) {
                cause[n_states..].copy_from_slice(&torques[interval * 2 * n..(interval + 1) * 2 * n]);
                let rows = &self.end_by[interval * n_states * count..(interval + 1) * n_states * count];
                after.iter_mut().zip(rows.chunks_exact(count)).for_each(|(after, row)| *after = dot(row, &cause));
                match &self.shown_by {
                    None => error.copy_from_slice(&after[..n]),
                    Some(shown_by) => {
                        let rows = &shown_by[interval * n * count..(interval + 1) * n * count];
                        error.iter_mut().zip(rows.chunks_exact(count)).for_each(|(own, row)| *own = dot(row, &cause));
                    }
                }
            }
            if let Some(shown) = &shown {
                error.iter_mut().zip(&shown[sample * n..]).for_each(|(error, shown)| *error += shown);
            }
            let span = Predictor::span(&self.run.time, sample);
            if sample >= first {
                (0..n).for_each(|slot| answer[(sample - first, slot)] = error[slot]);
            }
            // What is predicted more is an error less.
            correct_by(&self.system, &self.rates, span, |slot| -error[slot], &mut after);
            cause[..n_states].copy_from_slice(&after);
        }
        answer.iter().all(|value| value.is_finite()).then_some(answer)
    }

    /// The device's indices of the free joints.
    pub(super) fn free(&self) -> &'static [usize] {
        self.system.kernel().free
    }

    /// What moves and drives the model at the points.
    pub(super) fn signals(&self) -> Signals {
        let (n, n_states) = (self.system.n_free(), self.system.n_states());
        let points = self.intervals() * POINTS.len();
        let room = |width: usize| vec![Vec::with_capacity(points); width];
        let (mut q, mut dq, mut delivered) = (room(n), room(n), room(n));
        let (mut time, mut command) = (Vec::with_capacity(points), room(self.system.n_joints()));
        let Room { mut scratch, command: mut now, mut dx, .. } = Room::new(&self.system);
        let start = self.run.time.first().copied().unwrap_or(0.0);
        for (place, x) in self.states.chunks_exact(n_states).enumerate() {
            let (interval, point) = (place / POINTS.len(), place % POINTS.len());
            let t = self.time(interval, POINTS[point]);
            self.run.input().command_at(&self.system, interval, (point, POINTS.len()), t, &mut now);
            self.system.drive(&mut scratch, t, x, &now, &mut dx);
            time.push(t - start);
            command.iter_mut().zip(&now).for_each(|(all, now)| all.push(*now));
            for slot in 0..n {
                q[slot].push(x[slot]);
                dq[slot].push(x[n + slot]);
                delivered[slot].push(scratch.drive[slot]);
            }
        }
        let typical: Vec<f64> = self.free().iter().map(|joint| rms(&command[*joint])).collect();
        let per_command = self.system.drive_slope(&typical).0;
        Signals { time, q, dq, command, delivered, per_command }
    }
}

/// What moves and drives a model along its predictions: values at two points of each interval between samples.
pub struct Signals {
    /// Since the log's first sample (s).
    pub time: Vec<f64>,
    /// Positions and speeds of the free joints.
    pub q: Vec<Vec<f64>>,
    /// rad/s or m/s
    pub dq: Vec<Vec<f64>>,
    /// Commands of all joints.
    pub command: Vec<Vec<f64>>,
    /// Torques that the drive path delivers at the free joints [N*m or N].
    pub delivered: Vec<Vec<f64>>,
    /// Torque at each free joint per unit of its command.
    pub per_command: Vec<f64>,
}

/// At both ends of an interval, what runs straight through these values at its two points.
fn to_ends(first: f64, second: f64) -> [f64; 2] {
    let slope = (second - first) / (POINTS[1] - POINTS[0]);
    [first - POINTS[0] * slope, second + (1.0 - POINTS[1]) * slope]
}

/// Room for one evaluation of the equations.
struct Room {
    scratch: Scratch,
    command: Vec<f64>,
    dx: Vec<f64>,
    states: States,
}

/// The effects' states on their way along a motion.
struct States {
    /// Where the next part of the motion begins.
    begin: Vec<f64>,
    z: Vec<f64>,
    stage: Vec<f64>,
    slope: Vec<f64>,
    sum: Vec<f64>,
    last_slope: Vec<f64>,
    error: Vec<f64>,
    /// The largest that each was so far.
    largest: Vec<f64>,
    /// Steps that the last part took.
    steps: usize,
}

impl Room {
    fn new(system: &System) -> Self {
        let dx = vec![0.0; system.n_states()];
        let begin = system.initial_states().to_vec();
        let room = || begin.clone();
        let states = States {
            z: room(),
            stage: room(),
            slope: room(),
            sum: room(),
            last_slope: room(),
            error: room(),
            largest: vec![SMALL_STATE; begin.len()],
            steps: 1,
            begin: begin.clone(),
        };
        Self { scratch: system.scratch(), command: vec![0.0; system.n_joints()], dx, states }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_dynamics::simulate::{Intersample, Options, predict};
    use dynid_dynamics::system::PlacedEffect;
    use dynid_dynamics::system::fixtures::{
        ARM, GAIN, INPUT_COUPLING, INPUT_LAG, LUGRE, ROTOR_INERTIA, SPRING, VISCOUS, full_arm, placed,
    };

    const RATES: [f64; 2] = [20.0, 60.0];
    const START: [f64; 2] = [0.31, -0.42];

    /// The arm with friction that has states, and these effects beside it.
    fn arm(more: &[PlacedEffect]) -> System {
        let mut effects = vec![
            placed(&GAIN, 0, None, &[1.4]),
            placed(&SPRING, 0, None, &[0.9, 2.5]),
            placed(&LUGRE, 1, None, &[2.0, 0.2, 0.03, 0.1, 0.2, 0.1]),
        ];
        effects.extend_from_slice(more);
        System::new(&ARM, 2, full_arm().link_parameters().to_vec(), Vec::new(), &effects).unwrap()
    }

    /// A run of the arm that no model explains.
    fn run(system: &System) -> FitRun {
        let time: Vec<f64> = (0..81).map(|k| f64::from(k) * 0.01).collect();
        let command = time.iter().flat_map(|t| [4.0 + (9.0 * t).sin(), 3.0 * (5.0 * t).cos()]).collect();
        let position = time.iter().flat_map(|t| [0.3 + 0.2 * (4.0 * t).sin(), -0.5 + 0.1 * (7.0 * t).cos()]).collect();
        FitRun {
            name: String::new(),
            system: system.clone(),
            time,
            command,
            position,
            intersample: Intersample::ZeroOrder,
            weights: vec![1.0; 2],
            from_s: 0.1,
            first_half: 1.0,
            moving: false,
        }
    }

    /// The predictions themselves, of other equations.
    fn predictions(system: &System, run: &FitRun, schemes: &[Scheme]) -> Vec<f64> {
        let predictor = Predictor { position: &run.position, rates: &RATES, schemes };
        predict(system, &run.input(), &predictor, &START, &Options::default()).unwrap().q
    }

    /// Torques of every kind, and an inertia, small enough for the first order; then a lag of the drive, which is none.
    #[test]
    fn predictions_answer_to_other_equations() {
        let base = arm(&[]);
        let run = run(&base);
        for schemes in [[Scheme::Explicit(16); 80], [Scheme::Implicit(2); 80]] {
            let predicted = Predicted::new(&run, base.clone(), RATES.to_vec(), &schemes, &START).unwrap();
            assert!(predicted.to(&base).unwrap().is_none());
            let before = predictions(&base, &run, &schemes);
            for (more, tolerance) in [
                (placed(&VISCOUS, 0, None, &[1e-4]), 1e-2),
                (placed(&ROTOR_INERTIA, 1, None, &[1e-6]), 1e-2),
                (placed(&INPUT_COUPLING, 1, Some(0), &[1e-5]), 1e-2),
                (placed(&SPRING, 1, None, &[1e-4, 0.3]), 1e-2),
                (placed(&INPUT_LAG, 0, None, &[0.03]), 3e-2),
            ] {
                let name = more.names[0].clone();
                let changed = arm(&[more]);
                let answer = predicted.to(&changed).unwrap().unwrap();
                let after = predictions(&changed, &run, &schemes);
                let first = run.first_sample();
                let difference = |k: usize| after[2 * first + k] - before[2 * first + k];
                let scale = (0..2 * answer.nrows()).map(|k| difference(k).abs()).fold(0.0, f64::max);
                assert!(scale > 0.0, "{name} matters");
                for k in 0..2 * answer.nrows() {
                    let (exact, found) = (difference(k), answer[(k / 2, k % 2)]);
                    assert!((exact - found).abs() <= tolerance * scale, "{name}, {k}: {found} is not {exact}");
                }
            }
        }
    }
}
