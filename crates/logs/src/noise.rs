//! The noise of a measured position, seen through its fourth differences.

use crate::experiment::Run;

/// A joint moves if its positions span so many times their noise.
pub const MOVES: f64 = 10.0;

/// Whether a joint at these positions moves by more than noise.
pub fn moves(q: &[f64]) -> bool {
    let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
    // Not `>=`: what never changes has no noise either.
    high - low > MOVES * noise_of_log(q)
}

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

/// The noise of a logged position: what its fourth differences show, at least that of its last digit, `digit / sqrt(12)`,
/// which a position at rest does not show.
pub fn noise_of_log(measured: &[f64]) -> f64 {
    noise_floor(measured).max(last_digit(measured) / 12.0_f64.sqrt())
}

/// The noise of a joint's logged positions: the largest of the runs in which it is free [rad or m].
pub fn noise_of_joint<'a>(runs: impl IntoIterator<Item = &'a Run>, joint: usize) -> f64 {
    let free = runs.into_iter().filter(|run| run.free.contains(&joint));
    free.map(|run| noise_of_log(&run.log.q[joint])).fold(0.0, f64::max)
}

/// The smallest step between samples that is not rounding of the decimal text: the last digit of the log. Zero for a
/// position that does not move, and where the steps are not several whole numbers of it: then it is the slowest motion, not
/// a digit.
pub fn last_digit(measured: &[f64]) -> f64 {
    /// Smaller differences are rounding of the decimal text, not digits.
    const ROUNDING: f64 = 1e-9;
    /// How far from a whole number of digits a step may be, and up to how many digits that can be seen.
    const WHOLE: f64 = 0.02;
    const MOST_DIGITS: f64 = 1000.0;
    let size = measured.iter().fold(0.0_f64, |size, q| size.max(q.abs()));
    let steps = || measured.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let digit = steps().filter(|step| *step > ROUNDING * size).fold(f64::INFINITY, f64::min);
    if !digit.is_finite() {
        return 0.0;
    }
    let digits = || steps().map(|step| step / digit).filter(|digits| *digits < MOST_DIGITS);
    let are_whole = digits().all(|digits| (digits - digits.round()).abs() <= WHOLE);
    let differ = digits().any(|digits| digits.round() != 1.0);
    if are_whole && differ { digit } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    #[test]
    fn noise_on_a_moving_joint_is_seen() {
        let mut random = Random::new(7);
        let samples: Vec<f64> = (0..6000).map(|k| (f64::from(k) * 0.05).sin() + 2e-4 * random.normal()).collect();
        let floor = noise_floor(&samples);
        assert!((floor / 2e-4 - 1.0).abs() < 0.05, "{floor}");
        assert_eq!(noise_floor(&[1.0; 4]), 0.0);
    }

    #[test]
    fn the_last_digit_is_noise() {
        let rounded: Vec<f64> = (0..1000).map(|k| ((f64::from(k) * 1e-3).sin() * 100.0).round() / 100.0).collect();
        assert!((noise_of_log(&rounded) - 0.01 / 12.0_f64.sqrt()).abs() < 2e-3 * 0.01);
        assert_eq!(noise_of_log(&[0.5; 10]), 0.0);
    }

    /// A joint that turns steadily: its slowest step is no digit.
    #[test]
    fn a_steady_speed_is_no_digit() {
        for wave in [1e-3, 0.1] {
            let steady: Vec<f64> =
                (0..1000).map(|k| 0.01 * f64::from(k) + wave * (0.01 * f64::from(k)).sin()).collect();
            assert_eq!(last_digit(&steady), 0.0);
            let counted: Vec<f64> = steady.iter().map(|q| (q / 8e-3).round() * 8e-3).collect();
            assert!((last_digit(&counted) - 8e-3).abs() < 1e-12);
        }
    }
}
