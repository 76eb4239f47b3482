//! What a user can cause, as one type: every error says what was expected, what was found and what to do.

use std::{io, path::PathBuf};

use dynid_model::ModelError;

/// An error of the runtime. The binary prints it and ends with status 2.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A device, effect or model file, with the place.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// An experiment or one of its logs.
    #[error(transparent)]
    Experiment(Box<crate::experiment::ExperimentError>),
    /// A model and a configuration that do not make equations.
    #[error(transparent)]
    System(#[from] crate::system::SystemError),
    /// A position fit that cannot be made.
    #[error(transparent)]
    PositionFit(#[from] crate::fit::position::PositionFitError),
    /// A torque fit that cannot be made.
    #[error(transparent)]
    TorqueFit(#[from] crate::fit::torque::TorqueFitError),
    /// A log without a torque error.
    #[error(transparent)]
    Motion(#[from] crate::torque::MotionError),
    /// A file that cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file that cannot be written.
    #[error("cannot write {}: {source}; nothing was written", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// An output that is there already.
    #[error("{} exists already and is kept; choose another name, or overwrite it with `--force`", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// A name that nothing has: a device, an effect, a parameter.
    #[error("unknown {kind} `{name}`; {help}")]
    UnknownName {
        /// What was looked for.
        kind: &'static str,
        /// As the user wrote it.
        name: String,
        /// The nearest known name.
        help: String,
    },
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
    /// A checkpoint that cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] crate::checkpoint::CheckpointError),
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
        "{runs}: no free joint moves by more than 10 times its noise, so nothing can be told of what is missing{open}; command \
         more torque, or a motion from `dynid excite`"
    )]
    NothingMoves {
        /// The runs.
        runs: String,
        /// What else they say nothing of.
        open: String,
    },
    /// An effect that cannot stand where it was put.
    #[error("{message}; {help}")]
    Effect {
        /// What is wrong.
        message: String,
        /// What to do.
        help: String,
    },
}

impl Error {
    /// The text of a file, or [`Error::Unreadable`].
    pub(crate) fn read(path: &std::path::Path) -> Result<String, Self> {
        std::fs::read_to_string(path).map_err(|source| Self::Unreadable { path: path.to_owned(), source })
    }
}

impl From<crate::experiment::ExperimentError> for Error {
    fn from(error: crate::experiment::ExperimentError) -> Self {
        Self::Experiment(Box::new(error))
    }
}
