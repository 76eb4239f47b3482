//! The measured motion of a run: filtered positions with their derivatives, and which samples count.

use serde::Serialize;

use crate::experiment::Run;
use dynid_dynamics::simulate::Intersample;
use dynid_signal::{
    Gap, Grid, Lowpass, decimate, first_derivative, held, motion_bandwidth, second_derivative, straight,
};

/// Cut-off over the rate after decimation. A fourth-order Butterworth filter of half the new Nyquist frequency, run
/// forwards and backwards, leaves `1 / (1 + 2^8)`, 0.4 %, of what decimation folds back from there.
const DECIMATED_CUTOFF: f64 = 0.25;

/// A chosen cut-off stays below this share of the sample rate.
const HIGHEST_CUTOFF: f64 = 0.2;

/// The measured motion along which torques are compared. Vectors of samples are on `grid`.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Uniform times.
    pub grid: Grid,
    /// Cut-off of the zero-phase filter of the positions (Hz).
    pub cutoff_hz: f64,
    /// Cut-off of the zero-phase filter that regressor and torque pass alike (Hz): lower than `cutoff_hz` where
    /// decimation asks for it.
    pub parallel_cutoff_hz: f64,
    /// Positions of the free joints, filtered [rad or m].
    pub q: Vec<Vec<f64>>,
    /// Their first derivatives.
    pub dq: Vec<Vec<f64>>,
    /// Their second derivatives.
    pub ddq: Vec<Vec<f64>>,
    /// Commanded torque of every joint of the device, not filtered [N*m or N]: where it is held between samples, its
    /// mean over a step about each time.
    pub command: Vec<Vec<f64>>,
    /// Positions of the locked joints, ascending [rad or m].
    pub locked: Vec<f64>,
    /// Samples of the grid that remain after decimation.
    pub kept: Vec<usize>,
    /// Per free joint, for each kept sample: whether it counts in the torque error.
    pub used: Vec<Vec<bool>>,
    /// First time of the grid, counted from the beginning of the run (s).
    from_s: f64,
    filter: Lowpass,
    decimation: usize,
}

/// Why a run has no torque error.
#[derive(Debug, Clone, PartialEq, Serialize, thiserror::Error)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum MotionError {
    /// The filter does not fit the sampling.
    #[error(
        "{file}: cutoff_hz = {cutoff_hz} is not below half of the sample rate ({rate_hz:.4} Hz); choose a lower cut-off"
    )]
    Cutoff {
        /// The run's log.
        file: String,
        /// Asked for (Hz).
        cutoff_hz: f64,
        /// Samples a second.
        rate_hz: f64,
    },
    /// No period of the cut-off fits into the log.
    #[error(
        "{file}: cutoff_hz = {cutoff_hz:?} has a period longer than the log ({span_s:.4} s); choose a higher cut-off"
    )]
    SlowCutoff {
        /// The run's log.
        file: String,
        /// Asked for (Hz).
        cutoff_hz: f64,
        /// Length of the log (s).
        span_s: f64,
    },
    /// Times that are mostly a gap.
    #[error(
        "{file}: nothing is logged from {from} s to {to} s, too long to go across; keep the part before or after it \
         (rows = [from, to])"
    )]
    Gap {
        /// The run's log.
        file: String,
        /// Last time before the gap (s).
        from: f64,
        /// First time after it (s).
        to: f64,
    },
    /// Nothing is left of a run.
    #[error(
        "{file}: {n_samples} samples are too few for a filter of {cutoff_hz} Hz, which needs {needed}; use a longer log, a higher cutoff_hz or a smaller decimate"
    )]
    TooShort {
        /// The run's log.
        file: String,
        /// Samples that there are.
        n_samples: usize,
        /// Samples that the filter needs.
        needed: usize,
        /// Its cut-off (Hz).
        cutoff_hz: f64,
    },
}

impl Motion {
    /// The motion that `run` measured.
    ///
    /// Positions are brought to a uniform grid where the log is not uniform (straight from sample to sample, at the
    /// median step), filtered without phase and differentiated. Without a cut-off in the experiment, the highest frequency
    /// is taken at which the position of a free joint exceeds its noise.
    ///
    /// # Errors
    /// A cut-off above half of the sample rate or below one period in the log, a log too short for it, a log that is mostly a gap.
    pub fn of(run: &Run) -> Result<Self, MotionError> {
        let log = &run.log;
        let grid =
            Grid::of(&log.t).map_err(|Gap { from, to }| MotionError::Gap { file: run.file.clone(), from, to })?;
        let positions: Vec<Vec<f64>> = run.free.iter().map(|&joint| straight(&log.t, &log.q[joint], &grid)).collect();
        let cutoff_hz = run.settings.cutoff_hz.unwrap_or_else(|| choose_cutoff(&positions, &grid));
        let decimation = run.settings.decimate;
        let parallel_cutoff_hz = match decimation {
            1 => cutoff_hz,
            factor => cutoff_hz.min(DECIMATED_CUTOFF * grid.rate_hz() / factor as f64),
        };
        let span_s = grid.len as f64 * grid.step;
        if parallel_cutoff_hz * span_s < 1.0 {
            return Err(MotionError::SlowCutoff { file: run.file.clone(), cutoff_hz: parallel_cutoff_hz, span_s });
        }
        let lowpass = |hertz: f64| {
            Lowpass::new(hertz, grid.rate_hz()).ok_or_else(|| MotionError::Cutoff {
                file: run.file.clone(),
                cutoff_hz: hertz,
                rate_hz: grid.rate_hz(),
            })
        };
        let (position_filter, filter) = (lowpass(cutoff_hz)?, lowpass(parallel_cutoff_hz)?);
        let needed = 3 * filter.settling() + decimation;
        if grid.len < needed {
            let file = run.file.clone();
            return Err(MotionError::TooShort { file, n_samples: grid.len, needed, cutoff_hz: parallel_cutoff_hz });
        }

        let q: Vec<Vec<f64>> = positions.iter().map(|position| position_filter.apply(position)).collect();
        let dq: Vec<Vec<f64>> = q.iter().map(|position| first_derivative(position, grid.step)).collect();
        let ddq = q.iter().map(|position| second_derivative(position, grid.step)).collect();
        let command = log.tau.iter().map(|tau| match run.settings.intersample {
            Intersample::ZeroOrder => held(&log.t, tau, &grid),
            Intersample::FirstOrder => straight(&log.t, tau, &grid),
        });

        let kept: Vec<usize> = (0..grid.len).step_by(decimation).collect();
        let unmasked = grid.between(&log.t, log.mask.as_deref());
        // What the line across a gap makes up, the filter spreads as far as what it makes up at the ends.
        let away = grid.away_from_gaps(&log.t, filter.settling());
        let inside = filter.settling()..grid.len - filter.settling();
        let used = run.free.iter().zip(&dq).map(|(&joint, dq)| {
            let slowest = run.settings.min_speed[joint];
            kept.iter().map(|&k| inside.contains(&k) && away[k] && unmasked[k] && dq[k].abs() >= slowest).collect()
        });
        let locked = (0..log.q.len()).filter(|joint| !run.free.contains(joint));
        Ok(Self {
            grid,
            cutoff_hz,
            parallel_cutoff_hz,
            command: command.collect(),
            locked: locked.map(|joint| log.mean_position(joint)).collect(),
            used: used.collect(),
            q,
            dq,
            ddq,
            kept,
            from_s: grid.start - run.began_s(),
            filter,
            decimation,
        })
    }

    /// A signal on the grid as the torque error sees it: filtered, and only the kept samples.
    pub fn filtered(&self, signal: &[f64]) -> Vec<f64> {
        decimate(&self.filter.apply(signal), self.decimation)
    }

    /// The command of a joint and its rate [unit of the command per s] at `place` on the grid, where 1.5 is halfway from
    /// sample 1 to 2: the cubic through the samples around it whose slopes are theirs (Catmull & Rom 1974). The first
    /// command holds before the grid, and the last one after it.
    pub fn command_at(&self, joint: usize, place: f64) -> (f64, f64) {
        let values = &self.command[joint];
        let last = values.len() - 1;
        if place <= 0.0 || place >= last as f64 {
            return (values[if place <= 0.0 { 0 } else { last }], 0.0);
        }
        let k = place as usize;
        let share = place - k as f64;
        let [before, now, next, after] = [k.saturating_sub(1), k, k + 1, (k + 2).min(last)].map(|k| values[k]);
        let (slope, slope_next) = (0.5 * (next - before), 0.5 * (after - now));
        // now + slope s + b s^2 + c s^3, which is `next` with `slope_next` at s = 1
        let b = 3.0 * (next - now) - 2.0 * slope - slope_next;
        let c = slope + slope_next - 2.0 * (next - now);
        let value = now + share * (slope + share * (b + share * c));
        (value, (slope + share * (2.0 * b + share * 3.0 * c)) / self.grid.step)
    }

    /// Time of sample `k`, counted from the beginning of the run (s): the effects' time.
    pub fn elapsed_s(&self, k: usize) -> f64 {
        self.from_s + k as f64 * self.grid.step
    }

    /// Number of samples on the grid.
    pub fn len(&self) -> usize {
        self.grid.len
    }

    /// True without samples; no motion is.
    pub fn is_empty(&self) -> bool {
        self.grid.len == 0
    }
}

/// The highest frequency at which one of the positions exceeds its noise, at most a share of the sample rate.
fn choose_cutoff(positions: &[Vec<f64>], grid: &Grid) -> f64 {
    let highest = HIGHEST_CUTOFF * grid.rate_hz();
    let bandwidth = positions.iter().filter_map(|position| motion_bandwidth(position, grid.step));
    let bandwidth = bandwidth.fold(0.0, f64::max);
    if bandwidth > 0.0 { bandwidth.min(highest) } else { highest }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::{experiment::Role, experiment::Settings, log::Log};

    fn sine_run(rate: f64, n_samples: usize, settings: Settings) -> Run {
        let t: Vec<f64> = (0..n_samples).map(|k| k as f64 / rate).collect();
        let q: Vec<f64> = t.iter().map(|t| 0.5 * (2.0 * PI * t).sin()).collect();
        let tau = t.iter().map(|t| t.cos()).collect();
        let log = Log {
            tau: vec![tau, vec![0.0; n_samples]],
            q: vec![q, vec![0.3; n_samples]],
            t,
            reference: None,
            mask: None,
            left_out: Vec::new(),
        };
        Run {
            file: "sine.csv".to_owned(),
            role: Role::Fit,
            free: vec![0],
            payload: None,
            configuration: 1,
            log,
            settings,
        }
    }

    fn settings() -> Settings {
        Settings {
            cutoff_hz: Some(10.0),
            decimate: 1,
            min_speed: vec![0.0; 2],
            intersample: Intersample::FirstOrder,
            ..Settings::default()
        }
    }

    #[test]
    fn derivatives_of_a_sine() {
        let motion = Motion::of(&sine_run(200.0, 2000, settings())).expect("long enough");
        assert_eq!(motion.kept.len(), 2000);
        assert!((motion.locked[0] - 0.3).abs() < 1e-12);
        for k in 200..1800 {
            let phase = 2.0 * PI * motion.grid.time(k);
            assert!((motion.q[0][k] - 0.5 * phase.sin()).abs() < 1e-6);
            assert!((motion.dq[0][k] - PI * phase.cos()).abs() < 1e-5);
            assert!((motion.ddq[0][k] + 2.0 * PI * PI * phase.sin()).abs() < 1e-4);
        }
    }

    #[test]
    fn slow_masked_and_outer_samples_do_not_count() {
        let mut run = sine_run(200.0, 2000, Settings { min_speed: vec![1.0, 0.0], decimate: 4, ..settings() });
        run.log.mask = Some((0..2000).map(|k| k < 1000).collect());
        let motion = Motion::of(&run).expect("long enough");
        assert_eq!(motion.parallel_cutoff_hz, 10.0, "the cut-off already satisfies the decimation");
        for (k, used) in motion.kept.iter().zip(&motion.used[0]) {
            let expected = motion.dq[0][*k].abs() >= 1.0 && (40..1000).contains(k);
            assert_eq!(*used, expected, "sample {k}");
        }
        run.settings.decimate = 10;
        assert!((Motion::of(&run).expect("long enough").parallel_cutoff_hz - 5.0).abs() < 1e-9);
    }

    /// Half a second is not logged: the filter spreads what the line across it makes up.
    #[test]
    fn samples_beside_a_gap_do_not_count() {
        let mut run = sine_run(200.0, 2000, settings());
        let log = &mut run.log;
        for values in log.q.iter_mut().chain(&mut log.tau).chain([&mut log.t]) {
            values.drain(900..1000);
        }
        let motion = Motion::of(&run).expect("long enough");
        let counted = |k: usize| motion.used[0][k];
        assert!((40..=850).all(counted) && (1050..1950).all(counted));
        assert!(!(861..=1038).any(counted));
        for k in (0..motion.len()).filter(|k| counted(*k)) {
            let phase = 2.0 * PI * motion.grid.time(k);
            assert!((motion.ddq[0][k] + 2.0 * PI * PI * phase.sin()).abs() < 0.05 * 2.0 * PI * PI, "sample {k}");
        }
    }

    #[test]
    fn the_cutoff_is_found_where_none_is_given() {
        let motion =
            Motion::of(&sine_run(200.0, 8000, Settings { cutoff_hz: None, ..settings() })).expect("long enough");
        assert!(motion.cutoff_hz > 1.0 && motion.cutoff_hz <= 40.0, "{}", motion.cutoff_hz);
    }

    #[test]
    fn what_cannot_be_filtered_is_said() {
        let error = |rate, n_samples| {
            let refused = Motion::of(&sine_run(rate, n_samples, settings())).expect_err("cannot be filtered");
            refused.to_string()
        };
        insta::assert_snapshot!(error(15.0, 1000), @"sine.csv: cutoff_hz = 10 is not below half of the sample rate (15.0000 Hz); choose a lower cut-off");
        insta::assert_snapshot!(error(200.0, 50), @"sine.csv: 50 samples are too few for a filter of 10 Hz, which needs 121; use a longer log, a higher cutoff_hz or a smaller decimate");
        let mut slow = sine_run(200.0, 1000, Settings { cutoff_hz: Some(1e-300), ..settings() });
        insta::assert_snapshot!(Motion::of(&slow).expect_err("no period fits"), @"sine.csv: cutoff_hz = 1e-300 has a period longer than the log (5.0000 s); choose a higher cut-off");
        slow.settings.cutoff_hz = Some(10.0);
        slow.log.t[999] = 1e15;
        insta::assert_snapshot!(Motion::of(&slow).expect_err("nothing but a gap"), @"sine.csv: nothing is logged from 4.99 s to 1000000000000000 s, too long to go across; keep the part before or after it (rows = [from, to])");
    }
}
