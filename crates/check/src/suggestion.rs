//! How to excite what the runs leave open: what `dynid excite` should play.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use dynid_logs::experiment::Run;
use dynid_model::effect::{Place, Stage};
use dynid_signal::power_spectrum;
use dynid_user_model::Model;
use serde::Serialize;

use crate::{Unanswered, excitation::moves};

/// One run to play.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Suggestion {
    /// Id of the device, or the path of its file.
    pub device: String,
    /// Free joints, ascending.
    pub free: Vec<usize>,
    /// Those of them that the runs excite too little.
    pub joints: Vec<usize>,
    /// Parameters that this is for; none where a joint's whole motion is missing.
    pub parameters: Vec<String>,
    /// What to play.
    pub signal: Signal,
    /// Lowest frequency (Hz).
    pub from_hz: f64,
    /// Highest frequency (Hz).
    pub to_hz: f64,
    /// Largest speed that each free joint can take [rad/s or m/s]; `None` where the device does not say.
    pub speed: Vec<Option<f64>>,
    /// Samples a second (Hz).
    pub rate_hz: f64,
}

/// What to play.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Signal {
    /// The periodic motion that tells most.
    Optimised {
        /// Range of each free joint [rad or m].
        position: Vec<[f64; 2]>,
        /// As torques, because the runs were commanded so and the drive path is a straight line.
        as_torque: bool,
    },
    /// Torques of many frequencies, where no range is known.
    Multisine {
        /// Of each free joint [unit of the command]; `None` where nothing tells how large it must be.
        amplitude: Option<Vec<f64>>,
    },
}

/// One suggestion for each set of free joints in which something is missing.
pub fn suggestions(model: &Model, runs: &[&Run], unanswered: &[Unanswered]) -> Vec<Suggestion> {
    // The joints that lack something, with the parameters that this is for.
    let mut missing: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    let mut lines: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for own in unanswered {
        match own {
            Unanswered::NothingMoves { joints, .. } => joints.iter().for_each(|joint| {
                missing.entry(*joint).or_default();
            }),
            Unanswered::AllTooShort { .. } => runs.iter().flat_map(|run| &run.free).for_each(|joint| {
                missing.entry(*joint).or_default();
            }),
            Unanswered::NeverMoves { joint, parameters, .. } => {
                missing.entry(*joint).or_default().extend(parameters.iter().cloned());
            }
            Unanswered::FewFrequencies { joint, frequencies_hz, .. } => {
                missing.entry(*joint).or_default();
                lines.insert(*joint, frequencies_hz.clone());
            }
            Unanswered::LeftOpen { parameters, .. } => {
                for own in parameters {
                    missing.entry(own.joint).or_default().push(own.name.clone());
                }
            }
            _ => {}
        }
    }
    let mut groups: BTreeMap<Vec<usize>, BTreeSet<usize>> = BTreeMap::new();
    for joint in missing.keys() {
        let sets = runs.iter().map(|run| &run.free).filter(|free| free.contains(joint));
        if let Some(free) = sets.min_by_key(|free| free.len()) {
            groups.entry(free.clone()).or_default().insert(*joint);
        }
    }
    groups
        .into_iter()
        .map(|(free, joints)| {
            let mut parameters: Vec<String> = joints.iter().flat_map(|joint| missing[joint].clone()).collect();
            let mut seen = BTreeSet::new();
            parameters.retain(|name| seen.insert(name.clone()));
            let own: Vec<&Run> = runs.iter().copied().filter(|run| run.free == free).collect();
            let lines: Vec<f64> = joints.iter().filter_map(|joint| lines.get(joint)).flatten().copied().collect();
            let rate_hz = own.iter().map(|run| 1.0 / run.log.sample_time()).fold(0.0, f64::max);
            let [from_hz, to_hz] = band(&own, &joints, &lines, rate_hz);
            let limit = |joint: &usize| Some(model.device.joints[*joint].speed_limit).filter(|limit| limit.is_finite());
            Suggestion {
                device: model.device.name_from(Path::new("")),
                speed: free.iter().map(limit).collect(),
                signal: signal(model, &own, &free),
                joints: joints.into_iter().collect(),
                free,
                parameters,
                from_hz,
                to_hz,
                rate_hz,
            }
        })
        .collect()
}

/// Frequencies below and above those of the runs.
fn band(runs: &[&Run], joints: &BTreeSet<usize>, lines: &[f64], rate_hz: f64) -> [f64; 2] {
    /// Where nothing moves (Hz).
    const UNKNOWN: [f64; 2] = [0.1, 1.0];
    /// How far beyond the lines, and the band, of the runs.
    const BEYOND_LINES: f64 = 3.0;
    const BEYOND: f64 = 1.5;
    /// A motion of more than this share of the sample rate is hardly seen.
    const FASTEST: f64 = 0.1;
    /// Of the lowest frequency: more are searched for too long.
    const MOST_HARMONICS: f64 = 20.0;
    let [from, to] = if lines.is_empty() {
        let moving = runs
            .iter()
            .flat_map(|run| joints.iter().filter(|joint| moves(run, **joint)).map(move |joint| (run, joint)));
        let fastest =
            moving.filter_map(|(run, joint)| fast(&run.log.q[*joint], run.log.sample_time())).fold(0.0, f64::max);
        if fastest > 0.0 { [0.1 * BEYOND * fastest, BEYOND * fastest] } else { UNKNOWN }
    } else {
        let (low, high) = lines.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), hz| (low.min(*hz), high.max(*hz)));
        [low / BEYOND_LINES, high * BEYOND_LINES]
    };
    let to = to.min(FASTEST * rate_hz);
    [from.clamp(to / MOST_HARMONICS, 0.5 * to), to]
}

/// The frequency below which 95 % of the speed's power is (Hz).
fn fast(q: &[f64], step: f64) -> Option<f64> {
    const SHARE: f64 = 0.95;
    let spectrum = power_spectrum(q, step)?;
    // Noise has all its speed at the highest frequencies, above those of any motion.
    let seen = spectrum.density.len() / 4;
    let power = |k: usize| spectrum.density[k] * (k * k) as f64;
    let whole: f64 = (0..seen).map(power).sum();
    let mut sum = 0.0;
    let place = (0..seen).find(|&k| {
        sum += power(k);
        sum >= SHARE * whole
    })?;
    Some(place as f64 * spectrum.resolution_hz).filter(|hz| *hz > 0.0)
}

fn signal(model: &Model, runs: &[&Run], free: &[usize]) -> Signal {
    /// How far beyond what the runs have shown a joint without limits may go.
    const FARTHER: f64 = 1.5;
    /// How much more command a joint that stood still needs at least.
    const MORE: f64 = 3.0;
    let range = |joint: usize| -> Option<[f64; 2]> {
        let limits = model.device.joints[joint].position_limits;
        if limits.iter().all(|limit| limit.is_finite()) {
            return Some(limits);
        }
        let moving = runs.iter().filter(|run| moves(run, joint)).flat_map(|run| &run.log.q[joint]);
        let (low, high) = moving.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        half.is_finite().then_some([middle - FARTHER * half, middle + FARTHER * half])
    };
    if let Some(position) = free.iter().map(|&joint| range(joint)).collect::<Option<Vec<_>>>() {
        let is_straight = model.effects.iter().all(|own| match own.effect.place {
            Place::Actuator => matches!(own.effect.stage, Some(Stage::Offset | Stage::Coupling | Stage::Gain)),
            place => place != Place::Transmission,
        });
        let is_open_loop = runs.iter().all(|run| run.settings.controller.is_none());
        return Signal::Optimised { position, as_torque: is_straight && is_open_loop };
    }
    let amplitude = |joint: &usize| {
        let commands = runs.iter().flat_map(|run| &run.log.tau[*joint]);
        let largest = commands.fold(0.0_f64, |most, tau| most.max(tau.abs()));
        let limit = model.device.joints[*joint].torque_limit;
        let wanted = if largest > 0.0 { MORE * largest } else { 0.2 * limit };
        Some(wanted.min(limit)).filter(|amplitude| amplitude.is_finite())
    };
    Signal::Multisine { amplitude: free.iter().map(amplitude).collect() }
}
