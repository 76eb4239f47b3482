//! The noise of a measured position, seen through its fourth differences.

/// Standard deviation of the white noise on `samples` [their unit].
///
/// Motion well below the sample rate leaves almost nothing in fourth differences, white noise `sqrt(70)` times its
/// standard deviation. The few samples where the motion is abrupt are recognised by their size and left out. The quantum
/// of the log's last digit is part of the noise. Zero for fewer than five samples or a constant.
pub fn noise_floor(samples: &[f64]) -> f64 {
    /// Median of the absolute value of a standard normal variable.
    const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;
    /// Differences beyond this many standard deviations are left out, and the standard deviation of what is left of a
    /// standard normal variable.
    const REACH: f64 = 4.0;
    const REST_OF_NORMAL: f64 = 0.999_46;
    let sizes: Vec<f64> =
        samples.windows(5).map(|w| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let mut sorted = sizes.clone();
    let (_, median, _) = sorted.select_nth_unstable_by(sizes.len() / 2, f64::total_cmp);
    // A coarse quantum makes the median one of a few values; it only decides what is abrupt.
    let limit = REACH * *median / MEDIAN_OF_NORMAL;
    let kept = sizes.iter().filter(|size| **size <= limit);
    let (sum, count) = kept.fold((0.0, 0.0), |(sum, count), size| (sum + size * size, count + 1.0));
    (sum / f64::max(count, 1.0) / 70.0).sqrt() / REST_OF_NORMAL
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn noise_on_a_moving_joint_is_seen() {
        let mut random = Random::new(7);
        let samples: Vec<f64> = (0..6000).map(|k| (f64::from(k) * 0.05).sin() + 2e-4 * random.normal()).collect();
        let floor = noise_floor(&samples);
        assert!((floor / 2e-4 - 1.0).abs() < 0.05, "{floor}");
        assert_eq!(noise_floor(&[1.0; 4]), 0.0);
    }
}
