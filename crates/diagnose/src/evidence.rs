//! What speaks for and against an effect, and why one is given no credit. Sentences of them are made elsewhere.

use serde::Serialize;

use super::statement::as_stated;
use dynid_identify::FitStatus;

/// What speaks for or against an effect that explains something.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Evidence {
    /// For it: the squared error of the held-out runs falls.
    HeldOutFalls {
        /// At this joint, where it helps most.
        joint: usize,
        /// By this share (%).
        percent: f64,
    },
    /// For it: it is worth its parameters on the runs fitted to.
    BicChanges {
        /// By how much the Bayesian information criterion changes.
        delta_bic: f64,
        /// How many unknowns are counted in it.
        unknowns: f64,
    },
    /// For it: it explains the logs.
    LeavesNoise {
        /// Error over noise at the worst joint.
        times_noise: f64,
    },
    /// Against it: it does not explain all.
    LeavesMore {
        /// Error over noise at the worst joint.
        times_noise: f64,
    },
    /// Against it: the runs do not determine one of its parameters.
    NotDetermined {
        /// Which.
        parameter: String,
    },
    /// Against it: its fit came to no minimum.
    NotConverged {
        /// How it ended.
        #[serde(serialize_with = "as_stated")]
        status: FitStatus,
    },
}

/// Which way evidence speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speaks {
    /// For the effect.
    For,
    /// Against it.
    Against,
}

impl Evidence {
    /// Which way it speaks.
    pub fn speaks(&self) -> Speaks {
        match self {
            Self::HeldOutFalls { .. } | Self::BicChanges { .. } | Self::LeavesNoise { .. } => Speaks::For,
            Self::LeavesMore { .. } | Self::NotDetermined { .. } | Self::NotConverged { .. } => Speaks::Against,
        }
    }
}

/// Why an effect is given no credit.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Rejection {
    /// On the runs fitted to it is not worth its parameters.
    NotWorthItsParameters {
        /// By how much the Bayesian information criterion changes.
        delta_bic: f64,
    },
}
