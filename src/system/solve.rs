//! `D x = b` for a symmetric positive definite D by `L diag(d) L^T`, without square roots.

/// Factorises `matrix` (row-major, n x n; only its lower triangle is read) in place: below the diagonal L, on it the
/// *reciprocal* of d.
pub(crate) fn factorise(n: usize, matrix: &mut [f64]) {
    match n {
        1 => matrix[0] = 1.0 / matrix[0],
        2 => factorise_sized::<2>(matrix),
        3 => factorise_sized::<3>(matrix),
        4 => factorise_sized::<4>(matrix),
        5 => factorise_sized::<5>(matrix),
        6 => factorise_sized::<6>(matrix),
        _ => factorise_any(n, matrix),
    }
}

/// Solves in place, overwriting both.
pub(crate) fn solve(n: usize, matrix: &mut [f64], b: &mut [f64]) {
    match n {
        1 => b[0] /= matrix[0],
        2 => solve_sized::<2>(matrix, b),
        3 => solve_sized::<3>(matrix, b),
        4 => solve_sized::<4>(matrix, b),
        5 => solve_sized::<5>(matrix, b),
        6 => solve_sized::<6>(matrix, b),
        _ => {
            factorise_any(n, matrix);
            substitute(n, matrix, b);
        }
    }
}

/// Solves for many right-hand sides: `columns` is n x width, row-major; `factor` comes from [`factorise`].
pub(crate) fn solve_columns(n: usize, factor: &[f64], columns: &mut [f64], width: usize) {
    if n == 1 {
        columns.iter_mut().for_each(|value| *value *= factor[0]);
        return;
    }
    for row in 1..n {
        let (above, below) = columns.split_at_mut(row * width);
        for (k, solved) in above.chunks_exact(width).enumerate() {
            subtract_scaled(&mut below[..width], factor[row * n + k], solved);
        }
    }
    for row in (0..n).rev() {
        let (above, below) = columns.split_at_mut((row + 1) * width);
        let current = &mut above[row * width..];
        current.iter_mut().for_each(|value| *value *= factor[row * n + row]);
        for (k, solved) in below.chunks_exact(width).enumerate() {
            subtract_scaled(current, factor[(row + 1 + k) * n + row], solved);
        }
    }
}

fn subtract_scaled(target: &mut [f64], factor: f64, source: &[f64]) {
    for (target, source) in target.iter_mut().zip(source) {
        *target -= factor * source;
    }
}

/// With n known to the compiler every loop unrolls and every bound check goes.
fn factorise_sized<const N: usize>(matrix: &mut [f64]) {
    for row in 0..N {
        for column in 0..row {
            let mut sum = matrix[row * N + column];
            for k in 0..column {
                sum -= matrix[row * N + k] * matrix[column * N + k];
            }
            matrix[row * N + column] = sum;
        }
        let mut pivot = matrix[row * N + row];
        for column in 0..row {
            let scaled = matrix[row * N + column];
            let lower = scaled * matrix[column * N + column];
            pivot -= scaled * lower;
            matrix[row * N + column] = lower;
        }
        matrix[row * N + row] = 1.0 / pivot;
    }
}

fn solve_sized<const N: usize>(matrix: &mut [f64], b: &mut [f64]) {
    let (Some(matrix), Some(b)) = (matrix.get_mut(..N * N), b.get_mut(..N)) else {
        return;
    };
    factorise_sized::<N>(matrix);
    for row in 1..N {
        for k in 0..row {
            b[row] -= matrix[row * N + k] * b[k];
        }
    }
    for row in (0..N).rev() {
        b[row] *= matrix[row * N + row];
        for k in row + 1..N {
            b[row] -= matrix[k * N + row] * b[k];
        }
    }
}

fn factorise_any(n: usize, matrix: &mut [f64]) {
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

fn substitute(n: usize, factor: &[f64], b: &mut [f64]) {
    for row in 1..n {
        for k in 0..row {
            b[row] -= factor[row * n + k] * b[k];
        }
    }
    for row in (0..n).rev() {
        b[row] *= factor[row * n + row];
        for k in row + 1..n {
            b[row] -= factor[k * n + row] * b[k];
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
            let mut factor = d.clone();
            factorise(n, &mut factor);
            let mut columns: Vec<f64> = b.iter().flat_map(|value| [*value, -2.0 * value]).collect();
            solve_columns(n, &factor, &mut columns, 2);
            for row in 0..n {
                let product: f64 = (0..n).map(|k| d[row * n + k] * single[k]).sum();
                assert!((product - b[row]).abs() < 1e-12, "row {row} of {n}: {product}");
                assert!((columns[2 * row] - single[row]).abs() < 1e-12);
                assert!((columns[2 * row + 1] + 2.0 * single[row]).abs() < 1e-12);
            }
        }
    }
}
