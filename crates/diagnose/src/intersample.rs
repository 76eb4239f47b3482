//! How does the command run between samples? Where an experiment has it stand still from sample to sample and the logs say
//! that it does not, every effect of the drive path would be fitted to half a sample's delay.

use super::{
    Note, Refit, Screen, Work,
    first_estimate::{moving, observed},
};
use crate::DiagnoseError;
use dynid_dynamics::simulate::Intersample;
use dynid_identify::identify::ErrorSignal;
use dynid_logs::experiment::Run;
use dynid_user_model::Model;

/// The squared error of what is screened must fall by this share before a fit is tried, and that of the fit in the end.
const WORTH: f64 = 0.3;

/// Whether every command of `work` stands still between samples and something is left that this may explain.
pub(super) fn is_in_question(work: &Work<'_>, base: &Refit) -> bool {
    let stands = |run: &&Run| run.settings.intersample == Intersample::ZeroOrder && run.settings.controller.is_none();
    let is_near = base.worst_ratio().is_none_or(|ratio| ratio < super::verdict::NEAR_THE_FLOOR);
    work.judge.error == ErrorSignal::Position && !is_near && work.judge.runs.iter().all(stands)
}

/// Whether the runs of `work`, whose command stands still between samples, may be better taken as `straight` has them.
pub(super) fn may_be_straight(work: &Work<'_>, straight: &Work<'_>, base: &Refit) -> Result<bool, DiagnoseError> {
    let model = base.parsed()?;
    let (Some(standing), Some(straight)) = (left(&model, work.judge.runs), left(&model, straight.judge.runs)) else {
        return Ok(false);
    };
    Ok(straight < (1.0 - WORTH) * standing)
}

/// Whether the model, refitted with straight lines, leaves so much less that they are to be believed.
pub(super) fn is_worth_it(standing: &Refit, straight: &Refit) -> bool {
    let squares = |refit: &Refit| refit.judged().map(|left| left.squares).sum::<f64>();
    straight.is_finite() && !straight.was_given_up() && squares(straight) < (1.0 - WORTH) * squares(standing)
}

/// What a diagnosis says of it.
pub(super) fn note(standing: &Refit, straight: &Refit) -> Note {
    Note::StraightCommand { rmse_straight: straight.rmse_validate, rmse_standing: standing.rmse_validate }
}

/// The run with a command that runs straight from sample to sample.
pub(super) fn with_line(run: &Run) -> Run {
    let mut run = run.clone();
    run.settings.intersample = Intersample::FirstOrder;
    run
}

/// Squared error of simulations with an observer, the model's own parameters free.
fn left(model: &Model, runs: &[&Run]) -> Option<f64> {
    Some(Screen::new(&observed(model, runs)?, model, &moving(model))?.squares())
}
