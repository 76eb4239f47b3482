//! Optimised periodic motions: finite Fourier series (Swevers et al. 1997) that tell the base parameters best.
//!
//! Joint i moves as `q_i(t) = q_i0 + sum_l a_il / (l w) sin(l w t) - b_il / (l w) cos(l w t)`. `sum_l a_il = 0` and
//! `sum_l l b_il = 0` make it start at rest, without acceleration, and periodicity makes it end so. Among the series
//! within the limits, the one with the largest `log det` of the information is searched for (D-optimal). A point of the
//! search is a shape, scaled into the limits of position and speed, so that it never leaves them; torque beyond its limit
//! is penalised, and what is returned is within.

use std::f64::consts::PI;

use super::{
    information::{Drive, Information, Path, needed_torque},
    times,
};
use dynid_dynamics::system::System;
use dynid_optimise::cma_es;
use dynid_random::Random;
use dynid_user_model::Model;

/// What the free joints must stay within, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// [rad or m]
    pub position: Vec<[f64; 2]>,
    /// [rad/s or m/s]; may be infinite.
    pub speed: Vec<f64>,
    /// Of the command, in its unit; may be infinite.
    pub torque: Vec<f64>,
}

/// What to search for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// s
    pub period_s: f64,
    /// Harmonics of `1 / period_s`; at least 2.
    pub harmonics: usize,
    /// Motions that are looked at.
    pub evaluations: usize,
    /// The same seed gives the same motion.
    pub seed: u64,
}

/// A periodic motion of the free joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Fourier {
    /// s
    pub period_s: f64,
    /// `q_i0` [rad or m]
    pub centre: Vec<f64>,
    /// `a_il` [rad/s or m/s]: one row a joint.
    pub sine: Vec<Vec<f64>>,
    /// `b_il`
    pub cosine: Vec<Vec<f64>>,
}

/// Why there is no motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FourierError {
    /// The joint does not bear its load at rest.
    #[error(
        "joint {joint} needs {needed:.4} to stand still in the middle of its range, more than its torque limit {limit:.4}; \
         give a larger limit, or other positions"
    )]
    TooHeavy {
        /// The device's joint index.
        joint: usize,
        /// Command at rest.
        needed: f64,
        /// Its limit.
        limit: f64,
    },
    /// No motion tells every base parameter.
    #[error("no motion within the limits tells all base parameters; give more harmonics, or wider limits")]
    Dark,
}

impl Fourier {
    /// Position, speed and acceleration at the times.
    pub fn path(&self, time: &[f64]) -> Path {
        let base = 2.0 * PI / self.period_s;
        let n = self.centre.len();
        let mut path = Path { time: time.to_vec(), q: Vec::new(), dq: Vec::new(), ddq: Vec::new() };
        for t in time {
            let (mut q, mut dq, mut ddq) = (self.centre.clone(), vec![0.0; n], vec![0.0; n]);
            for harmonic in 0..self.sine.first().map_or(0, Vec::len) {
                let frequency = (harmonic + 1) as f64 * base;
                let (sin, cos) = (frequency * t).sin_cos();
                for joint in 0..n {
                    let (a, b) = (self.sine[joint][harmonic], self.cosine[joint][harmonic]);
                    q[joint] += (a * sin - b * cos) / frequency;
                    dq[joint] += a * cos + b * sin;
                    ddq[joint] += frequency * (b * cos - a * sin);
                }
            }
            path.q.push(q);
            path.dq.push(dq);
            path.ddq.push(ddq);
        }
        path
    }

    /// The same motion, smaller about its centre.
    fn scaled(&self, factor: f64) -> Self {
        let scale = |rows: &[Vec<f64>]| rows.iter().map(|row| row.iter().map(|x| factor * x).collect()).collect();
        Self { sine: scale(&self.sine), cosine: scale(&self.cosine), ..self.clone() }
    }
}

/// Samples of a period on which limits and information are looked at, per harmonic.
const SAMPLES_PER_HARMONIC: usize = 20;

/// What the search looks at.
struct Search<'a> {
    system: &'a System,
    limits: &'a Limits,
    options: &'a Options,
    information: Information<'a>,
    drive: Option<Drive>,
    time: Vec<f64>,
    noise: &'a [f64],
}

/// The motion that tells most, within the limits. `noise` is the torque noise of each free joint, which weighs joints
/// against each other.
///
/// # Errors
/// Limits that no motion can meet.
pub fn optimised(
    model: &Model,
    system: &System,
    limits: &Limits,
    noise: &[f64],
    options: &Options,
) -> Result<Fourier, FourierError> {
    let search = Search::new(model, system, limits, noise, options)?;
    let width = search.width();
    let mut random = Random::new(options.seed);
    // The best of some draws is where the search starts.
    let draws = (options.evaluations / 10).max(4);
    let mut best: Option<(Vec<f64>, f64)> = None;
    for _ in 0..draws {
        let x: Vec<f64> = (0..width).map(|_| random.normal()).collect();
        let cost = search.cost(&x);
        if best.as_ref().is_none_or(|(_, least)| cost < *least) {
            best = Some((x, cost));
        }
    }
    let start = best.unwrap_or_else(|| (vec![0.0; width], f64::INFINITY));
    let strategy = cma_es::Options {
        covariance: cma_es::Covariance::Diagonal,
        spread: 0.5,
        evaluations: options.evaluations,
        seed: options.seed,
        tolerance: None,
    };
    let (x, _) = cma_es::minimise(&|x| search.cost(x), start, &strategy);
    let motion = search.within(search.motion(&x));
    if search.information.log_det(&motion.path(&search.time), noise).is_finite() {
        Ok(motion)
    } else {
        Err(FourierError::Dark)
    }
}

/// A random motion within the limits: what an optimised one is compared with.
pub fn random(
    model: &Model,
    system: &System,
    limits: &Limits,
    noise: &[f64],
    options: &Options,
) -> Result<Fourier, FourierError> {
    let search = Search::new(model, system, limits, noise, options)?;
    let mut random = Random::new(options.seed);
    let x: Vec<f64> = (0..search.width()).map(|_| random.normal()).collect();
    Ok(search.within(search.motion(&x)))
}

impl<'a> Search<'a> {
    fn new(
        model: &Model,
        system: &'a System,
        limits: &'a Limits,
        noise: &'a [f64],
        options: &'a Options,
    ) -> Result<Self, FourierError> {
        let n_samples = SAMPLES_PER_HARMONIC * options.harmonics;
        let mut time = times(options.period_s, options.period_s / n_samples as f64);
        time.truncate(n_samples);
        let search = Self {
            system,
            limits,
            options,
            information: Information::new(model, system),
            drive: Drive::of(system),
            time,
            noise,
        };
        search.check_rest()?;
        Ok(search)
    }

    /// Numbers of a point: a joint's amplitude, its place within the limits, `a_il` and `b_il`.
    fn width(&self) -> usize {
        self.system.n_free() * (2 + 2 * self.options.harmonics)
    }

    /// The motion that a point stands for.
    fn motion(&self, x: &[f64]) -> Fourier {
        let n_harmonics = self.options.harmonics;
        let base = 2.0 * PI / self.options.period_s;
        let each = 2 + 2 * n_harmonics;
        let share = |x: f64| 1.0 / (1.0 + (-x).exp());
        let mut motion =
            Fourier { period_s: self.options.period_s, centre: Vec::new(), sine: Vec::new(), cosine: Vec::new() };
        for (slot, x) in x.chunks_exact(each).enumerate() {
            let (mut a, mut b) = (x[2..2 + n_harmonics].to_vec(), x[2 + n_harmonics..].to_vec());
            // at rest and without acceleration at t = 0
            let mean = a.iter().sum::<f64>() / n_harmonics as f64;
            a.iter_mut().for_each(|a| *a -= mean);
            let weight: f64 = (1..=n_harmonics).map(|l| (l * l) as f64).sum();
            let along = b.iter().zip(1..).map(|(b, l)| b * f64::from(l)).sum::<f64>() / weight;
            b.iter_mut().zip(1..).for_each(|(b, l)| *b -= along * f64::from(l));
            let shape = Fourier {
                period_s: self.options.period_s,
                centre: vec![0.0],
                sine: vec![a.clone()],
                cosine: vec![b.clone()],
            };
            let path = shape.path(&self.time);
            let (mut low, mut high, mut speed) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
            for (q, dq) in path.q.iter().zip(&path.dq) {
                (low, high, speed) = (low.min(q[0]), high.max(q[0]), speed.max(dq[0].abs()));
            }
            // What lies between the samples: at most a quarter step of the fastest harmonic squared, a per cent.
            let between =
                1.0 + 0.5 * (base * n_harmonics as f64 * self.options.period_s / self.time.len() as f64 / 2.0).powi(2);
            let [from, to] = self.limits.position[slot];
            let widest = (to - from) / ((high - low) * between).max(f64::MIN_POSITIVE);
            let fastest = self.limits.speed[slot] / (speed * between).max(f64::MIN_POSITIVE);
            let factor = widest.min(fastest) * share(x[0] + 2.0);
            let room = (to - from) - factor * (high - low) * between;
            let margin = 0.5 * factor * (high - low) * (between - 1.0);
            motion.centre.push(from + margin - factor * low + share(x[1]) * room.max(0.0));
            motion.sine.push(a.iter().map(|a| factor * a).collect());
            motion.cosine.push(b.iter().map(|b| factor * b).collect());
        }
        motion
    }

    /// Largest torque over its limit.
    fn load(&self, motion: &Fourier) -> f64 {
        if self.limits.torque.iter().all(|limit| limit.is_infinite()) {
            return 0.0;
        }
        let needed = needed_torque(self.system, &motion.path(&self.time));
        let over = |torque: Vec<f64>| {
            let command = self.drive.as_ref().map_or(torque.clone(), |drive| drive.command(&torque));
            command.iter().zip(&self.limits.torque).fold(0.0_f64, |most, (value, limit)| most.max(value.abs() / limit))
        };
        needed.into_iter().map(over).fold(0.0, f64::max)
    }

    fn cost(&self, x: &[f64]) -> f64 {
        let motion = self.motion(x);
        let excess = (self.load(&motion) - 1.0).max(0.0);
        let log_det = self.information.log_det(&motion.path(&self.time), self.noise);
        // A motion that tells nothing is worse than any that does; the penalty outweighs what more torque would tell.
        let finite = if log_det.is_finite() { log_det } else { -1e6 };
        -finite + 20.0 * self.width() as f64 * excess
    }

    /// The motion itself, or as much of it as the torque limits allow.
    fn within(&self, motion: Fourier) -> Fourier {
        if self.load(&motion) <= 1.0 {
            return motion;
        }
        let (mut fits, mut exceeds) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (fits + exceeds);
            if self.load(&motion.scaled(middle)) <= 1.0 { fits = middle } else { exceeds = middle }
        }
        motion.scaled(fits)
    }

    /// Whether the joints bear their load in the middle of their ranges.
    fn check_rest(&self) -> Result<(), FourierError> {
        let n = self.system.n_free();
        let centre: Vec<f64> = self.limits.position.iter().map(|[from, to]| 0.5 * (from + to)).collect();
        let rest = Path { time: vec![0.0], q: vec![centre], dq: vec![vec![0.0; n]], ddq: vec![vec![0.0; n]] };
        let needed = needed_torque(self.system, &rest).remove(0);
        let command = self.drive.as_ref().map_or(needed.clone(), |drive| drive.command(&needed));
        for (slot, (needed, limit)) in command.iter().zip(&self.limits.torque).enumerate() {
            if needed.abs() > *limit {
                let joint = self.system.kernel().free[slot];
                return Err(FourierError::TooHeavy { joint, needed: needed.abs(), limit: *limit });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{information::BaseRegressor, information::tests::arm, wave::Wave};

    fn limits(torque: f64) -> Limits {
        Limits { position: vec![[-1.0, 1.0], [-1.5, 0.5]], speed: vec![2.0, 3.0], torque: vec![torque; 2] }
    }

    const OPTIONS: Options = Options { period_s: 5.0, harmonics: 4, evaluations: 600, seed: 1 };
    const NOISE: [f64; 2] = [0.05, 0.02];

    /// Finely sampled: limits hold between the samples of the search, too.
    fn check_limits(motion: &Fourier, system: &System, limits: &Limits) {
        let path = motion.path(&times(motion.period_s, 0.002));
        for (q, dq) in path.q.iter().zip(&path.dq) {
            for slot in 0..q.len() {
                let [from, to] = limits.position[slot];
                assert!((from..=to).contains(&q[slot]) && dq[slot].abs() <= limits.speed[slot], "{q:?} {dq:?}");
            }
        }
        let torque = needed_torque(system, &path);
        let most = torque
            .iter()
            .flat_map(|row| row.iter().zip(&limits.torque))
            .fold(0.0_f64, |most, (torque, limit)| most.max(torque.abs() / limit));
        assert!(most < 1.02, "{most}");
        let ends = [0, path.time.len() - 1];
        for end in ends {
            assert!(path.dq[end].iter().chain(&path.ddq[end]).all(|rate| rate.abs() < 1e-9), "rest at the ends");
        }
        let change = path.q[0].iter().zip(&path.q[ends[1]]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(change < 1e-12);
    }

    #[test]
    fn the_optimised_motion_tells_more_than_random_ones_and_a_chirp() {
        let (model, system) = arm();
        let limits = limits(f64::INFINITY);
        let regressor = BaseRegressor::new(&model, &system);
        let time = times(5.0, 0.01);
        let log_det_of = |path: &Path| regressor.expected(path, &NOISE).log_det;
        let best = optimised(&model, &system, &limits, &NOISE, &OPTIONS).unwrap();
        check_limits(&best, &system, &limits);
        let optimised = log_det_of(&best.path(&time));
        let random = (0..200).map(|seed| {
            let motion = random(&model, &system, &limits, &NOISE, &Options { seed, ..OPTIONS }).unwrap();
            log_det_of(&motion.path(&time))
        });
        let random = random.fold(f64::NEG_INFINITY, f64::max);
        assert!(optimised > random + 1.0, "{optimised} {random}");
        // a chirp over the same frequencies, as large as position and speed allow
        let waves = Wave::Chirp { from: 0.2, to: 0.8 }.values(2, &time, 5.0).unwrap();
        let highest = 2.0 * PI * 0.8;
        let q = (0..time.len()).map(|k| {
            let place = |slot: usize| {
                let [from, to] = limits.position[slot];
                0.5 * (from + to) + (0.5 * (to - from)).min(limits.speed[slot] / highest) * waves[slot][k]
            };
            vec![place(0), place(1)]
        });
        let chirp = log_det_of(&Path::of_positions(&time, q.collect()));
        assert!(optimised > chirp + 1.0, "{optimised} {chirp}");
    }

    #[test]
    fn torque_limits_are_kept() {
        let (model, system) = arm();
        let unlimited = optimised(&model, &system, &limits(1e9), &NOISE, &OPTIONS).unwrap();
        let most = needed_torque(&system, &unlimited.path(&times(5.0, 0.01)));
        let most = most.iter().flatten().fold(0.0_f64, |most, torque| most.max(torque.abs()));
        let limits = limits(0.9 * most);
        let motion = optimised(&model, &system, &limits, &NOISE, &OPTIONS).unwrap();
        check_limits(&motion, &system, &limits);
        assert_eq!(optimised(&model, &system, &limits, &NOISE, &OPTIONS).unwrap(), motion, "the same seed");
    }

    #[test]
    fn a_joint_that_cannot_bear_its_load_is_reported() {
        let (model, system) = arm();
        let error = optimised(&model, &system, &limits(1e-3), &NOISE, &OPTIONS).unwrap_err();
        assert!(matches!(error, FourierError::TooHeavy { .. }), "{error}");
    }

    /// Played back open loop, the torque that a motion needs makes that motion.
    #[test]
    fn needed_torque_makes_the_motion() {
        let (_, system) = arm();
        let motion = Fourier {
            period_s: 4.0,
            centre: vec![-1.5, 0.2],
            sine: vec![vec![0.3, -0.3], vec![-0.2, 0.2]],
            cosine: vec![vec![0.2, -0.1], vec![0.4, -0.2]],
        };
        let time = times(2.0, 0.0005);
        let path = motion.path(&time);
        let command: Vec<f64> = needed_torque(&system, &path).concat();
        let input = dynid_dynamics::simulate::Input {
            time: &time,
            command: &command,
            intersample: dynid_dynamics::simulate::Intersample::FirstOrder,
        };
        let options = dynid_dynamics::simulate::Options::per_sample(2);
        let played = dynid_dynamics::simulate::simulate(&system, &input, &path.q[0], &options).unwrap();
        for (played, wanted) in played.q.iter().zip(path.q.concat()) {
            assert!((played - wanted).abs() < 1e-5, "{played} {wanted}");
        }
    }
}
