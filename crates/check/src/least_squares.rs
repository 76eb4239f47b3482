//! Sums over signals.

use dynid_signal::statistics::correlation_time;

/// Sum of products.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Sum of squares.
pub fn square(values: &[f64]) -> f64 {
    dot(values, values)
}

/// Without their mean.
pub fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|value| value - mean).collect()
}

/// Correlation coefficient; 0 where one of them is constant.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (centred(a), centred(b));
    let size = (square(&a) * square(&b)).sqrt();
    if size > 0.0 { dot(&a, &b) / size } else { 0.0 }
}

/// Number of independent errors in a residual.
pub fn independent(residual: &[f64]) -> f64 {
    residual.len() as f64 / correlation_time(residual, residual.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_lines_are_fully_correlated() {
        let line: Vec<f64> = (0..100).map(f64::from).collect();
        let falling: Vec<f64> = line.iter().map(|x| 3.0 - 0.5 * x).collect();
        assert!((correlation(&falling, &line) + 1.0).abs() < 1e-12);
        assert_eq!(correlation(&falling, &[1.0; 100]), 0.0);
    }
}
