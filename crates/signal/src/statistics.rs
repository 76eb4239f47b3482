//! What chance would give: how many samples of a signal with memory are independent, and critical values.
//!
//! A signal that repeats itself tells less than it has samples. How much less depends on what is asked of it, and both
//! answers are sums of one [`autocorrelation`] `rho` (Bartlett 1946, Journal of the Royal Statistical Society, Supplement 8,
//! 27-41):
//! - a mean, a sum, or an estimate whose regressors are slower than the error, has the variance of white noise times
//!   `1 + 2 sum rho(k)`: [`correlation_time`];
//! - the correlation with another signal of like bandwidth, what a regressor of that bandwidth takes away of a sum of squares
//!   by chance, and so the degrees of freedom of a squared error, have it times `1 + 2 sum rho(k)^2`: [`effective_samples`].
//!   The torque error is filtered to a band and swings: its `rho` nearly cancel in the first sum, and their squares do not.

use rustfft::{FftPlanner, num_complex::Complex};

/// A finding must be less likely than this by chance: about 1e-5, one sided, of a normal variable.
const NORMAL_QUANTILE: f64 = 4.26;

/// Autocorrelation of `x` at lags `0..lags` (1 at lag 0), by the fast Fourier transform. Samples that do not count are
/// zero in `x` (see [`counted`]), and a mean that does not count is taken off before; zeros for a signal without power.
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

/// `x` with zeros where a sample is not `used`.
pub fn counted(x: &[f64], used: &[bool]) -> Vec<f64> {
    x.iter().zip(used).map(|(value, used)| if *used { *value } else { 0.0 }).collect()
}

/// The middle of some values: the mean of the two middle ones where their count is even; NaN where there are none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 { f64::NAN } else { 0.5 * (values[(n - 1) / 2] + values[n / 2]) }
}

/// Number of successive samples of `x` that share one independent error: `1 + 2 sum rho(k)` over the lags before `rho`
/// first falls to zero in a pair of lags (Geyer 1992, Statistical Science 7, 473-483: initial positive sequence), of
/// `n_used` samples; 1 for white noise.
pub fn correlation_time(x: &[f64], n_used: usize) -> f64 {
    if n_used < 4 {
        return 1.0;
    }
    let rho = autocorrelation(x, x.len() / 2);
    let pairs = rho.get(1..).unwrap_or_default().chunks_exact(2).map(|pair| pair[0] + pair[1]);
    let sum: f64 = pairs.take_while(|pair| *pair > 0.0).sum();
    (1.0 + 2.0 * sum).clamp(1.0, n_used as f64)
}

/// Number of independent samples among `n_used` samples of `x`, for its correlation with another signal of like
/// bandwidth: `n / (1 + 2 sum rho(k)^2)`, with what chance adds to each `rho^2` taken off.
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

/// How many standard errors a `sum` is from zero, when `noise` holds what each sample adds to it beside its mean (see
/// [`correlation_time`]). Zero without noise.
pub fn standard_errors(sum: f64, noise: &[f64]) -> f64 {
    let power: f64 = noise.iter().map(|value| value * value).sum();
    let variance = power * correlation_time(noise, noise.len());
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

    /// x(k) = a x(k-1) + w, which has rho(k) = a^k.
    fn red(a: f64, n_samples: usize, seed: u64) -> Vec<f64> {
        let mut x = 0.0;
        let white = Random::new(seed).vector(n_samples, -1.0, 1.0).into_iter();
        white
            .map(|w| {
                x = a * x + w;
                x
            })
            .collect()
    }

    /// sum rho^2 = a^2 / (1 - a^2)
    #[test]
    fn memory_costs_samples_as_bartlett_says() {
        let a: f64 = 0.9;
        let red = red(a, 20_000, 5);
        let expected = 20_000.0 / (1.0 + 2.0 * a * a / (1.0 - a * a));
        let effective = effective_samples(&red, red.len());
        // Too few rather than too many: chance correlations at long lags of a signal with memory are counted too.
        assert!((0.7..1.1).contains(&(effective / expected)), "{effective} {expected}");
        assert!((autocorrelation(&red, 2)[1] - a).abs() < 0.02);
    }

    /// 1 + 2 sum rho = (1 + a) / (1 - a)
    #[test]
    fn correlation_time_of_an_autoregression() {
        let white = red(0.0, 200_000, 11);
        assert!((correlation_time(&white, white.len()) - 1.0).abs() < 0.05);
        let red = red(0.8, 200_000, 11);
        let time = correlation_time(&red, red.len());
        assert!((time - 9.0).abs() < 0.6, "{time}");
        // Of every other sample the rest counts for nothing, and what is left has rho(k) = a^2 at twice the lags.
        let used: Vec<bool> = (0..red.len()).map(|k| k % 2 == 0).collect();
        let thinned: Vec<f64> = red.iter().copied().step_by(2).collect();
        assert!((correlation_time(&thinned, thinned.len()) - 1.64 / 0.36).abs() < 0.4);
        assert_eq!(counted(&red[..3], &used), [red[0], 0.0, red[2]]);
        assert_eq!(correlation_time(&[0.0; 100], 100), 1.0);
    }

    /// Means of stretches of a red signal scatter as its correlation time says, and not as its number of samples does.
    #[test]
    fn a_mean_is_as_uncertain_as_its_correlation_time_says() {
        const STRETCH: usize = 1000;
        let red = red(0.8, 500 * STRETCH, 17);
        let power = red.iter().map(|x| x * x).sum::<f64>() / red.len() as f64;
        let variance =
            red.chunks(STRETCH).map(|own| (own.iter().sum::<f64>() / STRETCH as f64).powi(2)).sum::<f64>() / 500.0;
        let expected = power * correlation_time(&red, red.len()) / STRETCH as f64;
        // Of 500 means: a variance known to six percent.
        assert!((variance / expected - 1.0).abs() < 0.25, "{variance} {expected}");
    }

    /// As the definition, which is a sum over products.
    #[test]
    fn the_fast_autocorrelation_is_the_plain_one() {
        let x = red(0.5, 777, 3);
        let power: f64 = x.iter().map(|x| x * x).sum();
        for (lag, rho) in autocorrelation(&x, 300).into_iter().enumerate() {
            let plain = x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / power;
            assert!((rho - plain).abs() < 1e-13, "{lag}: {rho} {plain}");
        }
        assert_eq!(autocorrelation(&[0.0; 10], 2), [0.0, 0.0]);
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
        assert!(standard_errors(sum, &noise).abs() < 4.0);
        // 0.1 over 1 / sqrt(3 * 10 000)
        let reported = standard_errors(sum + 1000.0, &noise);
        assert!((reported - 17.3).abs() < 4.0, "{reported}");
        assert_eq!(standard_errors(0.0, &[]), 0.0);
    }
}
