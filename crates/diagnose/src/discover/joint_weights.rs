//! Errors of several joints as one least-squares problem. Each joint counts by what is left of its error when the model's own
//! parameters are taken out, which only taking them out tells.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::torque_error::{Block, regular};

/// Rounds of weighing and taking out; a third changes little.
const ROUNDS: usize = 2;

/// The problem, weighed.
pub(super) struct Weighed {
    /// Of each joint, one over the root mean square of what is left of its error.
    pub(super) weights: BTreeMap<usize, f64>,
    /// How the errors change with the own parameters: a row an error, a column a parameter.
    pub(super) own: DMatrix<f64>,
    /// The errors.
    pub(super) error: DVector<f64>,
    /// What the own parameters leave of them.
    pub(super) left: Vec<f64>,
    information: Option<Cholesky<f64, Dyn>>,
}

impl Weighed {
    /// Of the errors in `blocks` and how they change with the own parameters, `prior` being what is known of each of those
    /// beforehand.
    pub(super) fn new(blocks: &[Block], own: &DMatrix<f64>, prior: &[f64]) -> Self {
        let errors: Vec<f64> = blocks.iter().flat_map(|block| block.values.iter().copied()).collect();
        let mut problem = Self {
            weights: blocks.iter().map(|block| (block.joint, 1.0)).collect(),
            own: own.clone(),
            error: DVector::from_column_slice(&errors),
            left: errors.clone(),
            information: None,
        };
        for _ in 0..ROUNDS {
            // What is left is weighed already.
            for (joint, deviation) in problem.deviations(blocks) {
                problem.weights.entry(joint).and_modify(|weight| *weight /= deviation);
            }
            let weights = problem.of_rows(blocks);
            problem.own = DMatrix::from_fn(own.nrows(), own.ncols(), |row, column| own[(row, column)] * weights[row]);
            problem.information = regular(&problem.own.tr_mul(&problem.own), prior);
            let weighed: Vec<f64> = errors.iter().zip(&weights).map(|(error, weight)| error * weight).collect();
            problem.error = DVector::from_column_slice(&weighed);
            problem.left = problem.projected(weighed);
        }
        problem
    }

    /// The weight of each error.
    pub(super) fn of_rows(&self, blocks: &[Block]) -> Vec<f64> {
        blocks.iter().flat_map(|block| std::iter::repeat_n(self.weights[&block.joint], block.values.len())).collect()
    }

    /// Whether the own parameters could be taken out.
    pub(super) fn is_regular(&self) -> bool {
        self.information.is_some()
    }

    /// What the own parameters leave of a weighed signal.
    pub(super) fn projected(&self, mut signal: Vec<f64>) -> Vec<f64> {
        if let Some(information) = &self.information {
            let right = self.own.tr_mul(&DVector::from_column_slice(&signal));
            let steps = information.solve(&right);
            let taken = &self.own * steps;
            signal.iter_mut().zip(taken.iter()).for_each(|(value, taken)| *value -= taken);
        }
        signal
    }

    /// Root mean square of what is left of each joint.
    fn deviations(&self, blocks: &[Block]) -> BTreeMap<usize, f64> {
        let mut sums: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
        let mut from = 0;
        for block in blocks {
            let end = from + block.values.len();
            let sum = sums.entry(block.joint).or_insert((0.0, 0.0));
            sum.0 += self.left[from..end].iter().map(|value| value * value).sum::<f64>();
            sum.1 += (end - from) as f64;
            from = end;
        }
        let deviation = |(sum, count): (f64, f64)| (sum / f64::max(count, 1.0)).sqrt().max(f64::MIN_POSITIVE.sqrt());
        sums.into_iter().map(|(joint, sum)| (joint, deviation(sum))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    /// Two joints of very different size, each with a column of its own and noise: taken out and weighed, both are noise of
    /// size 1, and the weight is one over the noise.
    #[test]
    fn each_joint_counts_by_its_noise() {
        let n = 2000;
        let mut random = Random::new(31);
        let noises = [1e-3, 20.0];
        let columns: Vec<Vec<f64>> = (0..2).map(|_| random.vector(n, -1.0, 1.0)).collect();
        let block = |joint: usize, random: &mut Random| Block {
            joint,
            independent: n as f64,
            values: columns[joint].iter().map(|own| noises[joint] * (50.0 * own + random.normal())).collect(),
        };
        let blocks = [block(0, &mut random), block(1, &mut random)];
        let own =
            DMatrix::from_fn(2 * n, 2, |row, column| if row / n == column { columns[column][row % n] } else { 0.0 });
        let problem = Weighed::new(&blocks, &own, &[1e-12, 1e-12]);
        assert!(problem.is_regular());
        for (joint, noise) in noises.iter().enumerate() {
            assert!((problem.weights[&joint] * noise - 1.0).abs() < 0.05, "{joint}: {:?}", problem.weights);
        }
        let size = (problem.left.iter().map(|left| left * left).sum::<f64>() / (2 * n) as f64).sqrt();
        assert!((size - 1.0).abs() < 0.01, "{size}");
    }
}
