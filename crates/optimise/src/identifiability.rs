//! What the data say about each parameter, and what they do not.
//!
//! A regressor with millions of rows says no more about its unknowns than the triangular factor of its QR
//! factorisation ([`Compressed`]). The singular values of that factor, columns scaled to one length, give the number of
//! base parameters; its null space names the combinations that leave the prediction as it is ([`Standing`]).

use nalgebra::{DMatrix, DVector};

/// Singular values below this share of the largest count as zero: a regressor's own rounding is near 1e-15, what a
/// noisy motion excites is seldom below 1e-6.
const RANK_TOLERANCE: f64 = 1e-9;

/// A parameter whose unit vector lies in the null space by more than this share (squared) is not identifiable, whether
/// unknowns are measured by what they do to the prediction or by their natural size.
const FLAT_SHARE: f64 = 1e-8;

/// `[A | b]`, known only up to an orthogonal transformation from the left: enough for any least-squares question.
#[derive(Debug, Clone, PartialEq)]
pub struct Compressed {
    /// Square, upper triangular, one column more than there are unknowns.
    factor: DMatrix<f64>,
    /// Number of rows that went in.
    n_rows: usize,
}

impl Compressed {
    /// Nothing known of `n_unknowns` unknowns.
    pub fn new(n_unknowns: usize) -> Self {
        Self { factor: DMatrix::zeros(n_unknowns + 1, n_unknowns + 1), n_rows: 0 }
    }

    /// Adds rows `[A | b]`.
    pub fn push(&mut self, rows: &DMatrix<f64>) {
        /// Rows that are folded in at a time.
        const CHUNK: usize = 512;
        assert_eq!(rows.ncols(), self.factor.ncols(), "rows have one entry an unknown and a right-hand side");
        let mut from = 0;
        while from < rows.nrows() {
            let length = CHUNK.min(rows.nrows() - from);
            self.fold(&rows.rows(from, length).into_owned());
            from += length;
        }
        self.n_rows += rows.nrows();
    }

    /// Adds what `other` knows, its rows multiplied by `weight`.
    pub fn merge(&mut self, other: &Self, weight: f64) {
        self.fold(&(&other.factor * weight));
        self.n_rows += other.n_rows;
    }

    /// The same equations for other unknowns `y`, of which these are `spread * y`.
    pub fn spread(&self, spread: &DMatrix<f64>) -> Self {
        let n = self.n_unknowns();
        assert_eq!(spread.nrows(), n, "one row an unknown");
        let mut rows = DMatrix::zeros(n + 1, spread.ncols() + 1);
        rows.columns_mut(0, spread.ncols()).copy_from(&(self.factor.columns(0, n) * spread));
        rows.column_mut(spread.ncols()).copy_from(&self.factor.column(n));
        let mut other = Self::new(spread.ncols());
        other.fold(&rows);
        other.n_rows = self.n_rows;
        other
    }

    fn fold(&mut self, rows: &DMatrix<f64>) {
        let n = self.factor.ncols();
        let mut stacked = DMatrix::zeros(n + rows.nrows(), n);
        stacked.rows_mut(0, n).copy_from(&self.factor);
        stacked.rows_mut(n, rows.nrows()).copy_from(rows);
        self.factor = stacked.qr().r();
    }

    /// Number of rows that went in.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// `|A x - b|^2`
    pub fn residual_squared(&self, x: &DVector<f64>) -> f64 {
        self.residual(x).norm_squared()
    }

    /// `A^T A`
    pub fn information(&self) -> DMatrix<f64> {
        let a = self.factor.columns(0, self.n_unknowns());
        a.transpose() * a
    }

    /// `A x - b`, up to the orthogonal transformation.
    pub fn residual(&self, x: &DVector<f64>) -> DVector<f64> {
        let n = self.n_unknowns();
        self.factor.columns(0, n) * x - self.factor.column(n)
    }

    /// Triangular factor of A.
    pub fn factor(&self) -> DMatrix<f64> {
        self.factor.columns(0, self.n_unknowns()).into_owned()
    }

    /// Number of unknowns.
    pub fn n_unknowns(&self) -> usize {
        self.factor.ncols() - 1
    }
}

/// What a weighted regressor says about its unknowns.
#[derive(Debug, Clone, PartialEq)]
pub struct Standing {
    /// Number of combinations that the data determine: the base parameters.
    pub rank: usize,
    /// Largest over smallest singular value that counts, columns scaled to one length.
    pub condition: f64,
    /// Whether the data determine the unknown by itself, not only in a combination with others.
    pub identifiable: Vec<bool>,
    /// One standard deviation, where the unknown is identifiable.
    pub std_error: Vec<Option<f64>>,
    /// Correlation of the estimates; zero where either is not identifiable.
    pub correlation: DMatrix<f64>,
    /// Combinations that leave the prediction as it is, each scaled so that its largest entry is 1; entries are changes
    /// of the unknowns.
    pub flat: Vec<Vec<f64>>,
}

/// An unknown that moves the prediction, over its natural size, by less than this share of what the strongest does, moves
/// it by rounding only.
pub const NO_EFFECT: f64 = 1e-11;

/// Analyses a weighted regressor by its triangular `factor`, rows divided by their standard deviation. `scale` is a
/// natural size of each unknown. `noise` is the
/// sum over groups of rows of `A_g^T A_g` times how many rows of the group share one independent error (1 for white
/// residuals), so that the covariance is the sandwich `H^+ noise H^+` with `H = A^T A`.
pub fn standing(factor: &DMatrix<f64>, noise: &DMatrix<f64>, scale: &[f64]) -> Standing {
    let n = factor.ncols();
    let mut lengths: Vec<f64> = factor.column_iter().map(|column| column.norm()).collect();
    let strongest = lengths.iter().zip(scale).map(|(length, scale)| length * scale).fold(0.0, f64::max);
    for (length, scale) in lengths.iter_mut().zip(scale) {
        if *length * scale <= NO_EFFECT * strongest {
            *length = 0.0;
        }
    }
    let mut scaled = factor.clone();
    for (mut column, length) in scaled.column_iter_mut().zip(&lengths) {
        column.iter_mut().for_each(|entry| *entry = if *length > 0.0 { *entry / length } else { 0.0 });
    }
    let svd = scaled.svd(false, true);
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let largest = order.first().map_or(0.0, |&index| svd.singular_values[index]);
    let seen: Vec<usize> =
        order.iter().copied().filter(|&index| svd.singular_values[index] > RANK_TOLERANCE * largest).collect();
    let rank = seen.len();
    let smallest = seen.last().map_or(0.0, |&index| svd.singular_values[index]);
    let condition = if smallest > 0.0 { largest / smallest } else { 1.0 };

    let v_t = svd.v_t.unwrap_or_else(|| DMatrix::zeros(0, n));
    let mut pseudo_inverse = DMatrix::<f64>::zeros(n, n);
    let mut share = vec![0.0; n];
    for &index in &seen {
        let row = v_t.row(index);
        pseudo_inverse += row.transpose() * row / svd.singular_values[index].powi(2);
        share.iter_mut().zip(row.iter()).for_each(|(share, entry)| *share += entry * entry);
    }
    let scaled_noise = DMatrix::from_fn(n, n, |row, column| {
        let product = lengths[row] * lengths[column];
        if product > 0.0 { noise[(row, column)] / product } else { 0.0 }
    });
    let covariance = &pseudo_inverse * scaled_noise * &pseudo_inverse;
    let flat = flat(&v_t, &seen, &lengths, n);
    let unidentifiable_share = unidentifiable_share(&flat, scale);
    let identifiable: Vec<bool> = (0..n)
        .map(|k| lengths[k] > 0.0 && 1.0 - share[k] < FLAT_SHARE && unidentifiable_share[k] < FLAT_SHARE)
        .collect();
    let std_error = (0..n)
        .map(|index| identifiable[index].then(|| covariance[(index, index)].max(0.0).sqrt() / lengths[index]))
        .collect();
    let correlation = DMatrix::from_fn(n, n, |row, column| {
        let size = (covariance[(row, row)] * covariance[(column, column)]).sqrt();
        let known = identifiable[row] && identifiable[column] && size > 0.0;
        if known { covariance[(row, column)] / size } else { 0.0 }
    });
    Standing { rank, condition, identifiable, std_error, correlation, flat }
}

/// The squared share of each unknown's unit vector in the space of the `flat` combinations, unknowns in units of their
/// natural size. One that hardly moves the prediction can be exchanged for a little of one that moves it much: only this
/// measure sees that the former is open then.
fn unidentifiable_share(flat: &[Vec<f64>], scale: &[f64]) -> Vec<f64> {
    let n = scale.len();
    if flat.is_empty() {
        return vec![0.0; n];
    }
    let mut changes = DMatrix::from_fn(n, flat.len(), |row, column| flat[column][row] / scale[row]);
    for mut change in changes.column_iter_mut() {
        let length = change.norm();
        change /= length;
    }
    changes.qr().q().row_iter().map(|row| row.norm_squared()).collect()
}

/// A basis of the null space in which each vector has few entries: reduced echelon form with complete pivoting.
fn flat(v_t: &DMatrix<f64>, seen: &[usize], lengths: &[f64], n: usize) -> Vec<Vec<f64>> {
    // Null space as what remains of the identity after projection; its pivoted elimination gives a basis.
    let mut projector = DMatrix::<f64>::identity(n, n);
    for &index in seen {
        let row = v_t.row(index);
        projector -= row.transpose() * row;
    }
    let mut basis: Vec<DVector<f64>> = Vec::new();
    let mut pivots: Vec<usize> = Vec::new();
    while basis.len() < n - seen.len().min(n) {
        let free = (0..n).filter(|index| !pivots.contains(index));
        let Some(pivot) = free.max_by(|a, b| projector[(*a, *a)].total_cmp(&projector[(*b, *b)])) else { break };
        let length = projector[(pivot, pivot)];
        if length < 1e-6 {
            break;
        }
        let column = projector.column(pivot).into_owned() / length;
        // A projector minus the part along its own column is the projector onto the rest.
        projector -= &column * column.transpose() * length;
        for vector in &mut basis {
            let entry = vector[pivot];
            *vector -= &column * entry;
        }
        basis.push(column);
        pivots.push(pivot);
    }
    basis
        .iter()
        .map(|vector| {
            let change: Vec<f64> =
                vector.iter().zip(lengths).map(|(x, length)| if *length > 0.0 { x / length } else { *x }).collect();
            // Which entries matter is judged where every column has one length.
            let largest = vector.amax();
            let kept =
                vector.iter().zip(&change).map(|(x, change)| if x.abs() > 1e-6 * largest { *change } else { 0.0 });
            let kept: Vec<f64> = kept.collect();
            let size = kept.iter().fold(0.0_f64, |size, entry| size.max(entry.abs()));
            kept.iter().map(|entry| entry / size).collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    fn random(n_rows: usize, n_columns: usize, seed: u64) -> DMatrix<f64> {
        let mut random = Random::new(seed);
        DMatrix::from_fn(n_rows, n_columns, |_, _| random.between(-0.5, 0.5))
    }

    #[test]
    fn compression_keeps_least_squares() {
        let rows = random(1300, 4, 1);
        let (a, b) = (rows.columns(0, 3).into_owned(), rows.column(3).into_owned());
        let mut compressed = Compressed::new(3);
        compressed.push(&rows.rows(0, 700).into_owned());
        let mut rest = Compressed::new(3);
        rest.push(&rows.rows(700, 600).into_owned());
        compressed.merge(&rest, 1.0);
        assert_eq!(compressed.n_rows(), 1300);
        let x = DVector::from_column_slice(&[0.3, -2.0, 1.0]);
        assert!((compressed.residual_squared(&x) - (&a * &x - &b).norm_squared()).abs() < 1e-9);
        assert!((compressed.information() - a.transpose() * &a).abs().max() < 1e-9);
        let gradient = compressed.factor().transpose() * compressed.residual(&x);
        assert!((gradient - a.transpose() * (&a * &x - &b)).abs().max() < 1e-9);
    }

    /// Columns: a, b, a + 2b, nothing, c.
    #[test]
    fn rank_flat_directions_and_what_stays_identifiable() {
        let base = random(200, 3, 7);
        let a = DMatrix::from_fn(200, 5, |row, column| match column {
            0 => base[(row, 0)],
            1 => base[(row, 1)],
            2 => base[(row, 0)] + 2.0 * base[(row, 1)],
            3 => 0.0,
            _ => 1e3 * base[(row, 2)],
        });
        let standing = standing(&a.clone().qr().r(), &(a.transpose() * &a), &[1.0; 5]);
        assert_eq!(standing.rank, 3);
        assert_eq!(standing.identifiable, [false, false, false, false, true]);
        assert_eq!(standing.flat.len(), 2);
        for flat in &standing.flat {
            let change = &a * DVector::from_column_slice(flat);
            assert!(change.amax() < 1e-9, "{flat:?}");
        }
        assert!(standing.flat.iter().any(|flat| flat[3] == 1.0 && flat.iter().filter(|x| **x != 0.0).count() == 1));
    }

    /// Columns: a, b, a + b and c, b being small: none of the first three is known by itself.
    #[test]
    fn a_small_column_tied_to_large_ones_is_not_identifiable() {
        const SMALL: f64 = 1e-5;
        let base = random(200, 3, 19);
        let a = DMatrix::from_fn(200, 4, |row, column| match column {
            0 => base[(row, 0)],
            1 => SMALL * base[(row, 1)],
            2 => base[(row, 0)] + SMALL * base[(row, 1)],
            _ => base[(row, 2)],
        });
        let standing = standing(&a.clone().qr().r(), &(a.transpose() * &a), &[1.0; 4]);
        assert_eq!(standing.rank, 3);
        assert_eq!(standing.identifiable, [false, false, false, true]);
        assert_eq!(standing.std_error[1], None);
    }

    /// White residuals: the covariance is the inverse of the information.
    #[test]
    fn standard_errors_are_those_of_least_squares() {
        let a = random(100, 2, 3);
        let information = a.transpose() * &a;
        let standing = standing(&a.qr().r(), &information, &[1.0; 2]);
        let inverse = information.clone().try_inverse().expect("random columns are independent");
        for index in 0..2 {
            let expected = inverse[(index, index)].sqrt();
            let found = standing.std_error[index].expect("identifiable");
            assert!((found - expected).abs() < 1e-12 * expected.max(1.0));
        }
        let expected = inverse[(0, 1)] / (inverse[(0, 0)] * inverse[(1, 1)]).sqrt();
        assert!((standing.correlation[(0, 1)] - expected).abs() < 1e-12);
    }
}
