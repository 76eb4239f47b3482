//! Error budget: how much of each joint's remaining error comes from which configuration.
//!
//! With the information `I_c` of each configuration's runs and `P` of the parameters' ranges, the covariance of all
//! parameters is `S = (P + sum(I_c))^-1`. The noise of configuration c reaches the estimate with the covariance
//! `S I_c S`, and these shares add up: `S = S P S + sum(S I_c S)`. A simulated position with the derivative `j` by the
//! parameters varies by `j S I_c S j'`; its mean over a run's samples is what the budget states, as a root. Thus a later
//! joint's error is told apart into what its own runs left open and what earlier ones did (thesis section 4.2.2 could
//! only suspect it).

use nalgebra::DMatrix;

use super::{
    position::{Options, PositionFit, PositionFitError, PositionProblem, RunMotion, Unknown, motions},
    sequence::Step,
};
use dynid_user_model::{ErrorShare, Source};

/// The budget of a sequence: `joint` fitted `problem`, whose runs are of `configurations` and have the free joints
/// `free`; `steps` led there.
pub fn budget(
    problem: &PositionProblem,
    (configurations, free): (&[usize], &[&[usize]]),
    steps: &[Step],
    joint: &PositionFit,
    options: &Options,
) -> Result<Vec<ErrorShare>, PositionFitError> {
    let motions = motions(problem, joint, options)?;
    let n = joint.parameters.len();
    let widening = joint.widening();
    let mut numbers: Vec<usize> = Vec::new();
    for number in configurations {
        if !numbers.contains(number) {
            numbers.push(*number);
        }
    }
    let informations: Vec<DMatrix<f64>> = numbers
        .iter()
        .map(|number| {
            let own = motions.iter().zip(configurations).filter(|(_, other)| *other == number);
            own.fold(DMatrix::zeros(n, n), |sum, (motion, _)| sum + &motion.information) / widening
        })
        .collect();
    let mut range = DMatrix::zeros(n, n);
    for (index, estimate) in joint.parameters.iter().enumerate() {
        let unknown = problem.unknowns.iter().find(|unknown| unknown.name == estimate.name);
        range[(index, index)] = unknown.map_or(1.0, Unknown::spread).powi(-2);
    }
    let shares = shares(&range, &informations);
    let carried: Vec<(usize, DMatrix<f64>)> =
        steps.iter().map(|step| (step.configuration, spread_out(step, joint))).collect();

    let mut reported = Vec::new();
    for number in &numbers {
        let runs: Vec<usize> = (0..motions.len()).filter(|run| configurations[*run] == *number).collect();
        let earlier = carried.iter().take_while(|(step, _)| step != number);
        for (slot, &index) in free[runs[0]].iter().enumerate() {
            let samples: f64 = runs.iter().map(|&run| joint.runs[run].samples as f64).sum();
            let pooled = |of: &dyn Fn(usize) -> f64| {
                runs.iter().map(|&run| of(run) * joint.runs[run].samples as f64).sum::<f64>() / samples.max(1.0)
            };
            let variance = |covariance: &DMatrix<f64>| pooled(&|run| mean_variance(&motions[run], slot, covariance));
            let from: Vec<f64> = shares.from.iter().map(&variance).collect();
            let of_range = variance(&shares.range);
            let source = |configuration: usize, variance: f64| Source { configuration, rms: variance.sqrt() };
            reported.push(ErrorShare {
                configuration: *number,
                joint: index,
                noise_floor: pooled(&|run| joint.runs[run].noise[slot].powi(2)).sqrt(),
                rmse: pooled(&|run| joint.runs[run].rmse[slot].powi(2)).sqrt(),
                remaining: (of_range + from.iter().sum::<f64>()).sqrt(),
                from: numbers.iter().zip(&from).map(|(number, variance)| source(*number, *variance)).collect(),
                range: of_range.sqrt(),
                carried: earlier.clone().map(|(step, covariance)| source(*step, variance(covariance))).collect(),
            });
        }
    }
    Ok(reported)
}

/// The covariance of all parameters, taken apart by where it comes from.
struct Shares {
    from: Vec<DMatrix<f64>>,
    range: DMatrix<f64>,
}

fn shares(range: &DMatrix<f64>, informations: &[DMatrix<f64>]) -> Shares {
    let n = range.nrows();
    // Unit diagonal: the parameters have all sorts of units.
    let total = informations.iter().fold(range.clone(), |sum, information| sum + information);
    let scale: Vec<f64> = (0..n).map(|k| total[(k, k)].sqrt().recip()).collect();
    let scaled = |matrix: &DMatrix<f64>| {
        DMatrix::from_fn(n, n, |row, column| matrix[(row, column)] * scale[row] * scale[column])
    };
    let Some(factor) = scaled(&total).cholesky() else {
        let unknown = DMatrix::from_element(n, n, f64::INFINITY);
        return Shares { from: vec![unknown.clone(); informations.len()], range: unknown };
    };
    let part = |information: &DMatrix<f64>| {
        let half = factor.solve(&scaled(information));
        scaled(&factor.solve(&half.transpose()))
    };
    Shares { from: informations.iter().map(part).collect(), range: part(range) }
}

/// A step's covariance among all parameters; those that it did not know have none.
fn spread_out(step: &Step, joint: &PositionFit) -> DMatrix<f64> {
    let n = joint.parameters.len();
    let mut covariance = DMatrix::zeros(n, n);
    let place = |name: &str| joint.parameters.iter().position(|estimate| estimate.name == name);
    let places: Vec<Option<usize>> = step.fit.parameters.iter().map(|estimate| place(&estimate.name)).collect();
    for (row, one) in places.iter().enumerate() {
        for (column, other) in places.iter().enumerate() {
            if let (Some(one), Some(other)) = (*one, *other) {
                covariance[(one, other)] = step.fit.covariance[(row, column)];
            }
        }
    }
    covariance
}

/// Mean of `j C j'`: the trace of `C` times the mean of `j' j`.
fn mean_variance(motion: &RunMotion, slot: usize, covariance: &DMatrix<f64>) -> f64 {
    motion.by_slot[slot].component_mul(covariance).sum().max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two parameters: the first seen by configuration 1 alone, the sum of both by configuration 2.
    #[test]
    fn shares_add_up_to_the_covariance() {
        let range = DMatrix::from_row_slice(2, 2, &[1e-6, 0.0, 0.0, 1e-6]);
        let first = DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 0.0]);
        let second = DMatrix::from_row_slice(2, 2, &[100.0, 100.0, 100.0, 100.0]);
        let whole = (&range + &first + &second).try_inverse().expect("both are seen");
        let shares = shares(&range, &[first, second]);
        let sum = &shares.from[0] + &shares.from[1] + &shares.range;
        assert!((sum - &whole).norm() < 1e-9 * whole.norm());
        // By hand: b = s - a with var(a) = 1/4 from the first, var(s) = 1/100 from the second.
        assert!((shares.from[0][(0, 0)] - 0.25).abs() < 1e-5 && (shares.from[0][(1, 1)] - 0.25).abs() < 1e-5);
        assert!(shares.from[1][(0, 0)].abs() < 1e-5 && (shares.from[1][(1, 1)] - 0.01).abs() < 1e-5);
    }
}
