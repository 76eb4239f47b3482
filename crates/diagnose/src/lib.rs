//! Diagnosis: which physical effect a model lacks, at which joint, and how sure that is ([`diagnose`]), in ten lines:
//!
//! 1. `excitation`: runs that are too short, or in which nothing moves, are errors; `runs`: what a mask takes out and more samples than
//!    tell anything are left out.
//! 2. The model is fitted by the prediction-error method: its values, one rate and one standard deviation per joint, and where each run
//!    starts; with a command that stands still between samples and, where something is left, with one that runs straight.
//! 3. Its innovations are white and its rates 0, on the runs held out too: nothing is missing.
//! 4. `score_test`: every effect at every place, along the model's own linearised predictions, at three rates; what holds the motion that
//!    moves it is simulated; from the fitted and from the believed values.
//! 5. `arms`: one queue of starts, halved again and again, the best so far among them; then starts from its values; as long as that
//!    changes the best. Where it leaves noise, only what has fewer unknowns is a rival.
//! 6. What is compared is the log likelihood of the fitted and the held-out runs, less the price of the unknowns.
//! 7. Effects that this does not tell apart, for how it differs along the logs or but for that price, are named together; the plainest
//!    comes first.
//! 8. The best is the missing effect if it leaves noise (white innovations, and no more acts on a joint whose model is not trusted than
//!    noise of the logged torque: `disturbance`), or if it makes up for nearly all of what the logs' own
//!    noise leaves to explain and of what a formula promises; else it is the nearest.
//! 9. Where it pays and is not all it is added, and all goes on from 3, to white errors only what promises more than chance in all runs; what
//!    is found so counts where it explains all in the end.
//! 10. Where no effect explains what is left: values that moved between runs, a body that is carried in one (`inconsistent_runs`), or a
//!     formula (`discover`).
//!
//! `finished` holds searches by key: an interrupted diagnosis goes on from them to the same answer. [`with_first_estimates`] uses the
//! score test to give an effect that vanishes a start for a fit.

mod arms;
mod candidate;
mod discover;
mod distinguishing_experiment;
mod disturbance;
mod error;
mod evidence;
mod excitation;
mod first_estimate;
#[cfg(test)]
mod fixtures;
mod inconsistent_runs;
mod missing;
mod note;
mod procedure;
mod refit;
mod runs;
mod score_test;
mod settings;
mod statement;
mod verdict;

use std::collections::BTreeMap;

use serde::Serialize;

pub use candidate::{Candidate, Probe, Sizes, candidates, probes};
pub use discover::{Discovered, DiscoveredTerm, discover};
pub use distinguishing_experiment::{DistinguishingExperiment, SinePhase};
pub use error::{DiagnoseError, WhySoMany};
pub use evidence::{Evidence, Rejection, Speaks};
pub use first_estimate::{FirstEstimates, with_first_estimates};
pub use note::Note;
pub use procedure::diagnose;
pub use refit::EffectParameter;
pub use statement::{ActsOn, ErrorLeft, Statement};

use dynid_identify::identify::ErrorSignal;
use dynid_identify::prediction::State;
use dynid_judge::compare::Finding;
use dynid_user_model::Model;

/// What a diagnosis says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// An effect of the library explains what is left.
    MissingEffect,
    /// Nothing but noise is left, or the parameters moved between runs.
    NothingMissing,
    /// Something is left that no effect of the library explains.
    Unexplained,
}

/// What a diagnosis found.
#[derive(Debug, Clone, Serialize)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// The answer, statement by statement.
    pub statements: Vec<Statement>,
    /// Which error it is about: `position` or `torque`.
    pub error: String,
    /// Effects that were fitted and may be given credit, best first; with several found one after the other, those first.
    pub ranking: Vec<Ranked>,
    /// Effects that were fitted and are given none.
    #[serde(rename = "refused")]
    pub rejected: Vec<RejectedCandidate>,
    /// What the score test said of every candidate, most promising first.
    pub screening: Vec<Screened>,
    /// Where the model fails.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// Parameters that differ between runs.
    pub moved: Vec<Moved>,
    /// What should be known besides.
    #[serde(rename = "typed_notes")]
    pub notes: Vec<Note>,
    /// How far the model is from its logs, refitted where that could be done: the largest error of a joint over its noise.
    pub worst_ratio: Option<f64>,
    /// Where no effect of the library explains what is left: a formula that does, if there is one.
    pub discovered: Option<Discovered>,
    /// The model that was diagnosed: refitted where that could be done.
    #[serde(skip)]
    pub base: Option<Model>,
    /// The fitted model with everything added that was found; `None` where nothing was.
    #[serde(skip)]
    pub better: Option<Model>,
}

/// An effect that explains something.
#[derive(Debug, Clone, Serialize)]
pub struct Ranked {
    /// Which, and where.
    #[serde(flatten)]
    pub candidate: Candidate,
    /// Position error of the held-out runs without it [rad or m].
    pub rmse_validate_before: Option<f64>,
    /// With it, after a fit.
    pub rmse_validate_after: Option<f64>,
    /// Torque error of the held-out runs without it (%).
    pub torque_percent_before: Option<f64>,
    /// With it, after a fit.
    pub torque_percent_after: Option<f64>,
    /// Change of the Bayesian information criterion on the runs fitted to: below 0 the effect is worth its parameters.
    pub delta_bic: f64,
    /// Effects that fit as well.
    pub confounded_with: Vec<Candidate>,
    /// Its parameters.
    pub parameters: Vec<EffectParameter>,
    /// What speaks for it and against it.
    pub evidence: Vec<Evidence>,
    /// What would tell it from the first of the effects that fit as well.
    #[serde(rename = "typed_experiment")]
    pub experiment: Option<DistinguishingExperiment>,
    /// Which step of a search for several it belongs to, from 1.
    pub depth: usize,
    /// The largest error of a joint over its noise, with it.
    pub worst_ratio_after: Option<f64>,
}

/// What the score test says of a candidate, before any fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Screened {
    /// Which, and where.
    #[serde(flatten)]
    pub candidate: Candidate,
    /// Change of minus twice the log likelihood that one step promises: below 0 it explains something.
    pub position: Option<f64>,
}

/// An effect that is given no credit.
#[derive(Debug, Clone, Serialize)]
pub struct RejectedCandidate {
    /// Which, and where.
    #[serde(flatten)]
    pub candidate: Candidate,
    /// Why.
    #[serde(rename = "rejection")]
    pub reason: Rejection,
}

/// Where the model fails.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Place {
    /// What is found, of the run that says it most.
    #[serde(flatten)]
    pub finding: Finding,
    /// Other runs that say the same.
    pub also_in: Vec<String>,
}

/// A parameter that differs between runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Moved {
    /// Its name.
    pub parameter: String,
    /// The run.
    pub run: String,
    /// By how much its value in this run differs from that in the other runs, in standard errors of the difference.
    pub change_in_std_errors: f64,
}

/// How to diagnose.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Options {
    /// Which error decides; without one, the likelihood of the logs, which estimates how far the model is to be trusted between samples:
    /// the position error is that of a model that is trusted altogether, the torque error that of one that is trusted only within the
    /// bandwidth of the torque error's filter.
    pub error: Option<ErrorSignal>,
    /// How many effects are looked for, one after the other; `None` for as many as it pays.
    pub depth: Option<usize>,
}

/// What a diagnosis tells while it works.
#[derive(Debug)]
pub enum Event<'a> {
    /// The model itself is being fitted.
    FittingModel,
    /// So many candidates are asked what they would add.
    Asking(usize),
    /// What each of them promises, those that promise most first.
    Screened(&'a [Screened]),
    /// Those that promise most, so many, are fitted.
    Comparing(usize),
    /// A search for the likeliest values has come farther; its key and where it is are worth keeping.
    Searched(&'a str, &'a State),
}

/// Where searches were, by their keys: a diagnosis that was stopped goes on from them.
pub type Finished = BTreeMap<String, State>;
