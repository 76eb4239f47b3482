//! The torque of a measured motion, taken apart into physical terms.
//!
//! `command = D ddq + C dq + phi + effects + what is left`, all brought to the unit of the command and through the filter
//! that the torque error passes. Effects are taken out one after the other, first those that build on others (friction that
//! grows with the load, say); the term of each is what the torque error then has more, so that the terms add up.

use dynid_model::{Effect, Place, Stage, effect::REST_POSITION};

use super::{Motion, Sample, along, typical_commands};
use dynid_dynamics::system::System;
use dynid_dynamics::system::SystemError;
use dynid_logs::experiment::Run;
use dynid_logs::motion::MotionError;
use dynid_user_model::Model;

/// The terms of one free joint. Vectors hold one entry a kept sample.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTerms {
    /// The device's joint index.
    pub joint: usize,
    /// s
    pub time: Vec<f64>,
    /// Commanded torque [unit of the command].
    pub command: Vec<f64>,
    /// What each term is called, and it [unit of the command]; the last one is what is left.
    pub terms: Vec<(String, Vec<f64>)>,
    /// Whether the sample counts.
    pub used: Vec<bool>,
}

impl JointTerms {
    /// Root mean square of `values` where samples count.
    pub fn rms(&self, values: &[f64]) -> f64 {
        let n_used = self.used.iter().filter(|used| **used).count().max(1);
        (super::square_sum(values, &self.used) / n_used as f64).sqrt()
    }
}

/// Why a torque cannot be taken apart.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TermsError {
    /// A model that makes no equations for the run.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A motion that cannot be filtered.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// The terms along the motion of `run`, for each of its free joints. Terms that vanish are left out.
///
/// # Errors
/// A model that makes no equations for the run; a motion that cannot be filtered.
pub fn terms(model: &Model, run: &Run) -> Result<Vec<JointTerms>, TermsError> {
    let of_model = |model: &Model| model.system_of(run);
    let system = of_model(model)?;
    let motion = Motion::of(run)?;
    let whole = along(&system, &motion);
    // What the torque error of each joint is without the effects that are taken out so far, and each one's term.
    let mut left: Vec<Vec<f64>> = whole.iter().map(|error| error.residual.clone()).collect();
    let mut of_effects: Vec<Vec<(usize, String, Vec<f64>)>> = vec![Vec::new(); whole.len()];
    let mut rest = model.clone();
    let mut bare = system;
    // Stable, so that the others keep the model's order.
    let mut order: Vec<usize> = (0..model.effects.len()).collect();
    order.sort_by_key(|&index| !builds_on_others(model.effects[index].effect));
    for index in order {
        let effect = &model.effects[index];
        // The gain is the scale of all terms; a sensor's effect acts on the logged positions, which the torque error takes for
        // true ones; a body is in inertia and gravity.
        let is_body = effect.effect.outputs.iter().any(|(name, _)| name == "m");
        if effect.effect.place == Place::Sensor || effect.effect.stage == Some(Stage::Gain) || is_body {
            continue;
        }
        let mut without = rest.clone();
        without.effects.retain(|own| !own.is_same_place(effect));
        let name = match effect.from {
            Some(from) => format!("{} from {from}", effect.effect.id),
            None => effect.effect.id.clone(),
        };
        let name = effect.payload.as_ref().map_or(name.clone(), |payload| format!("{name} with {payload}"));
        // What others build on cannot be taken out while they are there.
        let Ok(system) = of_model(&without) else { continue };
        let errors = along(&system, &motion);
        (rest, bare) = (without, system);
        for (slot, error) in errors.into_iter().enumerate() {
            // A pair's law may act on both joints; what an actuator delivers acts on its own.
            let other = effect.from.filter(|_| effect.effect.place != Place::Actuator);
            let own = effect.joint.is_none_or(|own| own == error.joint) || other == Some(error.joint);
            if own {
                let term = error.residual.iter().zip(&left[slot]).map(|(more, left)| more - left).collect();
                of_effects[slot].push((index, name.clone(), term));
                left[slot] = error.residual;
            }
        }
    }
    let rigid = rigid(&bare, &motion, &bare.drive_slope(&typical_commands(&bare, &motion)).0);
    Ok(whole
        .into_iter()
        .zip(rigid)
        .zip(of_effects)
        .map(|((error, rigid), mut of_effects)| {
            let mut terms: Vec<(String, Vec<f64>)> =
                rigid.into_iter().map(|(name, values)| (name.to_owned(), motion.filtered(&values))).collect();
            of_effects.sort_by_key(|(index, ..)| *index);
            terms.extend(of_effects.into_iter().map(|(_, name, term)| (name, term)));
            terms.retain(|(_, values)| values.iter().any(|value| *value != 0.0));
            terms.push(("what is left".to_owned(), error.residual));
            JointTerms { joint: error.joint, time: error.time, command: error.torque, terms, used: error.used }
        })
        .collect())
}

/// Whether an effect at the joint acts by what other effects do there: their friction, the drive's torque, the rest position.
fn builds_on_others(effect: &Effect) -> bool {
    effect.place == Place::Joint && ["friction", "load", REST_POSITION].iter().any(|signal| effect.reads(signal))
}

/// Inertia, Coriolis and centrifugal, and gravity torque of each free joint on the grid, in the unit of the command.
fn rigid(system: &System, motion: &Motion, slopes: &[f64]) -> Vec<[(&'static str, Vec<f64>); 3]> {
    let n = system.n_free();
    let mut columns: Vec<[(&'static str, Vec<f64>); 3]> = (0..n)
        .map(|_| ["inertia", "Coriolis", "gravity"].map(|name| (name, Vec::with_capacity(motion.len()))))
        .collect();
    let mut sample = Sample::new(system);
    let (mut needed, mut bias, mut gravity) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    for k in 0..motion.len() {
        sample.load(motion, None, k);
        let (q, dq) = (&sample.x[..n], &sample.x[n..2 * n]);
        let kernel = system.kernel();
        kernel.functions.inverse_dynamics(system.prepared(), q, dq, &sample.ddq, &mut needed);
        kernel.functions.bias(system.prepared(), q, dq, &mut bias);
        kernel.functions.gravity(system.prepared(), q, &mut gravity);
        for slot in 0..n {
            let [inertia, coriolis, weight] = &mut columns[slot];
            inertia.1.push((needed[slot] - bias[slot]) / slopes[slot]);
            coriolis.1.push((bias[slot] - gravity[slot]) / slopes[slot]);
            weight.1.push(gravity[slot] / slopes[slot]);
        }
    }
    columns
}
