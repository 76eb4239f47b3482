//! The diagnosis in ten lines:
//!
//! 1. `excitation`: runs that are too short, or in which nothing moves, are errors.
//! 2. The model is fitted by the prediction-error method: its values, one rate and one standard deviation per joint, and where each run
//!    starts; with a command that stands still between samples and, where something is left, with one that runs straight.
//! 3. Its innovations are white and its rates 0: nothing is missing.
//! 4. `score_test`: every effect at every place, at three rates, finite values where the derivative vanishes; from the fitted and from the
//!    believed values.
//! 5. `arms`: one queue of starts, halved again and again; then starts from the best one's values; as long as that changes the best.
//! 6. What is compared is the log likelihood of the fitted and the held-out runs, less the price of the unknowns.
//! 7. Effects that this does not tell apart are named together.
//! 8. The best is the missing effect if its innovations are white and its rates 0, or if it makes up for most of what the logs' own noise
//!    leaves to explain and no formula leaves far less; else it is the nearest.
//! 9. It is added, and all goes on from 3 while it pays; what is found so counts where it explains all in the end.
//! 10. A formula (`discover`) is looked for where no effect explains what is left.

use dynid_dynamics::simulate::Intersample;
use dynid_identify::FitError;
use dynid_check::excitation::LEAST_SAMPLES;
use dynid_identify::identify::{ErrorSignal, default_error};
use dynid_identify::position::PositionFitError;
use dynid_identify::prediction::{JointInnovations, Settings, State};
use dynid_logs::experiment::{Experiment, Role, Run};
use dynid_logs::noise::noise_of_log;
use dynid_logs::part::{may_keep_one_of, thinned, unmasked};
use dynid_user_model::Model;
use rayon::prelude::*;

use crate::missing::{Fitted, Logs};
use crate::refit::{EffectParameter, Judge, Refit};
use crate::verdict::{self, Judged};
use crate::{
    Candidate, DiagnoseError, Diagnosis, Event, Finished, FinishedFit, Note, Options, RejectedCandidate, Rejection,
    Screened, Step, Verdict, Work, blocks, discover, excitation, intersample,
};

/// An effect is chance if its log likelihood rises by less than the logarithm of the places asked over this.
const BY_CHANCE: f64 = 0.01;
/// A command that runs straight must leave so much less of the squared errors.
const LESS: f64 = 0.3;
/// An effect that does not explain all is named if it explains this share.
const MUCH: f64 = 0.5;
/// So many effects are looked for one after the other, unless it is said how many.
const DEEPEST: usize = 2;
/// Samples, over all joints, of which more are thinned where they tell no more.
const ENOUGH_SAMPLES: usize = 60_000;
/// Effects of a step that are shown, and judged by simulations.
const SHOWN: usize = 5;

/// Diagnoses by the likelihood of the logs.
pub(super) fn diagnose(
    model: &Model,
    experiment: &Experiment,
    runs: &[&Run],
    options: &Options,
    finished: &Finished,
    tell: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    // What is shown beside the likelihood.
    let error = match default_error(model, runs) {
        ErrorSignal::Torque => ErrorSignal::Torque,
        _ => ErrorSignal::Position,
    };
    let split = blocks::Split::of(runs, error);
    let mut notes = Vec::new();
    if split.is_cut() {
        notes.push(Note::LastPartHeldOut { parts: blocks::BLOCKS });
    }
    notes.extend(excitation::check(model, runs, &split.folds(), ErrorSignal::Position)?);
    let judged = split.judged(runs);
    let seen = looked_at(&judged);
    let recall = |key: &str| match finished.get(key) {
        Some(FinishedFit::Search(state)) => Some(state.clone()),
        _ => None,
    };
    let keep = |key: &str, state: &State| tell(&Event::Searched(key, state));
    let logs = |runs: &[&'_ Run]| -> (Vec<Run>, Vec<Run>) {
        let (fit, held_out): (Vec<&Run>, Vec<&Run>) = runs.iter().partition(|run| run.role == Role::Fit);
        (fit.into_iter().cloned().collect(), held_out.into_iter().cloned().collect())
    };
    let search = Settings::default();
    tell(&Event::FittingModel);
    let (fit, held_out) = logs(&seen.iter().collect::<Vec<_>>());
    let mut work = Logs { given: model, fit, held_out, search, recall: &recall, keep: &keep, stop };
    let mut base = work.base(model, "base").map_err(FitError::from)?;
    asked_to_stop(stop)?;
    let stands = |run: &&Run| run.settings.intersample == Intersample::ZeroOrder && run.settings.controller.is_none();
    let mut lines: Vec<Run> = Vec::new();
    if !base.is_whole() && seen.iter().all(|run| stands(&run)) {
        lines = seen.iter().map(intersample::with_line).collect();
        let (fit, held_out) = logs(&lines.iter().collect::<Vec<_>>());
        let straight = Logs { fit, held_out, ..work };
        let refitted = straight.base(&base.model, "base, straight").map_err(FitError::from)?;
        asked_to_stop(stop)?;
        let samples: f64 = base.fit.joints.iter().map(|joint| joint.samples).sum();
        let is_better = |base: &Fitted| refitted.score() - base.score() > -0.5 * samples * (1.0 - LESS).ln();
        if is_better(&base) {
            // The search may have come further, and not the command.
            let again = work.base(&refitted.model, "base, standing again").map_err(FitError::from)?;
            asked_to_stop(stop)?;
            if again.score() > base.score() {
                base = again;
            }
        }
        if is_better(&base) {
            (base, work) = (refitted, straight);
        } else {
            lines.clear();
        }
    }
    let straight: Vec<Run> = judged.iter().filter(|_| !lines.is_empty()).map(|run| intersample::with_line(run)).collect();
    let judged: Vec<&Run> = if lines.is_empty() { judged } else { straight.iter().collect() };
    let options_of_fit = crate::fit_options(options, error, &judged);
    let judge = Judge { error, experiment, runs: &judged, options: options_of_fit };
    let first = refit(&judge, &base, 0.0)?;
    if !lines.is_empty() {
        notes.push(Note::StraightCommand { rmse_straight: first.rmse_validate, rmse_standing: None });
    }
    notes.extend(excitation::left_open(model, runs, &first));
    let outer = Work { runs, prior: model, judge: &judge, folds: &[], options, finished, tell, stop };
    let mut steps: Vec<Step> = Vec::new();
    let mut before = (base, first.clone());
    let mut is_whole = false;
    for depth in 1..=options.depth.unwrap_or(DEEPEST).max(1) {
        let (found, step) = step(&work, &judge, (&before.0, &before.1), depth, tell, stop)?;
        let goes_on = step.verdict == Verdict::MissingEffect && !found.first().is_some_and(Fitted::is_whole);
        let next = found.into_iter().next().zip(step.best().cloned());
        steps.push(step);
        let Some((mut fitted, mut refit)) = next else { break };
        if steps.last().is_some_and(|step| step.verdict != Verdict::MissingEffect) {
            break;
        }
        // A later effect may make an earlier one needless.
        for index in (0..steps.len() - 1).rev() {
            let others = steps.iter().enumerate().filter(|(own, _)| *own != index);
            let kept: Vec<Candidate> = others.filter_map(|(_, step)| step.best()?.candidate.clone()).collect();
            let key = format!("step {depth} without {}", index + 1);
            let Some(without) = work.without(&fitted, &kept.iter().collect::<Vec<_>>(), &key) else { continue };
            asked_to_stop(stop)?;
            if without.score() > fitted.score() {
                refit = self::refit(&judge, &without, 0.0)?;
                fitted = without;
                steps.remove(index);
                if let Some(best) = steps.last_mut().and_then(|step| step.fitted.first_mut()) {
                    best.refit = refit.clone();
                }
                if let [only] = steps.as_mut_slice() {
                    only.base = first.clone();
                }
            }
        }
        is_whole = fitted.is_whole();
        if !goes_on || is_whole {
            break;
        }
        before = (fitted.as_base(), refit);
    }
    // Where nothing explains all, what was added to the first may make up for its values; unless more was asked for, only that is said.
    if options.depth.is_none() && !is_whole {
        steps.truncate(1);
    }
    verdict::conclude(&outer, &first, steps, notes)
}

/// What of the runs the likelihood is of: the stretches that a mask lets count, and of more samples than decide anything no more than
/// tell the same.
fn looked_at(runs: &[&Run]) -> Vec<Run> {
    let whole: Vec<Run> = runs.iter().flat_map(|run| unmasked(run, LEAST_SAMPLES)).collect();
    let samples: usize = whole.iter().map(|run| run.log.len() * run.free.len()).sum();
    let most = samples.div_ceil(ENOUGH_SAMPLES);
    whole.par_iter().map(|run| thinned(run, may_keep_one_of(run, most))).collect()
}

pub(super) fn asked_to_stop(stop: &(dyn Fn() -> bool + Sync)) -> Result<(), DiagnoseError> {
    if stop() { Err(FitError::from(PositionFitError::Interrupted { iterations: 0 }).into()) } else { Ok(()) }
}

/// One effect's search.
fn step(
    work: &Logs<'_>,
    judge: &Judge<'_>,
    (base, before): (&Fitted, &Refit),
    depth: usize,
    tell: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<Fitted>, Step), DiagnoseError> {
    let nothing =
        |verdict| Step { verdict, base: before.clone(), screening: Vec::new(), fitted: Vec::new(), failed: Vec::new() };
    // Where free simulations leave no more than the noise of the logs, a pattern in it is not worth a name.
    if base.is_whole() || verdict::reaches_the_floor(before) {
        return Ok((Vec::new(), nothing(Verdict::NothingMissing)));
    }
    let starts = work.starts(base, &[], &|_| true).map_err(FitError::from)?;
    asked_to_stop(stop)?;
    let mut asked: Vec<&Candidate> = starts.iter().map(|start| &start.candidate).collect();
    asked.sort();
    asked.dedup();
    tell(&Event::Comparing(asked.len()));
    let found = work.best(base, &starts, &format!("step {depth}")).map_err(FitError::from)?;
    asked_to_stop(stop)?;
    let least = (asked.len().max(1) as f64 / BY_CHANCE).ln();
    let mut screening: Vec<Screened> = Vec::new();
    for start in &starts {
        if screening.iter().all(|other| other.candidate != start.candidate) {
            let (position, candidate) = (Some(-2.0 * start.promise), start.candidate.clone());
            screening.push(Screened {
                candidate,
                torque: None,
                torque_explained: None,
                position,
                position_explained: None,
            });
        }
    }
    screening.sort_by(|a, b| a.position.unwrap_or(0.0).total_cmp(&b.position.unwrap_or(0.0)));
    let (mut paying, others): (Vec<Fitted>, Vec<Fitted>) =
        found.into_iter().partition(|fitted| fitted.score() - base.score() > least);
    // Of those that differ by what may be chance the plainest comes first.
    let best = paying.first().map_or(0.0, Fitted::score);
    let alike = paying.iter().take_while(|fitted| best - fitted.score() < least).count();
    let plainest = (0..alike).min_by(|a, b| paying[*a].unknowns.total_cmp(&paying[*b].unknowns).then(a.cmp(b)));
    if let Some(plainest) = plainest {
        paying[..=plainest].rotate_right(1);
    }
    let bic = |fitted: &Fitted| {
        -2.0 * (fitted.fit.log_likelihood - base.fit.log_likelihood) + 2.0 * (fitted.price() - base.price())
    };
    let failed = others.iter().filter_map(|fitted| {
        let reason = Rejection::NotWorthItsParameters { delta_bic: bic(fitted) };
        Some(RejectedCandidate { candidate: fitted.candidate.clone()?, reason })
    });
    let failed = failed.collect();
    let mut fitted = Vec::new();
    for own in paying.iter().take(SHOWN) {
        let held_out = -2.0 * (own.score() - base.score());
        fitted.push(Judged { refit: refit(judge, own, base.unknowns)?, held_out, delta_bic: bic(own), reason: None });
    }
    if std::env::var_os("DBG").is_some() {
        for own in paying.iter().take(4) {
            eprintln!("{:?} score {:.1} rate {:?} white {:.1} explained {:.2} {:?}", own.candidate, own.score() - base.score(), own.fit.rates, own.whiteness(), explained(base, own, &work.fit), own.fit.joints.iter().map(|j| (j.deviation, j.whiteness)).collect::<Vec<_>>());
        }
    }
    let verdict = match paying.first() {
        None if is_near_noise(before) || base.is_white() => Verdict::NothingMissing,
        None => Verdict::Unexplained,
        Some(best) if best.is_white() => Verdict::MissingEffect,
        Some(best) => {
            // Of a torque that is measured at a high rate, noise hides how much is explained where it matters.
            let of_torque = fitted.first().filter(|_| judge.error == ErrorSignal::Torque);
            let of_torque = of_torque.and_then(|best| verdict::share(before, &best.refit)).map_or(0.0, |(.., share)| share);
            let much = explained(base, best, &work.fit).max(of_torque) >= MUCH;
            let joint = helped(base, best);
            let formula = || discover::better_than(&base.model, &[&best.model], judge.runs, joint, 0.5);
            if much && formula().is_none() { Verdict::MissingEffect } else { Verdict::Unexplained }
        }
    };
    Ok((paying, Step { verdict, base: before.clone(), screening, fitted, failed }))
}

/// Whether hardly more than noise is left.
fn is_near_noise(refit: &Refit) -> bool {
    refit.worst_ratio().is_some_and(|ratio| ratio < verdict::NEAR_THE_FLOOR)
}

/// How much of what the log likelihood falls short of at the noise of the logs an effect makes up for.
fn explained(before: &Fitted, after: &Fitted, runs: &[Run]) -> f64 {
    let short = |joint: &JointInnovations| {
        let free = runs.iter().filter(|run| run.free.contains(&joint.joint));
        let noise = free.map(|run| noise_of_log(&run.log.q[joint.joint])).fold(0.0, f64::max);
        joint.samples * (joint.deviation / noise.max(f64::MIN_POSITIVE)).ln().max(0.0)
    };
    let attainable: f64 = before.fit.joints.iter().map(short).sum();
    (after.fit.log_likelihood - before.fit.log_likelihood) / attainable.max(f64::MIN_POSITIVE)
}

/// The joint whose logs become likelier most.
fn helped(before: &Fitted, after: &Fitted) -> usize {
    let gain = |joint: &JointInnovations| {
        let own = after.fit.joints.iter().find(|own| own.joint == joint.joint);
        own.map_or(0.0, |own| joint.samples * (joint.deviation / own.deviation).ln())
    };
    let best = before.fit.joints.iter().max_by(|a, b| gain(a).total_cmp(&gain(b)));
    best.map_or(0, |joint| joint.joint)
}

/// What simulations and torques say of a fitted model.
fn refit(judge: &Judge<'_>, fitted: &Fitted, base_unknowns: f64) -> Result<Refit, DiagnoseError> {
    let model = &fitted.model;
    let own =
        |name: &str| fitted.candidate.as_ref().is_none_or(|candidate| crate::refit::is_own(candidate, model, name));
    let parameters =
        fitted.fit.parameters.iter().filter(|estimate| own(&estimate.name)).map(|estimate| EffectParameter {
            name: estimate.name.clone(),
            value: estimate.value,
            std_error: estimate.std_error,
            at_bound: estimate.at_bound && !crate::refit::is_null(model, &estimate.name, estimate.value),
            identifiable: estimate.identifiable,
        });
    Ok(Refit {
        candidate: fitted.candidate.clone(),
        parameters: parameters.collect(),
        unknowns: fitted.unknowns - base_unknowns,
        status: fitted.fit.status(),
        followed: crate::SearchExtent::ToItsEnd,
        ..judge.as_it_is(model)?
    })
}
