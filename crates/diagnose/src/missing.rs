//! One step of a diagnosis: the effect that raises the likelihood of the logs most.

use std::collections::BTreeMap;

use dynid_identify::SearchControl;
use dynid_identify::position::{FitRun, PositionFitError};
use dynid_identify::prediction::{
    self, HeldOut, JointInnovations, Plan, PredictionFit, PredictionProblem, Search, State, Tangent,
};
use dynid_logs::experiment::Run;
use dynid_logs::motion::Motion;
use dynid_logs::noise::noise_of_joint;
use dynid_model::Parameter;
use dynid_user_model::{EffectInstance, Model};
use rayon::prelude::*;

use crate::arms::{Arm, race};
use crate::candidate::{Candidate, Probe, Sizes, candidates, make_alike, probes};
use crate::disturbance;
use crate::refit::count;
use crate::score_test::{RATES, ScoreTest, Start, at_rates, promising};
use crate::settings::Settings;
use dynid_logs::part::part;

/// A model that was fitted, and what it makes of the runs.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// What was added to the model that is diagnosed; `None` for that model itself.
    pub candidate: Option<Candidate>,
    /// The model.
    pub model: Model,
    /// The fit.
    pub fit: PredictionFit,
    /// What it makes of the runs held out; `None` where it cannot simulate them.
    pub held_out: Option<HeldOut>,
    /// How many unknown effect parameters the model has beyond the one that was given.
    pub unknowns: f64,
    /// Where its search is.
    pub state: State,
    /// Whether it was followed with fine integration steps to its end, or until it would not come near the best.
    pub is_final: bool,
}

impl Fitted {
    /// Log likelihood of all runs, less the price of the unknowns.
    pub fn score(&self) -> f64 {
        let held_out = self.held_out.as_ref().map_or(f64::NEG_INFINITY, |held_out| held_out.log_likelihood);
        self.fit.log_likelihood + held_out - self.price()
    }

    /// What its unknowns cost, in log likelihood: half the logarithm of the samples each (Schwarz 1978).
    pub fn price(&self) -> f64 {
        let samples: f64 = self.fit.joints.iter().map(|joint| joint.samples).sum();
        0.5 * self.unknowns * samples.max(2.0).ln()
    }

    /// The largest share of an innovation that corrects a position: near 0, the model is trusted altogether.
    pub fn correction(&self) -> f64 {
        self.fit.joints.iter().map(|joint| joint.correction).fold(0.0, f64::max)
    }

    /// Whether what is left has no structure, in the runs held out too.
    pub fn is_white(&self, settings: &Settings) -> bool {
        let held_out = self.held_out.iter().flat_map(|held_out| &held_out.joints);
        whiteness(self.fit.joints.iter().chain(held_out)) < settings.white
    }

    /// Whether nothing is left to explain of the runs that were fitted to.
    pub fn is_whole(&self, settings: &Settings) -> bool {
        self.correction() < settings.trusted && whiteness(self.fit.joints.iter()) < settings.white
    }

    /// By how much the log likelihood falls short of what it were if nothing but the noise of these logs were left.
    fn falls_short(&self, runs: &[Run]) -> f64 {
        let short = |joint: &JointInnovations| {
            let noise = noise_at(runs.iter(), joint.joint);
            joint.samples * (joint.deviation / noise).ln().max(0.0)
        };
        self.fit.joints.iter().map(short).sum()
    }

    /// How much of what the log likelihood of `before` falls short of this makes up for.
    pub fn explains(&self, before: &Self, runs: &[Run]) -> f64 {
        let attainable = before.falls_short(runs).max(f64::MIN_POSITIVE);
        (self.fit.log_likelihood - before.fit.log_likelihood) / attainable
    }

    /// Log likelihood of each tenth of each run, those held out coming last.
    fn by_tenths(&self) -> Vec<f64> {
        let of_tenth = |joints: &[JointInnovations], tenth: usize| -> f64 {
            let of_joint = |own: &JointInnovations| {
                let fitted = self.fit.joints.iter().find(|fitted| fitted.joint == own.joint)?;
                let (samples, squares) = own.tenths[tenth];
                Some(-0.5 * (2.0 * samples * fitted.deviation.ln() + squares / fitted.deviation.powi(2)))
            };
            joints.iter().filter_map(of_joint).sum()
        };
        let of_runs = |joints: &[JointInnovations]| -> Vec<f64> {
            (0..joints.first().map_or(0, |own| own.tenths.len())).map(|tenth| of_tenth(joints, tenth)).collect()
        };
        let held_out = self.held_out.as_ref().map(|held_out| of_runs(&held_out.joints));
        of_runs(&self.fit.joints).into_iter().chain(held_out.into_iter().flatten()).collect()
    }

    /// Whether what `other` falls short by may be chance: it is less than `least` or, of laws of which neither contains the other and that
    /// are not told apart the same way by the runs that were fitted to and those held out, not much for how it differs from part to part
    /// of the logs (Vuong 1989). Of such laws it may be more unknowns alone that `other` falls short by: the logs do not tell these apart.
    pub fn is_like(&self, other: &Self, least: f64, settings: &Settings) -> bool {
        let on_fitted = self.fit.log_likelihood - other.fit.log_likelihood;
        let price = self.price() - other.price();
        let on_all = self.score() - other.score() + price;
        let on_held_out = on_all - on_fitted;
        let pair = self.candidate.as_ref().zip(other.candidate.as_ref());
        if pair.is_some_and(|(own, other)| own.contains(other) || other.contains(own)) {
            return (on_all - price).abs() <= least;
        }
        let parts: Vec<f64> = self.by_tenths().iter().zip(other.by_tenths()).map(|(own, other)| own - other).collect();
        let n = parts.len().max(2) as f64;
        let mean = parts.iter().sum::<f64>() / n;
        let variance = parts.iter().map(|part| (part - mean).powi(2)).sum::<f64>() * n / (n - 1.0);
        let by_chance = (settings.apart * variance.sqrt()).max(least);
        let is_chance = |priced: f64| {
            let agree = (on_fitted - priced) * on_held_out > 0.0;
            (on_all - priced).abs() <= if agree { least } else { by_chance }
        };
        is_chance(price) || is_chance(0.0)
    }

    /// As the model that more is added to.
    pub fn as_base(&self) -> Self {
        Self { candidate: None, ..self.clone() }
    }
}

/// The noise of a joint's logs, which may be divided by [rad or m].
pub fn noise_at<'a>(runs: impl Iterator<Item = &'a Run>, joint: usize) -> f64 {
    noise_of_joint(runs, joint).max(f64::MIN_POSITIVE)
}

/// The worst joint's.
fn whiteness<'a>(joints: impl Iterator<Item = &'a JointInnovations>) -> f64 {
    joints.map(|joint| joint.whiteness).fold(0.0, f64::max)
}

/// A model, rates, where each run starts and integration steps.
type Point = (Model, BTreeMap<usize, f64>, Vec<Vec<f64>>, Plan);

/// Runs, and how models are fitted to them.
#[derive(Clone)]
pub struct Logs<'a> {
    /// The model that was given: what is believed.
    pub given: &'a Model,
    /// Runs to fit to.
    pub fit: Vec<Run>,
    /// Runs held out.
    pub held_out: Vec<Run>,
    /// How.
    pub settings: Settings,
    /// Rates at which every model is held to the logs [1/s], by joint; `None` where they are estimated.
    pub rates: Option<BTreeMap<usize, f64>>,
    /// Recalls a state.
    pub recall: &'a (dyn Fn(&str) -> Option<State> + Sync),
    /// Keeps one.
    pub keep: &'a (dyn Fn(&str, &State) + Sync),
    /// Asked between iterations.
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

impl<'a> Logs<'a> {
    /// With default settings and estimated rates; nothing is recalled or kept, and nobody stops it.
    pub fn new(given: &'a Model, fit: Vec<Run>, held_out: Vec<Run>) -> Self {
        let settings = Settings::default();
        Self { given, fit, held_out, settings, rates: None, recall: &|_| None, keep: &|_, _| (), stop: &|| false }
    }
}

impl Logs<'_> {
    fn expected(&self, name: &str) -> Option<f64> {
        self.given.prior(name)
    }

    /// What is fitted of a model; bounds of effects that were not given are those of physics alone.
    fn problem(&self, model: &Model) -> Result<PredictionProblem, PositionFitError> {
        self.problem_of(model, &self.fit)
    }

    fn problem_of(&self, model: &Model, runs: &[Run]) -> Result<PredictionProblem, PositionFitError> {
        let mut problem = PredictionProblem::of_model(model, &|name| self.expected(name), runs)?;
        if let Some(rates) = &self.rates {
            problem.rates.clone_from(rates);
            problem.keeps_rates = true;
        }
        for unknown in &mut problem.unknowns {
            let of_effect = |own: &EffectInstance| {
                let own = own
                    .effect
                    .parameters
                    .iter()
                    .enumerate()
                    .find(|(index, _)| own.parameter_name(*index) == unknown.name);
                own.map(|(_, own)| own)
            };
            let own =
                model.effects.iter().find_map(of_effect).filter(|_| self.given.parameter(&unknown.name).is_none());
            let Some(own) = own else { continue };
            // A size that may be negative may be anything.
            let is_size = own.null.is_some();
            let lower = if is_size && own.lower < 0.0 { f64::NEG_INFINITY } else { own.lower };
            let upper = if is_size { f64::INFINITY } else { own.upper };
            (unknown.lower, unknown.upper) = (lower.min(unknown.lower), upper.max(unknown.upper));
        }
        Ok(problem)
    }

    /// The model itself, fitted.
    pub fn base(&self, model: &Model, key: &str) -> Result<Fitted, PositionFitError> {
        let problem = self.problem(model)?;
        self.fitted(None, model, &self.to_its_end(&problem, key)?, true)
    }

    /// The model as it was given, fitted: of long runs to their beginnings first, for the way to where it ends needs not all samples.
    pub fn first_base(&self, key: &str) -> Result<Fitted, PositionFitError> {
        if self.of_all() < 2.0 {
            return self.base(self.given, key);
        }
        let beginnings = self.problem_of(self.given, &self.beginnings())?;
        // What cannot be simulated there begins in all of the runs.
        let begun = self.to_its_end(&beginnings, &format!("{key} beginnings")).ok();
        let problem = self.problem(self.given)?;
        let search = self.followed(&problem, key, begun.as_ref().map(Search::state), None);
        self.fitted(None, self.given, &search.or_else(|_| self.to_its_end(&problem, key))?, true)
    }

    /// Whether a search in these logs, from the values of a fit to others of the same samples, may gain so much log likelihood of the runs
    /// fitted to and held out: it goes on in rounds as an arm does.
    pub fn may_gain(&self, least: f64, over: &Fitted) -> Result<bool, PositionFitError> {
        let mut problem = self.problem(&over.model)?;
        problem.rates.clone_from(&over.fit.rates);
        problem.initial.clone_from(&over.fit.initial);
        let Some(best) = over.state.cost else { return Ok(true) };
        let enough = best - self.fitted_share() * least;
        let mut search = Search::new(&problem, None)?;
        self.follow(&mut search, Some(enough), &|cost| cost <= enough);
        Ok((self.stop)() || search.state().cost.is_some_and(|cost| cost <= enough))
    }

    /// Share of a gain in all runs that those fitted to have: a sample that is held out gains as one that is fitted to.
    fn fitted_share(&self) -> f64 {
        let (fitted, held_out) = (samples(&self.fit), samples(&self.held_out));
        fitted as f64 / (fitted + held_out).max(1) as f64
    }

    /// Takes a search on in rounds, as an arm is, to its end; unless it `is_over`, or so many rounds like the last would not bring it to
    /// `enough`.
    fn follow(&self, search: &mut Search<'_>, enough: Option<f64>, is_over: &dyn Fn(f64) -> bool) {
        let cost = |search: &Search<'_>| search.state().cost.unwrap_or(f64::INFINITY);
        let end = search.iterations() + self.settings.search.iterations;
        let mut before = cost(search);
        loop {
            let round = self.settings.of_round(self.settings.linearisations.0, search);
            let go_on = || if (self.stop)() { SearchControl::Stop } else { SearchControl::Continue };
            search.advance(&self.settings.search, round.min(end - search.iterations()), &mut |_| go_on());
            let now = cost(search);
            let may_come = enough.is_none_or(|enough| now - enough <= self.settings.rounds * (before - now));
            let is_at_end = search.state().is_done || search.iterations() >= end;
            if is_at_end || is_over(now) || !may_come || (self.stop)() {
                return;
            }
            before = now;
        }
    }

    /// Follows a fit to its end with fine integration steps, unless it would not come to `enough`.
    fn finish(
        &self,
        candidate: Option<&Candidate>,
        model: &Model,
        (state, enough): (Option<&State>, Option<f64>),
        key: &str,
    ) -> Result<Fitted, PositionFitError> {
        let problem = self.problem(model)?;
        let key = match candidate {
            Some(candidate) => format!("{key} > {candidate}, final"),
            None => format!("{key} final"),
        };
        let search = self.followed(&problem, &key, state, enough)?;
        self.fitted(candidate, model, &search, true)
    }

    /// A search from the beginning that has come to its end, or the one that is kept under this key.
    fn to_its_end<'p>(&self, problem: &'p PredictionProblem, key: &str) -> Result<Search<'p>, PositionFitError> {
        self.followed(problem, key, None, None)
    }

    /// A search that has come to its end, or would not come to `enough`: the one that is kept under this key, or one from `state` or from
    /// the beginning. One that was stopped on its way is not kept: it would go on to other bits than if it had not been.
    fn followed<'p>(
        &self,
        problem: &'p PredictionProblem,
        key: &str,
        state: Option<&State>,
        enough: Option<f64>,
    ) -> Result<Search<'p>, PositionFitError> {
        let recalled = (self.recall)(key);
        let is_new = recalled.is_none();
        let mut search = match state.filter(|_| is_new) {
            Some(state) => Search::reopened(problem, state, &self.settings.search)?,
            None => Search::new(problem, recalled)?,
        };
        if is_new {
            self.follow(&mut search, enough, &|_| false);
        }
        if !(self.stop)() {
            (self.keep)(key, search.state());
        }
        Ok(search)
    }

    fn fitted(
        &self,
        candidate: Option<&Candidate>,
        start: &Model,
        search: &Search<'_>,
        is_final: bool,
    ) -> Result<Fitted, PositionFitError> {
        let fit = search.result()?;
        let model = with_values(start, &fit);
        let held_out: Result<Vec<FitRun>, _> = self.held_out.iter().map(|run| FitRun::of_run(&model, run)).collect();
        let integration = if is_final { self.settings.search.integration } else { prediction::ROUGHLY };
        let held_out = prediction::held_out(held_out?, &fit, self.rates.is_some(), integration).ok();
        Ok(Fitted {
            candidate: candidate.cloned(),
            unknowns: self.added_unknowns(&model),
            model,
            fit,
            held_out,
            state: search.state().clone(),
            is_final,
        })
    }

    /// How many effects could be added to a model, at all places.
    pub fn places(&self, model: &Model) -> usize {
        candidates(model, &self.fit.iter().collect::<Vec<_>>()).len()
    }

    /// Starts for every effect at every place, those that are fitted first coming first: asked at the values of `base`, at those that
    /// were believed before any fit, and at those of others.
    pub fn starts(
        &self,
        base: &Fitted,
        others: &[&Fitted],
        is_asked: &dyn Fn(&Candidate) -> bool,
    ) -> Result<Vec<Start>, PositionFitError> {
        let model = &base.model;
        let mut points = Vec::new();
        if others.is_empty() {
            points.push((model.clone(), base.fit.rates.clone(), base.fit.initial.clone(), base.fit.plan.clone()));
            let believed = model.with_values(&|name| self.given.prior(name));
            let problem = self.problem(&believed)?;
            // Where nothing but noise is left, nothing is to be found from other values.
            let is_asked = !self.leaves_nothing(base);
            if let Some(search) = is_asked.then(|| Search::new(&problem, None).ok()).flatten() {
                let (rates, initial) = search.nuisance();
                points.push((believed, rates, initial, search.state().plan.clone()));
            }
        }
        for other in others {
            let fit = &other.fit;
            points.push((model.with_values_of(&other.model), fit.rates.clone(), fit.initial.clone(), fit.plan.clone()));
        }
        let mut all = candidates(model, &self.fit.iter().collect::<Vec<_>>());
        all.retain(is_asked);
        if all.is_empty() {
            return Ok(Vec::new());
        }
        let mut lists = Vec::new();
        for point in &points {
            let starts = self.asked(point, &all)?;
            // What promises least there is not asked elsewhere.
            let promising = promising(&starts, self.settings.further);
            all.retain(|candidate| promising.contains(candidate));
            lists.push(in_turn(&starts).into_iter());
        }
        // The first of each list, the second of each, ..
        let mut merged = Vec::new();
        loop {
            let before = merged.len();
            merged.extend(lists.iter_mut().filter_map(Iterator::next));
            if merged.len() == before {
                return Ok(merged);
            }
        }
    }

    /// Those of starts at a fitted model whose candidates promise more than `least` in all that is fitted to, not only in the beginnings.
    pub fn shown(&self, base: &Fitted, mut starts: Vec<Start>, least: f64) -> Result<Vec<Start>, PositionFitError> {
        let of_all = self.of_all();
        starts.retain(|start| of_all * start.promise > least);
        if starts.is_empty() {
            return Ok(starts);
        }
        let mut probes = self.probes(&base.model, &promising(&starts, starts.len()));
        keep_promising(&mut probes, &starts, self.settings.arms);
        let PredictionFit { rates, initial, plan, .. } = &base.fit;
        let expected = |name: &str| self.expected(name);
        let test = ScoreTest::new(&base.model, (rates, RATES.len()), (initial, plan), &self.fit, &expected)?;
        let shown = test.ask(&probes, &|| !(self.stop)());
        starts.retain(|start| shown.iter().any(|own| own.candidate == start.candidate && own.promise > least));
        Ok(starts)
    }

    /// All candidates' probes at the values of a model.
    fn probes(&self, model: &Model, all: &[Candidate]) -> Vec<(Candidate, Vec<Probe>)> {
        let motions = self.fit.iter().filter_map(|run| Some((run, Motion::of(run).ok()?)));
        let (with_motion, motions): (Vec<&Run>, Vec<Motion>) = motions.unzip();
        let joints = 0..model.device.joints.len();
        let sizes: Vec<Sizes> = joints.map(|joint| Sizes::of(model, &with_motion, &motions, joint)).collect();
        let own = |candidate: &Candidate| probes(model, candidate, &sizes[candidate.joint.unwrap_or(0)]);
        all.iter().map(|candidate| (candidate.clone(), own(candidate))).collect()
    }

    /// What candidates promise at a model with these rates, starts of the runs and integration steps. Of many, a short look at the fitted
    /// rates tells which are worth a longer one, and from which values.
    fn asked(&self, point: &Point, all: &[Candidate]) -> Result<Vec<Start>, PositionFitError> {
        let (model, rates, initial, plan) = point;
        let expected = |name: &str| self.expected(name);
        let mut probes = self.probes(model, all);
        let go_on = || !(self.stop)();
        let n_probes: usize = probes.iter().map(|(_, own)| own.len()).sum();
        if n_probes > self.settings.further * self.settings.arms {
            let share = (self.settings.further as f64 / all.len() as f64).min(1.0);
            let beginnings = self.beginnings_of_seconds(self.settings.beginning.0 * share);
            let test = ScoreTest::new(model, (rates, 1), (initial, plan), &beginnings, &expected)?;
            let starts = test.ask(&probes, &go_on);
            let promising = promising(&starts, self.settings.further);
            probes.retain(|(candidate, _)| promising.contains(candidate));
            keep_promising(&mut probes, &starts, self.settings.arms);
        }
        let beginnings = self.beginnings();
        let test = ScoreTest::new(model, (rates, RATES.len()), (initial, plan), &beginnings, &expected)?;
        Ok(test.ask(&probes, &go_on))
    }

    /// Starts for one effect that is added to the model as it is given, the most promising first; `None` where that cannot be simulated.
    pub fn promising(&self, candidate: &Candidate) -> Option<Vec<Start>> {
        let problem = self.problem(self.given).ok()?;
        let search = Search::new(&problem, None).ok()?;
        let (rates, initial) = search.nuisance();
        let point = (self.given.clone(), rates, initial, search.state().plan.clone());
        let starts = self.asked(&point, std::slice::from_ref(candidate)).ok()?;
        Some(starts.into_iter().filter(|start| start.promise > 0.0).collect())
    }

    /// Whether a fit leaves nothing that another would be looked for: its innovations are white and no larger than the noise.
    fn leaves_nothing(&self, fitted: &Fitted) -> bool {
        let samples: f64 = fitted.fit.joints.iter().map(|joint| joint.samples).sum();
        let is_at_noise = || fitted.falls_short(&self.fit) <= 0.5 * self.settings.trusted * samples;
        let is_white = || whiteness(fitted.fit.joints.iter()) < self.settings.white;
        fitted.is_whole(&self.settings) || (is_white() && is_at_noise())
    }

    /// Whether what a fit leaves may be noise of the logs: its innovations are white, and what acts on a joint whose model is not trusted is
    /// no more than noise of the logged torque, or not known.
    pub fn leaves_noise(&self, fitted: &Fitted) -> bool {
        let is_noise = |left: &JointInnovations| {
            left.correction < self.settings.trusted
                || disturbance::over_torque_noise(fitted, left, &self.fit)
                    .is_none_or(|ratio| ratio < self.settings.near)
        };
        fitted.is_white(&self.settings) && fitted.fit.joints.iter().all(is_noise)
    }

    /// Whether a fit explains the runs held out as it does those that were fitted to, or to their noise.
    pub fn holds_elsewhere(&self, fitted: &Fitted) -> bool {
        let deviation = |joint: usize| {
            let known = fitted.fit.joints.iter().find(|own| own.joint == joint).map_or(0.0, |own| own.deviation);
            known.max(noise_at(self.held_out.iter(), joint))
        };
        let is_explained = |own: &JointInnovations| {
            own.correction < self.settings.trusted && own.deviation < self.settings.near * deviation(own.joint)
        };
        let held_out = || fitted.held_out.as_ref().is_some_and(|held_out| held_out.joints.iter().all(is_explained));
        self.held_out.is_empty() || held_out()
    }

    /// Fits the most promising starts; all that were followed to their end, best first. It gives up where the best of a batch leaves
    /// more than noise and `explains` less than this share, where one is asked for.
    pub fn best(
        &self,
        base: &Fitted,
        starts: &[Start],
        key: &str,
        share: Option<f64>,
    ) -> Result<Vec<Fitted>, PositionFitError> {
        let mut found: Vec<Fitted> = Vec::new();
        let asked = promising(starts, self.settings.further);
        let mut ordered = starts.to_vec();
        let mut asked_at: Vec<Option<Candidate>> = Vec::new();
        // Another effect may be found beside what leaves noise.
        let is_enough = |best: &Fitted| self.leaves_noise(best) || self.leaves_nothing(best);
        for batch in 0..self.settings.batches {
            let key = format!("{key}.{batch}");
            let best_before = found.first().map(|best| best.candidate.clone());
            let later = ordered.split_off(ordered.len().min(self.settings.arms));
            self.race(base, &ordered, &key, &mut found)?;
            self.settle(base, &mut found, &key)?;
            ordered = later;
            let explains = |best: &Fitted, share: f64| is_enough(best) || best.explains(base, &self.fit) >= share;
            if share.is_some_and(|share| !found.first().is_some_and(|best| explains(best, share))) {
                break;
            }
            // A smaller law may do as well from the best one's values, and a larger one better.
            while let Some(best) = found.first().filter(|best| !asked_at.contains(&best.candidate)).cloned() {
                let key = format!("{key} there {}", asked_at.len());
                asked_at.push(best.candidate.clone());
                // What leaves noise has no rivals but with fewer unknowns, or laws that contain it where the errors are large.
                let (is_enough, is_all) = (is_enough(&best), self.leaves_nothing(&best));
                let is_smaller = |model: &Model| self.added_unknowns(model) < best.unknowns;
                let is_rival = |candidate: &Candidate| {
                    let mut model = base.model.clone();
                    let Candidate { effect, joint, from } = candidate;
                    Some(candidate) != best.candidate.as_ref()
                        && asked.contains(candidate)
                        && model.add_effect(effect, *joint, *from).is_ok()
                        && (!is_enough || is_smaller(&model))
                };
                let mut starts = self.starts(base, &[&best], &is_rival)?;
                starts.truncate(self.settings.later_arms);
                starts.extend(self.kin(base, &best).into_iter().filter(|start| !is_all || is_smaller(&start.model)));
                self.race(base, &starts, &key, &mut found)?;
                self.settle(base, &mut found, &key)?;
            }
            // What promises less is not asked where the last batch brought nothing better.
            let is_settled = batch > 0 && found.first().map(|best| best.candidate.clone()) == best_before;
            if found.first().is_some_and(is_enough) || ordered.is_empty() || is_settled {
                break;
            }
        }
        Ok(found)
    }

    /// Follows those to their end that are or may be the best, as long as they may come to it.
    fn settle(&self, base: &Fitted, found: &mut [Fitted], key: &str) -> Result<(), PositionFitError> {
        let rough = self.settings.rough * base.fit.joints.iter().map(|joint| joint.samples).sum::<f64>();
        loop {
            let Some(best) = found.first().map(Fitted::score) else { return Ok(()) };
            let near: Vec<usize> =
                (0..found.len()).filter(|k| !found[*k].is_final && best - found[*k].score() < rough).collect();
            if near.is_empty() {
                return Ok(());
            }
            let finished: Vec<Fitted> = near
                .par_iter()
                .map(|k| {
                    let Fitted { candidate, model, state, .. } = &found[*k];
                    // What may fall short of it by chance, or by rough steps, is worth its end too.
                    let short = best - found[*k].score() - prediction::ROUGHLY;
                    let enough = state.cost.filter(|_| *k > 0).map(|cost| cost - self.fitted_share() * short);
                    let finished = self.finish(candidate.as_ref(), model, (Some(state), enough), key);
                    finished.unwrap_or_else(|_| Fitted { is_final: true, ..found[*k].clone() })
                })
                .collect();
            near.into_iter().zip(finished).for_each(|(k, finished)| found[k] = finished);
            found.sort_by(|one, other| other.score().total_cmp(&one.score()));
        }
    }

    /// Laws that contain the best one or are contained in it, with its values.
    fn kin(&self, base: &Fitted, best: &Fitted) -> Vec<Start> {
        let (base, there) = (&base.model, &best.model);
        let Some(own) = &best.candidate else { return Vec::new() };
        let all = candidates(base, &self.fit.iter().collect::<Vec<_>>());
        let starts = |candidate: Candidate| -> Vec<Start> {
            let Candidate { effect, joint, from } = &candidate;
            let mut models = Vec::new();
            if own.contains(&candidate) {
                let mut model = base.clone();
                if model.add_effect(effect, *joint, *from).is_ok() {
                    models.push(model.with_values_of(there));
                }
            } else {
                // As guessed beside what it keeps, and as it was: what is new does nothing.
                let (mut guessed, mut alike) = (there.clone(), there.clone());
                if guessed.add_effect(effect, *joint, *from).is_ok() {
                    models.push(guessed);
                }
                if alike.add_effect_at_null(effect, *joint, *from).is_ok() {
                    make_alike(&mut alike, there, &candidate);
                    models.push(alike);
                }
            }
            let start = |(probe, model)| {
                let candidate = candidate.clone();
                Start { candidate, model, promise: 0.0, probe, step: Vec::new() }
            };
            models.into_iter().enumerate().map(start).collect()
        };
        all.into_iter().filter(|other| own.contains(other) || other.contains(own)).flat_map(starts).collect()
    }

    /// How many times the samples of the beginnings that promises rest on the runs to fit to have.
    pub fn of_all(&self) -> f64 {
        samples(&self.fit) as f64 / samples(&self.beginnings()).max(1) as f64
    }

    /// The beginnings of the runs to fit to, of about so many samples over all joints.
    pub fn beginnings_of(&self, samples: usize) -> Vec<Run> {
        let a_second: f64 = self.fit.iter().map(|run| run.free.len() as f64 / run.log.sample_time()).sum();
        self.fit.iter().map(|run| beginning(run, samples as f64 / a_second)).collect()
    }

    /// How the predictions of `base` answer to anything, in the runs that it `is_fitted` to or their beginnings, or in others, at this
    /// multiple of its rates; and its unknown parameters, which come first among the unknowns.
    pub fn tangent(&self, base: &Fitted, runs: &[Run], rate: f64, is_fitted: bool) -> Option<(Tangent, Vec<String>)> {
        let mut problem = self.problem_of(&base.model, runs).ok()?;
        problem.rates = at_rates(&base.fit.rates, rate);
        problem.keeps_rates = false;
        let plan = if is_fitted {
            problem.initial.clone_from(&base.fit.initial);
            base.fit.plan.clone()
        } else {
            Search::new(&problem, None).ok()?.state().plan.clone()
        };
        let names = problem.unknowns.iter().map(|unknown| unknown.name.clone()).collect();
        Some((Tangent::new(&problem, &plan)?, names))
    }

    /// The beginnings of the runs that promises and races rest on.
    fn beginnings(&self) -> Vec<Run> {
        self.beginnings_of_seconds(self.settings.beginning.0)
    }

    /// The beginnings of the runs, so many seconds of all and at least `Settings::beginning.1` of each.
    fn beginnings_of_seconds(&self, all: f64) -> Vec<Run> {
        let each = (all / self.fit.len() as f64).max(self.settings.beginning.1);
        self.fit.iter().map(|run| beginning(run, each)).collect()
    }

    /// Number of unknown effect parameters of `model` beyond those of the one that was given.
    fn added_unknowns(&self, model: &Model) -> f64 {
        count(model, &self.fit) - count(self.given, &self.fit)
    }

    /// The model without some of what was found before, fitted from the values with it: where the later makes the earlier needless.
    pub fn without(&self, whole: &Fitted, kept: &[&Candidate], key: &str) -> Option<Fitted> {
        let mut model = self.given.clone();
        for Candidate { effect, joint, from } in kept {
            model.add_effect(effect, *joint, *from).ok()?;
        }
        let model = model.with_values_of(&whole.model);
        let mut problem = self.problem(&model).ok()?;
        problem.initial.clone_from(&whole.fit.initial);
        problem.rates.clone_from(&whole.fit.rates);
        let search = self.to_its_end(&problem, key).ok()?;
        self.fitted(whole.candidate.as_ref(), &model, &search, true).ok()
    }

    /// Fits the beginnings of the runs, the best of `found` among the starts: what falls far behind it is left.
    fn race(
        &self,
        base: &Fitted,
        starts: &[Start],
        key: &str,
        found: &mut Vec<Fitted>,
    ) -> Result<(), PositionFitError> {
        let beginnings = self.beginnings();
        let samples = samples(&beginnings);
        let arm = |key: String, candidate: Option<&Candidate>, model: &Model, from: &PredictionFit| {
            let mut problem = self.problem_of(model, &beginnings)?;
            problem.initial.clone_from(&from.initial);
            problem.rates.clone_from(&from.rates);
            problem.plan.clone_from(&base.fit.plan);
            let price = 0.5 * self.added_unknowns(model) * (samples as f64).max(2.0).ln();
            let (candidate, model) = (candidate.cloned(), model.clone());
            Ok::<Arm, PositionFitError>(Arm {
                candidate,
                model,
                key,
                problem,
                price,
                state: None,
                before: f64::INFINITY,
            })
        };
        let mut arms = Vec::new();
        for (number, start) in starts.iter().enumerate() {
            let key = format!("{key} > {} {number}", start.candidate);
            arms.push(arm(key, Some(&start.candidate), &start.model, &base.fit)?);
        }
        let known = format!("{key} > best");
        if let Some(best) = found.first().filter(|_| !starts.is_empty()) {
            arms.push(arm(known.clone(), best.candidate.as_ref(), &best.model, &best.fit)?);
        }
        let mut arms = race(arms, &self.settings, self.recall, self.keep, self.stop);
        let known = arms.iter().position(|arm| arm.key == known).map(|place| arms.remove(place).cost());
        let best = known.unwrap_or(f64::INFINITY);
        arms.retain(|arm| arm.cost().is_finite() && arm.cost() <= best + self.settings.rough * samples as f64);
        let fitted = arms.par_iter().enumerate().map(|(place, arm)| {
            // The best is followed to its end in any case.
            let is_best = place == 0 && arm.cost() < best;
            let state = (arm.state.as_ref(), None);
            let finish = || self.finish(arm.candidate.as_ref(), &arm.model, state, &arm.key).ok();
            if let Some(finished) = is_best.then(finish).flatten() {
                return Ok(Some(finished));
            }
            let problem = self.problem(&arm.model)?;
            let search = Search::new(&problem, arm.state.clone());
            Ok(search.and_then(|search| self.fitted(arm.candidate.as_ref(), &arm.model, &search, false)).ok())
        });
        for fitted in fitted.collect::<Result<Vec<_>, PositionFitError>>()?.into_iter().flatten() {
            match found.iter_mut().find(|other| other.candidate == fitted.candidate) {
                Some(other) if other.score() < fitted.score() => *other = fitted,
                Some(_) => {}
                None => found.push(fitted),
            }
        }
        found.sort_by(|one, other| other.score().total_cmp(&one.score()));
        Ok(())
    }
}

/// Keeps so many probes of each candidate, those that its starts promise most from.
fn keep_promising(probes: &mut [(Candidate, Vec<Probe>)], starts: &[Start], most: usize) {
    for (candidate, own) in probes {
        let best = starts.iter().filter(|start| start.candidate == *candidate).take(most);
        let best: Vec<usize> = best.map(|start| start.probe).collect();
        let mut place = 0..;
        own.retain(|_| place.next().is_some_and(|place| best.contains(&place)));
    }
}

/// Starts in the order in which they are fitted: the best of each candidate first; a second one of a candidate stands among the firsts
/// of candidates that promise less.
fn in_turn(starts: &[Start]) -> Vec<Start> {
    /// Places that a further start of a candidate stands behind its own.
    const LATER: usize = 12;
    let mut seen: BTreeMap<&Candidate, (usize, usize)> = BTreeMap::new();
    let mut turns: Vec<(usize, &Start)> = Vec::new();
    for start in starts {
        let next = seen.len();
        let (place, before) = seen.entry(&start.candidate).or_insert((next, 0));
        turns.push((*place + LATER * *before, start));
        *before += 1;
    }
    turns.sort_by_key(|(turn, _)| *turn);
    turns.into_iter().map(|(_, start)| start.clone()).collect()
}

/// `model` with the values of a fit, its bounds widened to hold them.
fn with_values(model: &Model, fit: &PredictionFit) -> Model {
    let mut model = model.clone();
    for estimate in &fit.parameters {
        if let Some(Parameter { lower, upper, fixed, .. }) = model.parameter(&estimate.name) {
            let value = estimate.value;
            let parameter = Parameter { value, lower: lower.min(value), upper: upper.max(value), fixed };
            // The names are the model's own.
            let _known = model.set(&estimate.name, parameter);
        }
    }
    model
}

/// Samples of all joints.
fn samples(runs: &[Run]) -> usize {
    runs.iter().map(|run| run.log.len() * run.free.len()).sum()
}

/// The first seconds of a run.
fn beginning(run: &Run, seconds: f64) -> Run {
    let end = run.log.t[0] + run.settings.from_s.unwrap_or(0.0) + seconds;
    part(run, 0..run.log.t.partition_point(|t| *t <= end), run.role)
}

#[cfg(test)]
mod tests;
