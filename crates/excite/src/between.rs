//! The input that tells two rival models apart best (T-optimal: Atkinson & Fedorov 1975, Biometrika 62, 57-70).
//!
//! Both models are simulated under one command. If model A is true and the positions have white noise of standard deviation
//! `sigma`, the logarithm of the likelihood ratio of A over B is expected to be `1/2 sum ((q_A - q_B) / sigma)^2`. What B's
//! free parameters and initial positions could absorb is no evidence, so that the difference is first projected on what B's
//! sensitivities do not span: a fit of B to first order. The command is a Fourier series whose harmonics are its bandwidth; it
//! starts and ends at what holds A at rest. Among the series under which both models stay within the limits of position, speed
//! and torque, the one of the largest expected ratio is searched for; a point of the search is a shape, scaled into the limits.

use std::f64::consts::TAU;

use dynid_dynamics::{
    simulate::{self, Input, Intersample},
    system::{System, SystemError},
};
use dynid_identify::sensitivity::{self, Columns, Lumps};
use dynid_optimise::{basis::Basis, cma_es};
use dynid_random::Random;
use dynid_user_model::Model;

use crate::{
    fourier::Limits,
    information::{Drive, Path, needed_torque},
    times,
};

/// Two models of one device, and where the experiment begins.
#[derive(Debug, Clone, Copy)]
pub struct Rivals<'a> {
    /// The model that counts as true.
    pub a: &'a Model,
    /// Its rival.
    pub b: &'a Model,
    /// Free joints, ascending.
    pub free: &'a [usize],
    /// Where all joints stand at the start [rad or m], at rest.
    pub pose: &'a [f64],
}

/// What to search for.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// s
    pub period_s: f64,
    /// Harmonics of `1 / period_s`, which bound the band of the command.
    pub harmonics: usize,
    /// Length of the run (s).
    pub duration_s: f64,
    /// Time from sample to sample (s); the command is held over it.
    pub sample_s: f64,
    /// Standard deviation of the noise of each free joint's position [rad or m].
    pub noise: Vec<f64>,
    /// Commands that are looked at.
    pub evaluations: usize,
    /// The same seed gives the same command.
    pub seed: u64,
}

/// A command, and what it tells.
#[derive(Debug, Clone, PartialEq)]
pub struct Between {
    /// s
    pub time: Vec<f64>,
    /// Command of each free joint [N*m or N].
    pub command: Vec<Vec<f64>>,
    /// The motion of model A.
    pub motion: Path,
    /// What the command tells.
    pub expected: ExpectedRatio,
}

/// What a command tells of two models, the first being true.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedRatio {
    /// Expected logarithm of the likelihood ratio, what B's free parameters absorb being taken off.
    pub log_likelihood_ratio: f64,
    /// The same with B as it is.
    pub as_given: f64,
    /// How many combinations of B's unknowns absorb something, initial positions included.
    pub absorbing: usize,
}

/// Why there is no command.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BetweenError {
    /// A model that makes no equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// Nothing bounds the command.
    #[error(
        "joint {joint} has limits neither of torque nor of position, so that nothing bounds its command; give one of them"
    )]
    NoLimit {
        /// The device's joint index.
        joint: usize,
    },
    /// A joint does not bear its load at rest.
    #[error(
        "joint {joint} needs {needed:.4} to stand still at the start, more than its torque limit {limit:.4}; give a larger limit, or another --pose"
    )]
    TooHeavy {
        /// The device's joint index.
        joint: usize,
        /// Command at rest.
        needed: f64,
        /// Its limit.
        limit: f64,
    },
    /// Both models do the same within the limits.
    #[error(
        "within the limits no command tells the two models apart: B does whatever A does once its free parameters are fitted"
    )]
    Alike,
    /// No simulation stays within the limits.
    #[error("under no command that was tried both models stay within the limits; give wider ones, or another --pose")]
    Outside,
}

/// Longest step of the integration of what is reported, and of the search (s).
const STEP_S: f64 = 2.5e-4;
const SEARCH_STEP_S: f64 = 1e-3;

/// Less evidence than this is rounding.
const NOTHING: f64 = 1e-6;

/// Two systems under one command.
struct Trial<'a> {
    a: System,
    b: System,
    columns: Columns,
    start: Vec<f64>,
    /// Command at rest, per free joint.
    rest: Vec<f64>,
    /// Largest amplitude about it, per free joint; where the torque has no limit, a size to begin with.
    reach: Vec<f64>,
    limits: &'a Limits,
    settings: &'a Settings,
    time: Vec<f64>,
}

/// The command that tells A from B best, within `limits`.
///
/// # Errors
/// Limits that nothing keeps or that bound nothing; models that are alike.
pub fn optimised(rivals: &Rivals<'_>, limits: &Limits, settings: &Settings) -> Result<Between, BetweenError> {
    let trial = Trial::new(rivals, limits, settings)?;
    let mut random = Random::new(settings.seed);
    let draws = (settings.evaluations / 10).max(4);
    let mut start: Option<(Vec<f64>, f64)> = None;
    for _ in 0..draws {
        let x: Vec<f64> = (0..trial.width()).map(|_| random.normal()).collect();
        let cost = trial.cost(&x);
        if start.as_ref().is_none_or(|(_, least)| cost < *least) {
            start = Some((x, cost));
        }
    }
    let start = start.unwrap_or_else(|| (vec![0.0; trial.width()], f64::INFINITY));
    // Where none of them tells anything, none will.
    if start.1 >= -NOTHING.ln() {
        return trial.finish(&start.0);
    }
    let strategy = cma_es::Options {
        covariance: cma_es::Covariance::Diagonal,
        spread: 0.5,
        evaluations: settings.evaluations,
        seed: settings.seed,
        tolerance: None,
    };
    let (x, _) = cma_es::minimise(&|x| trial.cost(x), start, &strategy);
    trial.finish(&x)
}

/// A random command within the limits: what the optimised one is compared with.
///
/// # Errors
/// As [`optimised`].
pub fn random(rivals: &Rivals<'_>, limits: &Limits, settings: &Settings) -> Result<Between, BetweenError> {
    let trial = Trial::new(rivals, limits, settings)?;
    let mut random = Random::new(settings.seed);
    let x: Vec<f64> = (0..trial.width()).map(|_| random.normal()).collect();
    trial.finish(&x)
}

impl<'a> Trial<'a> {
    fn new(rivals: &Rivals<'_>, limits: &'a Limits, settings: &'a Settings) -> Result<Self, BetweenError> {
        let system = |model: &Model| model.system(rivals.free, |joint| rivals.pose[joint]);
        let (a, b) = (system(rivals.a)?, system(rivals.b)?);
        let is_free = |name: &str| rivals.b.parameter(name).is_some_and(|parameter| !parameter.fixed);
        let lumps = match b.kernel().parameters.iter().any(|name| name.starts_with("link.") && is_free(name)) {
            true => Lumps::Wanted,
            false => Lumps::Known,
        };
        let columns = Columns::new(&b, is_free, lumps);
        let n = a.n_free();
        let start: Vec<f64> = rivals.free.iter().map(|&joint| rivals.pose[joint]).collect();
        let still = Path { time: vec![0.0], q: vec![start.clone()], dq: vec![vec![0.0; n]], ddq: vec![vec![0.0; n]] };
        let needed = needed_torque(&a, &still).remove(0);
        let rest = Drive::of(&a).map_or_else(|| vec![0.0; n], |drive| drive.command(&needed));
        let mut reach = Vec::with_capacity(n);
        for (slot, &joint) in rivals.free.iter().enumerate() {
            let limit = limits.torque[slot];
            if rest[slot].abs() > limit {
                return Err(BetweenError::TooHeavy { joint, needed: rest[slot].abs(), limit });
            }
            if limit.is_infinite() && limits.position[slot].iter().any(|limit| limit.is_infinite()) {
                return Err(BetweenError::NoLimit { joint });
            }
            reach.push(if limit.is_finite() { limit - rest[slot].abs() } else { 1.0 });
        }
        let time = times(settings.duration_s.min(settings.period_s), settings.sample_s);
        let mut trial = Self { a, b, columns, start, rest, reach, limits, settings, time };
        trial.find_reach();
        Ok(trial)
    }

    /// Gives the joints whose torque has no limit an amplitude under which a random command uses the limits of position.
    fn find_reach(&mut self) {
        let unlimited: Vec<usize> =
            (0..self.reach.len()).filter(|slot| self.limits.torque[*slot].is_infinite()).collect();
        if unlimited.is_empty() {
            return;
        }
        let mut random = Random::new(self.settings.seed);
        let x: Vec<f64> = (0..self.width()).map(|_| random.normal()).collect();
        let given = self.reach.clone();
        // Largest power of two that keeps the limits.
        let keeps = |trial: &Self| trial.load(&trial.series(&x, &trial.time), &trial.time, SEARCH_STEP_S) <= 1.0;
        let set = |trial: &mut Self, power: i32| {
            unlimited.iter().for_each(|&slot| trial.reach[slot] = given[slot] * 2.0_f64.powi(power));
        };
        const POWERS: i32 = 40;
        let power = (-POWERS..=POWERS).rev().find(|&power| {
            set(self, power);
            keeps(self)
        });
        set(self, power.unwrap_or(0));
    }

    /// Numbers of a point: each joint's amplitude, and its sines and cosines.
    fn width(&self) -> usize {
        self.reach.len() * (1 + 2 * self.settings.harmonics)
    }

    /// The commands that a point stands for, at these times.
    fn series(&self, x: &[f64], time: &[f64]) -> Vec<Vec<f64>> {
        let n_harmonics = self.settings.harmonics;
        let base = TAU / self.settings.period_s;
        let of_joint = |(slot, x): (usize, &[f64])| -> Vec<f64> {
            let (sine, mut cosine) = (&x[1..=n_harmonics], x[1 + n_harmonics..].to_vec());
            // nothing at t = 0
            let mean = cosine.iter().sum::<f64>() / n_harmonics as f64;
            cosine.iter_mut().for_each(|own| *own -= mean);
            let shape = |t: f64| -> f64 {
                let harmonics = sine.iter().zip(&cosine).zip(1..);
                harmonics
                    .map(|((sine, cosine), harmonic)| {
                        let (sin, cos) = (f64::from(harmonic) * base * t).sin_cos();
                        sine * sin + cosine * cos
                    })
                    .sum()
            };
            // The peak of a period, whatever the samples.
            let fine = 40 * n_harmonics;
            let peak = (0..fine).map(|k| shape(k as f64 / fine as f64 * self.settings.period_s).abs());
            let peak = peak.fold(f64::MIN_POSITIVE, f64::max);
            let share = match self.limits.torque[slot].is_finite() {
                true => 1.0 / (1.0 + (-x[0] - 1.0).exp()),
                false => x[0].exp(),
            };
            let size = self.reach[slot] * share / peak;
            time.iter().map(|&t| self.rest[slot] + size * shape(t)).collect()
        };
        x.chunks_exact(1 + 2 * n_harmonics).enumerate().map(of_joint).collect()
    }

    /// The same command, smaller about what holds A at rest.
    fn scaled(&self, command: &[Vec<f64>], factor: f64) -> Vec<Vec<f64>> {
        let of_joint = |(own, rest): (&Vec<f64>, &f64)| own.iter().map(|own| rest + factor * (own - rest)).collect();
        command.iter().zip(&self.rest).map(of_joint).collect()
    }

    /// Commands of all joints, one row a sample.
    fn rows(&self, command: &[Vec<f64>]) -> Vec<f64> {
        let n_joints = self.a.n_joints();
        let samples = command.first().map_or(0, Vec::len);
        let mut rows = vec![0.0; samples * n_joints];
        for (own, &joint) in command.iter().zip(self.a.kernel().free) {
            own.iter().enumerate().for_each(|(k, value)| rows[k * n_joints + joint] = *value);
        }
        rows
    }

    fn options(&self, step_s: f64) -> simulate::Options {
        let substeps = (self.settings.sample_s / step_s).ceil().clamp(1.0, 600.0) as usize;
        simulate::Options::per_sample(substeps)
    }

    /// How much of the limits of position, speed and torque the motions of both models use; infinite where one diverges.
    fn load(&self, command: &[Vec<f64>], time: &[f64], step_s: f64) -> f64 {
        let rows = self.rows(command);
        let input = Input { time, command: &rows, intersample: Intersample::ZeroOrder };
        let n = self.start.len();
        let mut load = 0.0_f64;
        for system in [&self.a, &self.b] {
            let Ok(played) = simulate::simulate(system, &input, &self.start, &self.options(step_s)) else {
                return f64::INFINITY;
            };
            for (index, (q, dq)) in played.q.iter().zip(&played.dq).enumerate() {
                let slot = index % n;
                let [from, to] = self.limits.position[slot];
                // From where it starts, so that a smaller command uses less of them.
                let room = if *q > self.start[slot] { to - self.start[slot] } else { from - self.start[slot] };
                let position = (q - self.start[slot]) / room;
                load = load.max(if position.is_nan() { 0.0 } else { position }).max(dq.abs() / self.limits.speed[slot]);
            }
        }
        for (own, limit) in command.iter().zip(&self.limits.torque) {
            load = own.iter().fold(load, |load, value| load.max(value.abs() / limit));
        }
        load
    }

    /// What a command tells; `None` where a model diverges.
    fn expected(&self, command: &[Vec<f64>], time: &[f64], step_s: f64) -> Option<ExpectedRatio> {
        let rows = self.rows(command);
        let input = Input { time, command: &rows, intersample: Intersample::ZeroOrder };
        let options = self.options(step_s);
        let played = simulate::simulate(&self.a, &input, &self.start, &options).ok()?;
        let n = self.start.len();
        let width = self.columns.width();
        let samples = time.len();
        let mut difference = vec![0.0; samples * n];
        let mut by = vec![vec![0.0; samples * n]; self.columns.count()];
        let observe = |sample: usize, q: &[f64], gradient: &[f64]| {
            for slot in 0..n {
                let (row, noise) = (sample * n + slot, self.settings.noise[slot]);
                difference[row] = (played.q[row] - q[slot]) / noise;
                for (column, by) in by.iter_mut().enumerate() {
                    by[row] = gradient[slot * width + column] / noise;
                }
            }
        };
        sensitivity::simulate(&self.b, &self.columns, &input, &self.start, &options, observe).ok()?;
        let basis = Basis::new(by);
        let half = |values: &[f64]| 0.5 * values.iter().map(|value| value * value).sum::<f64>();
        let expected = ExpectedRatio {
            log_likelihood_ratio: half(&basis.residual(&difference)),
            as_given: half(&difference),
            absorbing: basis.rank(),
        };
        expected.log_likelihood_ratio.is_finite().then_some(expected)
    }

    /// The command, or as much of it as the limits allow to `rounds` halvings; `None` where even a small one leaves them.
    fn within(&self, command: Vec<Vec<f64>>, time: &[f64], step_s: f64, rounds: usize) -> Option<Vec<Vec<f64>>> {
        let load = |factor: f64| self.load(&self.scaled(&command, factor), time, step_s);
        let whole = load(1.0);
        if whole <= 1.0 {
            return Some(command);
        }
        let (mut fits, mut exceeds) = (0.0, 1.0);
        // Were the models linear, it would be this.
        let mut next = if whole.is_finite() { 1.0 / whole } else { 0.5 };
        for _ in 0..rounds {
            if load(next) <= 1.0 {
                fits = next
            } else {
                exceeds = next
            }
            next = 0.5 * (fits + exceeds);
        }
        (fits > 0.0).then(|| self.scaled(&command, fits))
    }

    fn cost(&self, x: &[f64]) -> f64 {
        /// Of a command that no scale brings within the limits.
        const OUTSIDE: f64 = 1e6;
        const ROUNDS: usize = 6;
        let command = self.within(self.series(x, &self.time), &self.time, SEARCH_STEP_S, ROUNDS);
        let expected = command.and_then(|command| self.expected(&command, &self.time, SEARCH_STEP_S));
        expected.map_or(OUTSIDE, |own| -own.log_likelihood_ratio.max(f64::MIN_POSITIVE).ln())
    }

    /// The command of a point over the whole run, or as much of it as the limits allow.
    fn finish(&self, x: &[f64]) -> Result<Between, BetweenError> {
        const ROUNDS: usize = 16;
        let time = times(self.settings.duration_s, self.settings.sample_s);
        let command = self.within(self.series(x, &time), &time, STEP_S, ROUNDS).ok_or(BetweenError::Outside)?;
        let expected = self.expected(&command, &time, STEP_S).ok_or(BetweenError::Outside)?;
        if expected.log_likelihood_ratio < NOTHING {
            return Err(BetweenError::Alike);
        }
        let rows = self.rows(&command);
        let input = Input { time: &time, command: &rows, intersample: Intersample::ZeroOrder };
        let played = simulate::simulate(&self.a, &input, &self.start, &self.options(STEP_S))
            .map_err(|_| BetweenError::Outside)?;
        let each = |values: &[f64]| values.chunks_exact(self.start.len()).map(<[f64]>::to_vec).collect();
        let motion = Path::of_speeds(&time, each(&played.q), each(&played.dq));
        Ok(Between { time, command, motion, expected })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path as FilePath;

    use super::*;
    use nalgebra::{DMatrix, DVector};

    const NOISE: f64 = 1e-4;

    /// A mass on a spring that stiffens, and its rival on a straight one.
    fn rivals() -> [Model; 2] {
        let text = |cubic: &str| {
            format!(
                "device = \"oscillator\"\n[link.1]\nm = 8e-4\n[[effect]]\nid = \"gain\"\njoint = 0\n[[effect]]\nid = \
                 \"viscous\"\njoint = 0\nFv = 0.006\n[[effect]]\nid = \"spring\"\njoint = 0\nKs = 1.0\n{cubic}"
            )
        };
        let cubic = "[[effect]]\nid = \"spring_cubic\"\njoint = 0\nK3 = 50.0\n";
        [text(cubic), text("")].map(|text| Model::parse(&text, FilePath::new("made.toml")).expect("a model"))
    }

    fn limits() -> Limits {
        Limits { position: vec![[-0.05, 0.05]], speed: vec![f64::INFINITY], torque: vec![0.2] }
    }

    fn settings(seed: u64) -> Settings {
        Settings {
            period_s: 4.0,
            harmonics: 4,
            duration_s: 4.0,
            sample_s: 0.01,
            noise: vec![NOISE],
            evaluations: 300,
            seed,
        }
    }

    fn farthest(played: &Between) -> f64 {
        played.motion.q.iter().fold(0.0_f64, |most, q| most.max(q[0].abs()))
    }

    /// Played anew with a finer step; B's unknowns by central differences, and a singular value decomposition.
    fn independent_ratio(a: &Model, b: &Model, played: &Between) -> f64 {
        let input = Input { time: &played.time, command: &played.command[0], intersample: Intersample::ZeroOrder };
        let options = simulate::Options::per_sample(80);
        let positions = |model: &Model, start: f64| -> DVector<f64> {
            let system = model.system(&[0], |_| 0.0).expect("a system");
            DVector::from_vec(simulate::simulate(&system, &input, &[start], &options).expect("a motion").q)
        };
        let unknowns = ["link.1.m", "joint.0.viscous.Fv", "joint.0.spring.Ks", "joint.0.spring.qeq"];
        let mut columns: Vec<DVector<f64>> = unknowns
            .iter()
            .map(|name| {
                let value = b.parameter(name).expect("an unknown").value;
                let step = 1e-4 * value.abs().max(1e-3);
                let at = |value: f64| {
                    let mut moved = b.clone();
                    moved.set_value(name, value).expect("an unknown");
                    positions(&moved, 0.0)
                };
                (at(value + step) - at(value - step)) / (2.0 * step)
            })
            .collect();
        columns.push((positions(b, 1e-6) - positions(b, -1e-6)) / 2e-6);
        columns.iter_mut().for_each(|column| *column /= column.norm());
        let matrix = DMatrix::from_columns(&columns);
        let difference = positions(a, 0.0) - positions(b, 0.0);
        let fitted = matrix.clone().svd(true, true).solve(&difference, 1e-9).expect("a solution");
        0.5 * (difference - matrix * fitted).norm_squared() / (NOISE * NOISE)
    }

    #[test]
    fn the_optimum_beats_random_commands_and_reaches_farther() {
        let [a, b] = rivals();
        let rivals = Rivals { a: &a, b: &b, free: &[0], pose: &[0.0] };
        // The torque is what bounds the motion.
        let limits = Limits { position: vec![[-0.5, 0.5]], torque: vec![0.03], ..limits() };
        let best = optimised(&rivals, &limits, &settings(1)).expect("a command");
        let random: Vec<Between> =
            (0..20).map(|seed| random(&rivals, &limits, &settings(seed)).expect("a command")).collect();
        let most = random.iter().map(|own| own.expected.log_likelihood_ratio).fold(0.0, f64::max);
        assert!(best.expected.log_likelihood_ratio > 1.2 * most, "{:?} {most}", best.expected);
        let largest = random.iter().map(farthest).fold(0.0, f64::max);
        assert!(farthest(&best) > largest, "{} {largest}", farthest(&best));
        assert!(best.command[0].iter().all(|torque| torque.abs() <= 0.03) && best.command[0][0].abs() < 1e-12);
        let again = optimised(&rivals, &limits, &settings(1)).expect("a command");
        assert_eq!(best, again, "one seed, one command");
    }

    #[test]
    fn the_expected_ratio_is_that_of_an_independent_computation() {
        let [a, b] = rivals();
        let rivals = Rivals { a: &a, b: &b, free: &[0], pose: &[0.0] };
        let played = random(&rivals, &limits(), &settings(3)).expect("a command");
        let ratio = independent_ratio(&a, &b, &played);
        let said = &played.expected;
        assert!((said.log_likelihood_ratio / ratio - 1.0).abs() < 1e-3, "{said:?} {ratio}");
        assert!(said.as_given > said.log_likelihood_ratio && said.absorbing == 5, "{said:?}");
    }

    #[test]
    fn what_cannot_be_is_told() {
        let [a, b] = rivals();
        let same = Rivals { a: &b, b: &b, free: &[0], pose: &[0.0] };
        assert_eq!(random(&same, &limits(), &settings(1)), Err(BetweenError::Alike));
        // The rival has the spring that stiffens, too, at nothing: it absorbs all of a first order.
        let mut nests = a.clone();
        nests.set_value("joint.0.spring_cubic.K3", 0.0).expect("an unknown");
        let nested = Rivals { a: &a, b: &nests, free: &[0], pose: &[0.0] };
        let (apart, within) = (
            random(&Rivals { a: &a, b: &b, ..same }, &limits(), &settings(1)).expect("a command").expected,
            random(&nested, &limits(), &settings(1)).expect("a command").expected,
        );
        assert!(within.log_likelihood_ratio < 0.2 * apart.log_likelihood_ratio, "{apart:?} {within:?}");
        let boundless = Limits { torque: vec![f64::INFINITY], position: vec![[f64::NEG_INFINITY, 1.0]], ..limits() };
        let rivals = Rivals { a: &a, ..same };
        assert_eq!(random(&rivals, &boundless, &settings(1)), Err(BetweenError::NoLimit { joint: 0 }));
        // Without a limit of torque, that of position bounds the command.
        let by_position = Limits { torque: vec![f64::INFINITY], ..limits() };
        let played = random(&rivals, &by_position, &settings(1)).expect("a command");
        assert!((0.005..=0.05).contains(&farthest(&played)), "{}", farthest(&played));
    }
}
