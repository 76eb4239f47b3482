//! The experiment that would tell effects apart which fit the logs at hand equally well.

use std::f64::consts::TAU;

use rayon::prelude::*;
use serde::Serialize;

use super::Candidate;
use dynid_dynamics::{simulate, simulate::Input, simulate::Intersample};
use dynid_logs::{experiment::Run, noise::noise_floor};
use dynid_user_model::Model;

/// One thing to play: which joints are free, and what is commanded at one of them.
#[derive(Debug, Clone)]
struct Trial {
    free: Vec<usize>,
    joint: usize,
    amplitude: f64,
    hz: f64,
    phase: SinePhase,
}

/// What would tell an effect from another that fits as well.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DistinguishingExperiment {
    /// A sine at one joint.
    Sine {
        /// Joints to lock; the others are free.
        locked: Vec<usize>,
        /// The joint that is commanded.
        joint: usize,
        /// Of the command, in `unit`.
        amplitude: f64,
        /// Unit of the command.
        unit: String,
        /// Hz
        frequency_hz: f64,
        /// Where it begins.
        phase: SinePhase,
        /// What it tells the effect from.
        from: Candidate,
        /// By how many times the noise the two differ (root mean square at the joint that shows it most).
        times_noise: f64,
        /// Over so long (s).
        duration_s: f64,
    },
    /// None of the sines that were tried tells the two apart.
    NoneFound {
        /// What it should be told from.
        from: Candidate,
        /// By how many times the noise the two differ at best.
        times_noise: f64,
    },
}

/// Where a sine begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SinePhase {
    /// At zero, `sin(2 pi f t)`.
    Zero,
    /// A quarter period later, `cos(2 pi f t)`.
    Quarter,
}

impl SinePhase {
    /// In periods.
    fn periods(self) -> f64 {
        match self {
            Self::Zero => 0.0,
            Self::Quarter => 0.25,
        }
    }
}

/// What to play so that `own` and `others`, models that were fitted to `runs`, differ most from each other, in units of the
/// noise; `None` where nothing can be tried.
///
/// Tried are sines at each joint that an effect acts on, of several amplitudes and frequencies about those of the runs, in
/// every configuration in which that joint is free and at most as many joints as in the runs.
pub(super) fn experiment(
    own: &Model,
    others: &[(&Candidate, &Model)],
    runs: &[&Run],
) -> Option<DistinguishingExperiment> {
    /// Models that differ by fewer noises are not told apart.
    const LEAST: f64 = 3.0;
    let (candidate, other) = others.first()?;
    let (times_noise, Trial { free, joint, amplitude, hz, phase }) = best(own, candidate, other, runs)?;
    let from = Candidate::clone(candidate);
    if times_noise < LEAST {
        return Some(DistinguishingExperiment::NoneFound { from, times_noise });
    }
    Some(DistinguishingExperiment::Sine {
        locked: (0..own.device.joints.len()).filter(|joint| !free.contains(joint)).collect(),
        joint,
        amplitude,
        unit: own.device.joints[joint].command_unit.clone(),
        frequency_hz: hz,
        phase,
        from,
        times_noise,
        duration_s: DURATION_S,
    })
}

/// The trial that tells most, and by how many noises the models differ there.
fn best(own: &Model, candidate: &Candidate, other: &Model, runs: &[&Run]) -> Option<(f64, Trial)> {
    let seen: Vec<Seen> = (0..own.device.joints.len()).map(|joint| Seen::of(runs, joint)).collect();
    trials(own, candidate, runs)
        .into_par_iter()
        .filter_map(|trial| Some((difference(own, other, &trial, runs, &seen)?, trial)))
        .collect::<Vec<(f64, Trial)>>()
        .into_iter()
        .max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Length of a trial (s).
const DURATION_S: f64 = 20.0;
/// Time from sample to sample (s).
const SAMPLE_S: f64 = 0.01;

fn trials(model: &Model, candidate: &Candidate, runs: &[&Run]) -> Vec<Trial> {
    let most = runs.iter().map(|run| run.free.len()).max().unwrap_or(1);
    let joints: Vec<usize> = [candidate.joint, candidate.from].into_iter().flatten().collect();
    let mut trials = Vec::new();
    for configuration in &model.device.configurations {
        let free = &configuration.free;
        if free.len() > most || !joints.iter().any(|joint| free.contains(joint)) {
            continue;
        }
        for &joint in free {
            let commands = runs.iter().filter(|run| run.free.contains(&joint)).flat_map(|run| &run.log.tau[joint]);
            let (sum, count) = commands.fold((0.0, 0.0), |(sum, count), tau| (sum + tau * tau, count + 1.0));
            let size = (2.0 * sum / f64::max(count, 1.0)).sqrt();
            if size == 0.0 {
                continue;
            }
            for share in [0.2, 0.5, 1.0, 1.5] {
                for hz in [0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0] {
                    for phase in [SinePhase::Zero, SinePhase::Quarter] {
                        trials.push(Trial { free: free.clone(), joint, amplitude: share * size, hz, phase });
                    }
                }
            }
        }
    }
    trials
}

/// What the runs have seen of a joint.
struct Seen {
    /// The middle of its range [rad or m].
    centre: f64,
    /// Half of it; infinite where no run has seen it move.
    half: f64,
    /// The noise of its logs [rad or m].
    noise: f64,
}

impl Seen {
    fn of(runs: &[&Run], joint: usize) -> Self {
        let moving = || runs.iter().filter(|run| run.free.contains(&joint));
        let positions = moving().flat_map(|run| &run.log.q[joint]);
        let (low, high) =
            positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
        let noise = moving().map(|run| noise_floor(&run.log.q[joint])).fold(0.0, f64::max);
        Self { centre: 0.5 * (low + high), half: (0.5 * (high - low)).abs(), noise }
    }

    /// Whether a position is far from all that was seen.
    fn is_left_by(&self, q: f64) -> bool {
        /// A motion beyond this multiple of the range that the logs show is not asked for.
        const FARTHEST: f64 = 1.5;
        let distance = (q - self.centre).abs();
        self.half > 0.0 && (distance > FARTHEST * self.half || distance.is_nan())
    }
}

/// Root mean square of the difference of two models' motions in units of the noise; `None` where one of them leaves what
/// the runs have seen.
fn difference(one: &Model, other: &Model, trial: &Trial, runs: &[&Run], seen: &[Seen]) -> Option<f64> {
    let n_joints = one.device.joints.len();
    let samples = (DURATION_S / SAMPLE_S) as usize;
    let time: Vec<f64> = (0..samples).map(|k| k as f64 * SAMPLE_S).collect();
    let mut command = vec![0.0; samples * n_joints];
    for (k, t) in time.iter().enumerate() {
        command[k * n_joints + trial.joint] = trial.amplitude * (TAU * (trial.hz * t + trial.phase.periods())).sin();
    }
    let free: Vec<&Seen> = trial.free.iter().map(|joint| &seen[*joint]).collect();
    if free.iter().any(|seen| !seen.half.is_finite()) {
        return None;
    }
    let middle = |joint: usize| runs.first().map_or(0.0, |run| run.log.mean_position(joint));
    let start: Vec<f64> = trial.free.iter().map(|joint| middle(*joint)).collect();
    let options = simulate::Options::per_sample(15);
    let play = |model: &Model, samples: usize| {
        let system = model.system(&trial.free, middle).ok()?;
        let (time, command) = (&time[..samples], &command[..samples * n_joints]);
        let input = Input { time, command, intersample: Intersample::ZeroOrder };
        let motion = simulate::simulate(&system, &input, &start, &options).ok()?.q;
        let stays = motion.iter().zip(free.iter().cycle()).all(|(q, seen)| !seen.is_left_by(*q));
        stays.then_some(motion)
    };
    // What falls does so at once.
    play(one, samples / 10)?;
    let (a, b) = (play(one, samples)?, play(other, samples)?);
    let squares =
        |slot: usize| -> f64 { a.iter().zip(&b).skip(slot).step_by(free.len()).map(|(a, b)| (a - b) * (a - b)).sum() };
    let in_noises = |(slot, seen): (usize, &&Seen)| (squares(slot) / samples as f64).sqrt() / seen.noise;
    Some(free.iter().enumerate().filter(|(_, seen)| seen.noise > 0.0).map(in_noises).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{self, Oscillator};
    use dynid_logs::experiment::Role;

    /// Amplitude of the fitted run's command (N), and stiffness of the cubic spring (N/m^3).
    const FORCE: f64 = 0.02;
    const K3: f64 = 50.0;

    /// A mass on a spring that stiffens, and one on a stiffer straight spring: at the run's amplitude the two are alike but
    /// for the third harmonic, `K + 3/4 K3 A^2` being the stiffness of the first.
    fn models() -> [Model; 2] {
        [fixtures::model(1.0, &fixtures::cubic(K3)), fixtures::model(1.0 + 0.75 * K3 * FORCE * FORCE, "")]
    }

    fn played(model: &Model, trial: &Trial, substeps: usize) -> Vec<f64> {
        let time: Vec<f64> = (0..(DURATION_S / SAMPLE_S) as usize).map(|k| k as f64 * SAMPLE_S).collect();
        let command: Vec<f64> =
            time.iter().map(|t| trial.amplitude * (TAU * (trial.hz * t + trial.phase.periods())).sin()).collect();
        let system = model.system(&[0], |_| 0.0).expect("a system");
        let input = Input { time: &time, command: &command, intersample: Intersample::ZeroOrder };
        let options = simulate::Options::per_sample(substeps);
        simulate::simulate(&system, &input, &[0.0], &options).expect("a motion").q
    }

    #[test]
    fn what_is_proposed_tells_more_than_what_was_fitted() {
        let [own, other] = models();
        let fitted = Trial { free: vec![0], joint: 0, amplitude: FORCE, hz: 1.0, phase: SinePhase::Zero };
        let run = Oscillator { stiffness: 1.0, cubic: K3 }.run(&[(FORCE, 1.0)], DURATION_S, (Role::Fit, 5));
        let noise = noise_floor(&run.log.q[0]);
        let runs = [&run];

        let before =
            difference(&own, &other, &fitted, &runs, &[Seen::of(&runs, 0)]).expect("it is what the run has seen");
        assert!(before < 1.5, "the two fit the run alike: {before}");
        let candidate = Candidate { effect: "spring_cubic".to_owned(), joint: Some(0), from: None };
        let (noises, trial) = best(&own, &candidate, &other, &runs).expect("a trial");
        assert!(noises > 3.0 && noises > 3.0 * before, "{before} {noises} {trial:?}");

        // Played anew, with a finer step.
        let (one, two) = (played(&own, &trial, 60), played(&other, &trial, 60));
        let squares: f64 = one.iter().zip(&two).map(|(a, b)| (a - b) * (a - b)).sum();
        let again = (squares / one.len() as f64).sqrt() / noise;
        assert!((again / noises - 1.0).abs() < 0.02, "{again} {noises}");
        let farthest = one.iter().fold(0.0_f64, |farthest, q| farthest.max(q.abs()));
        assert!(farthest < 1.6 * FORCE, "nothing is asked for beyond what the run has seen: {farthest}");
        let reported = experiment(&own, &[(&candidate, &other)], &runs);
        assert_eq!(
            reported,
            Some(DistinguishingExperiment::Sine {
                locked: Vec::new(),
                joint: 0,
                amplitude: trial.amplitude,
                unit: own.device.joints[0].command_unit.clone(),
                frequency_hz: trial.hz,
                phase: trial.phase,
                from: candidate.clone(),
                times_noise: noises,
                duration_s: DURATION_S,
            })
        );
        // A model is not told from itself.
        let same = experiment(&own, &[(&candidate, &own)], &runs);
        assert_eq!(same, Some(DistinguishingExperiment::NoneFound { from: candidate, times_noise: 0.0 }));
    }

    /// At the joint that the effect acts on, and at each that moves with it: seven frequencies in two phases, of a fifth to one and a half
    /// times the size of the runs' commands.
    #[test]
    fn sines_about_those_of_the_runs_are_tried_where_the_effect_is_felt() {
        let model = Model::parse("device = \"planar2r\"\n", std::path::Path::new("made.toml")).expect("a model");
        let alone = Oscillator { stiffness: 1.0, cubic: 0.0 }.run(&[(FORCE, 1.0)], 2.0, (Role::Fit, 5));
        let of_joint = |free: &[usize], sizes: [f64; 2]| {
            let mut run = alone.clone();
            run.free = free.to_vec();
            run.log.tau = sizes.map(|size| alone.log.tau[0].iter().map(|tau| size / FORCE * tau).collect()).into();
            run
        };
        // Which joint is driven with which free, and how large, in multiples of its runs' size.
        let tried = |effect_at: usize, run: &Run, sizes: [f64; 2]| {
            let candidate = Candidate { effect: "coulomb".to_owned(), joint: Some(effect_at), from: None };
            let trials = trials(&model, &candidate, &[run]);
            let mut places: Vec<(Vec<usize>, usize)> = Vec::new();
            for trial in &trials {
                let place = (trial.free.clone(), trial.joint);
                if places.last() != Some(&place) {
                    places.push(place);
                }
            }
            for (free, joint) in &places {
                let own = trials.iter().filter(|trial| (&trial.free, trial.joint) == (free, *joint));
                let mut shares: Vec<f64> = own.map(|trial| trial.amplitude / sizes[*joint]).collect();
                assert_eq!(shares.len(), 4 * 7 * 2);
                shares.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
                let expected = [0.2, 0.5, 1.0, 1.5];
                assert!(
                    shares.len() == 4 && shares.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9),
                    "{shares:?}"
                );
            }
            places
        };
        let sizes = [1.2, 0.4];
        let second = of_joint(&[1], [0.0, 0.4]);
        assert_eq!(tried(1, &second, sizes), [(vec![1], 1)], "only one joint was free");
        assert_eq!(tried(0, &second, sizes), [], "nothing is known of its torque");
        let both = of_joint(&[0, 1], sizes);
        assert_eq!(tried(0, &both, sizes), [(vec![0], 0), (vec![0, 1], 0), (vec![0, 1], 1)]);
    }
}
