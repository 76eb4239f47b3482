//! What fits make small as a vector of residuals with its Jacobian, for optimisers outside of this crate.
//!
//! Half the sum of their squares is the fit's cost, its weak prior included. Bounds are stated; that links have to be bodies and that
//! some effects keep an order among their parameters is for the optimiser to know.

use dynid_dynamics::simulate::Steps;
use dynid_logs::experiment::{Role, Run};
use dynid_logs::motion::Motion;
use dynid_user_model::Model;

use crate::FitError;
pub use crate::evaluated::{Bounds, Evaluated};
use crate::position::{PositionProblem, PositionResiduals};
use crate::torque::{TorqueResiduals, TorqueRun};

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
        let of_run = |run: &&Run| -> Result<TorqueRun, FitError> {
            let (system, motion) = (model.system_of(run)?, Motion::of(run)?);
            Ok(TorqueRun { name: run.label(), role: run.role, system, motion })
        };
        let fitted = runs.iter().copied().filter(|run| run.role == Role::Fit);
        let runs = fitted.map(|run| of_run(&run)).collect::<Result<Vec<_>, _>>()?;
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
mod tests;
