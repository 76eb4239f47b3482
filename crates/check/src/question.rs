//! What is asked of logs, and how many of their runs could be asked.

use serde::Serialize;

use crate::{FindingKind, balance::Balance};

/// What is asked of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// Are time stamps even and complete?
    TimeStamps,
    /// Are positions measured, finely and without jumps?
    Positions,
    /// Are commands there, and not cut off?
    Commands,
    /// Are the units right?
    Units,
    /// Are the signs right?
    Signs,
    /// Do command and position belong to the same time?
    Timing,
    /// Do runs agree with each other?
    Agreement,
}

impl Question {
    /// All, in the order in which they are told.
    pub const ALL: [Self; 7] =
        [Self::TimeStamps, Self::Positions, Self::Commands, Self::Units, Self::Signs, Self::Timing, Self::Agreement];

    /// Whether the torque that the motion needs is what answers it.
    fn needs_balance(self) -> bool {
        matches!(self, Self::Commands | Self::Units | Self::Signs | Self::Timing | Self::Agreement)
    }
}

impl FindingKind {
    /// The question that this answers with no.
    pub fn question(&self) -> Question {
        match self {
            Self::Gaps { .. } | Self::UnevenSampling { .. } | Self::BunchedSamples { .. } => Question::TimeStamps,
            Self::EncoderWrap { .. }
            | Self::RepeatedPositions { .. }
            | Self::NoNoise { .. }
            | Self::CoarseQuantum { .. } => Question::Positions,
            Self::ZeroTorque { .. } | Self::Saturated { .. } => Question::Commands,
            Self::Degrees { .. } | Self::Thousand { .. } => Question::Units,
            Self::WrongSign { .. } => Question::Signs,
            Self::Delay { .. } | Self::Hold { .. } => Question::Timing,
            Self::Contradicts { .. } => Question::Agreement,
        }
    }
}

/// A question, and where it could be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Asked {
    /// Which.
    pub question: Question,
    /// Of so many runs: one whose motion has no torque balance says nothing of commands, units, signs and times.
    pub runs: usize,
}

/// All questions to `n_runs` runs, of which some have a torque balance.
pub(crate) fn asked(n_runs: usize, balances: &[Balance<'_>]) -> Vec<Asked> {
    let judged = |own: &&Balance<'_>| (0..own.run.free.len()).any(|slot| own.is_judged(slot));
    let balanced = balances.iter().filter(judged).count();
    let runs = |question: Question| match question {
        // One alone cannot contradict.
        Question::Agreement if balanced < 2 => 0,
        question if question.needs_balance() => balanced,
        _ => n_runs,
    };
    Question::ALL.map(|question| Asked { question, runs: runs(question) }).to_vec()
}
