//! How far estimates of one quantity are from night to night where nothing happens: in the fleet, and in each of its robots.

use serde::Serialize;
use statrs::function::gamma::digamma;

use crate::{Series, median};

/// How far the estimates of a quantity are from each other where nothing happens: an estimate of a night has the variance
/// `std_error^2 + night^2` about a level that walks on by the variance `walk^2` from each night to the next. Both are the most likely
/// ones of the whole fleet (the local level model: Durbin & Koopman 2012, *Time Series Analysis by State Space Methods*, 2).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scatter {
    /// What.
    pub quantity: String,
    /// Standard deviation of a night beyond the fit's standard error (unit of the quantity).
    pub night: f64,
    /// Standard deviation of what is added from one night to the next, and stays (unit of the quantity).
    pub walk: f64,
    /// Degrees of freedom by which they are known.
    pub freedom: f64,
}

impl Scatter {
    /// Of the series of one quantity, without what has changed in them.
    pub(crate) fn of(all: &[Series]) -> Self {
        let steps = || all.iter().flat_map(|own| own.values.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)));
        let count = steps().count();
        let typical = steps().sum::<f64>() / count.max(1) as f64;
        let (mut night, mut walk) = (0.0, 0.0);
        if typical > 0.0 {
            let unlikeliness =
                |night: f64, walk: f64| all.iter().map(|own| unlikeliness(own, night, walk)).sum::<f64>();
            let best_night = |walk: f64| least(typical, |night| unlikeliness(night, walk));
            walk = least(typical, |walk| unlikeliness(best_night(walk), walk));
            night = best_night(walk);
        }
        let quantity = all.first().map_or_else(String::new, |own| own.quantity.clone());
        Self { quantity, night: night.sqrt(), walk: walk.sqrt(), freedom: (count as f64).max(1.0) }
    }
}

/// The scatter of one robot beside that of its fleet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Own {
    /// Its variance over that of the fleet.
    pub(crate) variance: f64,
    /// Degrees of freedom by which that is known.
    pub(crate) freedom: f64,
}

/// Median of the square of a normal number of variance 1.
const MEDIAN_OF_SQUARE: f64 = 0.454_936_423_119_572_8;
/// A median of squares tells as much of a variance as so large a share of normal numbers would (its asymptotic efficiency).
const EFFICIENCY: f64 = 0.37;

impl Scatter {
    /// Of each robot: the variance of its own steps from night to night (their median, which one change does not move), drawn towards that of the
    /// fleet by as much as the robots are alike (Smyth 2004, Statistical Applications in Genetics and Molecular Biology 3, 3).
    pub(crate) fn of_each(&self, all: &[Series]) -> Vec<Own> {
        let freedom = |own: &Series| EFFICIENCY * own.len().saturating_sub(1) as f64;
        let observed: Vec<Option<f64>> = all.iter().map(|own| self.of_steps(own)).collect();
        // Logarithms of the variances, without what chance alone makes of them: their mean, and what is left of their spread.
        let logarithms: Vec<(f64, f64)> = all
            .iter()
            .zip(&observed)
            .filter_map(|(own, variance)| Some((variance.filter(|own| *own > 0.0)?.ln(), 0.5 * freedom(own))))
            .map(|(logarithm, half)| (logarithm - digamma(half) + half.ln(), trigamma(half)))
            .collect();
        let n = logarithms.len() as f64;
        let mean = logarithms.iter().map(|own| own.0).sum::<f64>() / n;
        let spread = logarithms.iter().map(|own| (own.0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let real = spread - logarithms.iter().map(|own| own.1).sum::<f64>() / n;
        if logarithms.len() < 2 || real.is_nan() || real <= 0.0 {
            return vec![Own { variance: 1.0, freedom: self.freedom }; all.len()];
        }
        let half = inverse_trigamma(real);
        let (prior, fleet) = (2.0 * half, (mean + digamma(half) - half.ln()).exp());
        let of = |(own, variance): (&Series, &Option<f64>)| {
            let freedom = if variance.is_some() { freedom(own) } else { 0.0 };
            let variance = (prior * fleet + freedom * variance.unwrap_or(0.0)) / (prior + freedom);
            Own { variance, freedom: prior + freedom }
        };
        all.iter().zip(&observed).map(of).collect()
    }

    /// Variance of the steps of a series over that of the fleet's.
    fn of_steps(&self, own: &Series) -> Option<f64> {
        let step = |k: usize| {
            let said = own.std_errors[k].powi(2) + own.std_errors[k + 1].powi(2) + 2.0 * self.night.powi(2);
            let variance = said + self.walk.powi(2) * (own.nights[k + 1] - own.nights[k]) as f64;
            (own.values[k + 1] - own.values[k]).powi(2) / variance
        };
        let steps: Vec<f64> = (0..own.len().saturating_sub(1)).map(step).filter(|step| step.is_finite()).collect();
        median(steps).map(|middle| middle / MEDIAN_OF_SQUARE)
    }
}

/// Derivative of the digamma function, for positive numbers: by its recurrence up to where its asymptotic series holds
/// (Abramowitz & Stegun 6.4.12).
fn trigamma(x: f64) -> f64 {
    let (mut x, mut sum) = (x, 0.0);
    while x < 10.0 {
        sum += 1.0 / (x * x);
        x += 1.0;
    }
    let y = 1.0 / (x * x);
    sum + 1.0 / x + 0.5 * y + y / x * (1.0 / 6.0 - y * (1.0 / 30.0 - y * (1.0 / 42.0 - y / 30.0)))
}

/// The positive number of which [`trigamma`] is a value.
fn inverse_trigamma(value: f64) -> f64 {
    let (mut low, mut high) = (1e-8_f64, 1e8_f64);
    while high / low > 1.0 + 1e-9 {
        let middle = (low * high).sqrt();
        if trigamma(middle) > value { low = middle } else { high = middle }
    }
    (low * high).sqrt()
}

/// Twice the negative logarithm of the likelihood of a series by two variances, but for a constant; its first level is unknown
/// (Kalman's filter with a diffuse beginning).
fn unlikeliness(series: &Series, night: f64, walk: f64) -> f64 {
    let noise = |k: usize| series.std_errors[k].powi(2) + night;
    let (mut level, mut variance) = (series.values[0], noise(0));
    let mut sum = 0.0;
    for k in 1..series.len() {
        variance += walk * (series.nights[k] - series.nights[k - 1]) as f64;
        let error = series.values[k] - level;
        // Estimates without any error that repeat to the last digit.
        let total = (variance + noise(k)).max(f64::MIN_POSITIVE);
        sum += error * error / total + total.ln();
        let gain = variance / total;
        level += gain * error;
        variance *= 1.0 - gain;
    }
    sum
}

/// The variance at which a function is least: 0, or one within many powers of ten of a typical one (golden section of its
/// logarithm).
fn least(typical: f64, function: impl Fn(f64) -> f64) -> f64 {
    /// Far below and above what matters.
    const BELOW: f64 = 1e-8;
    const ABOVE: f64 = 10.0;
    /// To a thousandth of a power of e.
    const WIDTH: f64 = 1e-3;
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let at = |logarithm: f64| typical * logarithm.exp();
    let (mut low, mut high) = (BELOW.ln(), ABOVE.ln());
    let (mut left, mut right) = (high - golden * (high - low), low + golden * (high - low));
    let (mut of_left, mut of_right) = (function(at(left)), function(at(right)));
    while high - low > WIDTH {
        if of_left <= of_right {
            (high, right, of_right) = (right, left, of_left);
            left = high - golden * (high - low);
            of_left = function(at(left));
        } else {
            (low, left, of_left) = (left, right, of_right);
            right = low + golden * (high - low);
            of_right = function(at(right));
        }
    }
    let found = at(0.5 * (low + high));
    if function(0.0) <= function(found) { 0.0 } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trigamma_is_what_tables_say() {
        // pi^2 / 6, pi^2 / 2, and a derivative of the digamma function.
        for (x, expected) in [
            (1.0, 1.644_934_066_848_226_4),
            (0.5, 4.934_802_200_544_679),
            (7.3, (digamma(7.3 + 1e-5) - digamma(7.3 - 1e-5)) / 2e-5),
        ] {
            assert!((trigamma(x) - expected).abs() < 1e-8 * expected, "{x}: {} {expected}", trigamma(x));
            assert!((inverse_trigamma(trigamma(x)) / x - 1.0).abs() < 1e-8);
        }
    }
}
