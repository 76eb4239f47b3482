//! Why nothing can be said of what is missing.

use std::fmt;

use dynid_dynamics::system::SystemError;
use dynid_format::{UnknownName, listed, number};
use dynid_identify::FitError;
use dynid_judge::CompareError;
use dynid_logs::motion::MotionError;
use dynid_model::ModelError;
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
        "{run}: {samples} samples ({} s) are too few to tell what is missing: it takes {needed} ({} s at its \
         rate){because}; log for longer, or leave the run out",
        number(*span_s), number(*needed_s)
    )]
    TooShortToTell {
        /// The run.
        run: String,
        /// How many it has.
        samples: usize,
        /// How long it is (s).
        span_s: f64,
        /// How many it takes.
        needed: usize,
        /// How long that is (s).
        needed_s: f64,
        /// Why so many.
        because: WhySoMany,
    },
    /// Runs in which no joint moves.
    #[error(
        "{}: no free joint moves by more than 10 times its noise, so nothing can be said of what is missing{}; command \
         more torque, or a motion from `dynid excite`",
        listed(runs),
        nor_of(open)
    )]
    NothingMoves {
        /// The runs.
        runs: Vec<String>,
        /// Parameters that they say nothing of either.
        open: Vec<String>,
    },
}

/// Why it takes so many samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WhySoMany {
    /// There is no more to it.
    Plain,
    /// No run is held out, so that the last of so many parts of each is.
    Parts {
        /// How many.
        parts: usize,
    },
    /// The beginning of the run is cut.
    Cut {
        /// How many samples are.
        samples: usize,
    },
}

impl fmt::Display for WhySoMany {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Plain => Ok(()),
            Self::Parts { parts } => {
                write!(formatter, ", since no run is held out and the last of {parts} parts of each is instead")
            }
            Self::Cut { samples } => write!(formatter, ", since from_s cuts {samples} of its samples"),
        }
    }
}

fn nor_of(parameters: &[String]) -> String {
    if parameters.is_empty() { String::new() } else { format!(", nor of {}", listed(parameters)) }
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

#[cfg(test)]
mod tests {
    use dynid_identify::position::PositionFitError;

    use super::*;

    #[test]
    fn a_diagnosis_was_interrupted_where_one_of_its_fits_was() {
        let of = |error: PositionFitError| DiagnoseError::from(FitError::from(error)).interrupted_after();
        assert_eq!(of(PositionFitError::Interrupted { iterations: 7 }), Some(7));
        assert_eq!(of(PositionFitError::NoRun), None);
        let still = DiagnoseError::NothingMoves { runs: Vec::new(), open: Vec::new() };
        assert_eq!(still.interrupted_after(), None);
    }

    #[test]
    fn what_was_not_moved_names_the_parameters_that_stay_open() {
        let open = |names: &[&str]| nor_of(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        assert_eq!(open(&[]), "");
        assert_eq!(open(&["link.1.m"]), ", nor of link.1.m");
    }
}
