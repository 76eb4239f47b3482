//! From the times of a log to a uniform grid.

/// Largest departure of a sample's time from the grid, in steps, at which a log still counts as uniformly sampled.
const UNIFORM_TOLERANCE: f64 = 0.01;

/// Steps longer than so many median steps are gaps: nothing is known there.
const GAP: f64 = 3.0;

/// A uniform grid has at most so many times the log's samples: beyond, it would consist of gaps.
const LARGEST: f64 = 10.0;

/// A log whose longest gap leaves too little of a uniform grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Last time before it (s).
    pub from: f64,
    /// First time after it (s).
    pub to: f64,
}

/// Uniform times `start + k * step`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// First time (s).
    pub start: f64,
    /// Time between samples (s).
    pub step: f64,
    /// Number of samples.
    pub len: usize,
    /// True where the log's own samples lie on the grid, so that nothing is interpolated.
    pub is_native: bool,
}

impl Grid {
    /// The log's own times `t` where they are uniform, else times at their median step from the first to the last.
    /// `t` rises and has two entries or more.
    ///
    /// # Errors
    /// Times so far apart that the grid would be mostly gap.
    pub fn of(t: &[f64]) -> Result<Self, Gap> {
        assert!(t.len() >= 2, "a grid needs two samples");
        let start = t[0];
        let span = t[t.len() - 1] - start;
        let mean = span / (t.len() - 1) as f64;
        let is_native =
            t.iter().enumerate().all(|(k, time)| (time - start - k as f64 * mean).abs() <= UNIFORM_TOLERANCE * mean);
        if is_native {
            return Ok(Self { start, step: mean, len: t.len(), is_native });
        }
        let step = crate::median_step(t);
        let steps = (span / step * (1.0 + 1e-12)).floor();
        if steps <= LARGEST * t.len() as f64 {
            return Ok(Self { start, step, len: steps as usize + 1, is_native });
        }
        let longest = t.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0])));
        Err(longest.map_or(Gap { from: start, to: start + span }, |pair| Gap { from: pair[0], to: pair[1] }))
    }

    /// Samples a second (Hz).
    pub fn rate_hz(&self) -> f64 {
        1.0 / self.step
    }

    /// Time of sample `k` (s).
    pub fn time(&self, k: usize) -> f64 {
        self.start + k as f64 * self.step
    }

    /// Which samples of the grid lie between samples of the log that are `used`, and in no gap of the log.
    pub fn between(&self, t: &[f64], used: Option<&[bool]>) -> Vec<bool> {
        let is_used = |k: usize| used.is_none_or(|used| used[k]);
        if self.is_native {
            return (0..self.len).map(is_used).collect();
        }
        let mut low = 0;
        (0..self.len)
            .map(|k| {
                low = interval(t, low, self.time(k));
                is_used(low) && is_used(low + 1) && t[low + 1] - t[low] <= GAP * self.step
            })
            .collect()
    }

    /// Which samples of the grid are more than `reach` samples away from every gap of the log.
    pub fn away_from_gaps(&self, t: &[f64], reach: usize) -> Vec<bool> {
        let mut away = vec![true; self.len];
        if self.is_native {
            return away;
        }
        for pair in t.windows(2).filter(|pair| pair[1] - pair[0] > GAP * self.step) {
            let [last, next] = [pair[0], pair[1]].map(|time| (time - self.start) / self.step);
            let to = (next.ceil() as usize).saturating_add(reach + 1).min(self.len);
            let from = (last.floor() as usize).saturating_sub(reach).min(to);
            away[from..to].fill(false);
        }
        away
    }
}

/// `values` at times `t`, straight from sample to sample, on the grid.
pub fn straight(t: &[f64], values: &[f64], grid: &Grid) -> Vec<f64> {
    if grid.is_native {
        return values.to_vec();
    }
    let mut low = 0;
    (0..grid.len)
        .map(|k| {
            let time = grid.time(k);
            low = interval(t, low, time);
            let share = ((time - t[low]) / (t[low + 1] - t[low])).clamp(0.0, 1.0);
            values[low] + share * (values[low + 1] - values[low])
        })
        .collect()
}

/// `values` of which each is held from its time to the next, as the mean over one step about each time of the grid.
/// A held signal lags its samples by half a step; its mean about a time lags nothing.
pub fn held(t: &[f64], values: &[f64], grid: &Grid) -> Vec<f64> {
    // Integral of the held signal up to a time that does not fall.
    let mut low = 0;
    let mut before = 0.0; // up to t[low]
    let mut integral = |time: f64| {
        while low + 1 < t.len() && t[low + 1] <= time {
            before += values[low] * (t[low + 1] - t[low]);
            low += 1;
        }
        before + values[low] * (time - t[low])
    };
    let mut from = integral(grid.start - 0.5 * grid.step);
    (0..grid.len)
        .map(|k| {
            let to = integral(grid.time(k) + 0.5 * grid.step);
            let mean = (to - from) / grid.step;
            from = to;
            mean
        })
        .collect()
}

/// The `k` with `t[k] <= time < t[k + 1]`, searched upwards from `low`; the last interval for later times.
fn interval(t: &[f64], mut low: usize, time: f64) -> usize {
    while low + 2 < t.len() && t[low + 1] <= time {
        low += 1;
    }
    low
}

/// Median of the differences of `t`; zero for fewer than two samples.
pub fn median_step(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_log_is_its_own_grid() {
        let t: Vec<f64> = (0..100).map(|k| 2.0 + 0.01 * f64::from(k) + 1e-6 * f64::from(k % 3)).collect();
        let grid = Grid::of(&t).expect("no gap");
        assert!(grid.is_native);
        assert_eq!(grid.len, 100);
        assert!((grid.step - 0.01).abs() < 1e-7);
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(straight(&t, &values, &grid), values);
    }

    #[test]
    fn an_irregular_log_is_brought_to_its_median_step() {
        let t = [0.0, 0.1, 0.2, 0.3, 0.45, 0.5, 0.6];
        let grid = Grid::of(&t).expect("no gap");
        assert!(!grid.is_native);
        assert!((grid.step - 0.1).abs() < 1e-12);
        assert_eq!(grid.len, 7);
        let values: Vec<f64> = t.iter().map(|time| 3.0 * time - 1.0).collect();
        for (k, value) in straight(&t, &values, &grid).iter().enumerate() {
            assert!((value - (3.0 * grid.time(k) - 1.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn held_values_are_averaged_about_each_time() {
        let t = [0.0, 1.0, 2.0, 3.0];
        let grid = Grid::of(&t).expect("no gap");
        let mean = held(&t, &[2.0, 4.0, 8.0, 6.0], &grid);
        assert_eq!(mean, [2.0, 3.0, 6.0, 7.0]);
    }

    #[test]
    fn held_values_keep_their_integral_on_another_grid() {
        let t = [0.0, 0.7, 1.0, 2.2, 3.0, 4.1];
        let values = [1.0, -2.0, 3.0, 0.5, 4.0, 2.0];
        let grid = Grid { start: 0.0, step: 0.5, len: 9, is_native: false };
        let sum: f64 = held(&t, &values, &grid).iter().sum::<f64>() * grid.step;
        // from -0.25 to 4.25, the first value reaching back and the last ahead
        let expected = 1.0 * 0.95 - 2.0 * 0.3 + 3.0 * 1.2 + 0.5 * 0.8 + 4.0 * 1.1 + 2.0 * 0.15;
        assert!((sum - expected).abs() < 1e-12, "{sum} {expected}");
    }

    #[test]
    fn gaps_and_masked_samples_are_left_out() {
        let t = [0.0, 1.0, 2.0, 3.0, 4.0, 9.5, 10.5, 11.5];
        let grid = Grid::of(&t).expect("no gap");
        let used = [true, true, false, true, true, true, true, true];
        let between = grid.between(&t, Some(&used));
        assert_eq!(between, [true, false, false, true, false, false, false, false, false, false, true, true]);
    }

    #[test]
    fn a_grid_of_nothing_but_gap_is_refused() {
        let mut t: Vec<f64> = (0..100).map(|k| 0.01 * f64::from(k)).collect();
        t.extend([1e15, 1e15 + 1.0]);
        assert_eq!(Grid::of(&t), Err(Gap { from: 0.99, to: 1e15 }));
    }
}
