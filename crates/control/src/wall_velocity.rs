//! A joint's velocity from its sampled positions (thesis Eq. 4.7).

use dynid_dynamics::simulate::control::Filter;

/// Differences of sampled positions through a second-order low-pass filter with one sample of delay (Eq. 4.7).
#[derive(Debug, Clone)]
pub struct FilteredVelocity {
    filter: Filter,
    sample_s: f64,
    last: Option<f64>,
    /// Differences of the last two samples, and what the filter made of them.
    past: [f64; 4],
}

impl FilteredVelocity {
    /// Of a joint that is sampled every `sample_s`.
    pub fn new(filter: Filter, sample_s: f64) -> Self {
        Self { filter, sample_s, last: None, past: [0.0; 4] }
    }

    /// The velocity once the position of another sample is known; 0 at the first.
    pub fn tick(&mut self, position: f64) -> f64 {
        let difference = self.last.map_or(0.0, |last| (position - last) / self.sample_s);
        let [one, _, filtered_one, _] = self.past;
        let filtered = self.filter.output(self.past);
        self.last = Some(position);
        self.past = [difference, one, filtered, filtered_one];
        filtered
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_steady_motion_it_is_the_slope() {
        let mut velocity = FilteredVelocity::new(Filter::butterworth(15.0, 0.01), 0.01);
        let last = (0..200).map(|k| velocity.tick(0.3 + 0.02 * f64::from(k))).last();
        assert!((last.expect("200 samples") - 2.0).abs() < 1e-9);
    }
}
