//! Runs made of parts of others: some of their rows, those that count, or one of every few.

use std::ops::Range;

use dynid_dynamics::simulate::Intersample;

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

/// Of how many samples one may be kept so that predictions from the mean command between those say the same: third differences of
/// the positions that are kept are still those of noise for the most part.
///
/// Between two samples `h` apart, a command that changes moves a joint by up to `h^3 q''' / 12` farther than its mean does, and third
/// differences are `h^3 q'''` beside the noise, `sqrt(20)` times that of a sample however far apart they are.
#[must_use]
pub fn may_keep_one_of(run: &Run, most: usize) -> usize {
    /// Third differences of what is kept may be so many times those of all samples.
    const TIMES_NOISE: f64 = 2.0;
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
    (2..=most).take_while(|keep| is_noise(*keep)).last().unwrap_or(1)
}

/// One of every `keep` samples of a run; between them the mean of the command.
#[must_use]
pub fn thinned(run: &Run, keep: usize) -> Run {
    if keep < 2 {
        return run.clone();
    }
    let log = &run.log;
    let kept: Vec<usize> = (0..log.len()).step_by(keep).collect();
    let is_straight = run.settings.intersample == Intersample::FirstOrder;
    let mean = |tau: &Vec<f64>| -> Vec<f64> {
        let integral = |k: usize| {
            let end = if is_straight { tau[k + 1] } else { tau[k] };
            0.5 * (tau[k] + end) * (log.t[k + 1] - log.t[k])
        };
        let over = |from: usize, to: usize| (from..to).map(integral).sum::<f64>() / (log.t[to] - log.t[from]);
        let mut means: Vec<f64> = kept.windows(2).map(|pair| over(pair[0], pair[1])).collect();
        means.extend(kept.last().map(|last| tau[*last]));
        means
    };
    let tau = log.tau.iter().map(mean).collect();
    let mut settings = run.settings.clone();
    settings.intersample = Intersample::ZeroOrder;
    Run { settings, log: Log { tau, ..rows_of(log, &kept) }, ..run.clone() }
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
    }
}
