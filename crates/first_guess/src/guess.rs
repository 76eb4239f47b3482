//! What was guessed, each with its reason.

use dynid_check::FindingKind;
use dynid_logs::experiment::Role;
use serde::{Serialize, Serializer};

use crate::Quantity;

/// A column of the logs and what it is taken for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ColumnGuess {
    /// The project's name: `t`, `q0`, `tau0`, `ref0`.
    pub logical: String,
    /// The log's own name.
    pub name: String,
    /// Why it was taken.
    pub why: WhyColumn,
    /// Other columns that might have been.
    pub others: Vec<String>,
    /// What brings it to SI, one after another; none where it is in SI.
    pub factors: Vec<Factor>,
    /// How much a turn is in the log's own unit, where its encoder begins anew after each.
    pub turn: Option<f64>,
}

impl ColumnGuess {
    /// The factor to SI.
    pub fn scale(&self) -> f64 {
        self.factors.iter().map(|factor| factor.factor).product()
    }

    /// The joint, of all columns but the time.
    pub fn joint(&self) -> Option<usize> {
        self.logical.trim_start_matches(char::is_alphabetic).parse().ok()
    }

    /// The project's name without the joint: `t`, `q`, `tau`, `ref`.
    pub fn kind(&self) -> &str {
        self.logical.trim_end_matches(|letter: char| letter.is_ascii_digit())
    }
}

/// Why a column was taken.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum WhyColumn {
    /// A person said so.
    Said,
    /// It has the project's own name.
    OwnName,
    /// Its name says the quantity, and the joint by a number.
    Number {
        /// As in the name.
        number: usize,
        /// The number of joint 0 in such names.
        first: usize,
    },
    /// Its name says the quantity, and the joint by the device's title of it.
    Title {
        /// The title.
        title: String,
    },
    /// Its name says the quantity, which no other's does.
    OnlyOne,
    /// Its name says the quantity but no joint of the device: the joints are taken in the order of the columns.
    Order,
    /// Its name says nothing, but it rises evenly from row to row: a time.
    RisesEvenly,
    /// Its name says that something was asked for, and the position follows it.
    IsFollowed,
    /// Its name says that something was asked for, and the position does not follow it: a torque.
    IsNotFollowed,
}

/// A factor on a column, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Factor {
    /// To SI.
    pub factor: f64,
    /// Why.
    pub reason: FactorReason,
}

/// Why a column has a factor.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum FactorReason {
    /// Its name says the unit.
    UnitInName {
        /// The unit.
        unit: &'static str,
    },
    /// In this unit of time the sample rate is that of a robot.
    SampleRate {
        /// The unit.
        unit: &'static str,
        /// Typical step in the log's own unit.
        step: f64,
        /// In that unit (Hz).
        rate_hz: f64,
    },
    /// Only so the positions change as the speeds beside them say.
    Speed {
        /// The speed column.
        column: String,
        /// Speed over change of position as logged, in the log's own units.
        ratio: f64,
    },
    /// The position begins anew after that much: it is a turn.
    Turn {
        /// In the log's own unit.
        turn: f64,
    },
    /// What a check found of the column as logged.
    Finding {
        /// The finding.
        finding: FindingKind,
    },
    /// The column is no torque; what the device's values need for the motion says how much torque its unit is.
    Needed {
        /// What the column is.
        quantity: Quantity,
        /// Correlation of the column with the torque that the device's values need.
        correlation: f64,
    },
}

/// A log, or a part of one, and what it is for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunGuess {
    /// Which of the logs, from 0.
    pub log: usize,
    /// Its rows, to excluded; `None` for all.
    pub rows: Option<[usize; 2]>,
    /// The free joints, ascending.
    pub free: Vec<usize>,
    /// Why they are.
    pub why_free: WhyFree,
    /// What it is for.
    #[serde(serialize_with = "as_text")]
    pub role: Role,
    /// Why.
    pub why: RoleReason,
    /// Whether it begins in motion.
    pub moving: bool,
    /// Samples in the log.
    pub n_samples: usize,
    /// s
    pub duration_s: f64,
    /// Hz
    pub rate_hz: f64,
}

/// Why joints are taken for free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WhyFree {
    /// A person said so.
    Said,
    /// They move by more than their noise.
    Moves,
}

/// Why a run is for fitting or held out.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum RoleReason {
    /// Its name says so.
    Name {
        /// The word that does.
        word: String,
    },
    /// Of several logs in which the same joints are free the last ones, about a fifth, are held out.
    Last,
    /// Of a single log the last quarter is held out.
    LastQuarter,
    /// Nothing speaks for holding it out.
    Rest,
    /// Nothing can be held out: the only log is too short, or the others lack a joint that moves here.
    NothingToHoldOut,
}

/// What was seen beside the guesses.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Remark {
    /// The log has references, and the positions follow them.
    ClosedLoop {
        /// Of position and reference, the least of all joints that move.
        correlation: f64,
    },
    /// No column is a reference that the positions follow.
    OpenLoop,
    /// Topics of a log were joined on the times of one.
    JoinedTopics {
        /// The log.
        log: String,
        /// The topic whose messages are the rows.
        clock: String,
        /// The others.
        others: Vec<String>,
        /// Messages of the clock at which another topic says nothing.
        left_out: usize,
    },
    /// Times are those at which messages were logged: some have no stamp of their own.
    TimeOfLogging {
        /// The log.
        log: String,
    },
    /// Variables of a log that have another number of values than the others.
    OtherLengths {
        /// The log.
        log: String,
        /// What the others have.
        n_rows: usize,
        /// Their names.
        names: Vec<String>,
    },
    /// Rows whose time is that of the row before.
    RepeatedTimes {
        /// The log.
        log: String,
        /// How many.
        count: usize,
        /// Of all rows (%).
        percent: f64,
    },
    /// A speed column fits the position of another joint better.
    SpeedOfOtherJoint {
        /// The speed column.
        column: String,
        /// The joint that its name says.
        joint: usize,
        /// The joint whose position it fits.
        fits: usize,
    },
    /// A speed column goes against the position of its joint.
    SpeedAgainstPosition {
        /// The speed column.
        column: String,
        /// The joint.
        joint: usize,
    },
    /// What drives a joint is logged in a unit that the device does not state, and the motion does not tell the factor.
    UnknownFactor {
        /// The column.
        column: String,
        /// What it is.
        quantity: Quantity,
        /// The joint.
        joint: usize,
    },
    /// A name says a unit that what the column is taken for does not have; it is taken to be in SI.
    UnitOfOther {
        /// The column.
        column: String,
        /// The unit.
        unit: &'static str,
        /// The project's name of what it is taken for.
        logical: String,
    },
    /// The time has the project's own name, so it is in seconds; but then rows are far apart.
    RowsFarApart {
        /// The column.
        column: String,
        /// Typical step (s).
        step_s: f64,
    },
    /// Joints that move in no log: what only they would tell stays open.
    NeverMoves {
        /// Ascending.
        joints: Vec<usize>,
    },
}

fn as_text<S: Serializer>(role: &Role, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(role)
}
