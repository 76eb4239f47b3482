//! Against differences, and against the costs of fits.

use std::collections::BTreeSet;

use dynid_logs::experiment::Experiment;

use super::*;
use crate::identify::{ErrorSignal, identify};
use crate::position::Options;

fn tour() -> (Model, Experiment) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../src/tour");
    let model = Model::load(format!("{folder}/believed.toml")).expect("the tour's model");
    (model, Experiment::load(format!("{folder}/experiment.toml")).expect("the tour's logs"))
}

fn cost(residuals: &[f64]) -> f64 {
    0.5 * residuals.iter().map(|residual| residual * residual).sum::<f64>()
}

/// Central differences of the residuals along each unknown, against the Jacobian's column: both in units of the column.
fn check_jacobian(residuals: &Residuals, within: f64) {
    let x = residuals.start().to_vec();
    let (lower, upper) = residuals.bounds();
    let Evaluated { residuals: here, jacobian } = residuals.with_jacobian(&x).expect("it can be simulated");
    assert_eq!(here, residuals.at(&x).expect("it can be simulated"), "the same residuals with and without derivatives");
    assert_eq!(residuals.names().len(), x.len());
    for (index, name) in residuals.names().iter().enumerate() {
        let step = 1e-5 * x[index].abs().max(1e-3);
        let moved = |by: f64| {
            let mut moved = x.clone();
            moved[index] = (moved[index] + by).clamp(lower[index], upper[index]);
            (moved[index], residuals.at(&moved).expect("it can be simulated"))
        };
        let ((above, high), (below, low)) = (moved(step), moved(-step));
        let slope = |row: usize| (high[row] - low[row]) / (above - below);
        let column = |row: usize| jacobian[row * x.len() + index];
        let size = (0..here.len()).map(|row| column(row).abs()).fold(0.0, f64::max);
        let off = (0..here.len()).map(|row| (slope(row) - column(row)).abs()).fold(0.0, f64::max);
        assert!(size > 0.0 && off <= within * size, "{name}: off by {off:e} of {size:e}");
    }
}

#[test]
fn derivatives_are_those_of_the_residuals() {
    let (model, experiment) = tour();
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    check_jacobian(&Residuals::of_position(&model, &runs, Some(4)).expect("a problem"), 1e-4);
    check_jacobian(&Residuals::of_torque(&model, &runs).expect("a problem"), 1e-5);
}

/// Parameters of the model, each once; for the position error then where each run starts.
#[test]
fn unknowns_have_the_names_of_the_model() {
    let (model, experiment) = tour();
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let known = model.names();
    let parameters =
        |names: &[String]| names.iter().filter(|name| known.contains(name)).cloned().collect::<BTreeSet<_>>();
    let of_torque = Residuals::of_torque(&model, &runs).expect("a problem").names();
    assert!(!of_torque.is_empty() && parameters(&of_torque).len() == of_torque.len(), "{of_torque:?}");
    let of_position = Residuals::of_position(&model, &runs, Some(4)).expect("a problem").names();
    let starts = of_position.iter().filter(|name| name.ends_with(" at the start")).count();
    assert!(starts > 0 && parameters(&of_position).len() == of_position.len() - starts, "{of_position:?}");
}

#[test]
fn half_their_squares_is_the_cost_of_the_fit() {
    let (model, experiment) = tour();
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let steps = Some(Steps::PerSample(4));
    let found = |error: ErrorSignal| {
        let options = Options { steps, ..Options::default() };
        identify(&model, &experiment, &runs, error, &options, &mut |_| ()).expect("a fit")
    };
    let fitted = found(ErrorSignal::Torque);
    let residuals = Residuals::of_torque(&fitted.model, &runs).expect("a problem");
    let own = cost(&residuals.at(residuals.start()).expect("along the logs"));
    assert!((own - fitted.cost_after).abs() < 1e-9 * own, "{own} {}", fitted.cost_after);

    // A fit tells the cost of the data alone.
    let fitted = found(ErrorSignal::Position);
    let residuals = Residuals::of_position(&fitted.model, &runs, Some(4)).expect("a problem");
    let mut x = residuals.start().to_vec();
    for _ in 0..10 {
        let Evaluated { residuals: r, jacobian } = residuals.with_jacobian(&x).expect("it can be simulated");
        let jacobian = nalgebra::DMatrix::from_row_slice(r.len(), x.len(), &jacobian);
        let r = nalgebra::DVector::from_vec(r);
        let step = jacobian.svd(true, true).solve(&r, 1e-14).expect("both were asked for");
        x.iter_mut().zip(step.iter()).for_each(|(x, step)| *x -= step);
    }
    let at = residuals.at(&x).expect("it can be simulated");
    let own = cost(&at[..at.len() - fitted.parameters.len()]);
    assert!((own - fitted.cost_after).abs() < 1e-6 * own, "{own} {}", fitted.cost_after);
}
