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
