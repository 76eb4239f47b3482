//! Why a fit is not made.

use dynid_dynamics::system::SystemError;
use dynid_format::UnknownName;
use dynid_logs::motion::MotionError;
use dynid_plan::PlanError;

use crate::{position::PositionFitError, torque::TorqueFitError};

/// A fit that cannot be made, or was stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// A model and a configuration that do not make equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A position fit that cannot be made.
    #[error(transparent)]
    Position(#[from] PositionFitError),
    /// A torque fit that cannot be made.
    #[error(transparent)]
    Torque(#[from] TorqueFitError),
    /// A log without a torque error.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// A method without a sequence.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A parameter that the model does not have.
    #[error(transparent)]
    UnknownParameter(#[from] UnknownName),
    /// A run to fit to of which the method has no step.
    #[error("{run}: {what}; {remedy}")]
    OtherConfiguration {
        /// The run.
        run: String,
        /// Its configuration, and those that the method has.
        what: String,
        /// What to do.
        remedy: String,
    },
    /// A fixed parameter among those that are to be fitted.
    #[error(
        "{name} is fixed in the model and cannot be fitted; take `fixed = true` off it (and give it bounds that differ), \
         or do not ask for it"
    )]
    FixedUnknown {
        /// As it was asked for.
        name: String,
    },
}

impl FitError {
    /// After how many iterations the fit was stopped on request, if that is what ended it.
    pub fn interrupted_after(&self) -> Option<usize> {
        match self {
            Self::Position(PositionFitError::Interrupted { iterations }) => Some(*iterations),
            _ => None,
        }
    }
}
