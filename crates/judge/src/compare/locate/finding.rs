//! What is found of where an error lies: enums with numbers. Sentences of them are made elsewhere.

use std::mem::discriminant;

use serde::Serialize;

/// One thing that is known of where an error lies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The run, as the experiment names it.
    pub run: String,
    /// The device's joint index.
    pub joint: usize,
    /// Which error it is about.
    pub error: Signal,
    /// Unit of that error, and of the numbers of `kind` that have its size.
    pub unit: String,
    /// Unit of the joint's position.
    pub position_unit: String,
    /// What it is.
    #[serde(rename = "finding")]
    pub kind: FindingKind,
    /// Share of the squared error, 0 to 1: what lies there, or what a regression on it explains.
    pub share: f64,
    /// What that share would be by chance.
    pub expected: f64,
    /// Where it stands in the regression, if it is from there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub regression: Option<RegressionStep>,
    /// The joint's other error, where that says the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub twin: Option<Twin>,
    /// Index of the run, for two may have one log.
    #[serde(skip)]
    pub run_index: usize,
    /// By which findings are ordered: larger ones first.
    #[serde(skip)]
    pub rank: f64,
}

/// Which error is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Commanded torque minus what the measured motion needs.
    Torque,
    /// Measured minus simulated position.
    Position,
}

/// A step of a regression that takes in one regressor after another.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RegressionStep {
    /// Its place among those that are reported, from 1: what comes later explains what the earlier ones leave.
    pub order: usize,
    /// Others that would have explained nearly as much, a few of them.
    pub nearly: Vec<Regressor>,
}

/// What the other error says of the same.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Twin {
    /// Which error that is.
    pub error: Signal,
    /// Its share of that error's square, 0 to 1.
    pub share: f64,
}

/// What an error does. Numbers are in the finding's `unit` and the joint's own units.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum FindingKind {
    /// It is proportional to a signal of its own joint.
    Follows {
        /// Which.
        signal: OwnSignal,
        /// Error per unit of the signal.
        per_unit: f64,
    },
    /// It is proportional to a signal of another joint.
    FollowsOther {
        /// That joint.
        joint: usize,
        /// Which.
        signal: OtherSignal,
        /// Error per unit of the signal.
        per_unit: f64,
    },
    /// It is a smooth function of the position: a polynomial in the distance from where the joint rests.
    FollowsSmoothly {
        /// Factors of the distance, its square and its cube.
        coefficients: [f64; 3],
        /// Where the joint rests [rad or m].
        rest: f64,
    },
    /// It has the sign of the speed on one side of the rest position only.
    HasSidedFriction {
        /// Error at positive speeds below the rest position.
        amplitude: f64,
        /// Where the joint rests [rad or m].
        rest: f64,
    },
    /// It repeats with the position.
    Repeats {
        /// [rad or m]
        period: f64,
        /// Of the error.
        amplitude: f64,
    },
    /// It drifts during the run.
    Drifts {
        /// By how much, from the beginning to the end.
        change: f64,
        /// How long that is (s).
        duration_s: f64,
    },
    /// It has a constant part.
    Offset {
        /// That part.
        constant: f64,
    },
    /// Its mean differs between runs.
    DiffersBetweenRuns {
        /// In this run, which is farthest off.
        here: f64,
        /// Over all runs.
        overall: f64,
    },
    /// It lies in some of the samples: the share of them is what chance gives.
    LiesIn {
        /// Which.
        region: Region,
        /// Other names of the same samples, as reversals are slow.
        also: Vec<AlsoIn>,
    },
    /// It lies in one band of frequencies.
    LiesInBand {
        /// From (Hz).
        low_hz: f64,
        /// To (Hz).
        high_hz: f64,
    },
    /// Two near frequencies hold it, and beat.
    Beats {
        /// The lower one (Hz).
        low_hz: f64,
        /// The higher one (Hz).
        high_hz: f64,
    },
}

/// A region that holds nothing beyond a stronger one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlsoIn {
    /// Which.
    pub region: Region,
    /// Share of the squared error in it, 0 to 1.
    pub share: f64,
}

/// A signal of an error's own joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OwnSignal {
    /// The position, from where the joint rests, as a spring follows it.
    Position,
    /// The speed.
    Speed,
    /// The speed squared, with its sign.
    SpeedSquared,
    /// The acceleration, as inertia follows it.
    Acceleration,
    /// The sign of the speed, as friction has it.
    SpeedSign,
    /// The sign of the speed times the size of the command: friction that grows with the load.
    LoadFriction,
    /// The commanded torque.
    Command,
    /// The sign of the commanded torque, as after a dead zone.
    CommandSign,
    /// The rate of the commanded torque, as a lag or delay follows it.
    CommandRate,
}

/// A signal of another joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OtherSignal {
    /// Its commanded torque.
    Command,
    /// Its position.
    Position,
    /// Its speed.
    Speed,
    /// Its acceleration.
    Acceleration,
    /// The sign of its speed.
    SpeedSign,
    /// The sign of the sum of its and the error's own joint's speed.
    SummedSpeedSign,
}

/// What an error may follow, named without numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Regressor {
    /// A signal of its own joint.
    Own {
        /// Which.
        signal: OwnSignal,
    },
    /// A signal of another joint.
    Other {
        /// That joint.
        joint: usize,
        /// Which.
        signal: OtherSignal,
    },
    /// A smooth function of the position.
    SmoothPosition,
    /// Friction on one side of the rest position.
    SidedFriction,
    /// A repetition in position.
    Repetition,
    /// The time.
    Time,
}

/// Some of the samples of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Region {
    /// Near reversals of the speed.
    Reversals {
        /// How near (s).
        within_s: f64,
        /// How many reversals there are.
        count: usize,
    },
    /// At low speed.
    LowSpeed {
        /// [rad/s or m/s]
        below: f64,
    },
    /// At high speed.
    HighSpeed {
        /// [rad/s or m/s]
        above: f64,
    },
    /// At the ends of the range of positions.
    EndOfRange {
        /// Positions below this [rad or m], ..
        below: f64,
        /// .. or above this [rad or m].
        above: f64,
    },
    /// On one side of the rest position.
    OneSide {
        /// Which.
        side: Side,
        /// Where the joint rests [rad or m].
        rest: f64,
    },
    /// At large commanded torque.
    HighCommand {
        /// [unit of the command]
        above: f64,
    },
    /// In a third of the run.
    PartOfRun {
        /// Which.
        third: Third,
    },
}

/// Of a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Smaller positions.
    Below,
    /// Larger positions.
    Above,
}

/// Of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Third {
    /// The beginning.
    First,
    /// The middle.
    Second,
    /// The end.
    Last,
}

impl Region {
    /// Whether it is of the same kind, on the same side, in the same part.
    pub fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::OneSide { side, .. }, Self::OneSide { side: other, .. }) => side == other,
            (Self::PartOfRun { third }, Self::PartOfRun { third: other }) => third == other,
            _ => discriminant(self) == discriminant(other),
        }
    }
}

impl FindingKind {
    /// Whether it says the same, whatever its numbers; bands of frequencies must overlap.
    pub fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Follows { signal, .. }, Self::Follows { signal: other, .. }) => signal == other,
            (
                Self::FollowsOther { joint, signal, .. },
                Self::FollowsOther { joint: other_joint, signal: other_signal, .. },
            ) => (joint, signal) == (other_joint, other_signal),
            (Self::LiesIn { region, .. }, Self::LiesIn { region: other, .. }) => region.is_like(other),
            (Self::LiesInBand { low_hz, high_hz }, Self::LiesInBand { low_hz: other_low, high_hz: other_high })
            | (Self::Beats { low_hz, high_hz }, Self::Beats { low_hz: other_low, high_hz: other_high }) => {
                low_hz <= other_high && other_low <= high_hz
            }
            _ => discriminant(self) == discriminant(other),
        }
    }

    /// How much it says beside its share: what an error follows says more than where it lies, and that more than its frequency.
    fn telling(&self) -> f64 {
        match self {
            Self::LiesInBand { .. } | Self::LiesIn { region: Region::PartOfRun { .. }, .. } => 0.25,
            Self::Beats { .. } | Self::LiesIn { .. } => 0.7,
            _ => 1.0,
        }
    }
}

impl Finding {
    /// Whether it says of its joint what `other` says, of whichever error and run.
    pub fn says_the_same(&self, other: &Self) -> bool {
        self.joint == other.joint && self.kind.is_like(&other.kind)
    }

    /// Share beyond chance, of what chance leaves.
    pub fn surplus(&self) -> f64 {
        (self.share - self.expected) / (1.0 - self.expected).max(1e-3)
    }

    pub(super) fn ranked(mut self) -> Self {
        self.rank = self.kind.telling() * self.surplus();
        self
    }
}
