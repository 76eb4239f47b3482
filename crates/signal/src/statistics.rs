//! What chance would give: effective numbers of samples and critical values.

use rustfft::{FftPlanner, num_complex::Complex};

/// A finding must be less likely than this by chance: about 1e-5, one sided, of a normal variable.
const NORMAL_QUANTILE: f64 = 4.26;

/// Autocorrelation of `x` at lags `0..lags` (1 at lag 0), by the fast Fourier transform. Samples that do not count are
/// zero in `x`; zeros for a signal without power.
pub fn autocorrelation(x: &[f64], lags: usize) -> Vec<f64> {
    let length = (2 * x.len()).next_power_of_two();
    let mut buffer: Vec<Complex<f64>> = x.iter().map(|&value| Complex::new(value, 0.0)).collect();
    buffer.resize(length, Complex::new(0.0, 0.0));
    let mut planner = FftPlanner::new();
    planner.plan_fft_forward(length).process(&mut buffer);
    buffer.iter_mut().for_each(|value| *value = Complex::new(value.norm_sqr(), 0.0));
    planner.plan_fft_inverse(length).process(&mut buffer);
    let power = buffer[0].re;
    let lags = lags.min(x.len());
    buffer[..lags].iter().map(|value| if power > 0.0 { value.re / power } else { 0.0 }).collect()
}

/// Number of independent samples among `n_used` samples of `x`, for its correlation with another signal of like
/// bandwidth: `n / (1 + 2 sum rho(k)^2)` (Bartlett 1946), with what chance adds to each `rho^2` taken off.
pub fn effective_samples(x: &[f64], n_used: usize) -> f64 {
    let n = n_used as f64;
    let sum: f64 = autocorrelation(x, n_used / 8).iter().skip(1).map(|rho| (rho * rho - 1.0 / n).max(0.0)).sum();
    // Positive parts of what chance gives to white noise add up to about 0.48 / n a lag.
    let by_chance = 0.48 * 0.125;
    n / (1.0 + 2.0 * (sum - by_chance).max(0.0))
}

/// What a chi-squared variable exceeds in about one case of 100 000 (Wilson & Hilferty 1931), for so many degrees of
/// freedom; more where the best of `looked` choices was taken.
pub fn critical(degrees: usize, looked: usize) -> f64 {
    let m = degrees.max(1) as f64;
    let cube = 2.0 / (9.0 * m);
    m * (1.0 - cube + NORMAL_QUANTILE * cube.sqrt()).powi(3) + 2.0 * (looked.max(1) as f64).ln()
}

/// How many standard errors a `sum` is from zero, when `noise` holds what each sample adds to it beside its mean. Neighbours
/// that are alike are counted (Newey & West 1987, with a bandwidth of `lags`). Zero without noise.
pub fn standard_errors(sum: f64, noise: &[f64], lags: usize) -> f64 {
    let power: f64 = noise.iter().map(|value| value * value).sum();
    let lags = lags.min(noise.len() / 4);
    let weighted: f64 = autocorrelation(noise, lags + 1)
        .iter()
        .enumerate()
        .skip(1)
        .map(|(lag, rho)| rho * (1.0 - lag as f64 / (lags + 1) as f64))
        .sum();
    // Negative correlation does not count as knowledge: a floor of half.
    let variance = power * (1.0 + 2.0 * weighted).max(0.5);
    if variance > 0.0 { sum / variance.sqrt() } else { 0.0 }
}

/// Root mean square; zero of no values.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    #[test]
    fn white_noise_has_as_many_samples_as_it_has() {
        let noise: Vec<f64> = Random::new(4).vector(4000, -1.0, 1.0);
        let effective = effective_samples(&noise, 4000);
        assert!((3200.0..=4000.0).contains(&effective), "{effective}");
    }

    /// x(k) = a x(k-1) + w has rho(k) = a^k, so sum rho^2 = a^2 / (1 - a^2).
    #[test]
    fn memory_costs_samples_as_bartlett_says() {
        let a: f64 = 0.9;
        let mut x = 0.0;
        let red: Vec<f64> = Random::new(5)
            .vector(20_000, -1.0, 1.0)
            .into_iter()
            .map(|w| {
                x = a * x + w;
                x
            })
            .collect();
        let expected = 20_000.0 / (1.0 + 2.0 * a * a / (1.0 - a * a));
        let effective = effective_samples(&red, red.len());
        // Too few rather than too many: chance correlations at long lags of a signal with memory are counted too.
        assert!((0.7..1.1).contains(&(effective / expected)), "{effective} {expected}");
        assert!((autocorrelation(&red, 2)[1] - a).abs() < 0.02);
    }

    /// Tables: in one case of 100 000, chi-squared of 1 degree exceeds 19.5, of 10 degrees 41.3; the
    /// approximation errs to the safe side.
    #[test]
    fn critical_values_are_those_of_tables() {
        assert!((19.5..22.0).contains(&critical(1, 1)), "{}", critical(1, 1));
        assert!((41.3..42.5).contains(&critical(10, 1)), "{}", critical(10, 1));
        assert!(critical(2, 50) > critical(2, 1) + 7.0);
    }

    #[test]
    fn a_constant_surplus_is_many_standard_errors() {
        let noise = Random::new(6).vector(10_000, -1.0, 1.0);
        let sum: f64 = noise.iter().sum();
        assert!(standard_errors(sum, &noise, 10).abs() < 4.0);
        // 0.1 over 1 / sqrt(3 * 10 000)
        let reported = standard_errors(sum + 1000.0, &noise, 10);
        assert!((reported - 17.3).abs() < 4.0, "{reported}");
        assert_eq!(standard_errors(0.0, &[], 3), 0.0);
    }
}
