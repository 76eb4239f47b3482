//! `D x = b` for a symmetric positive definite D by `L diag(d) L^T`, without square roots.

use dynid_generated::{Lanes, Scalar};

/// Factorises matrices (row-major, n x n; only the lower triangles are read) in place: below the diagonal L, on it the
/// *reciprocal* of d.
pub fn factorise_lanes(n: usize, matrix: &mut [Lanes]) {
    for row in 0..n {
        for column in 0..row {
            let mut sum = matrix[row * n + column];
            for k in 0..column {
                sum = sum - matrix[row * n + k] * matrix[column * n + k];
            }
            matrix[row * n + column] = sum;
        }
        let mut pivot = matrix[row * n + row];
        for column in 0..row {
            let scaled = matrix[row * n + column];
            let lower = scaled * matrix[column * n + column];
            pivot = pivot - scaled * lower;
            matrix[row * n + column] = lower;
        }
        matrix[row * n + row] = Lanes::constant(1.0) / pivot;
    }
}

/// Solves in place, overwriting both.
pub fn solve(n: usize, matrix: &mut [f64], b: &mut [f64]) {
    match n {
        1 => b[0] /= matrix[0],
        2 => solve_sized::<2>(matrix, b),
        3 => solve_sized::<3>(matrix, b),
        4 => solve_sized::<4>(matrix, b),
        5 => solve_sized::<5>(matrix, b),
        6 => solve_sized::<6>(matrix, b),
        _ => {
            factorise(n, matrix);
            substitute(n, |place| matrix[place], b);
        }
    }
}

/// With n known to the compiler every loop unrolls and every bound check goes.
fn solve_sized<const N: usize>(matrix: &mut [f64], b: &mut [f64]) {
    let (Some(matrix), Some(b)) = (matrix.get_mut(..N * N), b.get_mut(..N)) else {
        return;
    };
    factorise(N, matrix);
    substitute(N, |place| matrix[place], b);
}

/// As [`factorise_lanes`], of one matrix.
#[inline(always)]
fn factorise(n: usize, matrix: &mut [f64]) {
    for row in 0..n {
        for column in 0..row {
            let mut sum = matrix[row * n + column];
            for k in 0..column {
                sum -= matrix[row * n + k] * matrix[column * n + k];
            }
            matrix[row * n + column] = sum;
        }
        let mut pivot = matrix[row * n + row];
        for column in 0..row {
            let scaled = matrix[row * n + column];
            let lower = scaled * matrix[column * n + column];
            pivot -= scaled * lower;
            matrix[row * n + column] = lower;
        }
        matrix[row * n + row] = 1.0 / pivot;
    }
}

/// Solves in place with what `factorise_lanes` leaves of a matrix, entry by entry.
#[inline(always)]
pub fn substitute(n: usize, factor: impl Fn(usize) -> f64, b: &mut [f64]) {
    for row in 1..n {
        for k in 0..row {
            b[row] -= factor(row * n + k) * b[k];
        }
    }
    for row in (0..n).rev() {
        b[row] *= factor(row * n + row);
        for k in row + 1..n {
            b[row] -= factor(k * n + row) * b[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A symmetric positive definite matrix, made as `A A^T + 1`.
    fn sample(n: usize) -> Vec<f64> {
        let a: Vec<f64> = (0..n * n).map(|k| ((k * k + 3 * k) % 17) as f64 / 17.0 - 0.4).collect();
        let mut d = vec![0.0; n * n];
        for row in 0..n {
            for column in 0..n {
                d[row * n + column] = (0..n).map(|k| a[row * n + k] * a[column * n + k]).sum::<f64>();
            }
            d[row * n + row] += 1.0;
        }
        d
    }

    #[test]
    fn solutions_satisfy_the_equations() {
        for n in 1..=9 {
            let d = sample(n);
            let b: Vec<f64> = (0..n).map(|k| 1.0 + k as f64).collect();
            let mut single = b.clone();
            solve(n, &mut d.clone(), &mut single);
            let mut lanes: Vec<Lanes> = d.iter().map(|entry| Lanes::new([*entry, 2.0 * entry])).collect();
            factorise_lanes(n, &mut lanes);
            let twice: Vec<f64> = lanes.iter().map(|entry| entry.to_array()[1]).collect();
            let mut columns = b.clone();
            substitute(n, |place| twice[place], &mut columns);
            for row in 0..n {
                let product: f64 = (0..n).map(|k| d[row * n + k] * single[k]).sum();
                assert!((product - b[row]).abs() < 1e-12, "row {row} of {n}: {product}");
                assert!((2.0 * columns[row] - single[row]).abs() < 1e-12);
            }
        }
    }
}
