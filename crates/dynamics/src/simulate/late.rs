//! Commands as they arrive where some joints' are late.
//!
//! Held commands jump, at times that lie anywhere within a step of the integration. A step sees their mean over it, so
//! that the impulse is exact and the motion changes smoothly with the delay: `d mean / d delay` is what leaves less what
//! enters, over the step. Before the first sample its command holds, and after the last one that one does.

use super::Intersample;
use crate::{system::Delay, system::System};

/// The commands of a log, or those that a controller has given so far.
#[derive(Clone, Copy)]
pub struct Commands<'a> {
    /// Sample times (s), ascending.
    pub time: &'a [f64],
    /// All joints, one row a sample.
    pub rows: &'a [f64],
    /// Joints of the device.
    pub n_joints: usize,
    /// How a command runs between samples.
    pub intersample: Intersample,
}

impl Commands<'_> {
    /// Replaces the commands of late joints by what arrives at `t` within the step `(begin, end)`, all in s. `slopes`, one
    /// per delay, takes the derivatives by the delays.
    pub fn arrive(
        &self,
        system: &System,
        t: f64,
        (begin, end): (f64, f64),
        command: &mut [f64],
        mut slopes: Option<&mut [f64]>,
    ) {
        for (index, delay) in system.delays().iter().enumerate() {
            let &Delay { joint, span_s, .. } = delay;
            let (value, slope) = match self.intersample {
                Intersample::ZeroOrder => self.mean(joint, begin - span_s, end - span_s),
                Intersample::FirstOrder => {
                    let (value, rate) = self.at(joint, t - span_s);
                    (value, -rate)
                }
            };
            command[joint] = value;
            if let Some(slopes) = &mut slopes {
                slopes[index] = slope;
            }
        }
    }

    fn row(&self, sample: usize, joint: usize) -> f64 {
        self.rows[sample * self.n_joints + joint]
    }

    fn last(&self) -> usize {
        self.time.len() - 1
    }

    /// Mean of the held command over a span, and its derivative by a delay of both ends.
    fn mean(&self, joint: usize, from: f64, to: f64) -> (f64, f64) {
        // The sample that holds just after `from`, and the one just before `to`.
        let first = self.time.partition_point(|t| *t <= from).saturating_sub(1);
        let last = self.time.partition_point(|t| *t < to).saturating_sub(1).max(first);
        let (leaves, enters) = (self.row(first, joint), self.row(last, joint));
        if first == last {
            return (leaves, 0.0);
        }
        let sum: f64 = (first..=last)
            .map(|sample| {
                let begin = if sample == first { from } else { self.time[sample] };
                let end = if sample == last { to } else { self.time[sample + 1] };
                (end - begin) * self.row(sample, joint)
            })
            .sum();
        (sum / (to - from), (leaves - enters) / (to - from))
    }

    /// The command that runs straight from sample to sample, and its rate.
    fn at(&self, joint: usize, t: f64) -> (f64, f64) {
        let next = self.time.partition_point(|time| *time <= t);
        if next == 0 || next > self.last() {
            return (self.row(next.min(self.last()), joint), 0.0);
        }
        let (start, end) = (self.time[next - 1], self.time[next]);
        let (now, then) = (self.row(next - 1, joint), self.row(next, joint));
        let rate = (then - now) / (end - start);
        (now + (t - start) / (end - start) * (then - now), rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIME: [f64; 4] = [1.0, 2.0, 4.0, 5.0];
    const ROWS: [f64; 4] = [3.0, -1.0, 2.0, 7.0];

    fn commands(intersample: Intersample) -> Commands<'static> {
        Commands { time: &TIME, rows: &ROWS, n_joints: 1, intersample }
    }

    #[test]
    fn the_mean_of_what_is_held_is_its_integral() {
        let held = commands(Intersample::ZeroOrder);
        // A fine sum of the step function.
        let at = |t: f64| ROWS[TIME.iter().rposition(|time| *time <= t).unwrap_or(0)];
        for (from, to) in
            [(-3.0, 0.5), (0.2, 1.7), (1.0, 2.0), (1.9, 2.1), (1.5, 4.5), (2.0, 4.0), (4.9, 9.0), (6.0, 6.5)]
        {
            let n = 200_000;
            let sum: f64 = (0..n).map(|k| at(from + (to - from) * (f64::from(k) + 0.5) / f64::from(n))).sum();
            let (mean, slope) = held.mean(0, from, to);
            assert!((mean - sum / f64::from(n)).abs() < 1e-4, "{from} to {to}: {mean}");
            let late = |delay: f64| held.mean(0, from - delay, to - delay).0;
            let difference = (late(1e-6) - late(-1e-6)) / 2e-6;
            let kink = TIME.iter().any(|time| (time - from).abs() < 1e-5 || (time - to).abs() < 1e-5);
            assert!(kink || (slope - difference).abs() < 1e-6, "{from} to {to}: {slope} {difference}");
        }
        assert_eq!(held.mean(0, 1.0, 2.0), (3.0, 0.0), "the bits of the row");
    }

    #[test]
    fn what_runs_straight_is_read_between_the_samples() {
        let straight = commands(Intersample::FirstOrder);
        for (t, value, rate) in [(0.0, 3.0, 0.0), (1.5, 1.0, -4.0), (3.0, 0.5, 1.5), (5.0, 7.0, 0.0), (8.0, 7.0, 0.0)] {
            assert_eq!(straight.at(0, t), (value, rate), "at {t}");
        }
    }
}
