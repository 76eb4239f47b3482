//! The models of a lineage on the same runs: does each effect that was added pay for its parameters?
//!
//! Errors are reported per joint, on the runs to fit to and on those held out. Parsimony is the Bayesian information criterion
//! (Schwarz 1978) of the one-step predictions of the runs to fit to, whose errors are as good as independent,
//! `BIC = -2 log L + k ln n`,
//! with the number `k` of free parameters and that of samples, `n`. Only differences mean something; below -10 is strong.

use serde::Serialize;

use crate::CompareError;
use crate::{compare::Comparison, compare::compare, predictions::Predictions, predictions::predictions};
use dynid_identify::position::FitRun;
use dynid_logs::{experiment::Role, experiment::Run};
use dynid_user_model::{Added, EffectError, EffectInstance, Model};

/// Models of one device, one after the other, on the same runs.
#[derive(Debug, Clone, Serialize)]
pub struct Ladder {
    /// In the order given.
    pub rungs: Vec<Rung>,
    /// Root mean square of the logs' own noise over the held-out runs (those to fit to without any) [rad or m].
    pub noise_floor: Option<f64>,
    /// Which error the BIC is of: `prediction`, that of one-step predictions of the runs to fit to; `None` where no model has one.
    pub bic_error: Option<&'static str>,
    /// Samples of all joints together, in the BIC.
    pub independent_samples: Option<f64>,
    /// What should be known besides.
    #[serde(rename = "typed_notes")]
    pub notes: Vec<LadderNote>,
}

/// What should be known of a ladder besides its numbers. Models are named as the user calls them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum LadderNote {
    /// No run is held out, so that a lower error may only be more parameters.
    NothingHeldOut,
    /// Simulations drift away from a log.
    SimulationsLost {
        /// Of these models.
        models: Vec<String>,
    },
    /// A model was fitted from another one than that before it.
    NotAChild {
        /// The model.
        model: String,
        /// The one before it.
        before: String,
        /// Digest of what it was fitted from.
        parent_digest: String,
        /// Digest of the one before it.
        before_digest: String,
    },
    /// A model was not fitted, so that nothing says where it comes from.
    UnknownDescent {
        /// The model.
        model: String,
        /// The one before it.
        before: String,
    },
    /// A model is the one before it with effects added, not fitted yet.
    NotFittedYet {
        /// The model.
        model: String,
        /// The one before it.
        before: String,
    },
    /// The models were not all fitted to the same samples.
    FittedToDifferentLogs,
}

/// One model.
#[derive(Debug, Clone, Serialize)]
pub struct Rung {
    /// As the user calls it.
    pub model: String,
    /// [`Model::digest`].
    pub digest: String,
    /// How it stands to the one before it; `None` for the first.
    pub lineage: Option<Lineage>,
    /// Over all runs to fit to [rad or m].
    pub rmse_fit: Option<f64>,
    /// Over all held-out runs [rad or m].
    pub rmse_validate: Option<f64>,
    /// Torque error over all runs to fit to, as a share of the torque.
    pub torque_percent_fit: Option<f64>,
    /// The same over the held-out runs.
    pub torque_percent_validate: Option<f64>,
    /// The same, per joint.
    pub joints: Vec<RungJoint>,
    /// What one-step predictions leave.
    pub predictions: Predictions,
    /// Parameters that are not fixed and occur in the equations of a run.
    pub free_parameters: usize,
    /// Parsimony: smaller is better.
    pub bic: Option<f64>,
    /// Against the rung before.
    pub delta_bic: Option<f64>,
    /// Effects that the rung before does not have, e.g. `joint.4.input_coupling.5`.
    pub added: Vec<String>,
    /// Effects that only the rung before has.
    pub removed: Vec<String>,
    /// Parameters of both whose values differ.
    pub changed: Vec<Changed>,
    /// The comparison itself.
    #[serde(skip)]
    pub comparison: Comparison,
}

/// The error of one joint over the runs of each role.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RungJoint {
    /// The device's joint index.
    pub joint: usize,
    /// rad or m
    pub rmse_fit: Option<f64>,
    /// rad or m
    pub rmse_validate: Option<f64>,
    /// Of the logs over all runs in which it is free [rad or m].
    pub noise_floor: f64,
    /// Torque error as a share of the torque.
    pub torque_percent_fit: Option<f64>,
    /// Torque error as a share of the torque.
    pub torque_percent_validate: Option<f64>,
}

/// A parameter that differs between two rungs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Changed {
    /// E.g. `joint.4.gain.Kp`.
    pub name: String,
    /// On the rung before.
    pub before: f64,
    /// On this one.
    pub after: f64,
    /// The difference in standard errors of the two, where both fits state one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub in_std_errors: Option<f64>,
}

/// How a model stands to the one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Lineage {
    /// The same parameters.
    Same,
    /// It was fitted from the one before, as that is.
    Fitted,
    /// It was fitted from the one before with the effects added.
    AddedAndFitted,
    /// It is the one before with effects added, not fitted.
    Added,
    /// It was fitted from another model.
    OtherParent,
    /// It was not fitted, and is no other model with effects added: its parent is not recorded.
    Unknown,
}

impl Lineage {
    /// Whether the record shows that it comes from the one before.
    pub fn is_child(self) -> bool {
        !matches!(self, Self::OtherParent | Self::Unknown)
    }

    /// How `model` stands to `before`, by what its file records.
    pub fn of(before: &Model, model: &Model) -> Self {
        if model.digest() == before.digest() {
            return Self::Same;
        }
        let parent = model.fit.as_ref().map(|fit| fit.parent_digest.as_str());
        if parent == Some(before.digest().as_str()) {
            // A diagnosis adds what is missing while it fits.
            return if only_in(model, before).is_empty() { Self::Fitted } else { Self::AddedAndFitted };
        }
        // As `add` puts effects in, where they vanish; or with their first guesses.
        let at_null = extended(before, model, Model::add_effect_at_null).map(|extended| extended.digest());
        let guessed = extended(before, model, Model::add_effect).map(|extended| extended.digest());
        let is_extended = |digest: &str| [&at_null, &guessed].into_iter().flatten().any(|own| own == digest);
        match parent {
            Some(parent) if is_extended(parent) => Self::AddedAndFitted,
            None if is_extended(&model.digest()) => Self::Added,
            Some(_) => Self::OtherParent,
            None => Self::Unknown,
        }
    }
}

/// Puts an effect into a model.
type Add = fn(&mut Model, &str, Option<usize>, Option<usize>) -> Result<Added, EffectError>;

/// `before` with the effects of `model` that it lacks.
fn extended(before: &Model, model: &Model, add: Add) -> Option<Model> {
    let mut extended = before.clone();
    let lacking = model.effects.iter().filter(|own| !before.effects.iter().any(|other| own.is_same_place(other)));
    let mut n_added = 0;
    for effect in lacking {
        match effect.payload {
            Some(_) => extended.effects.push(as_added(effect, model)),
            None => {
                add(&mut extended, &effect.effect.id, effect.joint, effect.from).ok()?;
            }
        }
        n_added += 1;
    }
    (n_added > 0).then_some(extended)
}

/// An effect of a payload as it stood in the model before its fit: a user writes it, no command adds it.
fn as_added(effect: &EffectInstance, model: &Model) -> EffectInstance {
    let mut added = effect.clone();
    for (index, parameter) in added.parameters.iter_mut().enumerate() {
        if let Some(prior) = model.prior(&effect.parameter_name(index)) {
            parameter.value = prior;
        }
    }
    added
}

/// Puts `models`, each with what it is called, on `runs`.
///
/// # Errors
/// A model that makes no equations for a run.
pub fn ladder(models: &[(String, Model)], runs: &[&Run]) -> Result<Ladder, CompareError> {
    let judged = models.iter().map(|(_, model)| Judged::of(model, runs)).collect::<Result<_, CompareError>>()?;
    of_judged(models, runs, judged)
}

/// A model on the runs of a ladder.
pub struct Judged {
    comparison: Comparison,
    predictions: Predictions,
}

impl Judged {
    /// `model` on `runs`.
    ///
    /// # Errors
    /// A model that makes no equations for a run.
    pub fn of(model: &Model, runs: &[&Run]) -> Result<Self, CompareError> {
        Ok(Self { comparison: compare(model, runs)?, predictions: predictions(model, runs)? })
    }
}

/// As [`ladder`], of models that were judged on `runs` already.
///
/// # Errors
/// As [`ladder`].
pub fn of_judged(models: &[(String, Model)], runs: &[&Run], judged: Vec<Judged>) -> Result<Ladder, CompareError> {
    let mut rungs: Vec<Rung> = Vec::new();
    for (index, ((name, model), Judged { comparison, predictions })) in models.iter().zip(judged).enumerate() {
        let before = index.checked_sub(1).map(|before| &models[before].1);
        rungs.push(Rung {
            model: name.clone(),
            digest: model.digest(),
            lineage: before.map(|before| Lineage::of(before, model)),
            rmse_fit: comparison.rmse_fit,
            rmse_validate: comparison.rmse_validate,
            torque_percent_fit: comparison.torque_percent_fit,
            torque_percent_validate: comparison.torque_percent_validate,
            joints: joints(runs, &comparison),
            predictions,
            free_parameters: free_parameters(model, runs)?,
            bic: None,
            delta_bic: None,
            added: before.map_or_else(Vec::new, |before| only_in(model, before)),
            removed: before.map_or_else(Vec::new, |before| only_in(before, model)),
            changed: before.map_or_else(Vec::new, |before| changed(before, model)),
            comparison,
        });
    }
    let notes = notes(models, &rungs, runs);
    let mut ladder =
        Ladder { noise_floor: noise_floor(runs, &rungs), rungs, bic_error: None, independent_samples: None, notes };
    judge(&mut ladder);
    Ok(ladder)
}

fn only_in(model: &Model, other: &Model) -> Vec<String> {
    let lacks = |own: &&EffectInstance| !other.effects.iter().any(|other| own.is_same_place(other));
    model.effects.iter().filter(lacks).map(EffectInstance::place_name).collect()
}

fn changed(before: &Model, model: &Model) -> Vec<Changed> {
    let std_error = |model: &Model, name: &str| model.fit.as_ref().and_then(|fit| fit.std_error.get(name).copied());
    model
        .parameters()
        .into_iter()
        .filter_map(|(name, own)| {
            let (old, new) = (before.parameter(&name)?.value, own.value);
            let together = match (std_error(before, &name), std_error(model, &name)) {
                (Some(one), Some(other)) => Some((one * one + other * other).sqrt()).filter(|size| *size > 0.0),
                _ => None,
            };
            (old != new).then(|| Changed {
                in_std_errors: together.map(|size| (new - old) / size),
                name,
                before: old,
                after: new,
            })
        })
        .collect()
}

fn free_parameters(model: &Model, runs: &[&Run]) -> Result<usize, CompareError> {
    let systems =
        runs.iter().map(|run| Ok(FitRun::of_run(model, run)?)).collect::<Result<Vec<FitRun>, CompareError>>()?;
    let occurs = |name: &str| systems.iter().any(|system| system.occurs(name));
    Ok(model.parameters().iter().filter(|(name, parameter)| !parameter.fixed && occurs(name)).count())
}

/// Sums over the runs of a role, per joint of the device that is free in any.
fn joints(runs: &[&Run], comparison: &Comparison) -> Vec<RungJoint> {
    let mut free: Vec<usize> = runs.iter().flat_map(|run| run.free.iter().copied()).collect();
    free.sort_unstable();
    free.dedup();
    let one = |joint: usize| {
        let of = |role: Option<Role>| {
            runs.iter()
                .zip(&comparison.runs)
                .filter(move |(run, _)| role.is_none_or(|role| run.role == role))
                .filter_map(move |(run, compared)| {
                    let slot = run.free.iter().position(|free| *free == joint)?;
                    Some((run.log.len() as f64, &compared.joints[slot], compared.torque.get(slot)))
                })
        };
        let rmse = |role: Role| -> Option<f64> {
            let (mut sum, mut count) = (0.0, 0.0);
            for (samples, joint, _) in of(Some(role)) {
                sum += samples * joint.rmse?.powi(2);
                count += samples;
            }
            (count > 0.0).then(|| (sum / count).sqrt())
        };
        let percent = |role: Role| dynid_torque::total_percent(of(Some(role)).filter_map(|(.., torque)| torque));
        let (sum, count) = of(None).fold((0.0, 0.0), |(sum, count), (samples, joint, _)| {
            (sum + samples * joint.noise_floor.powi(2), count + samples)
        });
        RungJoint {
            joint,
            rmse_fit: rmse(Role::Fit),
            rmse_validate: rmse(Role::Validate),
            noise_floor: (sum / f64::max(count, 1.0)).sqrt(),
            torque_percent_fit: percent(Role::Fit),
            torque_percent_validate: percent(Role::Validate),
        }
    };
    free.into_iter().map(one).collect()
}

fn noise_floor(runs: &[&Run], rungs: &[Rung]) -> Option<f64> {
    let role = if runs.iter().any(|run| run.role == Role::Validate) { Role::Validate } else { Role::Fit };
    let (mut sum, mut count) = (0.0, 0.0);
    for (run, compared) in runs.iter().zip(&rungs.first()?.comparison.runs).filter(|(run, _)| run.role == role) {
        for joint in &compared.joints {
            sum += run.log.len() as f64 * joint.noise_floor.powi(2);
            count += run.log.len() as f64;
        }
    }
    (count > 0.0).then(|| (sum / count).sqrt())
}

fn notes(models: &[(String, Model)], rungs: &[Rung], runs: &[&Run]) -> Vec<LadderNote> {
    let mut notes = Vec::new();
    if !runs.iter().any(|run| run.role == Role::Validate) {
        notes.push(LadderNote::NothingHeldOut);
    }
    let is_lost = |rung: &&Rung| rung.comparison.runs.iter().any(|run| run.lost);
    let lost: Vec<String> = rungs.iter().filter(is_lost).map(|rung| rung.model.clone()).collect();
    if !lost.is_empty() {
        notes.push(LadderNote::SimulationsLost { models: lost });
    }
    for (index, rung) in rungs.iter().enumerate().skip(1) {
        let (before, model) = (rungs[index - 1].model.clone(), rung.model.clone());
        let fit = models[index].1.fit.as_ref();
        match (rung.lineage, fit) {
            (Some(Lineage::OtherParent), Some(fit)) => notes.push(LadderNote::NotAChild {
                model,
                before,
                parent_digest: fit.parent_digest.clone(),
                before_digest: rungs[index - 1].digest.clone(),
            }),
            (Some(Lineage::Unknown), _) => notes.push(LadderNote::UnknownDescent { model, before }),
            (Some(Lineage::Added), _) => notes.push(LadderNote::NotFittedYet { model, before }),
            _ => {}
        }
    }
    let digests: Vec<&str> =
        models.iter().filter_map(|(_, model)| model.fit.as_ref()).map(|fit| fit.data_digest.as_str()).collect();
    if digests.windows(2).any(|pair| pair[0] != pair[1]) {
        notes.push(LadderNote::FittedToDifferentLogs);
    }
    notes
}

/// Fills the BIC in.
fn judge(ladder: &mut Ladder) {
    let of_fit = |rung: &Rung| rung.predictions.fit.clone();
    let Some(samples) = ladder.rungs.iter().find_map(of_fit).map(|fit| fit.samples) else { return };
    let mut before: Option<f64> = None;
    for rung in &mut ladder.rungs {
        let price = rung.free_parameters as f64 * samples.ln();
        rung.bic = of_fit(rung).map(|fit| price - 2.0 * fit.log_likelihood);
        rung.delta_bic = rung.bic.zip(before).map(|(own, before)| own - before);
        before = rung.bic;
    }
    ladder.bic_error = Some("prediction");
    ladder.independent_samples = Some(samples);
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_user_model::FitRecord;

    fn model() -> Model {
        Model::of_device(dynid_model::device("planar2r").expect("a shipped device"))
    }

    fn fitted_from(parent: &Model, mut model: Model) -> Model {
        model.fit = Some(FitRecord { parent_digest: parent.digest(), ..FitRecord::default() });
        model
    }

    #[test]
    fn a_child_is_known_by_its_parents_digest() {
        let start = model();
        let mut moved = start.clone();
        moved.set_value("link.1.m", 1.234).expect("a parameter");
        let fitted = fitted_from(&start, moved.clone());
        assert_eq!(Lineage::of(&start, &start), Lineage::Same);
        assert_eq!(Lineage::of(&start, &fitted), Lineage::Fitted);
        assert_eq!(Lineage::of(&start, &moved), Lineage::Unknown);

        let mut added = fitted.clone();
        added.add_effect("torque_offset", Some(1), None).expect("it fits");
        assert_eq!(Lineage::of(&fitted, &added), Lineage::Added);
        let mut better = added.clone();
        better.set_value("joint.1.torque_offset.offset", 0.1).expect("a parameter");
        let better = fitted_from(&added, better);
        assert_eq!(Lineage::of(&fitted, &better), Lineage::AddedAndFitted);
        assert_eq!(Lineage::of(&start, &better), Lineage::OtherParent, "not from the first rung");
        let diagnosed = fitted_from(&fitted, better);
        assert_eq!(Lineage::of(&fitted, &diagnosed), Lineage::AddedAndFitted);

        let child = [Lineage::Same, Lineage::Fitted, Lineage::AddedAndFitted, Lineage::Added].map(Lineage::is_child);
        assert_eq!(child, [true; 4]);
        assert_eq!([Lineage::OtherParent, Lineage::Unknown].map(Lineage::is_child), [false; 2]);
    }

    #[test]
    fn what_a_reader_must_know_of_the_rungs_is_noted() {
        let start = model();
        let mut added = start.clone();
        added.add_effect("torque_offset", Some(1), None).expect("it fits");
        let mut moved = added.clone();
        moved.set_value("link.1.m", 1.234).expect("a parameter");
        let mut stranger = fitted_from(&start, moved.clone());
        stranger.set_value("link.1.m", 2.345).expect("a parameter");
        let named = [("start", start), ("added", added), ("moved", moved), ("stranger", stranger)];
        let models = named.map(|(name, model)| (name.to_owned(), model));
        let name = str::to_owned;
        let expected = [
            LadderNote::NothingHeldOut,
            LadderNote::NotFittedYet { model: name("added"), before: name("start") },
            LadderNote::UnknownDescent { model: name("moved"), before: name("added") },
            LadderNote::NotAChild {
                model: name("stranger"),
                before: name("moved"),
                parent_digest: models[0].1.digest(),
                before_digest: models[2].1.digest(),
            },
        ];
        assert_eq!(ladder(&models, &[]).expect("no run, no error").notes, expected);
    }

    #[test]
    fn what_changed_is_named_by_place() {
        let start = model();
        let mut other = start.clone();
        other.add_effect("torque_offset", Some(1), None).expect("it fits");
        other.add_effect("input_coupling", Some(1), Some(0)).expect("it fits");
        other.set_value("link.1.m", 2.0).expect("a parameter");
        assert_eq!(only_in(&other, &start), ["joint.1.torque_offset", "joint.1.input_coupling.0"]);
        assert_eq!(only_in(&start, &other), Vec::<String>::new());
        let names: Vec<String> = changed(&start, &other).into_iter().map(|changed| changed.name).collect();
        assert_eq!(names, ["link.1.m"]);
    }
}
