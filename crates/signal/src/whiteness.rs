//! Is a residual nothing but noise?

use crate::statistics::autocorrelation;

/// Lags that are looked at.
const LAGS: usize = 20;

/// What a chi-squared variable of [`LAGS`] degrees of freedom exceeds in one case of a hundred.
const CHI_SQUARED: f64 = 37.566;

/// What [`whiteness`] stays below for white noise in 99 of 100 cases.
pub const WHITENESS_BOUND: f64 = CHI_SQUARED;

/// The statistic of Ljung & Box (1978, Biometrika 65, 297-303) over 20 lags: chi-squared with 20 degrees of freedom for
/// white noise. `None` for fewer than 40 samples, of which nothing can be said.
pub fn whiteness(residual: &[f64]) -> Option<f64> {
    let n = residual.len() as f64;
    if residual.len() < 2 * LAGS {
        return None;
    }
    let mean = residual.iter().sum::<f64>() / n;
    let centred: Vec<f64> = residual.iter().map(|value| value - mean).collect();
    let rho = autocorrelation(&centred, LAGS + 1);
    let sum: f64 = rho.iter().zip(0..).skip(1).map(|(rho, lag)| rho * rho / (n - f64::from(lag))).sum();
    Some(n * (n + 2.0) * sum)
}

/// Whether successive samples of `residual` are uncorrelated, by [`whiteness`] at a level of 1 %. False for too few
/// samples.
pub fn is_white(residual: &[f64]) -> bool {
    whiteness(residual).is_some_and(|statistic| statistic < WHITENESS_BOUND)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    fn noise(n_samples: usize, seed: u64) -> Vec<f64> {
        Random::new(seed).vector(n_samples, -0.5, 0.5)
    }

    #[test]
    fn noise_is_white_in_99_of_100_cases() {
        let white = (0..300).filter(|&seed| is_white(&noise(1000, 9_176 * seed + 5))).count();
        assert!((288..=300).contains(&white), "{white} of 300");
    }

    #[test]
    fn a_little_memory_is_noticed() {
        let raw = noise(4000, 3);
        let red: Vec<f64> = raw.windows(2).map(|pair| pair[1] + 0.2 * pair[0]).collect();
        assert!(!is_white(&red));
        // x[k] + a x[k-1] has rho_1 = a / (1 + a^2).
        assert!((autocorrelation(&red, 2)[1] - 0.2 / 1.04).abs() < 0.04);
        assert!(!is_white(&raw[..30]), "too short to tell");
        assert_eq!(whiteness(&[2.0; 100]), Some(0.0), "a constant is its mean");
    }
}
