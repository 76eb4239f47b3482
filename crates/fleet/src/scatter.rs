//! How far estimates of one quantity are from night to night where nothing happens.

use serde::Serialize;

use crate::Series;

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
