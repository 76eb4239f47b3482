//! A first estimate for an effect that stands where it vanishes: what a fit starts from.

use dynid_model::Parameter;
use rayon::prelude::*;

use super::{
    Candidate, MUCH, ObserverView, Probe, Screen, Sizes, TorqueView, probes, screen::Scored, screening_substeps,
    shortlist,
};
use dynid_identify::identify::ErrorSignal;
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion};
use dynid_user_model::{EffectInstance, Model};

/// The logs that a screening looks at, with the sizes of what their joints do.
pub(super) struct Screening<'a> {
    runs: Vec<&'a Run>,
    torque: TorqueView,
    sizes: Vec<Sizes>,
    typical: Sizes,
    error: ErrorSignal,
}

/// Rate of the observer that holds simulations to the log [1/s].
const OBSERVER: f64 = 4.0;

/// Simulations of the runs that are for fitting, held to their logs as a screening has them; `None` where `base` makes no
/// equations for one.
pub(super) fn observed(base: &Model, runs: &[&Run]) -> Option<ObserverView> {
    ObserverView::new(base, runs, OBSERVER, screening_substeps(runs)).ok()
}

/// The model's own parameters that a fit may move.
pub(super) fn moving(base: &Model) -> Vec<(String, Parameter)> {
    base.parameters().into_iter().filter(|(_, parameter)| !parameter.fixed).collect()
}

impl<'a> Screening<'a> {
    /// Of those of `runs` that are for fitting.
    pub(super) fn new(model: &Model, runs: &[&'a Run], error: ErrorSignal) -> Self {
        let runs: Vec<&Run> = runs.iter().copied().filter(|run| run.role == Role::Fit).collect();
        let motions: Vec<Option<Motion>> = runs.par_iter().map(|run| Motion::of(run).ok()).collect();
        let (with_motion, motions): (Vec<&Run>, Vec<Motion>) =
            runs.iter().zip(motions).filter_map(|(run, motion)| Some((*run, motion?))).unzip();
        let sizes =
            (0..model.device.joints.len()).map(|joint| Sizes::of(model, &with_motion, &motions, joint)).collect();
        Self {
            torque: TorqueView::new(&with_motion, &motions),
            typical: Sizes::of(model, &[], &[], 0),
            sizes,
            runs,
            error,
        }
    }

    /// The torque error of the runs to fit to.
    pub(super) fn torque(&self) -> &TorqueView {
        &self.torque
    }

    /// The runs to fit to.
    pub(super) fn runs(&self) -> &[&'a Run] {
        &self.runs
    }

    /// Scores candidates against `base`: by the torque error, and by simulations where the position error counts. `reported`
    /// hears of every candidate and says whether to go on.
    pub(super) fn scores(
        &self,
        base: &Model,
        candidates: &[Candidate],
        reported: &(dyn Fn() -> bool + Sync),
    ) -> Vec<Scored> {
        let moving = moving(base);
        let torque = Screen::new(&self.torque, base, &moving);
        let view = (self.error == ErrorSignal::Position).then(|| observed(base, &self.runs)).flatten();
        let observed = view.as_ref().and_then(|view| Screen::new(view, base, &moving));
        candidates
            .par_iter()
            .map(|candidate| {
                if !reported() {
                    return (None, None);
                }
                let size = candidate.joint.and_then(|joint| self.sizes.get(joint)).unwrap_or(&self.typical);
                let probes: Vec<Probe> = probes(base, candidate, size);
                let by_torque = torque.as_ref().and_then(|screen| screen.score(candidate, &probes));
                let by_position = observed.as_ref().and_then(|screen| {
                    // Where the torque error has told which values are worth a simulation, few are left to try.
                    let probes = shortlist::worth_simulating(&probes, by_torque.as_ref(), candidates.len());
                    let score = screen.score(candidate, &probes)?;
                    // Of several values that were tried, which is best depends on the others.
                    let tried = probes.first().filter(|probe| probe.tried.len() > 1 && probe.scaled.is_empty());
                    Some(match tried {
                        Some(probe) if score.explained >= MUCH => screen.refined(score, &probe.tried),
                        _ => score,
                    })
                });
                (by_torque, by_position)
            })
            .collect()
    }
}

/// Where a fit of a model with new effects starts.
#[derive(Debug, Clone)]
pub struct FirstEstimates {
    /// The model with the most promising estimates.
    pub model: Model,
    /// Other starts, should a fit from there come to no minimum; only where a single effect is new.
    pub others: Vec<Model>,
    /// Whether the other starts should be tried even where the first leads to a minimum that leaves more than noise, for there
    /// are many near by.
    pub is_narrow: bool,
    /// The effects that got an estimate.
    pub labels: Vec<String>,
}

/// `model` with a first estimate for every effect that stands where it vanishes, from those of `runs` that are for
/// fitting.
///
/// The estimate is the one that a screening finds ([`Screen`]); where it finds none the effect stays.
pub fn with_first_estimates(model: &Model, runs: &[&Run], error: ErrorSignal) -> FirstEstimates {
    let mut found = FirstEstimates { model: model.clone(), others: Vec::new(), is_narrow: false, labels: Vec::new() };
    let new: Vec<EffectInstance> = model.effects.iter().filter(|own| vanishes(own)).cloned().collect();
    if new.is_empty() {
        return found;
    }
    let screening = Screening::new(model, runs, error);
    let is_single = new.len() == 1;
    for instance in new {
        let candidate = Candidate { effect: instance.effect.id.clone(), joint: instance.joint, from: instance.from };
        let mut without = found.model.clone();
        if without.remove_effect(&candidate.effect, candidate.joint, candidate.from).is_err() {
            continue;
        }
        let scores = screening.scores(&without, std::slice::from_ref(&candidate), &|| true);
        let Some((torque, position)) = scores.into_iter().next() else { continue };
        let mut estimates = Vec::new();
        for score in [position, torque].into_iter().flatten() {
            found.is_narrow |= is_single && score.is_narrow;
            estimates.push(score.estimate);
            estimates.extend(score.others);
        }
        let mut estimates = estimates.into_iter().map(|estimate| with_values(&found.model, &instance, &estimate));
        let Some(first) = estimates.next() else { continue };
        if is_single {
            found.others = estimates.filter(|other| other.digest() != first.digest()).collect();
        }
        found.model = first;
        found.labels.push(instance.label());
    }
    found
}

/// `model` with the values that `estimate` has for `instance`.
fn with_values(model: &Model, instance: &EffectInstance, estimate: &Model) -> Model {
    let mut model = model.clone();
    for index in 0..instance.parameters.len() {
        let name = instance.parameter_name(index);
        let own = instance.parameters[index];
        if let Some(found) = estimate.parameter(&name)
            && (!own.fixed || instance.effect.parameters[index].scan.is_some())
        {
            // The name is the model's own.
            let _ = model.set_value(&name, found.value.clamp(own.lower, own.upper));
        }
    }
    model
}

/// Whether an effect does nothing of its own: every parameter that has a null value is there, and at least one has one. What
/// it keeps of an effect whose place it took says nothing about that, unless there is nothing else.
fn vanishes(instance: &EffectInstance) -> bool {
    let effect = instance.effect;
    let is_kept =
        |symbol: &str| effect.replaces.iter().any(|replaced| replaced.carry.iter().any(|(own, _)| own == symbol));
    let nulls: Vec<(bool, bool)> = effect
        .parameters
        .iter()
        .zip(&instance.parameters)
        .filter_map(|(own, parameter)| Some((is_kept(&own.symbol), parameter.value == own.null? && !parameter.fixed)))
        .collect();
    let has_own = nulls.iter().any(|(is_kept, _)| !is_kept);
    !nulls.is_empty() && nulls.iter().filter(|(is_kept, _)| !(has_own && *is_kept)).all(|(_, is_null)| *is_null)
}
