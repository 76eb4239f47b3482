//! What logs are worth before any fit: what they cannot answer ([`unanswered`]), how to excite what is missing
//! ([`suggestion`]), and what looks wrong in them ([`finding`]).
//!
//! - [`columns`]: what a log shows without a model: time stamps, encoder wraps, repeated rows, coarse digits, cut commands;
//! - [`balance`]: what the torque balance shows along the measured motion, a model's own parameters and common effects that it
//!   may lack being free: units, sign, delay, hold, runs that contradict each other;
//! - [`question`]: what is asked for that, and of how many runs;
//! - [`excitation`]: joints that stand still, runs that are too short, motions of too few frequencies;
//! - [`identifiability`]: parameters that the motion leaves open, and directions that no motion reveals.
//!
//! Nothing is fitted for good: every statement is a least-squares problem of one linearisation. [`check`] asks everything.

pub mod balance;
pub mod columns;
pub mod excitation;
pub mod finding;
pub mod identifiability;
mod least_squares;
pub mod question;
pub mod suggestion;
pub mod unanswered;

use dynid_dynamics::system::SystemError;
use dynid_logs::{experiment::Run, quality, quality::Quality};
use dynid_plan::PlanError;
use dynid_user_model::Model;
use rayon::prelude::*;
use serde::Serialize;

pub use finding::{Finding, FindingKind};
pub use identifiability::Identifiability;
pub use question::{Asked, Question};
pub use suggestion::Suggestion;
pub use unanswered::Unanswered;

use balance::Balance;

/// All that a check says.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Checked {
    /// The answer in one word.
    pub verdict: Verdict,
    /// What these logs cannot answer.
    #[serde(rename = "typed_unanswered")]
    pub unanswered: Vec<Unanswered>,
    /// What to play to change that.
    pub suggestions: Vec<Suggestion>,
    /// What looks wrong.
    pub findings: Vec<Finding>,
    /// What was asked to find it, and of how many runs.
    pub questions: Vec<Asked>,
    /// What the motion tells of the parameters; `None` where no run has a torque balance.
    pub identifiability: Option<Identifiability>,
    /// The logs, one by one.
    pub quality: Vec<Quality>,
}

/// The answer of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing looks wrong, and every parameter is excited.
    NothingWrong,
    /// Something looks wrong, or something stays open.
    Warnings,
    /// These logs answer nothing: no joint moves, or every run is too short.
    NothingToLearn,
}

/// Why nothing could be checked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckError {
    /// A model and a configuration that do not make equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// Equations whose directions cannot be analysed.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// Checks `runs` against `model`, whose values need only be of the right size.
///
/// # Errors
/// A model that makes no equations for a run.
pub fn check(model: &Model, runs: &[&Run]) -> Result<Checked, CheckError> {
    let quality: Vec<Quality> = runs.par_iter().map(|run| quality::of_run(run)).collect();
    let mut findings: Vec<Finding> = runs
        .par_iter()
        .zip(&quality)
        .map(|(run, quality)| columns::findings(model.device, run, quality))
        .collect::<Vec<_>>()
        .concat();
    let mut unanswered = excitation::unanswered(model, runs);
    let nothing = unanswered.iter().any(Unanswered::is_everything);
    let mut identifiability = None;
    let mut balances = Vec::new();
    if !nothing {
        let along = runs.par_iter().map(|run| Balance::of(model, run)).collect::<Result<Vec<_>, _>>()?;
        for (run, balance) in runs.iter().zip(along) {
            match balance {
                Ok(balance) => balances.push(balance),
                // What is too short altogether has been said.
                Err(_) if run.log.len() < dynid_logs::part::LEAST_SAMPLES => {}
                Err(reason) => unanswered.push(Unanswered::NoTorqueBalance { reason }),
            }
        }
        findings.extend(balance::findings(model, &balances));
        identifiability = identifiability::of(model, &balances)?;
        unanswered.extend(excitation::few_frequencies(model, &balances));
        unanswered.extend(identifiability.iter().flat_map(Identifiability::unanswered));
    }
    let suggestions = suggestion::suggestions(model, runs, &unanswered);
    let verdict = match (nothing, findings.is_empty(), unanswered.iter().all(|own| !own.is_warning())) {
        (true, ..) => Verdict::NothingToLearn,
        (false, true, true) => Verdict::NothingWrong,
        _ => Verdict::Warnings,
    };
    let questions = question::asked(runs.len(), &balances);
    Ok(Checked { verdict, unanswered, suggestions, findings, questions, identifiability, quality })
}
