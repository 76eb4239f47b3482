//! How likely logs are under the one-step predictions of a model as it is (see [`dynid_identify::prediction`]).
//!
//! The model's values stay. Where each run starts, and how far the model is trusted at each joint, is estimated for the runs of
//! each role; those held out are judged by the standard deviations of the runs to fit to.

use dynid_identify::position::FitRun;
use dynid_identify::prediction::{self, JointInnovations, PredictionProblem, Search, Settings};
use dynid_logs::experiment::{Role, Run};
use dynid_logs::noise::noise_of_joint;
use dynid_optimise::sqp::SearchControl;
use dynid_user_model::Model;
use serde::Serialize;

use crate::CompareError;

/// What one-step predictions of a model leave; `None` where there are no such runs or one cannot be simulated at any rate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Predictions {
    /// Of the runs to fit to.
    pub fit: Option<Predicted>,
    /// Of those held out.
    pub validate: Option<Predicted>,
}

/// What is left of the runs of a role.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Predicted {
    /// `sum of -n/2 (ln S + e^2/S)` over the joints, with their mean squared error e^2 and the variance S of the runs to fit to.
    pub log_likelihood: f64,
    /// Samples over all joints.
    pub samples: f64,
    /// Joint by joint.
    pub joints: Vec<PredictedJoint>,
}

/// What is left of a joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PredictedJoint {
    /// The device's joint index.
    pub joint: usize,
    /// Standard deviation of the errors of predictions from each sample to the next [rad or m].
    pub deviation: f64,
    /// The noise of the logs, the largest of the runs [rad or m].
    pub noise_floor: f64,
    /// One over the other; `None` where the logs show no noise.
    pub times_noise: Option<f64>,
    /// What share of an error corrects the position: 0 where the model is trusted altogether.
    pub correction: f64,
    /// Box and Pierce's sum over its expectation: 1 where the errors have no pattern in time.
    pub whiteness: f64,
}

impl Predicted {
    /// The joint that is farthest from its noise, and how far.
    pub fn worst(&self) -> Option<(usize, f64)> {
        let of = |own: &PredictedJoint| Some((own.joint, own.times_noise?));
        self.joints.iter().filter_map(of).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn of(log_likelihood: f64, joints: &[JointInnovations], runs: &[Run]) -> Self {
        let one = |own: &JointInnovations| {
            let noise_floor = noise_of_joint(runs, own.joint);
            PredictedJoint {
                joint: own.joint,
                deviation: own.deviation,
                noise_floor,
                times_noise: Some(own.deviation / noise_floor).filter(|ratio| ratio.is_finite()),
                correction: own.correction,
                whiteness: own.whiteness,
            }
        };
        let samples = joints.iter().map(|own| own.samples).sum();
        Self { log_likelihood, samples, joints: joints.iter().map(one).collect() }
    }
}

/// Predictions of `model` on `runs`, without what their masks leave out, and thinned where fewer samples tell the same.
///
/// # Errors
/// A model that makes no equations for a run.
pub fn predictions(model: &Model, runs: &[&Run]) -> Result<Predictions, CompareError> {
    let settings = Settings::default();
    // Whatever the values of a model, so that all of a device are told of the same samples.
    let usual = Model::of_device(model.device);
    let seen = usual.looked_at(runs.iter().copied(), settings.samples);
    let (fit, validate): (Vec<Run>, Vec<Run>) = seen.into_iter().partition(|run| run.role == Role::Fit);
    // Where nothing is to be fitted to, what is held out says how far the model is trusted.
    let (known, others) = if fit.is_empty() { (&validate, &fit) } else { (&fit, &validate) };
    let of_runs = |runs: &[Run]| runs.iter().map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<_>, _>>();
    let problem = PredictionProblem::of_values(of_runs(known)?);
    let fitted = Search::new(&problem, None).and_then(|mut search| {
        search.advance(&settings, settings.iterations, &mut |_| SearchControl::Continue);
        search.result()
    });
    let Ok(fitted) = fitted else { return Ok(Predictions { fit: None, validate: None }) };
    let own = Predicted::of(fitted.log_likelihood, &fitted.joints, known);
    let held_out = if others.is_empty() {
        None
    } else {
        let found = prediction::held_out(of_runs(others)?, &fitted, false, settings.integration).ok();
        found.map(|found| Predicted::of(found.log_likelihood, &found.joints, others))
    };
    let (fit, validate) = if fit.is_empty() { (None, Some(own)) } else { (Some(own), held_out) };
    Ok(Predictions { fit, validate })
}
