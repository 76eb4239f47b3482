//! Diagnosis: which physical effect a model lacks, at which joint, and how sure that is ([`diagnose`]).
//!
//! What decides is the likelihood of the logs (`by_likelihood`, where the order is listed). Where an error signal is asked for instead
//! ([`Options::error`]), the order is:
//!
//! 1. `excitation`: runs that are too short, or in which nothing moves, are errors; joints that stand still and parameters that
//!    the runs leave open are notes.
//! 2. The model is fitted, so that the residual is not due to its values. Where its fit breaks down, or does not follow the logs
//!    even with an observer and each of its steps takes long, the model is taken as it is.
//! 3. `intersample`: is the command better described by straight lines between samples (first-order hold)? All that follows uses
//!    the answer.
//! 4. [`Screen`]: for every effect at every place ([`candidates`], each tried at several values, [`probes`]), how much of the
//!    residual would it explain, the model's own parameters being free to compensate? No fit is needed. It looks at two
//!    signals ([`View`]): the torque error along the measured motion, and the position error of simulations with an observer
//!    of 4/s.
//! 5. `shortlist`, `prescreening`: which candidates are fitted, and in which order.
//! 6. [`Judge`]: fits of these candidates, and what they leave of the held-out runs ([`Refit`]); only this decides. Where no run is
//!    held out, `blocks` holds out each of three blocks of every run in turn.
//! 7. Further starts, for a search that has lost its way looks the same as a wrong law: `again` starts laws no larger than the
//!    best one from the best one's values; `at_prior` screens and fits once more from the values before any fit
//!    ([`Model::prior`]).
//! 8. `verdict`: credit, rank (held-out log-likelihood and 3 per unknown), candidates that fit as well, the answer. `region`: does
//!    the effect help where it acts? `inconsistent_runs`: or did parameters change between runs? `distinguishing_experiment`: the experiment that would
//!    distinguish candidates.
//! 9. [`discover()`] and `formula_beats_effect`: a formula that no effect of the library is, where none explains the residual or a formula
//!    explains far more.
//!
//! `finished` holds fits by key: an interrupted diagnosis goes on from them to the same answer. Most models that a screening tries
//! differ in one effect, so [`dynid_torque::Memory`] keeps the rest; the result does not depend on what is kept.
//!
//! The torque error is stated as a command: it is divided by what a change of the drive's torque leaves for the motion, and
//! a stage that takes the command away gets no credit for that ([`dynid_torque::JointTorqueError::delivered_share`]).
//! [`with_first_estimates`] uses the same screening to give an effect that vanishes a start for a fit.

mod arms;
mod blocks;
mod by_likelihood;
mod candidate;
mod discover;
mod distinguishing_experiment;
mod error;
mod error_signal;
mod evidence;
mod excitation;
mod first_estimate;
mod formula_beats_effect;
mod inconsistent_runs;
mod intersample;
mod joint_weights;
mod missing;
mod note;
mod prescreening;
mod refit;
mod region;
mod score_test;
mod screen;
mod shortlist;
mod statement;
mod verdict;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use candidate::{Candidate, Probe, Sizes, candidates, probes};
pub use discover::{Discovered, DiscoveredTerm, discover};
pub use distinguishing_experiment::{DistinguishingExperiment, SinePhase};
pub use error::{DiagnoseError, WhySoMany};
pub use error_signal::{Block, ObserverView, TorqueView, View};
pub use evidence::{Evidence, Rejection, Speaks};
pub use first_estimate::{FirstEstimates, with_first_estimates};
pub use note::{KeptValues, Note};
pub use refit::{CostLimits, EffectParameter, JointResidual, Judge, Refit, SearchExtent, stays_far_above};
pub use screen::{Score, Screen};
pub use statement::{ActsOn, ErrorLeft, ModelState, Statement};

use first_estimate::Screening;
use screen::Scored;

use dynid_identify::{FitError, FitStatus, identify::ErrorSignal, identify::default_error, position};
use dynid_judge::compare::Finding;
use dynid_logs::{experiment::Experiment, experiment::Role, experiment::Run};
use dynid_user_model::Model;

/// What a diagnosis says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    /// What the screening said of every candidate, most promising first.
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

/// What the screening says of a candidate, before any fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Screened {
    /// Which, and where.
    #[serde(flatten)]
    pub candidate: Candidate,
    /// Change of the information criterion of the torque error: below 0 it explains something.
    pub torque: Option<f64>,
    /// Share of the squared torque error that it would explain.
    pub torque_explained: Option<f64>,
    /// The same of simulations that are held to the log.
    pub position: Option<f64>,
    /// Share of their squared error.
    pub position_explained: Option<f64>,
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
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Which error decides; without one, the likelihood of the logs.
    pub error: Option<ErrorSignal>,
    /// How many effects are looked for, one after the other; `None` for as many as it pays.
    pub depth: Option<usize>,
    /// How many candidates are fitted for good at most, per step, beside what the first of them contain.
    pub refits: usize,
    /// How finely fits integrate.
    pub fit: position::Options,
}

impl Default for Options {
    fn default() -> Self {
        let fit = position::Options { iterations: 60, tolerance: 1e-5, ..position::Options::default() };
        Self { error: None, depth: None, refits: 12, fit }
    }
}

/// What a diagnosis tells while it works.
#[derive(Debug)]
pub enum Event<'a> {
    /// The model itself is being fitted.
    FittingModel,
    /// So many candidates of so many are screened.
    Screened(usize, usize),
    /// So many candidates are compared with an observer.
    Comparing(usize),
    /// A candidate's fit begins.
    Refitting(&'a Candidate),
    /// A fit is done; its key and what it found are worth keeping.
    Refitted(&'a str, &'a Refit),
    /// A search for the likeliest values has come farther; its key and where it is are worth keeping.
    Searched(&'a str, &'a dynid_identify::prediction::State),
}

/// Finished fits by their keys: a diagnosis that was stopped goes on from them.
pub type Finished = BTreeMap<String, FinishedFit>;

/// Something worth keeping of a diagnosis that is stopped.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(clippy::large_enum_variant, reason = "there are some hundred at most")]
pub enum FinishedFit {
    /// A fit of one error.
    Refit(Refit),
    /// Where a search for the likeliest values is.
    Search(dynid_identify::prediction::State),
}

/// Linearisations of a torque fit, which is nearly linear: what takes more is not going anywhere.
const TORQUE_ITERATIONS: usize = 15;
/// As many candidates, the most promising, are fitted from every start that the screening suggests; of machines with many
/// free joints, whose fits take long, fewer.
const MANY_STARTS: usize = 3;
const MANY_STARTS_OF_MANY_JOINTS: usize = 2;
/// A candidate is worth a second start if the screening promises this share of the squared error, and its fit keeps less than
/// the other share of that promise.
const MUCH: f64 = 0.2;
const KEPT: f64 = 0.8;
/// Joints free at once beyond which there are many.
const FEW_JOINTS: usize = 3;
/// Longest integration step of the screening (s): eight steps per 10 ms matched 24 in the feasibility study.
const SCREENING_STEP: f64 = 0.01 / 8.0;
/// Longest integration step of a refit (s), as `compare` judges.
const LONGEST_STEP: f64 = 0.01 / 60.0;

/// Diagnoses `model` by `runs`. `tell` hears of every step and may be asked to stop with `stop`; `finished` are fits that
/// an earlier, stopped call told.
///
/// # Errors
/// No run to fit to; a model that makes no equations for a run; a fit of the model that cannot start; interrupted.
pub fn diagnose(
    model: &Model,
    experiment: &Experiment,
    runs: &[&Run],
    options: &Options,
    finished: &Finished,
    tell: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    if options.error.is_none() {
        return by_likelihood::diagnose(model, experiment, runs, options, finished, tell, stop);
    }
    let mut notes = Vec::new();
    let error = match options.error {
        Some(ErrorSignal::Both) | None => match default_error(model, runs) {
            ErrorSignal::Torque => ErrorSignal::Torque,
            _ => ErrorSignal::Position,
        },
        Some(error) => error,
    };
    let split = blocks::Split::of(runs, error);
    if split.is_cut() {
        notes.push(blocks::note());
    }
    notes.extend(excitation::check(model, runs, &split.folds(), error)?);
    let judged = split.judged(runs);
    let judge = Judge { error, experiment, runs: &judged, options: fit_options(options, error, &judged) };
    let mut work = Work { runs, prior: model, judge: &judge, folds: &split.others, options, finished, tell, stop };
    let mut base = work.base(model, "base")?;
    let in_question: &[&Run] = if intersample::is_in_question(&work, &base) { runs } else { &[] };
    let lines: Vec<Run> = in_question.iter().map(|run| intersample::with_line(run)).collect();
    let lines: Vec<&Run> = lines.iter().collect();
    let line_split = blocks::Split::of(&lines, error);
    let line_judged = line_split.judged(&lines);
    let line_judge = Judge { runs: &line_judged, ..judge };
    let straight = Work { runs: &lines, judge: &line_judge, folds: &line_split.others, ..work };
    if !lines.is_empty() && intersample::may_be_straight(&work, &straight, &base)? {
        let refitted = straight.base(&base.parsed()?, "base, straight")?;
        if intersample::is_worth_it(&base, &refitted) {
            notes.push(intersample::note(&base, &refitted));
            base = refitted;
            work = straight;
        }
    }
    if base.was_given_up() {
        let is_given = base.parsed()?.digest() == model.digest();
        notes.push(Note::FitGivenUp { values: if is_given { KeptValues::Given } else { KeptValues::Prior } });
    }
    notes.extend(excitation::left_open(model, runs, &base));
    let mut steps = Vec::new();
    let first = base.clone();
    let deepest = options.depth.unwrap_or(1).max(1);
    for depth in 1..=deepest {
        let parsed = base.parsed()?;
        let step = work.step(&parsed, &base, depth, &steps)?;
        let next = step.best().cloned();
        let goes_on = step.verdict == Verdict::MissingEffect;
        steps.push(step);
        match next {
            Some(next) if goes_on && depth < deepest => base = next,
            _ => break,
        }
    }
    verdict::conclude(&work, &first, steps, notes)
}

/// Steps per sample that the runs ask for.
fn fit_options(options: &Options, error: ErrorSignal, runs: &[&Run]) -> position::Options {
    let sample = runs.iter().map(|run| run.log.sample_time()).fold(0.0, f64::max);
    let substeps = (sample / LONGEST_STEP).round().clamp(1.0, 600.0) as usize;
    let iterations = if error == ErrorSignal::Torque {
        options.fit.iterations.min(TORQUE_ITERATIONS)
    } else {
        options.fit.iterations
    };
    position::Options { substeps, iterations, ..options.fit }
}

/// What every step of a diagnosis needs.
#[derive(Clone, Copy)]
struct Work<'a> {
    /// As they were given.
    runs: &'a [&'a Run],
    /// The model that was given.
    prior: &'a Model,
    /// Of these, or of the fold that holds out the last blocks of them.
    judge: &'a Judge<'a>,
    /// The other folds; none where runs of their own are held out.
    folds: &'a [Vec<Run>],
    options: &'a Options,
    finished: &'a Finished,
    tell: &'a (dyn Fn(&Event<'_>) + Sync),
    stop: &'a (dyn Fn() -> bool + Sync),
}

/// One effect's search.
struct Step {
    verdict: Verdict,
    base: Refit,
    screening: Vec<Screened>,
    /// All that were fitted, best first.
    fitted: Vec<verdict::Judged>,
    /// Those whose fit came to nothing.
    failed: Vec<RejectedCandidate>,
}

impl Step {
    /// The best of those that may be given credit.
    fn best(&self) -> Option<&Refit> {
        verdict::best(&self.fitted)
    }
}

impl Work<'_> {
    fn asked_to_stop(&self) -> Result<(), DiagnoseError> {
        by_likelihood::asked_to_stop(self.stop)
    }

    /// The model itself, fitted; as it is where the fit was given up, for the values where it was are worth less than those
    /// that were given.
    fn base(&self, model: &Model, key: &str) -> Result<Refit, DiagnoseError> {
        /// A search that ran out of iterations gets as many again, so often.
        const MORE: usize = 2;
        (self.tell)(&Event::FittingModel);
        let mut base = self.remembered(key, None, model, std::slice::from_ref(model), CostLimits::default())?;
        for more in 1..=MORE {
            if base.was_given_up() || base.status != FitStatus::IterationLimit {
                break;
            }
            let start = base.parsed()?;
            let key = format!("{key}, more {more}");
            let longer = self.remembered(&key, None, &start, std::slice::from_ref(&start), CostLimits::default())?;
            if longer.was_given_up() {
                break;
            }
            base = longer;
        }
        self.over_blocks(key, base)
    }

    /// What a fit leaves of all blocks, where every block is held out in turn; from memory where it is there.
    fn over_blocks(&self, key: &str, refit: Refit) -> Result<Refit, DiagnoseError> {
        if self.folds.is_empty() {
            return Ok(refit);
        }
        let key = format!("{key}, all blocks");
        if let Some(FinishedFit::Refit(refit)) = self.finished.get(&key) {
            return Ok(refit.clone());
        }
        let refit = blocks::over_all(self.judge, self.folds, &refit, self.stop)?;
        self.asked_to_stop()?;
        (self.tell)(&Event::Refitted(&key, &refit));
        Ok(refit)
    }

    /// A fit from several starts, the lowest cost kept; from memory where it is there.
    fn remembered(
        &self,
        key: &str,
        candidate: Option<&Candidate>,
        base: &Model,
        starts: &[Model],
        limits: CostLimits,
    ) -> Result<Refit, DiagnoseError> {
        if let Some(FinishedFit::Refit(refit)) = self.finished.get(key) {
            return Ok(refit.clone());
        }
        let mut fits: Vec<Result<Refit, DiagnoseError>> = Vec::new();
        for start in candidate::distinct(starts.iter().collect(), |start| start) {
            let fit = self.judge.refit(candidate, base, start, limits, self.stop);
            let fit = fit.map(|fit| self.gone_on(candidate, base, fit, limits));
            // Another start is worth its time only while nothing explains the logs.
            let done = limits.only_noise
                || fit.as_ref().is_ok_and(|fit| {
                    !limits.thorough && fits.iter().flatten().any(|before| come_to_the_same(before, fit))
                })
                || fit.as_ref().is_ok_and(|fit| {
                    verdict::reaches_the_floor(fit)
                        || fit.cost().zip(limits.enough).is_some_and(|(cost, enough)| cost <= enough)
                });
            fits.push(fit);
            if done || (self.stop)() {
                break;
            }
        }
        let cost = |refit: &Refit| {
            refit.side(false).map(|left| left.samples * left.squares.max(f64::MIN_POSITIVE).ln()).sum::<f64>()
        };
        let mut best: Option<Refit> = None;
        let mut failure = None;
        for fit in fits {
            match fit {
                Ok(fit) => {
                    if best.as_ref().is_none_or(|best| cost(&fit) < cost(best)) {
                        best = Some(fit);
                    }
                }
                Err(error) => failure = failure.or(Some(error)),
            }
        }
        self.asked_to_stop()?;
        match (best, failure) {
            (Some(best), _) => {
                (self.tell)(&Event::Refitted(key, &best));
                Ok(best)
            }
            (None, Some(error)) => Err(error),
            (None, None) => Err(FitError::from(position::PositionFitError::NoRun).into()),
        }
    }

    /// A candidate's fit that explains the logs but stopped short of a minimum, once more from the prior values of the
    /// model: whether it leaves only noise decides which others are fitted at all.
    fn gone_on(&self, candidate: Option<&Candidate>, base: &Model, fit: Refit, limits: CostLimits) -> Refit {
        let stopped_short = verdict::explains(&fit) && !fit.is_minimum() && !verdict::reaches_the_floor(&fit);
        if candidate.is_none() || !stopped_short {
            return fit;
        }
        let further = fit.parsed().and_then(|found| {
            let from = found.with_values(&|name| self.prior.prior(name));
            self.judge.refit(candidate, base, &from, limits, self.stop)
        });
        let is_better = |further: &Refit| further.cost().zip(fit.cost()).is_some_and(|(cost, before)| cost < before);
        further.ok().filter(is_better).unwrap_or(fit)
    }

    /// Screens, fits the best candidates and judges them.
    fn step(&self, base: &Model, refit: &Refit, depth: usize, before: &[Step]) -> Result<Step, DiagnoseError> {
        let is_near = refit.worst_ratio().is_some_and(|ratio| ratio < verdict::NEAR_THE_FLOOR);
        if verdict::reaches_the_floor(refit) || (is_near && refit.is_white()) {
            return Ok(Step {
                verdict: Verdict::NothingMissing,
                base: refit.clone(),
                screening: Vec::new(),
                fitted: Vec::new(),
                failed: Vec::new(),
            });
        }
        let screening = Screening::new(base, self.judge.runs, self.judge.error);
        let scored = self.screened(&screening, base)?;
        let shortlist = shortlist::of(&scored);
        let found = before.iter().filter_map(Step::best).filter_map(|best| best.candidate.as_ref());
        let path: Vec<String> = found.map(ToString::to_string).collect();
        let key = |candidate: &Candidate| format!("{depth}: {} > {candidate}", path.join(" > "));
        let mut fitted: Vec<Refit> = Vec::new();
        let mut failed = Vec::new();
        // A fit simulates its runs beside one another; the fewer fits there are at a time, the more of them know what another
        // has reached. The result depends on how many there are, but not on the number of threads.
        let at_once = if self.judge.runs.iter().filter(|run| run.role == Role::Fit).count() > 1 { 1 } else { 2 };
        let mut waiting = shortlist.clone();
        waiting.truncate(self.options.refits);
        shortlist::bring_contained(&mut waiting, &scored);
        // The less promising start once.
        let free = self.judge.runs.iter().map(|run| run.free.len()).max().unwrap_or(0);
        let many = if free > FEW_JOINTS { MANY_STARTS_OF_MANY_JOINTS } else { MANY_STARTS };
        waiting.iter_mut().skip(many).for_each(|score| score.others.clear());
        waiting.iter_mut().filter(|score| score.explained < MUCH).for_each(|score| score.others.clear());
        let unknowns = |score: &Score| self.judge.added_unknowns(&score.estimate, base);
        waiting = shortlist::plain_ones_first(waiting, &scored, &unknowns);
        // A fit that keeps what the screening promised needs no other start.
        let cost = refit.cost().filter(|cost| cost.is_finite() && !refit.was_given_up());
        let kept = |score: &Score| Some(cost? * (1.0 - KEPT * score.explained)).filter(|_| !score.is_narrow);
        let again = format!("{depth}: again, {}", path.join(" > "));
        let prior = format!("{depth}: believed, {}", path.join(" > "));
        let mut reached = prescreening::Reached::default();
        let mut may_ask_prior = self.judge.error == ErrorSignal::Position;
        // Which is fitted first: where the model's own fit strayed, what comes near the logs with an observer, or what does so from
        // the prior values; else what is plainer than the most promising and leaves only noise with the observer.
        let mut is_order_settled = false;
        let mut is_formula_asked = false;
        let mut hopeless: Vec<Score> = Vec::new();
        if refit.has_strayed() {
            is_order_settled = self.prescreening(base, &waiting, &mut reached)?;
            waiting = prescreening::ordered(waiting, &reached, &unknowns);
            if reached.all_stay_far() {
                may_ask_prior = false;
                self.at_prior(&screening, (base, false), &mut fitted, &mut failed, &prior)?;
                waiting.retain(|score| !has_explained(&score.candidate, &fitted));
                self.keep_rivals(&mut waiting, &fitted, &mut failed, (&scored, &reached), &unknowns);
            }
        } else {
            let first = waiting.first().map_or(0.0, unknowns);
            let mut smaller: Vec<Score> = waiting.iter().filter(|score| unknowns(score) < first).cloned().collect();
            smaller.sort_by(|a, b| unknowns(a).total_cmp(&unknowns(b)));
            self.prescreening(base, &smaller, &mut reached)?;
            waiting = prescreening::noise_first(waiting, &reached, &unknowns);
        }
        while !waiting.is_empty() {
            // Where nothing comes near the noise, not even with an observer, and a formula does far better, fits are not worth
            // their time.
            let is_asked = is_order_settled || !fitted.is_empty();
            if !is_formula_asked && is_asked && reached.none_is_near_noise() && !fitted.iter().any(verdict::explains) {
                is_formula_asked = true;
                if self.is_formula_ahead(base, refit, &scored) {
                    (waiting, hopeless) = formula_beats_effect::without_hopeless(waiting, !fitted.is_empty(), &reached);
                }
            }
            let later = waiting.split_off(at_once.min(waiting.len()));
            let least = fitted.iter().filter_map(Refit::cost).min_by(f64::total_cmp);
            let only_noise = fitted.iter().any(verdict::reaches_the_floor);
            let fits: Vec<Result<Refit, DiagnoseError>> = waiting
                .par_iter()
                .map(|score| {
                    self.asked_to_stop()?;
                    (self.tell)(&Event::Refitting(&score.candidate));
                    let mut starts = vec![score.estimate.clone()];
                    starts.extend(score.others.iter().cloned());
                    self.remembered(
                        &key(&score.candidate),
                        Some(&score.candidate),
                        base,
                        &starts,
                        CostLimits { reached: least, only_noise, enough: kept(score), thorough: false },
                    )
                })
                .collect();
            self.asked_to_stop()?;
            for (fit, score) in fits.into_iter().zip(&waiting) {
                match fit {
                    Ok(fit) if is_fitted(&score.candidate, &fitted) => {
                        take_better(std::iter::once(fit), &mut fitted, &mut failed);
                    }
                    Ok(fit) => fitted.push(fit),
                    Err(_) if is_fitted(&score.candidate, &fitted) => {}
                    Err(error) => failed.push(verdict::failed(&score.candidate, &error)),
                }
            }
            waiting = later;
            if !is_order_settled && waiting.len() > 1 && !fitted.iter().any(verdict::explains) {
                is_order_settled = self.prescreening(base, &waiting, &mut reached)?;
                waiting = prescreening::ordered(waiting, &reached, &unknowns);
            }
            // What explains the logs after all may have rivals among those that seemed hopeless.
            if fitted.iter().any(verdict::explains) {
                waiting.append(&mut hopeless);
            }
            self.keep_rivals(&mut waiting, &fitted, &mut failed, (&scored, &reached), &unknowns);
        }
        failed.extend(formula_beats_effect::rejected(hopeless, &fitted));
        self.again(&screening, base, &shortlist, &mut fitted, &mut failed, &again)?;
        if may_ask_prior && !fitted.iter().any(verdict::explains) {
            self.at_prior(&screening, (base, refit.is_minimum()), &mut fitted, &mut failed, &prior)?;
            // A law that was found only from there may have rivals that are found only from there, too. (Until a law explains
            // the logs the first call has done nothing, so that the key is free.)
            self.again(&screening, base, &shortlist, &mut fitted, &mut failed, &again)?;
        }
        let torque = screening.torque();
        // What explains the logs to their noise is right wherever it helps.
        let before_errors = torque.errors(base);
        let helps_elsewhere = |fit: &Refit| {
            let before = before_errors.as_deref().filter(|_| !verdict::explains(fit))?;
            region::helps_elsewhere(torque, before, fit)
        };
        let mut fitted = verdict::judge(&refit.of_one_fold(), fitted, &helps_elsewhere);
        if !self.folds.is_empty() {
            fitted = self.confirmed(refit, fitted, &mut failed, &key, &helps_elsewhere)?;
        }
        let mut verdict = verdict::of(refit, &fitted);
        if verdict == Verdict::MissingEffect && self.is_beaten(base, refit, &fitted)? {
            verdict = Verdict::Unexplained;
        }
        Ok(Step { verdict, base: refit.clone(), screening: shortlist::screened(&scored), fitted, failed })
    }

    /// Of `waiting`, where one leaves nothing but noise, those that may do so as well; where that is white, only what is no
    /// larger.
    fn keep_rivals(
        &self,
        waiting: &mut Vec<Score>,
        fitted: &[Refit],
        failed: &mut Vec<RejectedCandidate>,
        (scored, reached): (&[Scored], &prescreening::Reached),
        unknowns: &dyn Fn(&Score) -> f64,
    ) {
        if let Some(best) = fitted.iter().find(|fit| verdict::reaches_the_floor(fit)) {
            waiting.retain(|score| shortlist::may_rival(score, best, scored));
            waiting.retain(|score| match prescreening::no_rival(&score.candidate, best, reached) {
                Some(rejected) => {
                    if !is_fitted(&score.candidate, fitted) {
                        failed.push(rejected);
                    }
                    false
                }
                None => true,
            });
        }
        if let Some(plainest) = verdict::plainest_noise(fitted) {
            waiting.retain(|score| unknowns(score) <= plainest.unknowns);
        }
    }

    /// Another start for laws no larger than the best one (smaller, where that leaves only noise) that fell far short of it at
    /// its joint, with an observer or in a fit, and for those whose fit came to nothing: a search that has lost its way comes to
    /// the same as a law that is wrong. They start from the best one's values of the model's own parameters, then from the
    /// prior values.
    fn again(
        &self,
        screening: &Screening<'_>,
        base: &Model,
        shortlist: &[Score],
        fitted: &mut Vec<Refit>,
        failed: &mut Vec<RejectedCandidate>,
        key: &str,
    ) -> Result<(), DiagnoseError> {
        /// What costs so much more than the best fell short.
        const SHORT: f64 = 1.2;
        /// As many get another start.
        const MOST: usize = 4;
        /// Share of the winner's score that a rival's must reach.
        const NEARLY: f64 = 0.5;
        let cost = |refit: &Refit| refit.cost().filter(|_| refit.is_finite());
        let best = fitted.iter().filter_map(|refit| Some((cost(refit)?, refit))).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((least, best)) = best else { return Ok(()) };
        let best = verdict::plainest_noise(fitted).unwrap_or(best);
        // What explains nothing sets no mark.
        if !verdict::explains(best) {
            return Ok(());
        }
        let only_noise = fitted.iter().any(verdict::reaches_the_floor);
        let (Some(winner), best_unknowns) = (best.candidate.clone(), best.unknowns) else { return Ok(()) };
        // Beside a law that leaves only noise another of its size could only be a tie.
        let is_noise = verdict::plainest_noise(fitted).is_some();
        let is_small = |unknowns: f64| if is_noise { unknowns < best_unknowns } else { unknowns <= best_unknowns };
        let unknowns = |score: &Score| self.judge.added_unknowns(&score.estimate, base);
        let has_failed = |candidate: &Candidate| failed.iter().any(|failed| failed.candidate == *candidate);
        let fell_short =
            |score: &Score| match fitted.iter().find(|refit| refit.candidate.as_ref() == Some(&score.candidate)) {
                Some(refit) => is_small(refit.unknowns) && cost(refit).is_none_or(|cost| cost > SHORT * least),
                None => has_failed(&score.candidate) && (!is_noise || is_small(unknowns(score))),
            };
        let is_beside = |candidate: &Candidate| candidate.joint == winner.joint && *candidate != winner;
        let rivals = shortlist.iter().filter(|score| is_beside(&score.candidate) && fell_short(score));
        let mut rivals: Vec<Candidate> = rivals.map(|score| score.candidate.clone()).collect();
        if rivals.is_empty() {
            return Ok(());
        }
        // What the winner takes the place of is nearest to it.
        rivals.sort_by_key(|candidate| !winner.contains(candidate));
        rivals.truncate(MOST);
        let found = best.parsed()?;
        let start = base.with_values_of(&found);
        let mut asked = rivals;
        asked.push(winner);
        let mut scores = screening.scores(&start, &asked, &|| !(self.stop)());
        self.asked_to_stop()?;
        let reported = |scored: &Scored| scored.1.as_ref().or(scored.0.as_ref()).map_or(0.0, |score| score.information);
        let best = scores.pop().map_or(0.0, |scored| reported(&scored));
        // From values that are right but for the law, a law that may rival the winner tells nearly as much.
        let nearly = asked.into_iter().zip(scores).filter(|(_, scored)| reported(scored) < NEARLY * best);
        let (rivals, scores): (Vec<Candidate>, Vec<Scored>) = nearly.unzip();
        let estimate = |(torque, position): Scored| Some(position.or(torque)?.estimate);
        // The winner's values suit what it takes the place of better than what the screening, which is linear, finds there.
        let mut starts: Vec<Vec<Model>> = scores
            .into_iter()
            .map(|scored| {
                estimate(scored)
                    .map_or_else(Vec::new, |found_there| vec![found_there.with_values_of(&found), found_there])
            })
            .collect();
        if let Some(prior) = self.prior_of(base).filter(|_| !rivals.is_empty()) {
            let scores = screening.scores(&prior, &rivals, &|| !(self.stop)());
            self.asked_to_stop()?;
            for ((starts, candidate), scored) in starts.iter_mut().zip(&rivals).zip(scores) {
                starts.extend(estimate(scored));
                // What the law was first taken for may suit the prior values better than what the screening finds there.
                let first = shortlist.iter().find(|score| score.candidate == *candidate);
                starts.extend(first.map(|score| score.estimate.with_values(&|name| self.prior.prior(name))));
            }
        }
        let fits: Vec<Option<Refit>> = rivals
            .par_iter()
            .zip(starts)
            .map(|(candidate, starts)| {
                (self.tell)(&Event::Refitting(candidate));
                let key = format!("{key} > {candidate}");
                self.remembered(
                    &key,
                    Some(candidate),
                    base,
                    &starts,
                    CostLimits { reached: Some(least), only_noise, enough: None, thorough: true },
                )
                .ok()
            })
            .collect();
        self.asked_to_stop()?;
        take_better(fits.into_iter().flatten(), fitted, failed);
        Ok(())
    }

    /// `base` at the prior values; `None` where those are its own.
    fn prior_of(&self, base: &Model) -> Option<Model> {
        let start = base.with_values(&|name| self.prior.prior(name));
        (start.digest() != base.digest()).then_some(start)
    }

    /// Another start for what the screening finds most promising at the prior values: a model that
    /// lacks an effect may be fitted to values so far off that the effect that is missing does nothing there.
    fn at_prior(
        &self,
        screening: &Screening<'_>,
        (base, is_minimum): (&Model, bool),
        fitted: &mut Vec<Refit>,
        failed: &mut Vec<RejectedCandidate>,
        key: &str,
    ) -> Result<(), DiagnoseError> {
        /// As many are fitted.
        const MOST: usize = 3;
        let Some(start) = self.prior_of(base) else { return Ok(()) };
        if is_minimum && !has_wandered(&start, base) {
            return Ok(());
        }
        let mut promising = shortlist::of(&self.screened(screening, &start)?);
        promising.truncate(2 * MOST);
        let mut reached = prescreening::Reached::default();
        self.prescreening(&start, &promising, &mut reached)?;
        let mut unasked: Vec<Score> = promising[..MOST.min(promising.len())].to_vec();
        unasked.retain(|score| !reached.knows(&score.candidate));
        promising =
            prescreening::ordered(promising, &reached, &|score| self.judge.added_unknowns(&score.estimate, base));
        promising.truncate(MOST);
        // Of what no observer tells, the screening does.
        unasked.retain(|score| promising.iter().all(|other| other.candidate != score.candidate));
        promising.append(&mut unasked);
        for score in promising {
            let reached = fitted.iter().filter_map(Refit::cost).min_by(f64::total_cmp);
            (self.tell)(&Event::Refitting(&score.candidate));
            let key = format!("{key} > {}", score.candidate);
            let starts = std::slice::from_ref(&score.estimate);
            let fit = self.remembered(
                &key,
                Some(&score.candidate),
                base,
                starts,
                CostLimits { reached, ..CostLimits::default() },
            );
            self.asked_to_stop()?;
            take_better(fit.into_iter(), fitted, failed);
            if fitted.iter().any(verdict::explains) {
                break;
            }
        }
        Ok(())
    }

    /// Of candidates that one fold has judged, the best judged by all blocks; those that are not asked get no credit.
    fn confirmed(
        &self,
        before: &Refit,
        by_one_fold: Vec<verdict::Judged>,
        failed: &mut Vec<RejectedCandidate>,
        key: &(dyn Fn(&Candidate) -> String + Sync),
        helps_elsewhere: &dyn Fn(&Refit) -> Option<Rejection>,
    ) -> Result<Vec<verdict::Judged>, DiagnoseError> {
        let (mut waiting, rejected): (Vec<_>, Vec<_>) =
            by_one_fold.into_iter().partition(|judged| judged.reason.is_none());
        let mut asked: Vec<Refit> = Vec::new();
        let mut judged: Vec<verdict::Judged> = Vec::new();
        while !waiting.is_empty() && judged.iter().all(|judged| judged.reason.is_some()) {
            let later = waiting.split_off(blocks::CONFIRMED.min(waiting.len()));
            let fits: Vec<(Candidate, Result<Refit, DiagnoseError>)> = waiting
                .into_par_iter()
                .filter_map(|judged| Some((judged.refit.candidate.clone()?, judged.refit)))
                .map(|(candidate, refit)| {
                    (self.tell)(&Event::Refitting(&candidate));
                    let fit = self.asked_to_stop().and_then(|()| self.over_blocks(&key(&candidate), refit));
                    (candidate, fit)
                })
                .collect();
            self.asked_to_stop()?;
            for (candidate, fit) in fits {
                match fit {
                    Ok(fit) => asked.push(fit),
                    Err(error) => failed.push(verdict::failed(&candidate, &error)),
                }
            }
            judged = verdict::judge(before, asked.clone(), helps_elsewhere);
            waiting = later;
        }
        judged.extend(waiting.into_iter().map(verdict::Judged::unconfirmed));
        judged.extend(rejected);
        Ok(judged)
    }

    /// What the screening says of every candidate: by the torque error, and by simulations.
    fn screened(&self, screening: &Screening<'_>, base: &Model) -> Result<Vec<Scored>, DiagnoseError> {
        let candidates = candidates(base, screening.runs());
        let done = AtomicUsize::new(0);
        let reported = || {
            let count = 1 + done.fetch_add(1, Ordering::Relaxed);
            (self.tell)(&Event::Screened(count, candidates.len()));
            !(self.stop)()
        };
        let scored = screening.scores(base, &candidates, &reported);
        self.asked_to_stop()?;
        Ok(scored)
    }
}

/// Whether a fit has led an effect's parameter far from its prior value. (Links' parameters move far along what the
/// logs do not determine, which means nothing.)
fn has_wandered(prior: &Model, fitted: &Model) -> bool {
    /// Share of the larger of both values.
    const FAR: f64 = 0.3;
    prior.effects.iter().zip(&fitted.effects).any(|(prior, fitted)| {
        let pairs = prior.parameters.iter().zip(&fitted.parameters);
        pairs.into_iter().any(|(a, b)| (a.value - b.value).abs() > FAR * a.value.abs().max(b.value.abs()))
    })
}

/// Whether there is a fit of that candidate.
fn is_fitted(candidate: &Candidate, fitted: &[Refit]) -> bool {
    fitted.iter().any(|refit| refit.candidate.as_ref() == Some(candidate))
}

/// Whether a fit of that candidate explains the logs.
fn has_explained(candidate: &Candidate, fitted: &[Refit]) -> bool {
    fitted.iter().any(|refit| refit.candidate.as_ref() == Some(candidate) && verdict::explains(refit))
}

/// Whether two fits, from different starts, leave the same, and that is not poor: fits that came to nothing may do so alike.
fn come_to_the_same(one: &Refit, other: &Refit) -> bool {
    /// Costs differ by less than this share.
    const SAME: f64 = 1e-3;
    let costs = one.cost().zip(other.cost()).filter(|_| !one.is_poor() && !other.is_poor());
    costs.is_some_and(|(one, other)| (one - other).abs() <= SAME * one.min(other))
}

/// Puts refits in the place of those of the same candidates that cost more, or of none.
fn take_better(refits: impl Iterator<Item = Refit>, fitted: &mut Vec<Refit>, failed: &mut Vec<RejectedCandidate>) {
    let cost = |refit: &Refit| refit.cost().filter(|_| refit.is_finite());
    for refit in refits {
        let own = |other: &Refit| other.candidate == refit.candidate;
        let before = fitted.iter().find(|other| own(other)).and_then(cost).unwrap_or(f64::INFINITY);
        if cost(&refit).is_some_and(|cost| cost < before) {
            failed.retain(|failed| Some(&failed.candidate) != refit.candidate.as_ref());
            fitted.retain(|other| !own(other));
            fitted.push(refit);
        }
    }
}

/// Steps per sample of simulations that only screen.
fn screening_substeps(runs: &[&Run]) -> usize {
    let sample = runs.iter().map(|run| run.log.sample_time()).fold(0.0, f64::max);
    (sample / SCREENING_STEP).ceil().clamp(1.0, 60.0) as usize
}
