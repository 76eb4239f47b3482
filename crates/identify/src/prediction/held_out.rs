//! The likelihood of runs that were not fitted.

use super::{PredictionFit, PredictionProblem, Search, Settings, result::JointInnovations};
use crate::position::{FitRun, PositionFitError};
use dynid_optimise::sqp::SearchControl;

/// What a fit makes of runs that it has not seen.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HeldOut {
    /// Their log likelihood with the standard deviations of the fit.
    pub log_likelihood: f64,
    /// What is left of them, by joint.
    pub joints: Vec<JointInnovations>,
}

/// Of `runs`, whose equations have the values of `fit`. Where they start is estimated anew, and so are the rates unless they are kept:
/// how far a model is to be trusted depends on the motion (a joint that sticks forgets what disturbed it), not on the machine
/// alone. Joints that the fit does not know have no part. `integration` is what that may cost of the log likelihood.
///
/// # Errors
/// A run that cannot be simulated.
pub fn held_out(
    runs: Vec<FitRun>,
    fit: &PredictionFit,
    keeps_rates: bool,
    integration: f64,
) -> Result<HeldOut, PositionFitError> {
    let rates = fit.rates.clone();
    let problem = PredictionProblem { rates, keeps_rates, ..PredictionProblem::of_values(runs) };
    let mut search = Search::new(&problem, None)?;
    let settings = Settings { iterations: 10, integration, ..Settings::default() };
    search.advance(&settings, settings.iterations, &mut |_| SearchControl::Continue);
    let found = search.result()?;
    let mut log_likelihood = 0.0;
    for own in &found.joints {
        let Some(fitted) = fit.joints.iter().find(|fitted| fitted.joint == own.joint) else { continue };
        let share = own.deviation / fitted.deviation;
        log_likelihood -= 0.5 * own.samples * (2.0 * fitted.deviation.ln() + share * share);
    }
    Ok(HeldOut { log_likelihood, joints: found.joints })
}
