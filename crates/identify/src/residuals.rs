//! What fits make small as a vector of residuals with its Jacobian, for optimisers outside of this crate.
//!
//! Half the sum of their squares is the fit's cost, its weak prior included. Bounds are stated; that links have to be bodies and that
//! some effects keep an order among their parameters is for the optimiser to know.

use dynid_dynamics::simulate::Steps;
use dynid_logs::experiment::{Role, Run};
use dynid_user_model::Model;

use crate::FitError;
use crate::position::{PositionProblem, PositionResiduals};
use crate::torque::TorqueResiduals;

/// Least and largest values.
pub type Bounds = (Vec<f64>, Vec<f64>);

/// Residuals with their derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluated {
    /// The residuals.
    pub residuals: Vec<f64>,
    /// Their derivatives, one row a residual.
    pub jacobian: Vec<f64>,
}

/// Residuals of the position or of the torque error.
pub enum Residuals {
    /// Measured minus simulated positions over the noise of their log.
    Position(Box<PositionResiduals>),
    /// Torque errors over their standard deviations.
    Torque(Box<TorqueResiduals>),
}

impl Residuals {
    /// Of the position error of those of `runs` that are to be fitted to, with so many integration steps per sample; without, as finely as a
    /// fit that starts from the model's values integrates.
    ///
    /// # Errors
    /// As the fit of the position error.
    pub fn of_position(model: &Model, runs: &[&Run], substeps: Option<usize>) -> Result<Self, FitError> {
        let fitted = runs.iter().copied().filter(|run| run.role == Role::Fit);
        let problem = PositionProblem::of_model(model, fitted)?;
        let steps = substeps.map(|steps| Steps::PerSample(steps.max(1)));
        Ok(Self::Position(Box::new(PositionResiduals::new(problem, steps)?)))
    }

    /// Of the torque error of those of `runs` that are to be fitted to.
    ///
    /// # Errors
    /// As the fit of the torque error.
    pub fn of_torque(model: &Model, runs: &[&Run]) -> Result<Self, FitError> {
        Ok(Self::Torque(Box::new(TorqueResiduals::new(model, runs)?)))
    }

    /// Names of the unknowns: parameters, and for the position error where each run starts.
    pub fn names(&self) -> Vec<String> {
        match self {
            Self::Position(own) => own.names(),
            Self::Torque(own) => own.names(),
        }
    }

    /// The model's values, and where the logs begin.
    pub fn start(&self) -> &[f64] {
        match self {
            Self::Position(own) => own.start(),
            Self::Torque(own) => own.start(),
        }
    }

    /// Between which values each unknown may lie.
    pub fn bounds(&self) -> Bounds {
        match self {
            Self::Position(own) => own.bounds(),
            Self::Torque(own) => own.bounds(),
        }
    }

    /// The residuals at `x`, in the order of [`Residuals::names`]; `None` where the runs cannot be simulated there.
    ///
    /// # Panics
    /// Where `x` has another length than `names`.
    pub fn at(&self, x: &[f64]) -> Option<Vec<f64>> {
        self.check(x);
        match self {
            Self::Position(own) => own.at(x),
            Self::Torque(own) => Some(own.at(x)),
        }
    }

    /// As [`Residuals::at`], with derivatives.
    ///
    /// # Panics
    /// As [`Residuals::at`].
    pub fn with_jacobian(&self, x: &[f64]) -> Option<Evaluated> {
        self.check(x);
        match self {
            Self::Position(own) => own.with_jacobian(x),
            Self::Torque(own) => Some(own.with_jacobian(x)),
        }
    }

    fn check(&self, x: &[f64]) {
        assert_eq!(x.len(), self.start().len(), "one value for each unknown");
    }
}

#[cfg(test)]
mod tests {
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
        assert_eq!(
            here,
            residuals.at(&x).expect("it can be simulated"),
            "the same residuals with and without derivatives"
        );
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
        check_jacobian(&Residuals::of_position(&model, &runs, Some(2)).expect("a problem"), 1e-4);
        check_jacobian(&Residuals::of_torque(&model, &runs).expect("a problem"), 1e-5);
    }

    #[test]
    fn half_their_squares_is_the_cost_of_the_fit() {
        let (model, experiment) = tour();
        let runs: Vec<&Run> = experiment.runs.iter().collect();
        let steps = Some(Steps::PerSample(2));
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
        let residuals = Residuals::of_position(&fitted.model, &runs, Some(2)).expect("a problem");
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
}
