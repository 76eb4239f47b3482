//! Least squares for one signal at a time: an orthonormal basis of what may explain it.

use dynid_signal::statistics::correlation_time;

/// Orthonormal columns.
#[derive(Debug, Clone)]
pub struct Basis(Vec<Vec<f64>>);

impl Basis {
    /// Of all `columns`; those that others span are left out (Gram-Schmidt, twice: Giraud et al. 2005).
    pub fn new(columns: impl IntoIterator<Item = Vec<f64>>) -> Self {
        /// What is left of a column is rounding below this share of it.
        const ROUNDING: f64 = 1e-7;
        let mut basis = Self(Vec::new());
        for mut column in columns {
            let before = square(&column).sqrt();
            basis.take_off(&mut column);
            basis.take_off(&mut column);
            let left = square(&column).sqrt();
            if left > ROUNDING * before {
                column.iter_mut().for_each(|value| *value /= left);
                basis.0.push(column);
            }
        }
        basis
    }

    /// What the columns leave of `signal`.
    pub fn residual(&self, signal: &[f64]) -> Vec<f64> {
        let mut left = signal.to_vec();
        self.take_off(&mut left);
        left
    }

    fn take_off(&self, signal: &mut [f64]) {
        for own in &self.0 {
            let share = dot(own, signal);
            signal.iter_mut().zip(own).for_each(|(value, own)| *value -= share * own);
        }
    }
}

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
    fn a_basis_leaves_what_its_columns_do_not_explain() {
        let line: Vec<f64> = (0..100).map(f64::from).collect();
        let twice: Vec<f64> = line.iter().map(|x| 2.0 * x).collect();
        let basis = Basis::new([vec![1.0; 100], line.clone(), twice, vec![0.0; 100]]);
        assert_eq!(basis.0.len(), 2, "the same column twice is one, and nothing is none");
        let signal: Vec<f64> = line.iter().map(|x| 3.0 - 0.5 * x).collect();
        assert!(square(&basis.residual(&signal)).sqrt() < 1e-9);
        assert!((correlation(&signal, &line) + 1.0).abs() < 1e-12);
    }
}
