//! What a log shows without a model.

use std::f64::consts::PI;

use dynid_logs::{
    experiment::Run,
    motion::Motion,
    noise::noise_floor,
    quality::{JointQuality, Quality, QualityWarning},
};
use dynid_model::{Device, JointKind};

use crate::{Finding, FindingKind, excitation::moves, finding::DegreesBecause};

/// What looks wrong in the columns of a run.
pub fn findings(device: &Device, run: &Run, quality: &Quality) -> Vec<Finding> {
    let of_log = |kind| Finding { run: run.file.clone(), joint: None, kind };
    let mut findings: Vec<Finding> = time_stamps(run, quality).into_iter().map(of_log).collect();
    for own in &quality.joints {
        let at_joint = |kind| Finding { run: run.file.clone(), joint: Some(own.joint), kind };
        let is_revolute = device.joints[own.joint].kind == JointKind::Revolute;
        let wraps = if is_revolute { encoder_wrap(&run.log.q[own.joint]) } else { None };
        let kinds = [
            repeated(&run.log.q[own.joint], own),
            no_noise(run, own),
            coarse_quantum(run, own).filter(|_| wraps.is_none()),
            wraps,
            saturated(&run.log.tau[own.joint], own),
            if is_revolute { beyond_limits(device.joints[own.joint].position_limits, own) } else { None },
        ];
        findings.extend(kinds.into_iter().flatten().map(at_joint));
    }
    findings
}

fn time_stamps(run: &Run, quality: &Quality) -> Vec<FindingKind> {
    /// A step below this share of the typical one is none of the sampling.
    const BUNCHED: f64 = 0.2;
    /// A step above so many typical ones lacks a row; below, the sampling is uneven.
    const GAP: f64 = 1.8;
    let typical_s = run.log.sample_time();
    let steps = || run.log.t.windows(2).map(|pair| pair[1] - pair[0]);
    let mut kinds = Vec::new();
    let count = steps().filter(|step| *step > GAP * typical_s).count();
    if count > 0 {
        kinds.push(FindingKind::Gaps { count, longest_s: quality.longest_step_s });
    }
    kinds.extend(quality.warnings.iter().find_map(|warning| match *warning {
        QualityWarning::UnevenSampling { percent } => Some(FindingKind::UnevenSampling { percent }),
        _ => None,
    }));
    let short = || steps().filter(|step| *step < BUNCHED * typical_s);
    let count = short().count();
    if count > 0 {
        kinds.push(FindingKind::BunchedSamples { count, shortest_s: short().fold(f64::INFINITY, f64::min), typical_s });
    }
    kinds
}

/// Jumps of about a turn, in radians or degrees.
fn encoder_wrap(q: &[f64]) -> Option<FindingKind> {
    let found = [2.0 * PI, 360.0].into_iter().find_map(|turn| wraps(q, turn));
    found.map(|Wraps { count, jump }| FindingKind::EncoderWrap { count, jump })
}

/// Jumps of a position that begins anew after each turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wraps {
    /// How many.
    pub count: usize,
    /// Their mean size [unit of the position].
    pub jump: f64,
}

/// Jumps of about `turn`, in the unit of the position, in a motion whose other steps are far smaller.
pub fn wraps(q: &[f64], turn: f64) -> Option<Wraps> {
    /// How far from a turn a jump may be: the motion of one sample is in it.
    const NEAR: f64 = 0.1;
    let steps = || q.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let is_jump = |step: &f64| (step / turn - 1.0).abs() < NEAR;
    let count = steps().filter(is_jump).count();
    let largest_other = steps().filter(|step| !is_jump(step)).fold(0.0, f64::max);
    let jump = steps().filter(is_jump).sum::<f64>() / count as f64;
    (count > 0 && largest_other < 2.0 * NEAR * turn).then_some(Wraps { count, jump })
}

/// A position that stands from row to row although it has moved on by several digits about those rows.
fn repeated(q: &[f64], own: &JointQuality) -> Option<FindingKind> {
    /// Share of the rows in which the joint moves (%).
    const MOST_PERCENT: f64 = 20.0;
    /// So many rows must move for a share to mean something.
    const LEAST_ROWS: usize = 64;
    // Over four rows the joint moves by more digits than noise of their size explains; without digits no two rows are equal.
    let moving = || q.windows(4).filter(|four| (four[3] - four[0]).abs() > 8.0 * own.quantum);
    let rows = moving().count();
    let standing = moving().filter(|four| four[1] == four[2]).count();
    let percent = 100.0 * standing as f64 / rows.max(1) as f64;
    (rows >= LEAST_ROWS && percent > MOST_PERCENT).then_some(FindingKind::RepeatedPositions { percent })
}

fn no_noise(run: &Run, own: &JointQuality) -> Option<FindingKind> {
    /// No sensor resolves a ten-millionth of its range.
    const CLEAN: f64 = 1e-7;
    let range = own.range[1] - own.range[0];
    let is_clean = moves(run, own.joint) && own.noise_floor < CLEAN * range;
    is_clean.then_some(FindingKind::NoNoise { noise: own.noise_floor, range })
}

/// Digits above the noise matter by what they do to the acceleration: white errors of `quantum / sqrt(12)`, filtered to the
/// cut-off `f` at the sample rate `r`, are accelerations of `(2 pi f)^2 sqrt(2 f / (5 r))` times that.
fn coarse_quantum(run: &Run, own: &JointQuality) -> Option<FindingKind> {
    /// Share of the acceleration that may be the digits' (%).
    const MOST_PERCENT: f64 = 20.0;
    if own.quantum == 0.0 {
        return None;
    }
    let digits = own.quantum / 12.0_f64.sqrt();
    let noise = (noise_floor(&run.log.q[own.joint]).powi(2) - digits * digits).max(0.0).sqrt();
    let motion = Motion::of(run).ok()?;
    let slot = run.free.iter().position(|joint| *joint == own.joint)?;
    let acceleration = &motion.ddq[slot];
    let rms = (acceleration.iter().map(|value| value * value).sum::<f64>() / acceleration.len() as f64).sqrt();
    let band = (2.0 * PI * motion.cutoff_hz).powi(2) * (0.4 * motion.cutoff_hz / motion.grid.rate_hz()).sqrt();
    let percent = 100.0 * digits * band / rms;
    (own.quantum > noise && percent > MOST_PERCENT).then_some(FindingKind::CoarseQuantum {
        quantum: own.quantum,
        noise,
        acceleration_percent: percent,
    })
}

/// Stretches of three rows or more at the largest or smallest command, unless that is none. A command of fewer than eight
/// values is a square wave: it stands at its ends on purpose.
fn saturated(tau: &[f64], own: &JointQuality) -> Option<FindingKind> {
    /// Share of the rows (%).
    const LEAST_PERCENT: f64 = 2.0;
    const STRETCH: usize = 3;
    const FEW_VALUES: usize = 8;
    let mut distinct: Vec<u64> = tau.iter().map(|value| value.to_bits()).collect();
    distinct.sort_unstable();
    distinct.dedup();
    if distinct.len() < FEW_VALUES {
        return None;
    }
    let percent_at = |level: f64| {
        let stretches = tau.chunk_by(|a, b| a == b).filter(|own| own.len() >= STRETCH && own[0] == level);
        100.0 * stretches.map(<[f64]>::len).sum::<usize>() as f64 / tau.len() as f64
    };
    let cut: Vec<(f64, f64)> = own
        .command
        .iter()
        .filter(|level| **level != 0.0)
        .map(|level| (*level, percent_at(*level)))
        .filter(|(_, percent)| *percent > 0.5 * LEAST_PERCENT)
        .collect();
    let percent: f64 = cut.iter().map(|(_, percent)| percent).sum();
    let levels = cut.into_iter().map(|(level, _)| level).collect();
    (percent > LEAST_PERCENT).then_some(FindingKind::Saturated { levels, percent })
}

/// A position far outside what the joint can reach that lies within when it is read as degrees.
fn beyond_limits([lower, upper]: [f64; 2], own: &JointQuality) -> Option<FindingKind> {
    /// How far beyond its limits a position is no joint's.
    const BEYOND: f64 = 3.0;
    const DEGREE: f64 = PI / 180.0;
    if !(lower.is_finite() && upper.is_finite()) {
        return None;
    }
    let largest = own.range[0].abs().max(own.range[1].abs());
    let reach = lower.abs().max(upper.abs());
    let is_within = own.range[0] * DEGREE >= lower - 0.1 * reach && own.range[1] * DEGREE <= upper + 0.1 * reach;
    (largest > BEYOND * reach && is_within)
        .then_some(FindingKind::Degrees { largest, because: DegreesBecause::Limits { lower, upper } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::tests::run_of;
    use dynid_logs::quality;
    use dynid_random::Random;

    /// A joint that swings by 1 rad in noise of 1e-4 rad, whose columns `change` makes wrong.
    fn found(change: impl FnOnce(&mut Run)) -> Vec<FindingKind> {
        let mut random = Random::new(3);
        let t: Vec<f64> = (0..3000).map(|k| 0.01 * f64::from(k)).collect();
        let q = t.iter().map(|t| (3.0 * t).sin() + 0.2 * (7.1 * t).sin() + 1e-4 * random.normal()).collect();
        let tau: Vec<f64> = t.iter().map(|t| (3.0 * t + 0.4).sin() + 0.5 * (7.1 * t).cos()).collect();
        let mut run = run_of(t, vec![q, vec![0.3; 3000]], vec![tau, vec![0.0; 3000]], &[0]);
        change(&mut run);
        let device = dynid_model::device("planar2r").expect("a shipped device");
        findings(device, &run, &quality::of_run(&run)).into_iter().map(|finding| finding.kind).collect()
    }

    #[test]
    fn a_good_log_has_nothing_wrong() {
        assert_eq!(found(|_| ()), []);
    }

    #[test]
    fn wrong_time_stamps_are_found() {
        let [FindingKind::Gaps { count: 1, longest_s }] =
            found(|run| run.log.t.iter_mut().skip(1000).for_each(|t| *t += 0.4))[..]
        else {
            panic!("a gap")
        };
        assert!((longest_s - 0.41).abs() < 1e-9);
        let mut random = Random::new(4);
        let uneven = found(|run| run.log.t.iter_mut().for_each(|t| *t += 0.002 * (random.unit() - 0.5)));
        let [FindingKind::UnevenSampling { percent }] = uneven[..] else { panic!("{uneven:?}") };
        // differences of two numbers that are even over 2 ms: sqrt(2/12) of it
        assert!((percent - 100.0 * 0.2 / 6.0_f64.sqrt()).abs() < 1.0, "{percent}");
        let bunched = found(|run| (100..110).for_each(|k| run.log.t[250 * (k - 99)] -= 0.0095));
        let [.., FindingKind::BunchedSamples { count: 10, shortest_s, .. }] = bunched[..] else {
            panic!("{bunched:?}")
        };
        assert!((shortest_s - 5e-4).abs() < 1e-9);
    }

    #[test]
    fn a_wrapping_encoder_is_found() {
        let wrapped = found(|run| {
            run.log.q[0].iter_mut().for_each(|q| *q = (*q + 0.5 + PI).rem_euclid(2.0 * PI) - PI);
            run.log.q[0].iter_mut().for_each(|q| *q *= 1.0);
        });
        assert_eq!(wrapped, [], "a swing below half a turn does not wrap");
        let wrapped = found(|run| {
            run.log.q[0].iter_mut().for_each(|q| *q = (*q + 3.0 + PI).rem_euclid(2.0 * PI) - PI);
        });
        let Some(FindingKind::EncoderWrap { count, jump }) =
            wrapped.iter().find(|kind| matches!(kind, FindingKind::EncoderWrap { .. }))
        else {
            panic!("{wrapped:?}")
        };
        assert!(*count > 10 && (jump - 2.0 * PI).abs() < 0.1, "{count} {jump}");
    }

    #[test]
    fn repeated_rows_and_clean_positions_are_found() {
        let repeated = found(|run| (0..3000).for_each(|k| run.log.q[0][k] = run.log.q[0][k - k % 2]));
        let Some(FindingKind::RepeatedPositions { percent }) = repeated.first() else { panic!("{repeated:?}") };
        assert!((percent - 50.0).abs() < 5.0, "{percent}");
        let clean = found(|run| run.log.q[0] = run.log.t.iter().map(|t| (0.3 * t).sin()).collect());
        assert!(clean.iter().any(|kind| matches!(kind, FindingKind::NoNoise { .. })), "{clean:?}");
    }

    #[test]
    fn coarse_digits_are_found_where_they_matter() {
        let round = |to: f64| {
            found(move |run| {
                run.settings.cutoff_hz = Some(10.0);
                run.log.q[0].iter_mut().for_each(|q| *q = (*q / to).round() * to);
            })
        };
        assert_eq!(round(2e-4), [], "not where the acceleration does not suffer");
        let coarse = round(0.02);
        let [FindingKind::CoarseQuantum { quantum, acceleration_percent, .. }] = coarse[..] else {
            panic!("{coarse:?}")
        };
        assert!((quantum - 0.02).abs() < 1e-6 && acceleration_percent > 20.0, "{coarse:?}");
    }

    #[test]
    fn a_cut_command_is_found_with_its_level() {
        let cut = found(|run| run.log.tau[0].iter_mut().for_each(|tau| *tau = tau.clamp(-0.9, 0.9)));
        let [FindingKind::Saturated { levels, percent }] = &cut[..] else { panic!("{cut:?}") };
        assert!(*levels == [-0.9, 0.9] && (20.0..60.0).contains(percent), "{cut:?}");
        let off = found(|run| run.log.tau[0].iter_mut().for_each(|tau| *tau = tau.max(0.0)));
        assert_eq!(off, [], "a command that is none is no command at its end");
    }

    #[test]
    fn degrees_beyond_the_joints_limits_are_found() {
        let degrees = found(|run| run.log.q[0].iter_mut().for_each(|q| *q *= 180.0 / PI));
        let [FindingKind::Degrees { largest, because: DegreesBecause::Limits { .. } }] = degrees[..] else {
            panic!("{degrees:?}")
        };
        assert!((60.0..75.0).contains(&largest), "{largest}");
    }
}
