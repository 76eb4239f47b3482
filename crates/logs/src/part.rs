//! Runs made of parts of others: some of their rows, those that count, or one of every few.

use std::ops::Range;

use dynid_dynamics::simulate::Intersample;
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

/// The stretches that a mask lets count, thinned where there are more samples than `enough` and fewer tell the same.
#[must_use]
pub fn looked_at<'a>(runs: impl IntoIterator<Item = &'a Run>, enough: usize) -> Vec<Run> {
    let whole: Vec<Run> = runs.into_iter().flat_map(|run| unmasked(run, LEAST_SAMPLES)).collect();
    let samples: usize = whole.iter().map(|run| run.log.len() * run.free.len()).sum();
    let most = samples.div_ceil(enough);
    whole.par_iter().map(|run| thinned(run, may_keep_one_of(run, most))).collect()
}

/// Of how many samples one may be kept so that predictions say the same: third differences of the positions that are kept are still
/// those of noise for the most part.
///
/// They are `h^3 q'''` of samples `h` apart, which is what a command that does not change in time could not follow, beside the noise,
/// `sqrt(20)` times that of a sample however far apart they are.
///
/// A command that shakes the joint between the samples that are kept, as a loop that feeds the noise of its sensor back does, moves it no
/// less for that: friction that is steep in the speed sees another one. So of the command, too, nearly all must be kept.
#[must_use]
pub fn may_keep_one_of(run: &Run, most: usize) -> usize {
    /// Third differences of what is kept may be so many times those of all samples.
    const TIMES_NOISE: f64 = 2.0;
    /// What may be left out of the command, as a share of its deviation from its mean.
    const LEFT_OUT: f64 = 0.05;
    let mean_square = |q: &[f64], keep: usize| {
        let at = |k: usize| q[k * keep];
        let n = q.len().div_ceil(keep);
        let third = (3..n).map(|k| at(k) - 3.0 * at(k - 1) + 3.0 * at(k - 2) - at(k - 3));
        third.map(|change| change * change).sum::<f64>() / n.saturating_sub(3).max(1) as f64
    };
    let is_noise = |keep: usize| {
        let mut free = run.free.iter().map(|joint| run.log.q[*joint].as_slice());
        free.all(|q| mean_square(q, keep) <= TIMES_NOISE.powi(2) * mean_square(q, 1))
    };
    let is_straight = run.settings.intersample == Intersample::FirstOrder;
    let is_whole = |keep: usize| {
        let kept = one_of(run.log.len(), keep);
        let mut free = run.free.iter().map(|joint| run.log.tau[*joint].as_slice());
        free.all(|tau| left_out(&run.log.t, tau, is_straight, &kept) <= LEFT_OUT)
    };
    (2..=most).take_while(|keep| is_noise(*keep) && is_whole(*keep)).last().unwrap_or(1)
}

/// Rows that are kept, one of every few.
fn one_of(rows: usize, keep: usize) -> Vec<usize> {
    (0..rows).step_by(keep).collect()
}

/// What the straight command of [`straightened`] leaves out of a command, as a share of what the command deviates from its mean by.
fn left_out(t: &[f64], tau: &[f64], is_straight: bool, kept: &[usize]) -> f64 {
    let line = straightened(t, tau, is_straight, kept);
    let mean = tau.iter().sum::<f64>() / tau.len().max(1) as f64;
    let (mut left, mut all, mut least) = (0.0, 0.0, f64::MIN_POSITIVE);
    for (k, pair) in kept.windows(2).enumerate() {
        let (begin, span) = (t[pair[0]], t[pair[1]] - t[pair[0]]);
        for (row, at, weight) in within(pair) {
            let (value, time) = (command_at(tau, is_straight, row, at), t[row] + at * (t[row + 1] - t[row]));
            let straight = line[k] + (time - begin) / span * (line[k + 1] - line[k]);
            let weight = weight * (t[row + 1] - t[row]);
            left += weight * (value - straight).powi(2);
            all += weight * (value - mean).powi(2);
            // Of a command that never changes nothing but rounding is left out.
            least += weight * f64::EPSILON * mean.powi(2);
        }
    }
    (left / f64::max(all, least)).sqrt()
}

/// Where Simpson's rule, which is exact for a product of two lines, looks at the command between two rows that are kept: a row, the share of
/// the way to the next, and a weight.
fn within(pair: &[usize]) -> impl Iterator<Item = (usize, f64, f64)> {
    const AT: [(f64, f64); 3] = [(0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)];
    (pair[0]..pair[1]).flat_map(|row| AT.map(|(at, weight)| (row, at, weight)))
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
    let is_straight = run.settings.intersample == Intersample::FirstOrder;
    let tau = log.tau.iter().map(|tau| straightened(&log.t, tau, is_straight, &kept)).collect();
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
        for (row, at, weight) in within(pair) {
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
    use super::{left_out, straightened};

    /// Of held steps of a ramp the mean square of a saw-tooth is left out, of noise most, and of what does not change nothing.
    #[test]
    fn what_is_left_out_of_a_command_is_a_share_of_it() {
        let t: Vec<f64> = (0..601).map(|k| 0.01 * f64::from(k)).collect();
        let kept = super::one_of(601, 4);
        let ramp: Vec<f64> = t.clone();
        // The saw-tooth is a step over sqrt(12), the ramp its length over that.
        let share = left_out(&t, &ramp, false, &kept);
        assert!((share - 1.0 / 600.0).abs() < 1e-4, "{share}");
        assert!(left_out(&t, &ramp, true, &kept) < 1e-12);
        assert!(left_out(&t, &vec![2.0; 601], false, &kept) < 1e-6);
        let noise: Vec<f64> = (0..601).map(|k| (f64::from(k * k % 89) * 7.3).sin()).collect();
        assert!(left_out(&t, &noise, false, &kept) > 0.7);
    }

    /// Where a unit mass at rest is at the rows that are wanted, under a command.
    fn pushed(t: &[f64], tau: &[f64], is_straight: bool) -> Vec<f64> {
        let (mut q, mut dq) = (0.0, 0.0);
        let mut positions = vec![q];
        for row in 0..t.len() - 1 {
            let (span, end) = (t[row + 1] - t[row], if is_straight { tau[row + 1] } else { tau[row] });
            q += span * dq + span * span * (tau[row] / 3.0 + end / 6.0);
            dq += span * 0.5 * (tau[row] + end);
            positions.push(q);
        }
        positions
    }

    #[test]
    fn a_mass_is_where_it_was_at_the_samples_that_are_kept() {
        let t: Vec<f64> = (0..61).map(|k| 0.01 * f64::from(k) + 0.003 * f64::from(k % 3)).collect();
        let tau: Vec<f64> = (0..61).map(|k| (0.3 * f64::from(k)).sin() + f64::from(k * 7 % 5) - 2.0).collect();
        for is_straight in [false, true] {
            for keep in [2, 3, 5] {
                let kept: Vec<usize> = (0..61).step_by(keep).collect();
                let all = pushed(&t, &tau, is_straight);
                let times: Vec<f64> = kept.iter().map(|row| t[*row]).collect();
                let few = pushed(&times, &straightened(&t, &tau, is_straight, &kept), true);
                for (row, few) in kept.iter().zip(few) {
                    assert!((all[*row] - few).abs() < 1e-12, "{few} is not {}", all[*row]);
                }
            }
        }
    }
}
