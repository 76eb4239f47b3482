//! The errors of all parts, joined: every one says what was expected, what was found and what to do.

use dynid_check::CheckError;
use dynid_diagnose::DiagnoseError;
use std::path::PathBuf;

use dynid_dynamics::{kinematics::KinematicsError, simulate::SimulationError, system::SystemError};
use dynid_export::ExportError;
use dynid_files::{DocumentError, FileError};
use dynid_first_guess::FirstGuessError;
use dynid_format::{UnknownName, number};
use dynid_identify::{FitError, checkpoint::CheckpointError};
use dynid_judge::CompareError;
use dynid_logs::{experiment::ExperimentError, motion::MotionError};
use dynid_model::ModelError;
use dynid_plan::PlanError;
use dynid_torque::TermsError;
use dynid_user_model::{EffectError, UnknownPayload};

use crate::FitSettingsError;

/// What a user can cause.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A device, effect or model as text, with the place.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A document: its file, or what it says.
    #[error(transparent)]
    Document(#[from] DocumentError),
    /// A file that cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A name that nothing has: a device, an effect, a parameter.
    #[error(transparent)]
    UnknownName(#[from] UnknownName),
    /// An effect that cannot stand where it was put.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// An experiment or one of its logs.
    #[error(transparent)]
    Experiment(#[from] Box<ExperimentError>),
    /// A model and a configuration that do not make equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A device without an end point.
    #[error(transparent)]
    Kinematics(#[from] KinematicsError),
    /// A log without a torque error.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// A torque that cannot be taken apart.
    #[error(transparent)]
    Terms(#[from] TermsError),
    /// A plan that cannot be made.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A fit that cannot be made, or was stopped.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A checkpoint that cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Logs that say too little of themselves.
    #[error(transparent)]
    FirstGuess(#[from] FirstGuessError),
    /// A check that cannot be made.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// A comparison that cannot be made.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// A model that does not go into a description.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// A diagnosis that cannot be made, or was stopped.
    #[error(transparent)]
    Diagnose(#[from] DiagnoseError),
    /// Settings of a fit that do not go together.
    #[error(transparent)]
    FitSettings(#[from] FitSettingsError),
    /// A run that a model cannot be simulated along.
    #[error("{run}: {error}")]
    Simulation {
        /// The run.
        run: String,
        /// Why.
        error: SimulationError,
    },
    /// A model and an experiment of different devices.
    #[error(
        "the model is of device `{model}`, the experiment {} of `{device}`; use files of one device",
        experiment.display()
    )]
    OtherDevice {
        /// The model's device.
        model: String,
        /// The experiment's file.
        experiment: PathBuf,
        /// The experiment's device.
        device: String,
    },
    /// A payload that the model does not know.
    #[error(transparent)]
    Payload(#[from] UnknownPayload),
    /// A symbol that an effect does not have.
    #[error("{effect} has no `{symbol}`; it has {known}")]
    NoSuchSymbol {
        /// The effect at its place.
        effect: String,
        /// The symbol.
        symbol: String,
        /// Those that it has.
        known: String,
    },
    /// A value outside its bounds.
    #[error("{name} lies between {} and {}, not at {}", number(*lower), number(*upper), number(*value))]
    OutsideBounds {
        /// The parameter.
        name: String,
        /// The value.
        value: f64,
        /// Its least.
        lower: f64,
        /// Its largest.
        upper: f64,
    },
    /// A report about no model.
    #[error("a report is about a model; give at least one")]
    NoModel,
    /// Stopped by whoever listened to the progress.
    #[error("stopped on request")]
    Stopped,
}

impl Error {
    /// After how many iterations a fit was stopped on request, if that is what ended it.
    pub fn interrupted_after(&self) -> Option<usize> {
        match self {
            Self::Fit(error) => error.interrupted_after(),
            Self::Diagnose(error) => error.interrupted_after(),
            _ => None,
        }
    }
}

impl From<ExperimentError> for Error {
    fn from(error: ExperimentError) -> Self {
        Self::Experiment(Box::new(error))
    }
}
