//! The order of a diagnosis: what is fitted, asked and added, and when it ends.

use std::collections::{BTreeMap, BTreeSet};

use dynid_identify::FitError;
use dynid_identify::identify::{ErrorSignal, default_error};
use dynid_identify::position::{Estimate, PositionFitError};
use dynid_identify::prediction::{JointInnovations, State};
use dynid_logs::experiment::Run;
use dynid_logs::motion::Motion;
use dynid_user_model::{FitRecord, Model};

use crate::missing::{Fitted, Logs, noise_at};
use crate::refit::{EffectParameter, Judge, Refit, is_null, is_own};
use crate::settings::Settings;
use crate::verdict::{self, Judged, Otherwise, Step};
use crate::{
    Candidate, DiagnoseError, Diagnosis, Event, Finished, Note, Options, RejectedCandidate, Rejection, Screened,
    Verdict, discover, excitation, inconsistent_runs, runs,
};

/// What a diagnosis hears from outside and says while it works.
#[derive(Clone, Copy)]
struct Outside<'a> {
    tell: &'a (dyn Fn(&Event<'_>) + Sync),
    stop: &'a (dyn Fn() -> bool + Sync),
}

impl Outside<'_> {
    fn asked_to_stop(&self) -> Result<(), DiagnoseError> {
        let interrupted = FitError::from(PositionFitError::Interrupted { iterations: 0 });
        if (self.stop)() { Err(interrupted.into()) } else { Ok(()) }
    }
}

/// Diagnoses `model` by the likelihood of `runs`. `tell` hears of every step and may be asked to stop with `stop`; `finished` are
/// searches that an earlier, stopped call told.
///
/// # Errors
/// No run to fit to; runs that tell nothing; a model that makes no equations for a run or cannot be simulated at any rate; interrupted.
pub fn diagnose(
    model: &Model,
    runs: &[&Run],
    options: &Options,
    finished: &Finished,
    tell: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    let settings = Settings::default();
    let outside = Outside { tell, stop };
    let held = options.error.filter(|error| *error != ErrorSignal::Prediction);
    // What is shown beside the likelihood.
    let shown = match held.unwrap_or_else(|| default_error(model, runs)) {
        ErrorSignal::Torque => ErrorSignal::Torque,
        _ => ErrorSignal::Position,
    };
    let mut notes = Vec::new();
    if runs::is_cut(runs) {
        notes.push(Note::LastPartHeldOut { parts: runs::PARTS });
    }
    notes.extend(excitation::check(model, runs)?);
    let mut judged = runs::split(runs);
    let seen = model.looked_at(&judged, settings.search.samples);
    let recall = |key: &str| finished.get(key).cloned();
    let keep = |key: &str, state: &State| tell(&Event::Searched(key, state));
    let rates = held.map(|error| held_rates(model, runs, error)).transpose()?;
    tell(&Event::FittingModel);
    let (fit, held_out) = runs::by_role(&seen);
    let mut work = Logs { given: model, fit, held_out, settings, rates, recall: &recall, keep: &keep, stop };
    let mut base = work.first_base("base").map_err(FitError::from)?;
    outside.asked_to_stop()?;
    if !base.is_whole(&settings) && judged.iter().all(runs::stands) {
        let lines: Vec<Run> = judged.iter().map(runs::with_line).collect();
        let (fit, held_out) = runs::by_role(&model.looked_at(&lines, settings.search.samples));
        let straight = Logs { fit, held_out, ..work.clone() };
        let samples: f64 = base.fit.joints.iter().map(|joint| joint.samples).sum();
        let least = -0.5 * samples * (1.0 - settings.straight).ln();
        let may_pay = straight.may_gain(least, &base).map_err(FitError::from)?;
        outside.asked_to_stop()?;
        let refitted = may_pay.then(|| straight.base(&base.model, "base, straight")).transpose();
        let refitted = refitted.map_err(FitError::from)?;
        outside.asked_to_stop()?;
        let pays = |base: &Fitted| refitted.as_ref().filter(|refitted| refitted.score() - base.score() > least);
        if let Some(refitted) = pays(&base) {
            // The search may have come further, and not the command.
            let again = work.base(&refitted.model, "base, standing again").map_err(FitError::from)?;
            outside.asked_to_stop()?;
            if again.score() > base.score() {
                base = again;
            }
        }
        if let Some(refitted) = pays(&base).cloned() {
            judged = judged.iter().map(runs::with_line).collect();
            let judged: Vec<&Run> = judged.iter().collect();
            let left = |fitted: &Fitted| Judge { shown, runs: &judged }.as_it_is(&fitted.model).ok()?.rmse_validate;
            notes.push(Note::StraightCommand { rmse_straight: left(&refitted), rmse_standing: left(&base) });
            (base, work) = (refitted, straight);
        }
    }
    let judged: Vec<&Run> = judged.iter().collect();
    let judge = Judge { shown, runs: &judged };
    let first = refit(&judge, &base, 0.0)?;
    notes.extend(excitation::left_open(model, runs, &first));
    let mut steps: Vec<Step> = Vec::new();
    let mut before = (base.clone(), first.clone());
    let mut is_whole = false;
    for depth in 1..=options.depth.unwrap_or(settings.depth).max(1) {
        // A further effect is told only if nothing is left then, unless it was asked for.
        let share = (depth > 1 && options.depth.is_none()).then_some(settings.hopeful);
        let (found, step) = step(&work, &judge, (&before.0, &before.1), (depth, share), &outside)?;
        let is_all = found.first().is_some_and(|best| best.is_whole(&settings));
        let next = found.into_iter().next().zip(step.best().cloned());
        steps.push(step);
        let Some((mut fitted, mut refit)) = next else { break };
        // A later effect may make an earlier one needless.
        for index in (0..steps.len() - 1).rev() {
            let others = steps.iter().enumerate().filter(|(own, _)| *own != index);
            let kept: Vec<Candidate> = others.filter_map(|(_, step)| step.best()?.candidate.clone()).collect();
            let key = format!("step {depth} without {}", index + 1);
            let Some(without) = work.without(&fitted, &kept.iter().collect::<Vec<_>>(), &key) else { continue };
            outside.asked_to_stop()?;
            if without.score() > fitted.score() {
                refit = self::refit(&judge, &without, 0.0)?;
                fitted = without;
                steps.remove(index);
                if let Some(best) = steps.last_mut().and_then(|step| step.fitted.first_mut()) {
                    best.refit = refit.clone();
                }
                if let [only] = steps.as_mut_slice() {
                    only.base = first.clone();
                    if let Some(best) = only.fitted.first_mut() {
                        best.delta_bic = delta_bic(&base, &fitted);
                    }
                }
            }
        }
        is_whole = fitted.is_whole(&settings) && fitted.is_white(&settings);
        if is_all || is_whole {
            break;
        }
        before = (fitted.as_base(), refit);
    }
    if is_whole {
        steps.iter_mut().for_each(|step| step.verdict = Verdict::MissingEffect);
    } else {
        // What was added to the first may make up for its values; unless more was asked for, only that is said.
        let open = steps.iter().take_while(|step| step.verdict == Verdict::MissingEffect).count() + 1;
        steps.truncate(if options.depth.is_none() { 1 } else { open });
    }
    let is_open = steps.first().is_some_and(|step| step.verdict == Verdict::Unexplained);
    let otherwise = if is_open { otherwise(&work, &base, &first, &outside)? } else { Otherwise::NotAsked };
    outside.asked_to_stop()?;
    verdict::conclude(&judge, runs, (&first, otherwise), steps, notes)
}

/// What explains the runs where no effect does.
fn otherwise(work: &Logs<'_>, base: &Fitted, first: &Refit, outside: &Outside<'_>) -> Result<Otherwise, DiagnoseError> {
    let moved = inconsistent_runs::moved(work, &first.parsed()?)?;
    outside.asked_to_stop()?;
    Ok(if !moved.is_empty() {
        Otherwise::Moved(moved)
    } else if base.is_whole(&work.settings) {
        // A formula would be of the runs fitted to, of which nothing is left.
        Otherwise::HeldOut
    } else {
        Otherwise::Formula(discover::best(work, base))
    })
}

/// The rates at which a model is held to the logs where an error is asked for [1/s]: a free simulation, or the bandwidth of the torque
/// error's filter.
fn held_rates(model: &Model, runs: &[&Run], error: ErrorSignal) -> Result<BTreeMap<usize, f64>, DiagnoseError> {
    let rate = match error {
        ErrorSignal::Torque => {
            let cutoffs = runs.iter().map(|run| Ok(Motion::of(run)?.cutoff_hz));
            let cutoffs: Vec<f64> = cutoffs.collect::<Result<_, DiagnoseError>>()?;
            std::f64::consts::TAU * cutoffs.into_iter().fold(f64::INFINITY, f64::min)
        }
        _ => 0.0,
    };
    Ok((0..model.device.joints.len()).map(|joint| (joint, rate)).collect())
}

/// One effect's search.
fn step(
    work: &Logs<'_>,
    judge: &Judge<'_>,
    (base, before): (&Fitted, &Refit),
    (depth, share): (usize, Option<f64>),
    outside: &Outside<'_>,
) -> Result<(Vec<Fitted>, Step), DiagnoseError> {
    let settings = &work.settings;
    let nothing =
        |verdict| Step { verdict, base: before.clone(), screening: Vec::new(), fitted: Vec::new(), failed: Vec::new() };
    let is_near_noise = || before.worst_ratio().is_some_and(|ratio| ratio < settings.near);
    // Where free simulations leave no more than the noise of the logs, a pattern in it is not worth a name. What only the runs held out
    // show cannot be fitted.
    if base.is_whole(settings) || verdict::reaches_the_floor(before) {
        let is_all = work.holds_elsewhere(base) || is_near_noise();
        return Ok((Vec::new(), nothing(if is_all { Verdict::NothingMissing } else { Verdict::Unexplained })));
    }
    (outside.tell)(&Event::Asking(work.places(&base.model)));
    let mut starts = work.starts(base, &[], &|_| true).map_err(FitError::from)?;
    outside.asked_to_stop()?;
    let mut screening: Vec<Screened> = Vec::new();
    for start in &starts {
        if screening.iter().all(|other| other.candidate != start.candidate) {
            let (position, candidate) = (Some(-2.0 * start.promise), start.candidate.clone());
            screening.push(Screened { candidate, position });
        }
    }
    screening.sort_by(|a, b| a.position.unwrap_or(0.0).total_cmp(&b.position.unwrap_or(0.0)));
    (outside.tell)(&Event::Screened(&screening));
    let least = (screening.len().max(1) as f64 / settings.chance).ln();
    // In white errors only that is looked for which shows to first order, in all runs as in what was looked at.
    if base.is_white(settings) {
        starts = work.shown(base, starts, least).map_err(FitError::from)?;
        outside.asked_to_stop()?;
    }
    let raced: BTreeSet<&Candidate> = starts.iter().take(settings.arms).map(|start| &start.candidate).collect();
    (outside.tell)(&Event::Comparing(raced.len()));
    let found = work.best(base, &starts, &format!("step {depth}"), share).map_err(FitError::from)?;
    outside.asked_to_stop()?;
    let (mut paying, others): (Vec<Fitted>, Vec<Fitted>) =
        found.into_iter().partition(|fitted| fitted.score() - base.score() > least);
    // Of those that differ by what may be chance the plainest comes first.
    let is_like_best = |k: &usize| paying[0].is_like(&paying[*k], least, settings);
    let alike = (0..paying.len()).filter(is_like_best);
    let plainest = alike.min_by(|a, b| paying[*a].unknowns.total_cmp(&paying[*b].unknowns).then(a.cmp(b)));
    if let Some(plainest) = plainest {
        paying[..=plainest].rotate_right(1);
    }
    let failed = others.iter().filter_map(|fitted| {
        let reason = Rejection::NotWorthItsParameters { delta_bic: delta_bic(base, fitted) };
        Some(RejectedCandidate { candidate: fitted.candidate.clone()?, reason })
    });
    let failed = failed.collect();
    let mut fitted = Vec::new();
    for own in paying.iter().take(settings.shown) {
        let others = paying.iter().filter(|other| other.candidate != own.candidate);
        let alike = others.filter(|other| own.is_like(other, least, settings));
        let alike = alike.filter_map(|other| other.candidate.clone()).collect();
        fitted.push(Judged { refit: refit(judge, own, base.unknowns)?, alike, delta_bic: delta_bic(base, own) });
    }
    // Rounding is not white: predictions of a model that is trusted say by themselves that nothing is left where they are at the noise.
    let is_at_noise = |fitted: &Fitted, refit: &Refit| {
        fitted.correction() < settings.trusted && refit.one_step.is_some_and(|ratio| ratio < verdict::AT_THE_FLOOR)
    };
    let verdict = match paying.first() {
        None if is_near_noise() || is_at_noise(base, before) || work.leaves_noise(base) => Verdict::NothingMissing,
        None => Verdict::Unexplained,
        Some(best) if best.is_white(settings) && best.is_whole(settings) => Verdict::MissingEffect,
        Some(best) if fitted.first().is_some_and(|judged| is_at_noise(best, &judged.refit)) => Verdict::MissingEffect,
        Some(best) => {
            // Noise of the torque is nobody's to explain; of a torque that is measured at a high rate it hides how much is explained where
            // it matters.
            let of_torque = fitted.first().filter(|_| judge.shown == ErrorSignal::Torque);
            let of_torque =
                of_torque.and_then(|best| verdict::share(before, &best.refit)).map_or(0.0, |(.., share)| share);
            let much = work.leaves_noise(best) || best.explains(base, &work.fit).max(of_torque) >= settings.much;
            let promise = || discover::promise(work, base, helped(base, best)).unwrap_or(0.0);
            let is_best = || best.score() - base.score() >= settings.much * promise();
            if much && is_best() { Verdict::MissingEffect } else { Verdict::Unexplained }
        }
    };
    Ok((paying, Step { verdict, base: before.clone(), screening, fitted, failed }))
}

/// What `after` adds to Schwarz's criterion of `before`: negative where it is worth its unknowns.
fn delta_bic(before: &Fitted, after: &Fitted) -> f64 {
    2.0 * (before.fit.log_likelihood - after.fit.log_likelihood) + 2.0 * (after.price() - before.price())
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
    let own = |name: &str| fitted.candidate.as_ref().is_none_or(|candidate| is_own(candidate, model, name));
    let parameters =
        fitted.fit.parameters.iter().filter(|estimate| own(&estimate.name)).map(|estimate| EffectParameter {
            name: estimate.name.clone(),
            value: estimate.value,
            std_error: estimate.std_error,
            at_bound: estimate.at_bound && !is_null(model, &estimate.name, estimate.value),
            identifiable: estimate.identifiable,
        });
    Ok(Refit {
        candidate: fitted.candidate.clone(),
        parameters: parameters.collect(),
        unknowns: fitted.unknowns - base_unknowns,
        status: fitted.fit.status(),
        one_step: one_step(fitted, judge.runs),
        record: Some(record(fitted, judge.runs)),
        ..judge.as_it_is(model)?
    })
}

/// How the values were found; of which logs and from which model is added by who knows the files.
fn record(fitted: &Fitted, runs: &[&Run]) -> FitRecord {
    let parameters = &fitted.fit.parameters;
    let names =
        |is_so: fn(&Estimate) -> bool| parameters.iter().filter(move |own| is_so(own)).map(|own| own.name.clone());
    // As a fit states its cost.
    let shortfall =
        |own: &JointInnovations| own.samples * (own.deviation / noise_at(runs.iter().copied(), own.joint)).ln();
    FitRecord {
        error: ErrorSignal::Prediction.to_string(),
        status: fitted.fit.status().as_str().to_owned(),
        cost_after: fitted.fit.joints.iter().map(shortfall).sum(),
        not_identifiable: names(|own| !own.identifiable).collect(),
        std_error: parameters.iter().filter_map(|own| Some((own.name.clone(), own.std_error?))).collect(),
        at_bound: names(|own| own.at_bound).collect(),
        ..FitRecord::default()
    }
}

/// The largest error of a one-step prediction over the noise of its log, on the runs held out where there are some.
fn one_step(fitted: &Fitted, runs: &[&Run]) -> Option<f64> {
    let held_out = fitted.held_out.as_ref().map(|held_out| &held_out.joints).filter(|joints| !joints.is_empty());
    let joints = held_out.unwrap_or(&fitted.fit.joints).iter();
    joints.map(|joint| joint.deviation / noise_at(runs.iter().copied(), joint.joint)).max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use dynid_identify::prediction::HeldOut;
    use dynid_logs::experiment::Role;

    use super::*;
    use crate::fixtures::{self, NOISE, Oscillator, close};

    fn innovations(joint: usize, samples: f64, deviation: f64) -> JointInnovations {
        JointInnovations { joint, samples, deviation, whiteness: 1.0, correction: 0.0, tenths: Vec::new() }
    }

    /// A run, and a model fitted to it.
    fn fitted() -> (Run, Fitted) {
        let run = Oscillator { stiffness: 1.0, cubic: 0.0 }.run(&[(0.02, 1.0)], 6.0, (Role::Fit, 5));
        let model = fixtures::model(1.0, "");
        let base = Logs::new(&model, vec![run.clone()], Vec::new()).base(&model, "base").expect("a fit");
        (run, base)
    }

    /// The same with these errors left.
    fn with(fitted: &Fitted, joints: &[JointInnovations], held_out: Option<&[JointInnovations]>) -> Fitted {
        let mut own = fitted.clone();
        own.fit.joints = joints.to_vec();
        own.held_out = held_out.map(|joints| HeldOut { log_likelihood: 0.0, joints: joints.to_vec() });
        own
    }

    /// A joint gains its samples times the logarithm of the ratio of its deviations; one that the other fit lacks gains nothing.
    #[test]
    fn the_joint_that_is_helped_most_has_the_most_likely_logs() {
        let (_, fitted) = fitted();
        let of = |joints: &[JointInnovations]| with(&fitted, joints, None);
        let before = of(&[innovations(2, 100.0, 4.0), innovations(3, 1000.0, 4.0), innovations(5, 100.0, 9.0)]);
        let after = |first: f64, second: f64| of(&[innovations(3, 1000.0, second), innovations(2, 100.0, first)]);
        assert_eq!(helped(&before, &after(1.0, 2.0)), 3, "100 times ln 4, 1000 times ln 2");
        assert_eq!(helped(&before, &after(1.0, 3.9)), 2, "1000 times ln 4/3.9");
        assert_eq!(helped(&before, &after(8.0, 8.0)), 5, "the others became worse");
        assert_eq!(helped(&of(&[]), &before), 0);
    }

    /// The largest error of a prediction over the noise of its log, of the runs held out where there are some.
    #[test]
    fn one_step_errors_are_told_in_noises() {
        let (run, fitted) = fitted();
        let noise = noise_at([&run].into_iter(), 0);
        assert!((noise / NOISE - 1.0).abs() < 0.1);
        let ratio = |held_out: Option<&[JointInnovations]>| {
            one_step(&with(&fitted, &[innovations(0, 100.0, 3.0 * noise)], held_out), &[&run]).expect("a ratio")
        };
        close(ratio(Some(&[innovations(0, 50.0, 2.0 * noise)])), 2.0);
        close(ratio(Some(&[])), 3.0);
        close(ratio(None), 3.0);
    }

    /// A fit states as its cost how many noises its errors have, in log likelihood.
    #[test]
    fn a_record_says_how_values_were_found() {
        let (run, fitted) = fitted();
        let noise = noise_at([&run].into_iter(), 0);
        let record = record(&with(&fitted, &[innovations(0, 100.0, 3.0 * noise)], None), &[&run]);
        close(record.cost_after, 100.0 * 3.0_f64.ln());
        assert_eq!((&*record.error, record.not_identifiable.len(), record.at_bound.len()), ("prediction", 0, 0));
        assert!(record.std_error.contains_key("joint.0.spring.Ks"), "{:?}", record.std_error);
    }

    /// Schwarz's criterion: each unknown costs the logarithm of the samples.
    #[test]
    fn more_unknowns_must_be_worth_their_price() {
        let plain = with(&fitted().1, &[innovations(0, 100.0, 1.0)], None);
        let mut more = plain.clone();
        (more.unknowns, more.fit.log_likelihood) = (3.0, plain.fit.log_likelihood + 50.0);
        close(delta_bic(&plain, &more), 3.0 * 100.0_f64.ln() - 100.0);
        close(delta_bic(&more, &plain), 100.0 - 3.0 * 100.0_f64.ln());
    }

    /// A free simulation has no rate; the torque error's is the lowest cutoff of its filters.
    #[test]
    fn an_error_that_is_asked_for_holds_the_model_at_its_rate() {
        let text = "device = \"oscillator\"\n";
        let model = Model::parse(text, Path::new("made.toml")).expect("a model");
        let plant = Oscillator { stiffness: 1.0, cubic: 0.0 };
        let at = |cutoff: f64| {
            let mut run = plant.run(&[(0.02, 1.0)], 6.0, (Role::Fit, 5));
            run.settings.cutoff_hz = Some(cutoff);
            run
        };
        let (slow, fast) = (at(8.0), at(14.0));
        let rates = held_rates(&model, &[&fast, &slow], ErrorSignal::Torque).expect("rates");
        assert_eq!(rates, BTreeMap::from([(0, std::f64::consts::TAU * 8.0)]));
        let rates = held_rates(&model, &[&fast, &slow], ErrorSignal::Position).expect("rates");
        assert_eq!(rates, BTreeMap::from([(0, 0.0)]));
    }

    /// What differs only in the run that is held out is not told as nothing.
    #[test]
    fn a_spring_that_was_changed_before_the_run_held_out_is_noticed() {
        let sines = [(0.02, 1.0), (0.01, 5.3)];
        let run = |stiffness: f64, (file, role, seed): (&str, Role, u64)| {
            let run = Oscillator { stiffness, cubic: 0.0 }.run(&sines, 6.0, (role, seed));
            Run { file: file.to_owned(), ..run }
        };
        let model = fixtures::model(1.0, "");
        let moved = |stiffness: f64| {
            let held_out = run(stiffness, ("three.csv", Role::Validate, 7));
            let runs = [run(1.1, ("one.csv", Role::Fit, 5)), run(1.1, ("two.csv", Role::Fit, 6)), held_out];
            let runs: Vec<&Run> = runs.iter().collect();
            let said = diagnose(&model, &runs, &Options::default(), &Finished::new(), &|_| (), &|| false);
            let said = said.expect("an answer");
            assert_eq!(said.verdict, Verdict::NothingMissing);
            said.moved.into_iter().map(|moved| (moved.parameter, moved.run)).next()
        };
        assert_eq!(moved(1.3), Some(("joint.0.spring.Ks".to_owned(), "three.csv".to_owned())));
        assert_eq!(moved(1.1), None);
    }

    /// A command that runs straight from sample to sample, which the experiment does not say, is found before any effect is looked for; of
    /// one that stands, nothing is said.
    #[test]
    fn a_command_that_runs_straight_is_noticed() {
        let plant = Oscillator { stiffness: 1.1, cubic: 0.0 };
        let sines = [(0.02, 1.0), (0.01, 5.3)];
        let model = fixtures::model(1.0, "");
        let said = |one: &Run, two: &Run| {
            diagnose(&model, &[one, two], &Options::default(), &Finished::new(), &|_| (), &|| false).expect("an answer")
        };
        let straight = |seconds: f64, role: (Role, u64)| plant.run_with_straight_command(&sines, seconds, role);
        let found = said(&straight(8.0, (Role::Fit, 5)), &straight(5.0, (Role::Validate, 6)));
        let straight = found.notes.iter().find_map(|note| match note {
            Note::StraightCommand { rmse_straight, rmse_standing } => Some((*rmse_straight, *rmse_standing)),
            _ => None,
        });
        let (straight, standing) = straight.expect("it is noticed");
        let (straight, standing) = (straight.expect("it is simulated"), standing.expect("it is simulated"));
        assert!((straight / NOISE - 1.0).abs() < 0.1 && standing > 1.3 * NOISE, "{straight} {standing}");
        assert_eq!(found.verdict, Verdict::NothingMissing);
        let found = said(&plant.run(&sines, 8.0, (Role::Fit, 5)), &plant.run(&sines, 5.0, (Role::Validate, 6)));
        assert_eq!(found.verdict, Verdict::NothingMissing);
        assert!(!found.notes.iter().any(|note| matches!(note, Note::StraightCommand { .. })), "{:?}", found.notes);
    }
}
