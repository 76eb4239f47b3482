//! Unrolled elimination for a symmetric positive definite matrix.

use crate::{Node, Program};

/// Solves `matrix * x = right` by block elimination `L D L^T` with pivot blocks of two, from the last row up.
///
/// From the last joint up, because D's entries near the tip are the first to be known, so that elimination overlaps
/// with the rest of D; in blocks of two, because each block costs one division (its determinant's reciprocal) where
/// two scalar pivots would cost two, one after the other. The determinant `a c - b^2` loses no more digits than the
/// scalar pivot `c - b^2 / a` does. Structural zeros fold away in the constructors.
pub(super) fn symmetric(program: &mut Program, mut matrix: Vec<Vec<Node>>, mut right: Vec<Node>) -> Vec<Node> {
    let n = right.len();
    if n == 1 {
        return vec![program.divide(right[0], matrix[0][0])];
    }
    let blocks: Vec<Vec<usize>> = (0..n).rev().collect::<Vec<_>>().chunks(2).map(<[usize]>::to_vec).collect();
    // Per block: its inverse applied to its part of the right side, and the factors of the rows above it.
    let mut eliminated = Vec::new();
    for block in &blocks {
        let rest = block.iter().min().copied().unwrap_or(0);
        let inverse = inverse(program, &matrix, block);
        let factors: Vec<Vec<Node>> = (0..rest)
            .map(|row| {
                let coupling: Vec<Node> = block.iter().map(|&column| matrix[row][column]).collect();
                inverse.iter().map(|column| dot(program, &coupling, column)).collect()
            })
            .collect();
        for row in 0..rest {
            let corrections: Vec<Node> = (0..=row)
                .map(|column| {
                    let coupling: Vec<Node> = block.iter().map(|&k| matrix[column][k]).collect();
                    dot(program, &factors[row], &coupling)
                })
                .collect();
            for (column, correction) in corrections.into_iter().enumerate() {
                let entry = program.subtract(matrix[row][column], correction);
                matrix[row][column] = entry;
                matrix[column][row] = entry;
            }
            let own: Vec<Node> = block.iter().map(|&k| right[k]).collect();
            let correction = dot(program, &factors[row], &own);
            right[row] = program.subtract(right[row], correction);
        }
        let own: Vec<Node> = block.iter().map(|&k| right[k]).collect();
        let solved: Vec<Node> = inverse.iter().map(|row| dot(program, row, &own)).collect();
        eliminated.push((solved, factors));
    }
    let mut x = right;
    for (block, (solved, factors)) in blocks.iter().zip(&eliminated).rev() {
        for (place, &row) in block.iter().enumerate() {
            let terms: Vec<Node> = factors.iter().map(|factor| factor[place]).collect();
            let known = x[..terms.len()].to_vec();
            let correction = dot(program, &terms, &known);
            x[row] = program.subtract(solved[place], correction);
        }
    }
    x
}

/// The inverse of the pivot block: one row or two.
fn inverse(program: &mut Program, matrix: &[Vec<Node>], block: &[usize]) -> Vec<Vec<Node>> {
    let one = program.number(1.0);
    match *block {
        [i] => vec![vec![program.divide(one, matrix[i][i])]],
        [i, j] => {
            let (a, b, c) = (matrix[i][i], matrix[i][j], matrix[j][j]);
            let (ac, bb) = (program.multiply(a, c), program.multiply(b, b));
            let determinant = program.subtract(ac, bb);
            let reciprocal = program.divide(one, determinant);
            let first = program.multiply(c, reciprocal);
            let off = program.multiply(b, reciprocal);
            let off = program.negate(off);
            let last = program.multiply(a, reciprocal);
            vec![vec![first, off], vec![off, last]]
        }
        _ => Vec::new(),
    }
}

fn dot(program: &mut Program, a: &[Node], b: &[Node]) -> Node {
    let products: Vec<Node> = a.iter().zip(b).map(|(&a, &b)| program.multiply(a, b)).collect();
    program.sum(&products)
}

#[cfg(test)]
mod tests {
    use super::symmetric;
    use crate::{Input, Node, Program};

    /// A program that solves an `n` x `n` system of inputs; entries beyond `band` from the diagonal are zero.
    fn system(n: usize, band: usize) -> Program {
        let mut program = Program::new();
        let mut matrix = vec![Vec::new(); n];
        for (row, entries) in matrix.iter_mut().enumerate() {
            for column in 0..n {
                let entry: Node = if row.abs_diff(column) > band {
                    program.number(0.0)
                } else {
                    program.parameter(&format!("a.{}.{}", row.min(column), row.max(column)), "")
                };
                entries.push(entry);
            }
        }
        let right = (0..n).map(|row| program.parameter(&format!("b.{row}"), "")).collect();
        for (row, x) in symmetric(&mut program, matrix, right).into_iter().enumerate() {
            program.output(&format!("x_{row}"), x);
        }
        program
    }

    /// Diagonally dominant, so positive definite.
    fn value(input: &Input) -> f64 {
        let name = input.identifier();
        let indices: Vec<usize> = name.split('_').filter_map(|part| part.parse().ok()).collect();
        match indices.as_slice() {
            [row, column] if row == column => 8.0 + *row as f64,
            [row, column] => ((3 * row + 5 * column) % 7) as f64 / 7.0 - 0.4,
            _ => indices[0] as f64 - 1.5,
        }
    }

    #[test]
    fn the_solution_solves() {
        for n in 1..=7 {
            for band in [0, 2, n] {
                let x = system(n, band).evaluate(value);
                for row in 0..n {
                    let entry = |column: usize| match row.abs_diff(column) > band {
                        true => 0.0,
                        false => value(&Input::Parameter(format!("a.{}.{}", row.min(column), row.max(column)))),
                    };
                    let left: f64 = (0..n).map(|column| entry(column) * x[column]).sum();
                    let right = value(&Input::Parameter(format!("b.{row}")));
                    assert!((left - right).abs() < 1e-14, "n = {n}, band = {band}, row {row}: {left} {right}");
                }
            }
        }
    }

    #[test]
    fn zeros_cost_nothing_and_two_rows_cost_one_division() {
        let counts = |band| system(6, band).operations();
        assert_eq!(counts(6).divs, 3);
        // Three blocks of a diagonal matrix: the determinant, its reciprocal, two products and two solutions each.
        assert_eq!((counts(0).adds, counts(0).muls, counts(0).divs), (0, 15, 3));
        assert!(counts(2).arithmetic() < counts(6).arithmetic());
    }
}
