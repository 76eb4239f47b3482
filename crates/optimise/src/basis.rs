//! An orthonormal basis of the columns of a least-squares problem: what they explain of a signal, and what they leave.

/// Orthonormal columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis(Vec<Vec<f64>>);

impl Basis {
    /// Of all `columns`; those that others span are left out (Gram-Schmidt, twice: Giraud et al. 2005).
    pub fn new(columns: impl IntoIterator<Item = Vec<f64>>) -> Self {
        /// What is left of a column is rounding below this share of it.
        const ROUNDING: f64 = 1e-7;
        let mut basis = Self(Vec::new());
        for mut column in columns {
            let before = dot(&column, &column).sqrt();
            basis.take_off(&mut column);
            basis.take_off(&mut column);
            let left = dot(&column, &column).sqrt();
            if left > ROUNDING * before {
                column.iter_mut().for_each(|value| *value /= left);
                basis.0.push(column);
            }
        }
        basis
    }

    /// Number of independent columns.
    pub fn rank(&self) -> usize {
        self.0.len()
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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_basis_leaves_what_its_columns_do_not_explain() {
        let line: Vec<f64> = (0..100).map(f64::from).collect();
        let twice: Vec<f64> = line.iter().map(|x| 2.0 * x).collect();
        let basis = Basis::new([vec![1.0; 100], line.clone(), twice, vec![0.0; 100]]);
        assert_eq!(basis.rank(), 2, "the same column twice is one, and nothing is none");
        let signal: Vec<f64> = line.iter().map(|x| 3.0 - 0.5 * x).collect();
        assert!(basis.residual(&signal).iter().all(|left| left.abs() < 1e-9));
        let odd: Vec<f64> = (0..100).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let left = basis.residual(&odd);
        assert!(dot(&left, &line).abs() < 1e-9 && dot(&left, &left) > 99.0);
    }
}
