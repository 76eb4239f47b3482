//! Whether the joints move, long enough and at enough frequencies.

use std::collections::BTreeSet;

pub use dynid_logs::noise::MOVES;
use dynid_logs::{experiment::Run, noise, part::LEAST_SAMPLES};
use dynid_signal::power_spectrum;
use dynid_user_model::Model;

use crate::{Unanswered, balance::Balance};

/// Whether a joint moves in a run by more than noise.
pub fn moves(run: &Run, joint: usize) -> bool {
    noise::moves(&run.log.q[joint])
}

/// What follows from lengths and ranges alone.
pub fn unanswered(model: &Model, runs: &[&Run]) -> Vec<Unanswered> {
    let longest = runs.iter().map(|run| run.log.len()).max().unwrap_or(0);
    if longest < LEAST_SAMPLES {
        return vec![Unanswered::AllTooShort { samples: longest, needed: LEAST_SAMPLES }];
    }
    let free: BTreeSet<usize> = runs.iter().flat_map(|run| run.free.iter().copied()).collect();
    let moving: BTreeSet<usize> =
        runs.iter().flat_map(|run| run.free.iter().copied().filter(|joint| moves(run, *joint))).collect();
    if moving.is_empty() {
        return vec![Unanswered::NothingMoves { joints: free.into_iter().collect(), range_in_noises: MOVES }];
    }
    let mut unanswered = Vec::new();
    for run in runs.iter().filter(|run| run.log.len() < LEAST_SAMPLES) {
        let (run, samples) = (run.file.clone(), run.log.len());
        unanswered.push(Unanswered::TooShort { run, samples, needed: LEAST_SAMPLES });
    }
    for &joint in free.difference(&moving) {
        let parameters = parameters_at(model, joint);
        unanswered.push(Unanswered::NeverMoves { joint, range_in_noises: MOVES, parameters });
    }
    for run in runs {
        for &joint in run.free.iter().filter(|joint| moving.contains(joint) && !moves(run, **joint)) {
            unanswered.push(Unanswered::StandsStill { run: run.file.clone(), joint, range_in_noises: MOVES });
        }
    }
    let locked: Vec<usize> = (0..model.device.joints.len()).filter(|joint| !free.contains(joint)).collect();
    if !locked.is_empty() {
        unanswered.push(Unanswered::NeverFree { joints: locked });
    }
    unanswered
}

/// Joints that move at fewer frequencies than their unknowns need.
///
/// A linear system answers a sine with a sine, which tells two numbers, amplitude and phase, and its mean a third. What is
/// not linear tells more, but little of it.
pub fn few_frequencies(model: &Model, balances: &[Balance<'_>]) -> Vec<Unanswered> {
    /// With more, what is not linear decides.
    const MOST_FREQUENCIES: usize = 2;
    let mut unanswered = Vec::new();
    for joint in 0..model.device.joints.len() {
        let own = || balances.iter().filter(|own| own.run.free.contains(&joint) && moves(own.run, joint));
        let unknowns = own().map(|own| own.unknowns(model, joint)).max().unwrap_or(0);
        let mut frequencies: Vec<f64> = Vec::new();
        let mut is_broad = false;
        for own in own() {
            match lines(&own.run.log.q[joint], own.run.log.sample_time()) {
                Some(found) => {
                    for (hz, resolution) in found {
                        if frequencies.iter().all(|known| (known - hz).abs() > 2.0 * resolution) {
                            frequencies.push(hz);
                        }
                    }
                }
                None => is_broad = true,
            }
        }
        let determined = 2 * frequencies.len() + 1;
        if !is_broad && (1..=MOST_FREQUENCIES).contains(&frequencies.len()) && determined < unknowns {
            frequencies.sort_by(f64::total_cmp);
            unanswered.push(Unanswered::FewFrequencies { joint, frequencies_hz: frequencies, unknowns, determined });
        }
    }
    unanswered
}

/// The one or two frequencies that make up a position, each with the resolution (Hz); `None` where its power is spread, or too
/// slow for the run to show as a line.
fn lines(q: &[f64], step: f64) -> Option<Vec<(f64, f64)>> {
    /// Share of the power that the lines make up: what friction adds to a sine is more of a signal than the rest.
    const SHARE: f64 = 0.999;
    const MOST_LINES: usize = 2;
    /// Hann's window spreads a line over so many entries to each side, nearly all of it over one.
    const WIDTH: usize = 3;
    const NARROW: f64 = 0.9;
    /// Samples of one transform: a longer run is thinned to that, for its lines to be told apart.
    const TRANSFORMED: usize = 4096;
    let stride = q.len().div_ceil(TRANSFORMED);
    let thinned: Vec<f64> = q.chunks(stride).map(|part| part.iter().sum::<f64>() / part.len() as f64).collect();
    let spectrum = power_spectrum(&thinned, step * stride as f64)?;
    let mut density = spectrum.density;
    let whole: f64 = density.iter().sum();
    let mut found = Vec::new();
    let mut left = whole;
    while left > (1.0 - SHARE) * whole {
        let peak = (0..density.len()).max_by(|a, b| density[*a].total_cmp(&density[*b]))?;
        if found.len() == MOST_LINES || peak <= WIDTH {
            return None;
        }
        let power = |reach: usize| density[peak - reach..(peak + reach + 1).min(density.len())].iter().sum::<f64>();
        if power(1) < NARROW * power(WIDTH) {
            return None;
        }
        let last = (peak + WIDTH + 1).min(density.len());
        density[peak - WIDTH..last].fill(0.0);
        left = density.iter().sum();
        found.push((peak as f64 * spectrum.resolution_hz, spectrum.resolution_hz));
    }
    Some(found)
}

/// The unknown parameters of the effects at a joint.
pub fn parameters_at(model: &Model, joint: usize) -> Vec<String> {
    let place = format!("joint.{joint}.");
    let parameters = model.parameters().into_iter();
    parameters.filter(|(name, parameter)| !parameter.fixed && name.starts_with(&place)).map(|(name, _)| name).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use dynid_logs::{experiment::Role, experiment::Settings, log::Log};
    use dynid_random::Random;

    /// A run of these columns.
    pub(crate) fn run_of(t: Vec<f64>, q: Vec<Vec<f64>>, tau: Vec<Vec<f64>>, free: &[usize]) -> Run {
        let settings = Settings { min_speed: vec![0.0; q.len()], ..Settings::default() };
        let log = Log { t, tau, q, reference: None, mask: None, left_out: Vec::new() };
        Run {
            file: "made.csv".to_owned(),
            role: Role::Fit,
            free: free.to_vec(),
            payload: None,
            configuration: 1,
            log,
            settings,
        }
    }

    fn model() -> Model {
        Model::of_device(dynid_model::device("planar2r").expect("a shipped device"))
    }

    fn swinging(samples: usize, size: f64) -> Run {
        let mut random = Random::new(1);
        let t: Vec<f64> = (0..samples).map(|k| 0.01 * k as f64).collect();
        let q = t.iter().map(|t| size * (3.0 * t).sin() + 1e-4 * random.normal()).collect();
        let tau = t.iter().map(|t| (3.0 * t).cos()).collect();
        let still = (0..samples).map(|_| 1e-4 * random.normal()).collect();
        run_of(t, vec![q, still], vec![tau, vec![0.0; samples]], &[0, 1])
    }

    #[test]
    fn joints_that_stand_still_are_told() {
        let run = swinging(1000, 0.5);
        let Some(Unanswered::NeverMoves { joint: 1, parameters, .. }) = unanswered(&model(), &[&run]).pop() else {
            panic!("joint 1 stands still")
        };
        assert_eq!(
            parameters,
            ["joint.1.viscous.Fv", "joint.1.coulomb.Fc", "joint.1.coulomb.v_eps"].map(str::to_owned)[..2]
        );
        let still = swinging(1000, 0.0);
        assert!(unanswered(&model(), &[&still])[0].is_everything());
        let both = unanswered(&model(), &[&run, &still]);
        assert!(both.iter().any(|own| matches!(own, Unanswered::StandsStill { joint: 0, .. })), "{both:?}");
    }

    #[test]
    fn short_runs_are_told() {
        let (long, short) = (swinging(1000, 0.5), swinging(20, 0.5));
        assert_eq!(unanswered(&model(), &[&short]), [Unanswered::AllTooShort { samples: 20, needed: LEAST_SAMPLES }]);
        let told = unanswered(&model(), &[&long, &short]);
        assert!(told.iter().any(|own| matches!(own, Unanswered::TooShort { samples: 20, .. })), "{told:?}");
    }

    #[test]
    fn lines_are_counted_and_a_chirp_has_too_many() {
        let wave = |sum: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..4000).map(|k| sum(0.01 * f64::from(k))).collect() };
        let one = lines(&wave(&|t| (TAU * 0.7 * t).sin()), 0.01).expect("a line");
        assert!(one.len() == 1 && (one[0].0 - 0.7).abs() < one[0].1, "{one:?}");
        let two = lines(&wave(&|t| (TAU * 0.7 * t).sin() + 0.5 * (TAU * 1.9 * t).sin()), 0.01).expect("two lines");
        assert_eq!(two.len(), 2);
        assert_eq!(lines(&wave(&|t| (TAU * (0.2 + 0.1 * t) * t).sin()), 0.01), None);
        assert_eq!(lines(&wave(&|t| (TAU * (0.1 + 0.002 * t) * t).sin()), 0.01), None, "a slow chirp is no line");
    }
}
