//! Identify the dynamics of a robot from logged torques and positions, see where the model fails, learn which physical
//! effect it lacks, add it, and watch the error fall.
//!
//! | call | what it does |
//! | --- | --- |
//! | [`first_guess()`] | what logs hold, from their header and numbers: an experiment and a model to begin with |
//! | [`check()`] | what logs cannot answer, how to excite what is missing, and what looks wrong in them |
//! | [`fit()`] | a model's parameters from logs |
//! | [`compare()`] | how far a model is from its logs, and where |
//! | [`diagnose()`] | which physical effect is missing, at which joint, and what else it could be |
//! | [`add()`], [`with_effects()`] | the model with one effect more, where it does nothing yet; a model of chosen effects |
//! | [`ladder()`] | the models of a lineage on the same runs |
//! | [`simulate()`] | the positions that a model shows under the logged torques |
//! | [`report()`] | one page with all that is known |
//! | [`as_description()`], [`as_c99()`], [`as_json()`] | the model for other programs |
//!
//! Each but the first takes a [`Model`], an [`Experiment`] (logs and what was free in each) and one struct of settings, whose default is what
//! `dynid` on the command line does. Each reports its progress to a function of yours, which may stop it. A real-time control loop
//! needs none of this: it links the crate `dynid-control`.
//!
//! ```
//! use std::ops::ControlFlow;
//! # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
//! let experiment = dynid::Experiment::load(format!("{folder}/experiment.toml"))?;
//! let model = dynid::Model::of_device(experiment.device);
//! let compared = dynid::compare(&model, &experiment, &Default::default(), &|_| ControlFlow::Continue(()))?;
//! println!("RMS error of the held-out runs: {:?} rad", compared.errors.rmse_validate);
//! # Ok::<(), dynid::Error>(())
//! ```

#![deny(missing_docs)]

// The program names what it uses as other programs do.
#[cfg(feature = "cli")]
extern crate self as dynid;

mod add;
mod check;
// The program, for those who start it: itself, and Python. No part of the library's promises; what stands above its arguments is
// their help on a terminal, where [s] is a unit and no link.
#[cfg(feature = "cli")]
#[doc(hidden)]
#[allow(missing_docs, rustdoc::broken_intra_doc_links, rustdoc::private_intra_doc_links)]
pub mod cli;
mod compare;
mod diagnose;
mod error;
mod first_guess;
mod fit;
mod ladder;
mod progress;
mod report;
mod simulate;
pub mod tour;

pub use add::{Addition, add, set_value, with_effects};
pub use check::{CheckSettings, check};
pub use compare::{CompareSettings, Compared, compare};
pub use diagnose::{DiagnoseProgress, DiagnoseSettings, diagnose};
pub use error::Error;
pub use first_guess::{experiment_file, first_guess, model_file};
pub use fit::{Begin, Checkpoint, FitProgress, FitSettings, FitSettingsError, fit};
pub use ladder::{LadderSettings, ladder};
pub use progress::Done;
pub use report::{Report, ReportSettings, report};
pub use simulate::{SimulateSettings, Simulated, simulate};

pub use dynid_check::{
    Asked as AskedOfLogs, Checked, Finding as LogFinding, FindingKind as LogFindingKind, Identifiability,
    Question as QuestionOfLogs, Suggestion, Unanswered, Verdict as CheckVerdict,
};
pub use dynid_diagnose::{
    Candidate, Diagnosis, Event, Evidence, Finished, Note, Ranked, RejectedCandidate, Rejection, Statement, Verdict,
};
pub use dynid_first_guess::{
    ColumnGuess, FirstGuess, FirstGuessError, Known as KnownOfLogs, Lacking as LackingColumn, RunGuess,
};
/// What has changed on which of many robots, and since when.
pub use dynid_fleet as fleet;
pub use dynid_identify::FitStatus;
pub use dynid_identify::identify::{ErrorSignal, FitResult, FittedParameter, Progress};
pub use dynid_identify::sequence::Weighting;
pub use dynid_judge::compare::{Comparison, Finding, FindingKind};
pub use dynid_judge::ladder::{Ladder, Rung};
pub use dynid_logs::experiment::{Experiment, Role, Run};
/// Findings as sentences for people, and as JSON for programs.
pub use dynid_sentences as sentences;

/// Device files from other descriptions of robots.
pub use dynid_export::{ExportError, Exported, Format as DescriptionFormat, as_c99, as_description, as_json};
pub use dynid_import::{Imported, device_from_description};
pub use dynid_model::{Device, add_effects, device, device_named, devices};
pub use dynid_user_model::{Added, Model};

/// That a model and an experiment are of one device.
fn check_device(model: &Model, experiment: &Experiment) -> Result<(), Error> {
    if !model.device.is_same_as(experiment.device) {
        return Err(Error::OtherDevice {
            model: model.device.id.clone(),
            experiment: experiment.path.clone(),
            device: experiment.device.id.clone(),
        });
    }
    model.check_payloads(experiment)?;
    Ok(())
}
