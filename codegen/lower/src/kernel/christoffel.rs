//! The matrix of centrifugal and Coriolis terms from the inertia matrix.

use super::{entry, find};
use crate::{Input, Node, Program};

/// `C[k][j] = sum_i 1/2 (d D_kj / d q_i + d D_ki / d q_j - d D_ij / d q_k) dq_i` (thesis Eq. 3.3), row-major. Joints
/// outside `free` stand still. Where `k` is `i` or `j`, two of the three derivatives cancel.
pub(super) fn matrix(program: &mut Program, free: &[usize]) -> Vec<Node> {
    let n = free.len();
    let entries: Vec<Node> = free
        .iter()
        .flat_map(|&i| free.iter().map(move |&j| (i, j)))
        .map(|(i, j)| find(program, &entry("D", i, j)))
        .collect();
    let by: Vec<Vec<Node>> = free
        .iter()
        .map(|&joint| {
            let position = program.input(Input::Position(joint), "");
            program.derivative(&entries, position)
        })
        .collect();
    let velocities: Vec<Node> = free.iter().map(|&joint| program.input(Input::Velocity(joint), "")).collect();
    let half = program.number(0.5);
    let mut matrix = Vec::with_capacity(n * n);
    for k in 0..n {
        for j in 0..n {
            let terms: Vec<Node> = (0..n)
                .map(|i| {
                    let symbol = if k == i {
                        by[j][k * n + i]
                    } else if k == j {
                        by[i][k * n + j]
                    } else {
                        let symmetric = program.add(by[i][k * n + j], by[j][k * n + i]);
                        program.subtract(symmetric, by[k][i * n + j])
                    };
                    program.multiply(symbol, velocities[i])
                })
                .collect();
            let sum = program.sum(&terms);
            matrix.push(program.multiply(half, sum));
        }
    }
    matrix
}
