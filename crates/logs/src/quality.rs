//! What a log is worth before any model sees it: sampling, noise, digits, columns that do not move, excitation.

use serde::Serialize;

use crate::{experiment::Run, motion::Motion, noise::last_digit, noise::noise_of_log};
use dynid_signal::motion_bandwidth;

/// A step longer than this many typical ones is a gap.
const GAP: f64 = 1.5;

/// A command at its largest size in more than this share of the samples, in stretches, is cut there.
const SATURATED: f64 = 0.02;

/// Steps that vary by more than this share of the typical one are uneven.
const UNEVEN: f64 = 0.05;

/// A joint whose range is below so many times its noise hardly moves.
pub const LEAST_RANGE_IN_NOISES: f64 = 10.0;

/// Fewer reversals of a joint tell little of friction.
pub const LEAST_REVERSALS: usize = 4;

/// One log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quality {
    /// As the experiment names it.
    pub run: String,
    /// `fit` or `validate`.
    pub role: String,
    /// Number of samples.
    pub n_samples: usize,
    /// s
    pub duration_s: f64,
    /// From the median step (Hz).
    pub rate_hz: f64,
    /// Root mean square deviation of the steps from their median, gaps left out (s).
    pub jitter_s: f64,
    /// Steps that are longer than 1.5 typical ones.
    pub gaps: usize,
    /// The longest step (s).
    pub longest_step_s: f64,
    /// Its free joints.
    pub joints: Vec<JointQuality>,
    /// What should be looked at.
    #[serde(rename = "typed_warnings")]
    pub warnings: Vec<QualityWarning>,
}

/// What should be looked at in a log before it is believed.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum QualityWarning {
    /// Steps longer than 1.5 typical ones.
    Gaps {
        /// How many.
        count: usize,
        /// The longest step (s).
        longest_s: f64,
    },
    /// The sample time varies.
    UnevenSampling {
        /// Root mean square deviation from the typical step, as a share of it (%).
        percent: f64,
    },
    /// A free joint's position never changes.
    ConstantPosition {
        /// The device's joint index.
        joint: usize,
    },
    /// A free joint's range is below [`LEAST_RANGE_IN_NOISES`] times its noise.
    HardlyMoves {
        /// The device's joint index.
        joint: usize,
        /// Range over noise.
        range_in_noises: f64,
    },
    /// A free joint reverses fewer than [`LEAST_REVERSALS`] times.
    FewReversals {
        /// The device's joint index.
        joint: usize,
        /// How often it does.
        reversals: usize,
    },
    /// A free joint's command never changes, and no controller makes it.
    ConstantCommand {
        /// The device's joint index.
        joint: usize,
    },
    /// A command stands at its largest size in stretches: it may be cut off there.
    Saturated {
        /// The device's joint index.
        joint: usize,
        /// In this share of the samples (%).
        percent: f64,
    },
}

/// One free joint's columns.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointQuality {
    /// The device's joint index.
    pub joint: usize,
    /// Standard deviation of the position's noise, from the log alone [rad or m].
    pub noise_floor: f64,
    /// Smallest step of the position: its last digit [rad or m].
    pub quantum: f64,
    /// Least and largest position [rad or m].
    pub range: [f64; 2],
    /// Root mean square speed of the filtered motion [rad/s or m/s].
    pub rms_speed: Option<f64>,
    /// How often the speed changes its sign.
    pub reversals: Option<usize>,
    /// The highest frequency at which the motion exceeds its noise (Hz).
    pub bandwidth_hz: Option<f64>,
    /// Least and largest command [its unit].
    pub command: [f64; 2],
}

/// The quality of a run's log.
pub fn of_run(run: &Run) -> Quality {
    let t = &run.log.t;
    let step = run.log.sample_time();
    let steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let regular: Vec<f64> = steps.iter().copied().filter(|own| *own <= GAP * step).collect();
    let jitter = (regular.iter().map(|own| (own - step).powi(2)).sum::<f64>() / regular.len().max(1) as f64).sqrt();
    let motion = Motion::of(run).ok();
    let joints: Vec<JointQuality> = run
        .free
        .iter()
        .enumerate()
        .map(|(slot, &joint)| {
            let speed = motion.as_ref().map(|motion| &motion.dq[slot]);
            let rms = |values: &Vec<f64>| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
            JointQuality {
                joint,
                noise_floor: noise_of_log(&run.log.q[joint]),
                quantum: last_digit(&run.log.q[joint]),
                range: range(&run.log.q[joint]),
                rms_speed: speed.map(rms),
                reversals: speed.map(|speed| reversals(speed, 0.1 * rms(speed))),
                bandwidth_hz: motion_bandwidth(&run.log.q[joint], step),
                command: range(&run.log.tau[joint]),
            }
        })
        .collect();
    let gaps = steps.len() - regular.len();
    let mut quality = Quality {
        run: run.file.clone(),
        role: run.role.to_string(),
        n_samples: t.len(),
        duration_s: t.last().copied().unwrap_or(0.0) - t.first().copied().unwrap_or(0.0),
        rate_hz: if step > 0.0 { 1.0 / step } else { 0.0 },
        jitter_s: jitter,
        gaps,
        longest_step_s: steps.iter().copied().fold(0.0, f64::max),
        joints,
        warnings: Vec::new(),
    };
    quality.warnings = warnings(run, &quality, step);
    quality
}

fn warnings(run: &Run, quality: &Quality, step: f64) -> Vec<QualityWarning> {
    let mut warnings = Vec::new();
    if quality.gaps > 0 {
        warnings.push(QualityWarning::Gaps { count: quality.gaps, longest_s: quality.longest_step_s });
    }
    if quality.jitter_s > UNEVEN * step {
        warnings.push(QualityWarning::UnevenSampling { percent: 100.0 * quality.jitter_s / step });
    }
    for own in &quality.joints {
        let joint = own.joint;
        let span = own.range[1] - own.range[0];
        if own.range[0] == own.range[1] {
            warnings.push(QualityWarning::ConstantPosition { joint });
        } else if span < LEAST_RANGE_IN_NOISES * own.noise_floor {
            warnings.push(QualityWarning::HardlyMoves { joint, range_in_noises: span / own.noise_floor });
        } else if let Some(reversals) = own.reversals.filter(|reversals| *reversals < LEAST_REVERSALS) {
            warnings.push(QualityWarning::FewReversals { joint, reversals });
        }
        if own.command[0] == own.command[1] && run.settings.controller.is_none() {
            warnings.push(QualityWarning::ConstantCommand { joint });
        }
        let share = saturated(&run.log.tau[joint]);
        if share > SATURATED {
            warnings.push(QualityWarning::Saturated { joint, percent: 100.0 * share });
        }
    }
    warnings
}

fn range(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(*value), high.max(*value)])
}

/// Changes of sign between speeds outside a band about zero.
fn reversals(speed: &[f64], band: f64) -> usize {
    let signs = speed.iter().filter(|dq| dq.abs() > band).map(|dq| dq.signum());
    let signs: Vec<f64> = signs.collect();
    signs.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

/// Share of samples in stretches of three or more at the largest or smallest value. Zero for a signal that knows fewer than
/// eight values: square waves stand at their ends on purpose.
fn saturated(values: &[f64]) -> f64 {
    let mut distinct: Vec<u64> = values.iter().map(|value| value.to_bits()).collect();
    distinct.sort_unstable();
    distinct.dedup();
    if distinct.len() < 8 {
        return 0.0;
    }
    let [low, high] = range(values);
    let at_end = values.chunk_by(|a, b| a == b).filter(|stretch| stretch.len() >= 3);
    let at_end = at_end.filter(|stretch| stretch[0] == low || stretch[0] == high);
    at_end.map(<[f64]>::len).sum::<usize>() as f64 / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::run;

    #[test]
    fn a_cut_command_a_gap_and_a_still_joint_are_said() {
        let t: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k) + if k > 700 { 0.5 } else { 0.0 }).collect();
        let tau: Vec<f64> = t.iter().map(|t| (2.0 * t).sin().clamp(-0.8, 0.8)).collect();
        let q = vec![0.25; 2000];
        let quality = of_run(&run(t, q, tau));
        assert_eq!((quality.gaps, quality.n_samples), (1, 2000));
        assert!((quality.rate_hz - 100.0).abs() < 1e-6 && quality.jitter_s < 1e-9);
        let [
            QualityWarning::Gaps { count: 1, longest_s },
            QualityWarning::ConstantPosition { joint: 0 },
            QualityWarning::Saturated { joint: 0, percent },
        ] = quality.warnings[..]
        else {
            panic!("{:?}", quality.warnings);
        };
        assert!((longest_s - 0.51).abs() < 1e-9, "{longest_s}");
        // |sin| is above 0.8 for 41 % of a period, of which the ends of the run cut a little
        assert!((39.0..42.0).contains(&percent), "{percent}");
    }

    #[test]
    fn a_good_log_has_no_warnings_and_its_quantum_is_found() {
        let t: Vec<f64> = (0..4000).map(|k| 0.01 * f64::from(k)).collect();
        let q = t.iter().map(|t| (0.4 * (3.0 * t).sin() / 1e-3).round() * 1e-3).collect();
        let tau = t.iter().map(|t| (3.0 * t + 0.4).sin()).collect();
        let quality = of_run(&run(t, q, tau));
        assert_eq!(quality.warnings, []);
        let joint = &quality.joints[0];
        assert!((joint.quantum - 1e-3).abs() < 1e-9);
        // 40 s at 3 rad/s: 38 reversals.
        assert_eq!(joint.reversals, Some(38));
        assert!((joint.rms_speed.expect("it moves") - 0.4 * 3.0 / 2.0_f64.sqrt()).abs() < 0.02);
    }
}
