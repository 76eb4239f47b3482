//! Why nothing can be said of what is missing.

use dynid_dynamics::system::SystemError;
use dynid_identify::FitError;
use dynid_judge::CompareError;
use dynid_logs::motion::MotionError;
use dynid_model::ModelError;
use dynid_text::UnknownName;
use dynid_user_model::EffectError;

/// A diagnosis that cannot be made, or was stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DiagnoseError {
    /// A fit that cannot be made.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A comparison that cannot be made.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// A model that makes no equations for a run.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A log without a torque error.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// A fitted model in a checkpoint that was tampered with.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// An effect that cannot stand where it was put.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A parameter that the model does not have.
    #[error(transparent)]
    UnknownParameter(#[from] UnknownName),
    /// A run in which nothing can be told from noise.
    #[error(
        "{run}: {samples} samples ({span_s} s) are too few to tell what is missing: it takes {needed} ({needed_s} s at its \
         rate){because}; log for longer, or leave the run out"
    )]
    TooShortToTell {
        /// The run.
        run: String,
        /// How many it has.
        samples: usize,
        /// How long it is (s).
        span_s: String,
        /// How many it takes.
        needed: usize,
        /// How long that is (s).
        needed_s: String,
        /// Why so many; nothing where there is no more to it.
        because: String,
    },
    /// Runs in which no joint moves.
    #[error(
        "{runs}: no free joint moves by more than 10 times its noise, so nothing can be said of what is missing{open}; command \
         more torque, or a motion from `dynid excite`"
    )]
    NothingMoves {
        /// The runs.
        runs: String,
        /// What else they say nothing of.
        open: String,
    },
}

impl DiagnoseError {
    /// After how many iterations a fit was stopped on request, if that is what ended the diagnosis.
    pub fn interrupted_after(&self) -> Option<usize> {
        match self {
            Self::Fit(error) => error.interrupted_after(),
            _ => None,
        }
    }
}
