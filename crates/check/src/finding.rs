//! What looks wrong in a log, each with its numbers.

use serde::Serialize;

use dynid_dynamics::simulate::Intersample;

/// Something that looks wrong.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The run's log, as the experiment names it.
    pub run: String,
    /// The device's joint index; `None` where it concerns the whole log.
    pub joint: Option<usize>,
    /// What.
    #[serde(rename = "finding")]
    pub kind: FindingKind,
}

/// What looks wrong.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum FindingKind {
    /// Rows are missing: steps of twice the typical one or more.
    Gaps {
        /// How many.
        count: usize,
        /// The longest step (s).
        longest_s: f64,
    },
    /// The sample time varies.
    UnevenSampling {
        /// Root mean square deviation from the typical step, as a share of it (%).
        percent: f64,
    },
    /// Rows that follow each other at once: time stamps of the reader, not of the sampling.
    BunchedSamples {
        /// How many.
        count: usize,
        /// The shortest step (s).
        shortest_s: f64,
        /// The typical step (s).
        typical_s: f64,
    },
    /// Position jumps by about a whole turn: the encoder wraps.
    EncoderWrap {
        /// How often.
        count: usize,
        /// Typical size of the jumps [rad, or degrees where the log is in degrees].
        jump: f64,
    },
    /// Positions repeat from row to row while the joint moves on: they are logged less often than the rows say.
    RepeatedPositions {
        /// Share of the rows in which the joint moves (%).
        percent: f64,
    },
    /// A moving position without any noise: a reference or a simulation, not a measurement.
    NoNoise {
        /// Standard deviation of the noise that is left [rad or m].
        noise: f64,
        /// Largest minus smallest position [rad or m].
        range: f64,
    },
    /// The last digit of the position is larger than its noise, and so coarse that accelerations suffer.
    CoarseQuantum {
        /// Smallest step of the position [rad or m].
        quantum: f64,
        /// Standard deviation of the noise beside it [rad or m].
        noise: f64,
        /// The filtered acceleration's error by the quantum, as a share of its root mean square (%).
        acceleration_percent: f64,
    },
    /// A free joint's torque is zero throughout, and yet it moves as if it were driven.
    ZeroTorque {
        /// Root mean square of the torque that the model needs for the motion [unit of the command].
        needed: f64,
    },
    /// The command stands at its largest size in stretches: it is cut off there.
    Saturated {
        /// Where: one end, or both [unit of the command].
        levels: Vec<f64>,
        /// Share of the samples (%).
        percent: f64,
    },
    /// Positions look like degrees.
    Degrees {
        /// Largest size in the log.
        largest: f64,
        /// Why.
        because: DegreesBecause,
    },
    /// Torque (or position) is off by a power of a thousand.
    Thousand {
        /// Logged torque over what the model needs for the logged motion.
        factor: f64,
    },
    /// The torque column has the wrong sign, or the position has.
    WrongSign {
        /// Correlation of the logged torque with what the model needs for the logged motion.
        correlation: f64,
        /// Mean of torque times speed [unit of the command times rad/s or m/s]: what drives a passive mechanism puts energy in.
        mean_power: f64,
    },
    /// Torque and position are shifted against each other.
    Delay {
        /// Positions answer so many samples later than the columns say; negative where they answer before the torque.
        samples: f64,
        /// s
        delay_s: f64,
        /// Share of the torque that stays unexplained as logged (%).
        left_percent: f64,
        /// The same with the shift (%).
        left_percent_shifted: f64,
    },
    /// The command runs between the samples otherwise than the experiment says.
    Hold {
        /// What the logs look like.
        #[serde(serialize_with = "hold")]
        looks: Intersample,
        /// Share of the torque that stays unexplained with what the experiment says (%).
        left_percent: f64,
        /// The same with the other (%).
        left_percent_other: f64,
    },
    /// What the other runs say of this motion's torque is another torque.
    Contradicts {
        /// This run's torque over what the other runs predict of it.
        factor: f64,
        /// Correlation of the two.
        correlation: f64,
    },
}

/// What speaks for degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DegreesBecause {
    /// The position leaves what the joint can reach, and stays within it when read as degrees.
    Limits {
        /// Least reachable position (rad).
        lower: f64,
        /// Largest reachable position (rad).
        upper: f64,
    },
    /// Read as degrees, the motion needs the logged torque; read as radians, another one.
    Torque {
        /// Logged torque over needed torque, read as radians.
        ratio: f64,
        /// The same, read as degrees.
        ratio_as_degrees: f64,
    },
}

/// As an experiment writes it.
fn hold<S: serde::Serializer>(hold: &Intersample, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(match hold {
        Intersample::ZeroOrder => "zero",
        Intersample::FirstOrder => "linear",
    })
}
