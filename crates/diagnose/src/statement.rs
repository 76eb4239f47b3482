//! The answer of a diagnosis, statement by statement. Sentences of them are made elsewhere.

use serde::{Serialize, Serializer};

use super::{Candidate, Moved};
use dynid_identify::FitStatus;

/// One thing that a diagnosis says; in their order they are the answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Statement {
    /// What the model leaves of the held-out runs, which the others are about.
    ModelLeaves {
        /// How much.
        left: ErrorLeft,
    },
    /// Nothing is missing: what is left is noise.
    OnlyNoise,
    /// Nothing is named: what is left is near the noise and has a pattern, but no effect explains it.
    NearNoise,
    /// An effect is missing.
    Missing {
        /// Which, and where.
        candidate: Candidate,
        /// What is left with it.
        left: ErrorLeft,
    },
    /// What was named could as well be something else.
    CouldAsWellBe {
        /// What.
        candidates: Vec<Candidate>,
    },
    /// Beside what was named, something is left that no effect of the library explains.
    MoreIsUnexplained,
    /// No effect of the library explains what is left.
    NoEffectExplains,
    /// The effect that is nearest to what is left explains only part of it.
    Nearest {
        /// Which, and where.
        candidate: Candidate,
    },
    /// The runs fitted to are explained to their noise, those held out are not, and it was not found why.
    HeldOutRunsDiffer,
    /// Every run by itself is explained to its noise, but by other values.
    ValuesMoved {
        /// The parameter that moved most.
        most: Moved,
    },
    /// One run is explained only with a body that the others do not carry.
    BodyCarried {
        /// Its parameter that is surest, and the run.
        most: Moved,
    },
    /// A formula explains what no effect of the library does.
    FormulaExplains {
        /// The device's joint index.
        joint: usize,
        /// What it adds to.
        acts_on: ActsOn,
        /// In signs.
        formula: String,
        /// Share of the squared torque error of the held-out runs that it takes away (%).
        percent: f64,
    },
    /// No product of the measured signals explains what is left either.
    NoFormulaExplains,
}

/// What a formula adds to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ActsOn {
    /// The command, before the drive path.
    Command,
    /// The torque that resists the motion.
    Motion,
}

/// What is left of the held-out runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ErrorLeft {
    /// So little that it explains the logs.
    NearNoise {
        /// Error over noise at the worst joint.
        times_noise: f64,
    },
    /// More than that.
    AboveNoise {
        /// Error over noise at the worst joint.
        times_noise: f64,
    },
    /// A part of the torque; its noise is not known.
    OfTorque {
        /// That part (%).
        percent: f64,
    },
    /// An error that is not known.
    Unknown,
}

/// As it stands in files and reports.
pub(super) fn as_stated<S: Serializer>(status: &FitStatus, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(status.as_str())
}
