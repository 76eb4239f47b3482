//! Steps as short as a tolerance asks for, interval by interval.

use std::ops::Range;

use super::{Input, Scheme, Stepper};
use crate::system::System;

/// A nudge to a state, as a share of what an interval may err by, and how much larger it may be at the interval's end.
const NUDGE: f64 = 1e-4;
const MOST_GROWTH: f64 = 10.0;
/// Share of what it is larger by that halved steps may change.
const ALIKE: f64 = 0.1;
/// The state of an effect that is smaller than this is nudged as if it were so large.
const SMALL_STATE: f64 = 1e-6;

/// What steps are chosen to leave unused of the tolerance, so that the next interval need not be tried twice.
const RESERVE: f64 = 1.5;
/// Orders by which numbers of steps are foreseen: those of the schemes. The embedded formula's, one less, would use up the reserve.
const EXPLICIT_ORDER: f64 = 4.0;
const IMPLICIT_ORDER: f64 = 3.0;
/// Share of the third-order formula's difference that counts as error. Where one joint or six with LuGre friction take 3 to 12 steps of a
/// sample of 10 ms, half of the steps err by a tenth of it at most, and none by a third.
const OF_THIRD_ORDER: f64 = 0.1;
/// How many times more steps are tried at once, at most.
const MOST_MORE: f64 = 4.0;
/// Explicit steps that are tried first where the interval before took implicit ones.
const AFTER_IMPLICIT: f64 = 12.0;

/// What an interval may err by.
pub(super) enum Tolerance {
    /// By this in the position of each free joint [rad or m] after as long an interval again: in its position and in its speed together.
    Position(Vec<f64>),
    /// In each state, this share of the largest that it was so far.
    Share(f64, Vec<f64>),
}

impl Tolerance {
    /// What a position or a speed that was always smaller counts as [rad, m, rad/s or m/s].
    const SMALL_MOTION: f64 = 1e-3;

    pub(super) fn of_positions(tolerance: &[f64]) -> Self {
        Self::Position(tolerance.to_vec())
    }

    pub(super) fn of_all(system: &System, share: f64) -> Self {
        let (n, n_states) = (system.n_free(), system.n_states());
        let small = |state: usize| if state < 2 * n { Self::SMALL_MOTION } else { SMALL_STATE };
        Self::Share(share, (0..n_states).map(small).collect())
    }

    /// What each of the first states may err by at the end of an interval of `span` (s); those after them may by anything.
    fn by_state(&self, span: f64) -> impl Iterator<Item = f64> + Clone {
        let (positions, span, share, largest) = match self {
            Self::Position(positions) => (positions.as_slice(), span, 0.0, [].as_slice()),
            Self::Share(share, largest) => ([].as_slice(), span, *share, largest.as_slice()),
        };
        // Half of it each.
        let speeds = positions.iter().map(move |tolerance| 0.5 * tolerance / span);
        positions
            .iter()
            .map(|tolerance| 0.5 * tolerance)
            .chain(speeds)
            .chain(largest.iter().map(move |largest| share * largest))
    }

    /// Sees the state that an interval begins with.
    fn see(&mut self, x: &[f64]) {
        if let Self::Share(_, largest) = self {
            largest.iter_mut().zip(x).for_each(|(largest, x)| *largest = largest.max(x.abs()));
        }
    }
}

/// Chooses the steps of one interval after the other.
///
/// What an explicit step of fourth order errs by is estimated from what a third-order formula with the same slopes makes of it,
/// `h/6 (k4 - f(end))` ([`OF_THIRD_ORDER`]). Implicit steps are compared with halved ones.
pub(super) struct Adaptation<'a> {
    tolerance: Tolerance,
    /// Never fewer steps than these; none where it is empty.
    least: &'a [Scheme],
    /// Whether derivatives are taken of what comes out: then no step may be so long that a nudge to the state grows
    /// which with halved steps does not.
    is_differentiated: bool,
    /// Explicit steps that the last interval suggests.
    suggested: f64,
    begin: Vec<f64>,
    end: Vec<f64>,
    /// End of what errs least of what was tried and is not good enough.
    least_off: Vec<f64>,
}

impl<'a> Adaptation<'a> {
    pub(super) fn new(system: &System, tolerance: Tolerance, least: &'a [Scheme], is_differentiated: bool) -> Self {
        let room = vec![0.0; system.n_states()];
        Self {
            tolerance,
            least,
            is_differentiated,
            suggested: 1.0,
            begin: room.clone(),
            end: room.clone(),
            least_off: room,
        }
    }

    /// Takes a stepper from a sample to the next; returns how.
    pub(super) fn cross(&mut self, stepper: &mut Stepper, system: &System, input: &Input<'_>, sample: usize) -> Scheme {
        let span = input.time[sample + 1] - input.time[sample];
        self.begin.copy_from_slice(&stepper.x);
        self.tolerance.see(&self.begin);
        let first = self.least.get(sample);
        let most_explicit = if self.is_differentiated { Scheme::MOST_REPEATED } else { u32::MAX };
        let mut place = first.and_then(|first| Scheme::LADDER.iter().position(|own| own == first)).unwrap_or(0);
        let (mut least_explicit, mut least_implicit) = (if first.is_some() { 0.0 } else { self.suggested }, 0.0);
        let mut nearest: Option<(f64, Scheme)> = None;
        loop {
            let is_long_enough = |scheme: &Scheme| match scheme {
                Scheme::Explicit(steps) => *steps <= most_explicit && f64::from(*steps) >= least_explicit,
                Scheme::Implicit(steps) => f64::from(*steps) >= least_implicit || *scheme == Scheme::FINEST,
            };
            place += Scheme::LADDER[place..].iter().position(is_long_enough).unwrap_or(0);
            let scheme = Scheme::LADDER[place];
            stepper.x.copy_from_slice(&self.begin);
            match scheme {
                Scheme::FINEST => {
                    self.suggested = AFTER_IMPLICIT;
                    let Some((least, explicit)) = nearest else {
                        stepper.across(system, input, sample, scheme);
                        return scheme;
                    };
                    let is_better = self.halved(stepper, system, (input, sample), scheme, span) < least;
                    stepper.x.copy_from_slice(if is_better { &self.end } else { &self.least_off });
                    return if is_better { scheme } else { explicit };
                }
                Scheme::Explicit(steps) => {
                    let error = stepper.estimated(system, input, sample, scheme.steps());
                    let error = self.in_tolerances(span, |state| OF_THIRD_ORDER * error[state]);
                    let wanted = f64::from(steps) * (RESERVE * error).powf(EXPLICIT_ORDER.recip());
                    if error <= 1.0 {
                        self.end.copy_from_slice(&stepper.x);
                        if self.is_steady(stepper, system, (input, sample), scheme, span) {
                            self.suggested = wanted.max(1.0);
                            return scheme;
                        }
                        // Too long to be stable; what is implicit is stable at any length.
                        least_explicit = f64::INFINITY;
                    } else {
                        // No derivatives survive steps that are too long to be stable, whatever they err by.
                        let is_nearer = !self.is_differentiated && nearest.is_none_or(|(least, _)| error < least);
                        if is_nearer && error.is_finite() {
                            nearest = Some((error, scheme));
                            self.least_off.copy_from_slice(&stepper.x);
                        }
                        least_explicit = wanted.min(MOST_MORE * f64::from(steps)).max(f64::from(steps) + 1.0);
                        self.suggested = least_explicit;
                    }
                }
                Scheme::Implicit(steps) => {
                    let error = self.halved(stepper, system, (input, sample), scheme, span);
                    if error <= 1.0 && self.is_steady(stepper, system, (input, sample), scheme, span) {
                        self.suggested = AFTER_IMPLICIT;
                        return scheme;
                    }
                    let wanted = f64::from(steps) * (RESERVE * error).powf(IMPLICIT_ORDER.recip());
                    least_implicit = wanted.min(MOST_MORE * f64::from(steps)).max(f64::from(steps) + 1.0);
                }
            }
            place += 1;
        }
    }

    /// From a sample to a gap's end in explicit steps, at least one for each of its so many sample times; returns how.
    pub(super) fn cross_gap(
        &mut self,
        stepper: &mut Stepper,
        system: &System,
        (input, sample): (&Input<'_>, usize),
        samples: usize,
    ) -> Scheme {
        /// Steps in a sample time, at most.
        const MOST: usize = 1_000;
        let span = input.time[sample + 1] - input.time[sample];
        self.begin.copy_from_slice(&stepper.x);
        self.tolerance.see(&self.begin);
        let mut steps = samples * self.suggested.ceil() as usize;
        loop {
            let error = stepper.estimated(system, input, sample, steps);
            let error = self.in_tolerances(span, |state| OF_THIRD_ORDER * error[state]);
            if error <= 1.0 || steps >= samples * MOST {
                return Scheme::explicit(steps);
            }
            let wanted = (RESERVE * error).powf(EXPLICIT_ORDER.recip()).min(MOST_MORE) * steps as f64;
            steps = (wanted.ceil() as usize).max(steps + 1).min(samples * MOST);
            stepper.x.copy_from_slice(&self.begin);
        }
    }

    /// From the interval's beginning to its end by a scheme, which `end` then holds, and with halved steps: how far these are apart.
    fn halved(
        &mut self,
        stepper: &mut Stepper,
        system: &System,
        (input, sample): (&Input<'_>, usize),
        scheme: Scheme,
        span: f64,
    ) -> f64 {
        stepper.across(system, input, sample, scheme);
        self.end.copy_from_slice(&stepper.x);
        stepper.x.copy_from_slice(&self.begin);
        stepper.across(system, input, sample, scheme.finer());
        self.in_tolerances(span, |state| (self.end[state] - stepper.x[state]).abs())
    }

    /// The largest error of an interval's end in units of what it may be; infinite where one is no number.
    fn in_tolerances(&self, span: f64, error: impl Fn(usize) -> f64) -> f64 {
        let own = self
            .tolerance
            .by_state(span)
            .enumerate()
            .map(|(state, tolerance)| error(state) / tolerance.max(f64::MIN_POSITIVE));
        own.fold(0.0, |most: f64, own| if own.is_nan() { f64::INFINITY } else { most.max(own) })
    }

    /// Whether nudges to the speeds, and to the effects' states, are no larger at the end, or are as large with halved steps, where one
    /// state moves another as the equations have it; leaves the stepper at the unnudged end.
    ///
    /// What chatters between the two sides of a steep law may err by little, and the state of an effect that does nothing as yet errs by
    /// nothing; but no derivative survives it.
    fn is_steady(
        &self,
        stepper: &mut Stepper,
        system: &System,
        (input, sample): (&Input<'_>, usize),
        scheme: Scheme,
        span: f64,
    ) -> bool {
        let (n, n_states) = (system.n_free(), self.begin.len());
        let nudge = |state: usize| {
            let of_speed = self.tolerance.by_state(span).nth(state).filter(|_| state < 2 * n);
            NUDGE * of_speed.unwrap_or(self.begin[state].abs() + SMALL_STATE)
        };
        let cross = |stepper: &mut Stepper, scheme: Scheme, nudged: Range<usize>| {
            stepper.x.copy_from_slice(&self.begin);
            nudged.for_each(|state| stepper.x[state] += nudge(state));
            stepper.across(system, input, sample, scheme);
        };
        let grows = |stepper: &mut Stepper, nudged: Range<usize>| {
            cross(stepper, scheme, nudged.clone());
            let moved = |state: usize| stepper.x[state] - self.end[state];
            // What is no number is not within it either.
            if nudged.clone().all(|state| moved(state).abs() <= MOST_GROWTH * nudge(state)) {
                return false;
            }
            let moved: Vec<f64> = nudged.clone().map(moved).collect();
            let [from, to] = [0..0, nudged.clone()].map(|nudged| {
                cross(stepper, scheme.finer(), nudged);
                stepper.x.clone()
            });
            let is_alike = |(state, moved): (usize, f64)| {
                let finer = to[state] - from[state];
                (moved - finer).abs() <= MOST_GROWTH * nudge(state) + ALIKE * finer.abs()
            };
            !nudged.zip(moved).all(is_alike)
        };
        let is_steady = !self.is_differentiated
            || !(grows(stepper, n..2 * n) || (n_states > 2 * n && grows(stepper, 2 * n..n_states)));
        // From here on as it will be, so that what is not stable shows.
        stepper.x.copy_from_slice(&self.end);
        is_steady
    }
}
