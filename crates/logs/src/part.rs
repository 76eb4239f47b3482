//! Runs made of parts of others: some of their rows, those that count, or one of every few.

use std::ops::Range;

use dynid_dynamics::simulate::Intersample;
use dynid_signal::statistics::rms;
use rayon::prelude::*;

use crate::experiment::{Role, Run};
use crate::log::Log;

/// Those rows of a run as a run of their own.
#[must_use]
pub fn part(run: &Run, rows: Range<usize>, role: Role) -> Run {
    let mut settings = run.settings.clone();
    if rows.start > 0 {
        settings.began_s = Some(run.began_s());
        // The transient, and what is said of the first half, are the beginning's; later the joints are under way.
        settings.moving = true;
        let offset = run.log.t[rows.start] - run.log.t[0];
        settings.from_s = settings.from_s.map(|span| span - offset).filter(|left| *left > 0.0);
        settings.first_half = 1.0;
    }
    let kept: Vec<usize> = rows.collect();
    Run { role, settings, log: rows_of(&run.log, &kept), ..run.clone() }
}

/// The stretches of a run that its mask lets count, of at least `least` samples; the run itself where it has no mask.
#[must_use]
pub fn unmasked(run: &Run, least: usize) -> Vec<Run> {
    let Some(mask) = &run.log.mask else { return vec![run.clone()] };
    let mut parts = Vec::new();
    let mut start = 0;
    for stretch in mask.chunk_by(|one, other| one == other) {
        let end = start + stretch.len();
        if stretch[0] && stretch.len() >= least {
            parts.push(part(run, start..end, run.role));
        }
        start = end;
    }
    parts
}

/// Samples in which a pattern is told from noise.
pub const LEAST_SAMPLES: usize = 64;

/// By how much each commanded torque accelerates each free joint of a run, per unit of it: a row for each of those, a column for each joint
/// of the device; `None` where that is not known.
pub type Accelerations<'a> = &'a (dyn Fn(&Run) -> Option<Vec<Vec<f64>>> + Sync);

/// The stretches that a mask lets count, thinned where there are more samples than `enough` and fewer tell the same.
#[must_use]
pub fn looked_at<'a>(
    runs: impl IntoIterator<Item = &'a Run>,
    enough: usize,
    accelerations: Accelerations<'_>,
) -> Vec<Run> {
    let whole: Vec<Run> = runs.into_iter().flat_map(|run| unmasked(run, LEAST_SAMPLES)).collect();
    let samples: usize = whole.iter().map(|run| run.log.len() * run.free.len()).sum();
    let most = samples.div_ceil(enough);
    whole.par_iter().map(|run| thinned(run, may_keep_one_of(run, most, accelerations))).collect()
}

/// Of how many samples one may be kept so that predictions say the same: third differences of the positions that are kept are still
/// those of noise for the most part.
///
/// They are `h^3 q'''` of samples `h` apart, which is what a command that does not change in time could not follow, beside the noise,
/// `sqrt(20)` times that of a sample however far apart they are.
///
/// A command that shakes the joint between the samples that are kept, as a loop that feeds the noise of its sensor back does, moves it no
/// less for that: friction that is steep in the speed sees another one. So what is left out of it must not move a joint much, beside what
/// is seen of its motion, or of the noise, from one sample that is kept to the next.
fn may_keep_one_of(run: &Run, most: usize, accelerations: Accelerations<'_>) -> usize {
    /// Third differences of what is kept may be so many times those of all samples.
    const TIMES_NOISE: f64 = 2.0;
    /// What is left out of the command may move a joint by this share of what is seen.
    const SHAKEN: f64 = 0.05;
    let mean_square = |q: &[f64], keep: usize| {
        let at = |k: usize| q[k * keep];
        let n = q.len().div_ceil(keep);
        let third = (3..n).map(|k| at(k) - 3.0 * at(k - 1) + 3.0 * at(k - 2) - at(k - 3));
        third.map(|change| change * change).sum::<f64>() / n.saturating_sub(3).max(1) as f64
    };
    let free = || run.free.iter().map(|joint| run.log.q[*joint].as_slice());
    let is_noise = |keep: usize| free().all(|q| mean_square(q, keep) <= TIMES_NOISE.powi(2) * mean_square(q, 1));
    let accelerations = if most > 1 { accelerations(run) } else { None };
    let is_steady = |keep: usize| {
        let Some(accelerations) = &accelerations else { return false };
        let kept = one_of(run.log.len(), keep);
        let t = &run.log.t;
        // Whether the command stands or runs straight, so that logs are thinned alike by both.
        let pushes = [false, true]
            .map(|is_straight| run.log.tau.iter().map(|tau| left_out(t, tau, is_straight, &kept)).collect::<Vec<_>>());
        let shaken = |by: &[f64], pushes: &[Vec<f64>]| {
            let speed = |row: usize| by.iter().zip(pushes).map(|(by, push)| by * push[row]).sum();
            rms(&(0..t.len()).map(speed).collect::<Vec<f64>>())
        };
        let span = (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64 * keep as f64;
        let moved = |q: &[f64]| rms(&kept.windows(2).map(|pair| q[pair[1]] - q[pair[0]]).collect::<Vec<_>>());
        let moves_itself = run.free.iter().zip(accelerations).all(|(joint, by)| by[*joint].is_normal());
        let hardly_moves = |q: &[f64], by: &[f64]| {
            let most = SHAKEN * moved(q);
            pushes.iter().all(|pushes| shaken(by, pushes) * span <= most)
        };
        moves_itself && free().zip(accelerations).all(|(q, by)| hardly_moves(q, by))
    };
    let has_enough = |keep: usize| run.log.len() >= keep * LEAST_SAMPLES;
    (2..=most).take_while(|keep| has_enough(*keep) && is_noise(*keep) && is_steady(*keep)).last().unwrap_or(1)
}

/// Rows that are kept, one of every few.
fn one_of(rows: usize, keep: usize) -> Vec<usize> {
    (0..rows).step_by(keep).collect()
}

/// Integral over time, at each row, of what the straight command of [`straightened`] leaves out of a command.
fn left_out(t: &[f64], tau: &[f64], is_straight: bool, kept: &[usize]) -> Vec<f64> {
    let line = straightened(t, tau, is_straight, kept);
    let mut integral = vec![0.0; t.len()];
    for (k, pair) in kept.windows(2).enumerate() {
        let (begin, span) = (t[pair[0]], t[pair[1]] - t[pair[0]]);
        for row in pair[0]..pair[1] {
            integral[row + 1] = integral[row];
            for (at, weight) in SIMPSON {
                let straight = line[k] + (t[row] + at * (t[row + 1] - t[row]) - begin) / span * (line[k + 1] - line[k]);
                let left = command_at(tau, is_straight, row, at) - straight;
                integral[row + 1] += weight * (t[row + 1] - t[row]) * left;
            }
        }
    }
    integral
}

/// Where Simpson's rule, which is exact for a product of two lines, looks at the command between two rows: the share of the way to the next,
/// and a weight.
const SIMPSON: [(f64, f64); 3] = [(0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)];

/// Whether a run's command is straight between its rows.
fn is_straight(run: &Run) -> bool {
    run.settings.intersample == Intersample::FirstOrder
}

/// The command at a share of the way from a row to the next.
fn command_at(tau: &[f64], is_straight: bool, row: usize, at: f64) -> f64 {
    if is_straight { tau[row] + at * (tau[row + 1] - tau[row]) } else { tau[row] }
}

/// One of every `keep` samples of a run; between them the command runs straight, as near to what it was as it can be by least squares:
/// a mass that it pushes is then at the samples where it was.
#[must_use]
pub fn thinned(run: &Run, keep: usize) -> Run {
    if keep < 2 {
        return run.clone();
    }
    let log = &run.log;
    let kept = one_of(log.len(), keep);
    let tau = log.tau.iter().map(|tau| straightened(&log.t, tau, is_straight(run), &kept)).collect();
    let mut settings = run.settings.clone();
    settings.intersample = Intersample::FirstOrder;
    Run { settings, log: Log { tau, ..rows_of(log, &kept) }, ..run.clone() }
}

/// Values at the times that are kept of the continuous line, straight between them, that is nearest to a command by least squares: the
/// command is held from its row to the next, or runs straight itself.
fn straightened(t: &[f64], tau: &[f64], is_straight: bool, kept: &[usize]) -> Vec<f64> {
    let n = kept.len();
    // Normal equations: a matrix with three diagonals.
    let (mut diagonal, mut beside, mut moments) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    for (k, pair) in kept.windows(2).enumerate() {
        let (begin, span) = (t[pair[0]], t[pair[1]] - t[pair[0]]);
        diagonal[k] += span / 3.0;
        diagonal[k + 1] += span / 3.0;
        beside[k] = span / 6.0;
        for (row, (at, weight)) in (pair[0]..pair[1]).flat_map(|row| SIMPSON.map(|point| (row, point))) {
            let part = weight * (t[row + 1] - t[row]) * command_at(tau, is_straight, row, at);
            let share = (t[row] + at * (t[row + 1] - t[row]) - begin) / span;
            moments[k] += part * (1.0 - share);
            moments[k + 1] += part * share;
        }
    }
    if n < 2 {
        return kept.iter().map(|row| tau[*row]).collect();
    }
    for k in 1..n {
        let factor = beside[k - 1] / diagonal[k - 1];
        diagonal[k] -= factor * beside[k - 1];
        moments[k] -= factor * moments[k - 1];
    }
    for k in (0..n).rev() {
        let after = if k + 1 < n { beside[k] * moments[k + 1] } else { 0.0 };
        moments[k] = (moments[k] - after) / diagonal[k];
    }
    moments
}

/// Those samples of a log.
fn rows_of(log: &Log, kept: &[usize]) -> Log {
    let take = |values: &Vec<f64>| kept.iter().map(|k| values[*k]).collect();
    Log {
        t: take(&log.t),
        tau: log.tau.iter().map(take).collect(),
        q: log.q.iter().map(take).collect(),
        reference: log.reference.as_ref().map(|reference| reference.iter().map(take).collect()),
        mask: log.mask.as_ref().map(|mask| kept.iter().map(|k| mask[*k]).collect()),
        left_out: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::{left_out, may_keep_one_of, one_of, straightened};
    use crate::fixtures;

    /// A mass that a sine pushes, 0.5 m/s fast, seen 1,000 times a second to 1e-5 m; its torque is logged with a noise of 0.3.
    #[test]
    fn a_log_is_thinned_where_the_command_between_the_samples_moves_little() {
        let noise = |k: u32| (f64::from(k * k % 8_951) * 7.3).sin();
        let t: Vec<f64> = (0..5_000).map(|k| 0.001 * f64::from(k)).collect();
        let q = (0..5_000).map(|k| -0.25 * (0.002 * f64::from(k)).sin() + 1e-5 * noise(k)).collect();
        let tau = (0..5_000).map(|k| (0.002 * f64::from(k)).sin() + 0.4 * noise(k + 3)).collect();
        let run = fixtures::run(t, q, tau);
        // By the noise the speed changes by some 0.3 of 1 ms, whatever is known of the motion.
        let keep = |per_torque: f64| may_keep_one_of(&run, 5, &|_| Some(vec![vec![per_torque]]));
        assert_eq!([keep(1.0), keep(1_000.0)], [5, 1]);
        // What is not known, and what goes through a state, may move much.
        assert_eq!([may_keep_one_of(&run, 5, &|_| None), keep(0.0)], [1, 1]);
        assert_eq!(may_keep_one_of(&run, 1, &|_| Some(vec![vec![1.0]])), 1);
    }

    /// Where a unit mass that was at rest is at each row under a command, and how fast.
    fn pushed(t: &[f64], tau: &[f64], is_straight: bool) -> (Vec<f64>, Vec<f64>) {
        let (mut q, mut dq) = (0.0, 0.0);
        let (mut positions, mut speeds) = (vec![q], vec![dq]);
        for row in 0..t.len() - 1 {
            let (span, end) = (t[row + 1] - t[row], if is_straight { tau[row + 1] } else { tau[row] });
            q += span * dq + span * span * (tau[row] / 3.0 + end / 6.0);
            dq += span * 0.5 * (tau[row] + end);
            positions.push(q);
            speeds.push(dq);
        }
        (positions, speeds)
    }

    #[test]
    fn a_mass_is_where_it_was_at_the_samples_that_are_kept_and_as_much_faster_as_is_left_out() {
        let t: Vec<f64> = (0..61).map(|k| 0.01 * f64::from(k) + 0.003 * f64::from(k % 3)).collect();
        let tau: Vec<f64> = (0..61).map(|k| (0.3 * f64::from(k)).sin() + f64::from(k * 7 % 5) - 2.0).collect();
        for is_straight in [false, true] {
            for keep in [2, 3, 5] {
                let kept = one_of(61, keep);
                let (all, fast) = pushed(&t, &tau, is_straight);
                let times: Vec<f64> = kept.iter().map(|row| t[*row]).collect();
                let (few, slow) = pushed(&times, &straightened(&t, &tau, is_straight, &kept), true);
                let left = left_out(&t, &tau, is_straight, &kept);
                for (k, row) in kept.iter().enumerate() {
                    assert!((all[*row] - few[k]).abs() < 1e-12, "{} is not {}", few[k], all[*row]);
                    assert!((fast[*row] - slow[k] - left[*row]).abs() < 1e-12, "{} is not {}", slow[k], fast[*row]);
                }
            }
        }
    }
}
