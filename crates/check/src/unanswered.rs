//! What these logs cannot answer.

use serde::Serialize;

use dynid_logs::motion::MotionError;

/// Something that these logs cannot answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Unanswered {
    /// No free joint moves in any run: nothing can be answered.
    NothingMoves {
        /// The joints that are free.
        joints: Vec<usize>,
        /// Motion that is told from noise spans so many times the noise.
        range_in_noises: f64,
    },
    /// Every run is too short: nothing can be answered.
    AllTooShort {
        /// Samples of the longest run.
        samples: usize,
        /// Samples that are needed.
        needed: usize,
    },
    /// A run is too short.
    TooShort {
        /// The run.
        run: String,
        /// Its samples.
        samples: usize,
        /// Samples that are needed.
        needed: usize,
    },
    /// A run has no torque balance.
    NoTorqueBalance {
        /// Why.
        reason: MotionError,
    },
    /// A joint is free in some run, and moves in none.
    NeverMoves {
        /// The joint.
        joint: usize,
        /// Motion that is told from noise spans so many times the noise.
        range_in_noises: f64,
        /// Unknowns of the effects at that joint.
        parameters: Vec<String>,
    },
    /// A joint moves in some runs, and stands still in this one although it is free.
    StandsStill {
        /// The run.
        run: String,
        /// The joint.
        joint: usize,
        /// Motion that is told from noise spans so many times the noise.
        range_in_noises: f64,
    },
    /// Joints that are locked in every run.
    NeverFree {
        /// The joints.
        joints: Vec<usize>,
    },
    /// A joint moves at too few frequencies for the unknowns of its torque.
    FewFrequencies {
        /// The joint.
        joint: usize,
        /// The frequencies, over all runs (Hz).
        frequencies_hz: Vec<f64>,
        /// Combinations of unknowns that its torque depends on.
        unknowns: usize,
        /// How many of them so many frequencies determine: amplitude and phase each, and one constant.
        determined: usize,
    },
    /// Parameters that this motion leaves open, although another motion of the same joints would not.
    LeftOpen {
        /// The parameters, each with what is known of it.
        parameters: Vec<OpenParameter>,
        /// Combinations of unknowns that the free joints can reveal.
        of: usize,
    },
    /// A direction in which no motion of these joints tells anything.
    NoMotionReveals {
        /// Whether everything in it grows in one proportion.
        is_scale: bool,
        /// Parameters of which any one, once fixed, removes the direction.
        fix_one_of: Vec<String>,
    },
}

/// A parameter that is left open.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OpenParameter {
    /// Its name; ` + ..` follows the leading parameter of a combination.
    pub name: String,
    /// Its value in the model.
    pub value: f64,
    /// Standard error that these runs promise; `None` where they say nothing at all.
    pub std_error: Option<f64>,
    /// The joint whose torque shows it most.
    pub joint: usize,
}

impl Unanswered {
    /// Whether it means that nothing at all can be answered.
    pub fn is_everything(&self) -> bool {
        matches!(self, Self::NothingMoves { .. } | Self::AllTooShort { .. })
    }

    /// Whether the logs are to blame: joints that are locked on purpose and directions of the model itself are only notes.
    pub fn is_warning(&self) -> bool {
        !matches!(self, Self::NeverFree { .. } | Self::NoMotionReveals { .. })
    }
}
