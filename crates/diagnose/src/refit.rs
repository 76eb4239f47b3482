//! Real fits of a candidate, judged on the held-out runs: only these decide.

use std::collections::{BTreeMap, BTreeSet};

use dynid_model::{Parameter, Place};
use serde::{Deserialize, Serialize};

use super::{
    FEW_JOINTS,
    candidate::{Candidate, instance},
    verdict,
};
use crate::DiagnoseError;
use dynid_check::excitation::moves;
use dynid_identify::{
    FitStatus, identify, identify::ErrorSignal, identify::FitResult, identify::FitTask, position,
    position::WithObserver, position::noise_of, starts::Starts,
};
use dynid_judge::{compare::Comparison, compare::compare};
use dynid_logs::{experiment::Experiment, experiment::Role, experiment::Run, noise::noise_of_log};
use dynid_optimise::sqp::SearchControl;
use dynid_signal::{is_white, statistics::correlation_time, statistics::counted};
use dynid_user_model::Model;

/// A model that was fitted, or whose fit was given up, and what it leaves.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Refit {
    /// What was added to the model that is diagnosed; `None` for that model itself.
    pub candidate: Option<Candidate>,
    /// The model, as a file.
    pub model: String,
    /// How the fit ended.
    pub status: FitStatus,
    /// How far it was followed.
    pub followed: SearchExtent,
    /// The candidate's own parameters; of the model itself all that moved.
    pub parameters: Vec<EffectParameter>,
    /// Number of unknowns that the candidate brings beyond those that it takes the place of.
    pub unknowns: f64,
    /// Root mean square of the position error over the runs to fit to [rad or m].
    pub rmse_fit: Option<f64>,
    /// The same over the held-out runs.
    pub rmse_validate: Option<f64>,
    /// `100 |torque error| / |torque|` over the runs to fit to.
    pub torque_percent_fit: Option<f64>,
    /// The same over the held-out runs.
    pub torque_percent_validate: Option<f64>,
    /// What is left at each joint, of the error that was fitted.
    pub left: Vec<JointResidual>,
    /// What is left of every block, where all blocks were held out in turn: it counts as what is held out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub blocks: Vec<JointResidual>,
}

/// How far a fit was followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchExtent {
    /// To its end.
    ToItsEnd,
    /// To where it is poor and falls hardly any more.
    WhileItFell,
    /// Not at all: the model is as it was given.
    No,
}

/// A candidate's parameter after the refit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectParameter {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// One standard deviation.
    pub std_error: Option<f64>,
    /// On a bound where the effect does not vanish.
    pub at_bound: bool,
    /// Whether the runs determine it.
    pub identifiable: bool,
}

/// What is left at a joint over the runs of one role.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JointResidual {
    /// The device's joint index.
    pub joint: usize,
    /// Whether the runs are held out.
    pub held_out: bool,
    /// Sum of squared errors.
    pub squares: f64,
    /// Samples.
    pub samples: f64,
    /// Successive samples that share one independent error, counted as for a mean: position errors are slow, and that is the
    /// more careful of the two counts for them.
    pub correlation: f64,
    /// Sum of squares that noise alone would leave; `None` where it is not known.
    pub noise_squares: Option<f64>,
    /// Whether every run's error is white.
    pub white: bool,
}

impl JointResidual {
    /// The error in units of the noise; `None` where that is not known.
    pub fn ratio(&self) -> Option<f64> {
        self.noise_squares.map(|noise| (self.squares / noise.max(f64::MIN_POSITIVE)).sqrt())
    }
}

impl Refit {
    /// The model.
    ///
    /// # Errors
    /// Never for a refit of this program; a checkpoint that was tampered with.
    pub fn parsed(&self) -> Result<Model, DiagnoseError> {
        Ok(Model::parse(&self.model, std::path::Path::new("refitted.toml"))?)
    }

    /// Whether it is of a model as it was, its fit having been given up.
    pub(super) fn was_given_up(&self) -> bool {
        self.followed == SearchExtent::No
    }

    /// Whether the fit found a minimum.
    pub(super) fn is_minimum(&self) -> bool {
        self.status.may_update_model() && self.followed == SearchExtent::ToItsEnd
    }

    /// Whether every error is a number.
    pub fn is_finite(&self) -> bool {
        self.left.iter().chain(&self.blocks).all(|left| left.squares.is_finite())
    }

    /// What is left on the runs held out, or on those fitted to.
    pub fn side(&self, held_out: bool) -> impl Iterator<Item = &JointResidual> {
        let left = if held_out && !self.blocks.is_empty() { &self.blocks } else { &self.left };
        left.iter().filter(move |left| left.held_out == held_out)
    }

    /// What is left of every joint on the held-out runs; of one that is free in none of them, on those that were fitted.
    pub fn judged(&self) -> impl Iterator<Item = &JointResidual> {
        let is_held_out = |joint: usize| self.side(true).any(|left| left.joint == joint);
        self.side(true).chain(self.side(false).filter(move |left| !is_held_out(left.joint)))
    }

    /// The same as far as it does not come from other folds.
    #[must_use]
    pub fn of_one_fold(&self) -> Self {
        Self { blocks: Vec::new(), ..self.clone() }
    }

    /// Cost per sample and joint of the runs fitted to, as a fit tells it; `None` where the noise is not known.
    pub fn cost(&self) -> Option<f64> {
        let (mut cost, mut samples) = (0.0, 0.0);
        for left in self.side(false) {
            cost += 0.5 * left.samples * left.squares / left.noise_squares?.max(f64::MIN_POSITIVE);
            samples += left.samples;
        }
        (samples > 0.0).then(|| cost / samples)
    }

    /// The largest error of any judged joint, in units of its noise; `None` where the noise is not known, or nothing is.
    pub fn worst_ratio(&self) -> Option<f64> {
        self.judged().map(JointResidual::ratio).reduce(|worst, ratio| Some(worst?.max(ratio?))).flatten()
    }

    /// Whether a position fit is far from the noise and was followed to no minimum: what is missing may have led it anywhere.
    pub(super) fn has_strayed(&self) -> bool {
        !self.is_minimum() && self.is_poor()
    }

    /// Whether a position fit is far from the noise.
    pub(super) fn is_poor(&self) -> bool {
        self.cost().is_some_and(|cost| !cost.is_finite() || Watcher::is_poor(cost))
    }

    /// Whether nothing but white noise is left.
    pub fn is_white(&self) -> bool {
        self.judged().all(|left| left.white)
    }
}

/// What a refit is measured by while it goes on; costs are per sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CostLimits {
    /// What another candidate's fit has reached: a fit that stays far above it is given up.
    pub reached: Option<f64>,
    /// Whether that is nothing but noise.
    pub only_noise: bool,
    /// Low enough not to try another start.
    pub enough: Option<f64>,
    /// Whether a fit that stays poor is followed to its end all the same.
    pub thorough: bool,
}

/// How long a fit that stays poor is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SearchLimits {
    /// A valley is flat where so many iterations lower the cost by less than `share`.
    iterations: usize,
    share: f64,
    /// Whether a fit that does not follow the logs even with an observer, or breaks down, is given up, rather than taken as it is.
    gives_up: bool,
}

/// For a candidate, one of many.
pub(super) const FOR_A_CANDIDATE: SearchLimits = SearchLimits { iterations: 8, share: 0.01, gives_up: false };
/// For the model itself, from whose values all candidates are screened: as slow as a tenth of a per cent an iteration.
const FOR_THE_MODEL: SearchLimits = SearchLimits { iterations: 20, share: 0.02, gives_up: true };

/// Sees a fit's iterations and says how long it is worth following.
#[derive(Debug)]
struct Watcher {
    limits: Option<SearchLimits>,
    cost_limits: CostLimits,
    has_many_joints: bool,
    /// Rate of the observer of the iteration before, and its cost.
    last: (f64, f64),
    /// Cost on the last observer that was loose or firmer.
    with_observer: f64,
    /// Costs of the iterations without an observer.
    costs: Vec<f64>,
    /// Whether it had enough.
    had_enough: bool,
    /// Whether it gave the fit up.
    gave_up: bool,
}

impl Watcher {
    /// What costs so many times as much is far.
    const FAR: f64 = 30.0;
    /// What leaves this many times the cost of noise is poor.
    const POOR: f64 = 16.0;
    /// An observer of this rate [1/s] is loose.
    const LOOSE: f64 = 30.0;
    /// Cost per sample with such an observer beyond which following the fit of many joints, whose every step takes long, to a
    /// minimum without one is worth no time: accelerations are off by what moves a joint thirty noises in a thirtieth of a
    /// second.
    const HOPELESS: f64 = 500.0;

    fn new(limits: Option<SearchLimits>, cost_limits: CostLimits, has_many_joints: bool) -> Self {
        Self {
            limits,
            cost_limits,
            has_many_joints,
            last: (0.0, 0.0),
            with_observer: 0.0,
            costs: Vec::new(),
            had_enough: false,
            gave_up: false,
        }
    }

    fn is_poor(cost: f64) -> bool {
        cost > Self::POOR * verdict::COST_AT_THE_FLOOR
    }

    /// Of an iteration's `cost` per sample with an observer of rate `observer` [1/s], 0 without one.
    fn hears(&mut self, observer: f64, cost: f64) -> SearchControl {
        if observer == 0.0 {
            self.costs.push(cost);
        } else if observer >= Self::LOOSE {
            self.with_observer = cost;
        }
        let is_far = |cost: f64| self.cost_limits.reached.is_some_and(|reached| cost > Self::FAR * reached);
        // What leaves only noise leaves no more with an observer, which is why that is asked of its rivals there already.
        let (rate, before) = std::mem::replace(&mut self.last, (observer, cost));
        let is_loosened = observer < rate;
        let is_no_rival = self.cost_limits.only_noise && is_loosened && is_far(before) && is_far(cost);
        let stays_far =
            self.cost_limits.reached.is_some_and(|reached| stays_far_above(self.costs.len(), cost, reached));
        if is_no_rival || stays_far {
            return SearchControl::Stop;
        }
        let Some(limits) = self.limits.filter(|_| Self::is_poor(cost)) else { return SearchControl::Continue };
        let is_hopeless = self.has_many_joints && self.with_observer > Self::HOPELESS && observer < Self::LOOSE;
        if is_hopeless && limits.gives_up {
            self.gave_up = true;
            return SearchControl::Stop;
        }
        let earlier = self.costs.len().checked_sub(limits.iterations + 1).map(|index| self.costs[index]);
        let is_flat = earlier.is_some_and(|earlier| cost > (1.0 - limits.share) * earlier);
        self.had_enough |= is_flat || is_hopeless;
        if is_flat || is_hopeless { SearchControl::GoodEnough } else { SearchControl::Continue }
    }
}

/// Whether a search that after so many iterations without an observer has come to `cost` per sample stays far above the cost that
/// another `reached`: one that can reach that is not so far from it after so many.
pub fn stays_far_above(free_iterations: usize, cost: f64, reached: f64) -> bool {
    const TRIES: usize = 15;
    free_iterations >= TRIES && cost > Watcher::FAR * reached
}

/// How to refit.
#[derive(Debug, Clone, Copy)]
pub struct Judge<'a> {
    /// Which error.
    pub error: ErrorSignal,
    /// Its experiment.
    pub experiment: &'a Experiment,
    /// All runs, those to fit to and those held out.
    pub runs: &'a [&'a Run],
    /// How finely.
    pub options: position::Options,
}

impl Judge<'_> {
    /// Fits `start` and tells what is left. `base` is the model that the candidate was added to.
    ///
    /// # Errors
    /// The model makes no equations, the fit cannot start, it is given up or `stop` says so.
    pub fn refit(
        &self,
        candidate: Option<&Candidate>,
        base: &Model,
        start: &Model,
        cost_limits: CostLimits,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Refit, DiagnoseError> {
        // An observer pulls what a sensor shows wrongly away from where it is.
        let has_sensor = start.effects.iter().any(|own| own.effect.place == Place::Sensor);
        let cost_limits = CostLimits { only_noise: cost_limits.only_noise && !has_sensor, ..cost_limits };
        let limits = match candidate {
            _ if cost_limits.thorough => None,
            None => Some(FOR_THE_MODEL),
            Some(_) => Some(FOR_A_CANDIDATE),
        };
        let Some((found, followed)) = self.fit(start, limits, cost_limits, stop)? else { return self.as_it_is(start) };
        let own = |name: &str| candidate.is_none_or(|candidate| is_own(candidate, start, name));
        let parameters: Vec<EffectParameter> = found
            .parameters
            .iter()
            .filter(|parameter| own(&parameter.name))
            .map(|parameter| EffectParameter {
                name: parameter.name.clone(),
                value: parameter.value,
                std_error: parameter.std_error,
                at_bound: parameter.held && !is_null(start, &parameter.name, parameter.value),
                identifiable: parameter.identifiable,
            })
            .collect();
        let unknowns = self.added_unknowns(&found.model, base);
        let left = self.as_it_is(&found.model)?;
        let candidate = candidate.cloned();
        let refit = Refit { candidate, status: found.status, followed, parameters, unknowns, ..left };
        let may_give_up = found.needs_every_step && limits.is_some_and(|limits| limits.gives_up);
        if may_give_up && broke_down(&refit) { self.without_straying(start, &refit) } else { Ok(refit) }
    }

    /// Cost per sample that a short search from `start` comes to on the firmest observer, with steps that may be longer than a
    /// fit's: that takes a small part of a fit's time, and what is missing shows there already. Where it gets stuck above the
    /// noise, its steps may have been too long, for a law that jumps, say: it is made again with those of a fit, and the lower
    /// cost counts. `None` where it comes to nothing.
    pub(super) fn with_first_observer(&self, start: &Model, stop: &(dyn Fn() -> bool + Sync)) -> Option<f64> {
        const LINEARISATIONS: usize = 16;
        /// A third of what stiff friction may need: bristles that cannot be simulated with longer ones can with these.
        const TIMES_LONGER: usize = 3;
        let runs = self.runs.iter().copied().filter(|run| run.role == Role::Fit);
        let problem = position::PositionProblem::of_model(start, runs).ok()?;
        let search = |substeps: usize, above: usize| {
            let options = position::Options { substeps, ..self.options };
            position::with_first_observer(&problem, &options, above, LINEARISATIONS, &|| stop())
        };
        let rough = search(self.options.substeps.div_ceil(TIMES_LONGER), 0)?;
        let again = || if stop() { None } else { search(self.options.substeps, rough.substeps) };
        Some(cost_of(&rough, again))
    }

    /// The model as it was given; where the fit that strayed only stayed there, since an earlier one had strayed already, as it
    /// was believed before any fit.
    fn without_straying(&self, given: &Model, strayed: &Refit) -> Result<Refit, DiagnoseError> {
        /// A fit from elsewhere changes the cost by more.
        const STAYED: f64 = 1.5;
        let as_given = self.as_it_is(given)?;
        let prior = given.with_values(&|name| given.prior(name));
        let is_about =
            |(before, after): (f64, f64)| after.is_finite() && before < STAYED * after && after < STAYED * before;
        let stayed = as_given.cost().zip(strayed.cost()).is_some_and(is_about);
        if stayed && prior.digest() != given.digest() { self.as_it_is(&prior) } else { Ok(as_given) }
    }

    /// What a model leaves that is not fitted.
    ///
    /// # Errors
    /// The model makes no equations.
    pub(super) fn as_it_is(&self, model: &Model) -> Result<Refit, DiagnoseError> {
        let comparison = compare(model, self.runs)?;
        Ok(Refit {
            candidate: None,
            status: FitStatus::IterationLimit,
            followed: SearchExtent::No,
            parameters: Vec::new(),
            unknowns: 0.0,
            rmse_fit: comparison.rmse_fit,
            rmse_validate: comparison.rmse_validate,
            torque_percent_fit: comparison.torque_percent_fit,
            torque_percent_validate: comparison.torque_percent_validate,
            left: left(&comparison, self.runs, self.error),
            blocks: Vec::new(),
            model: model.to_toml(),
        })
    }

    /// How many unknowns that the runs depend on `model` has more than `base`.
    pub(super) fn added_unknowns(&self, model: &Model, base: &Model) -> f64 {
        count(model, self.runs.iter().copied()) - count(base, self.runs.iter().copied())
    }

    /// Fits `start` to the runs that are for it; a fit that stays poor is followed no longer than `limits` lasts. `None` where
    /// it was given up.
    ///
    /// # Errors
    /// As [`Judge::refit`].
    pub(super) fn fit(
        &self,
        start: &Model,
        limits: Option<SearchLimits>,
        cost_limits: CostLimits,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<(FitResult, SearchExtent)>, DiagnoseError> {
        // From where else to start is the diagnosis's own matter.
        let starts = Starts { prior: false, ..Starts::default() };
        let how = FitTask { starts, tell_start: false, ..FitTask::plain(self.error, self.options) };
        let limits = limits.filter(|_| self.error == ErrorSignal::Position);
        let mut watcher = Watcher::new(limits, cost_limits, self.runs.iter().any(|run| run.free.len() > FEW_JOINTS));
        let mut watch = |reported: &identify::Progress, _: Option<&identify::State>| {
            if stop() { SearchControl::Stop } else { watcher.hears(reported.observer, reported.cost) }
        };
        let found =
            identify::identify_as(start, self.experiment, self.runs, &how, identify::State::default(), &mut watch);
        if watcher.gave_up && !stop() {
            return Ok(None);
        }
        let followed = if watcher.had_enough { SearchExtent::WhileItFell } else { SearchExtent::ToItsEnd };
        Ok(Some((found?, followed)))
    }
}

/// Cost of a search with long steps, or of the same with short ones where it got stuck above the noise.
fn cost_of(rough: &WithObserver, fine: impl FnOnce() -> Option<WithObserver>) -> f64 {
    if !rough.is_stuck || verdict::is_nearly_noise(rough.cost) {
        return rough.cost;
    }
    fine().map_or(rough.cost, |fine| fine.cost.min(rough.cost))
}

/// Whether a fit, whose simulations need shorter steps than they may take, came to no free minimum and is far from the noise:
/// what is missing led it there, e.g. to inertias so small that friction stops a joint within an integration step.
fn broke_down(refit: &Refit) -> bool {
    let is_good = |cost: f64| cost.is_finite() && !Watcher::is_poor(cost);
    let is_held = matches!(refit.status, FitStatus::NumericalError | FitStatus::HeldByBound);
    is_held && refit.cost().is_some_and(|cost| !is_good(cost))
}

/// Number of unknown effect parameters that the runs depend on.
pub(super) fn count<'a>(model: &Model, runs: impl IntoIterator<Item = &'a Run>) -> f64 {
    let free: BTreeSet<usize> = runs.into_iter().flat_map(|run| run.free.iter().copied()).collect();
    let free = |joint: usize| free.contains(&joint);
    let effects = model.effects.iter().filter(|own| own.joint.is_none_or(free));
    effects.flat_map(|own| &own.parameters).filter(|parameter| !parameter.fixed).count() as f64
}

pub(super) fn is_own(candidate: &Candidate, model: &Model, name: &str) -> bool {
    instance(model, candidate)
        .is_some_and(|own| (0..own.parameters.len()).any(|index| own.parameter_name(index) == name))
}

/// Whether the parameter of that name is where its effect vanishes.
pub(super) fn is_null(model: &Model, name: &str, value: f64) -> bool {
    model.effects.iter().any(|own| {
        own.effect.parameters.iter().enumerate().any(|(index, parameter)| {
            let Parameter { lower, upper, .. } = own.parameters[index];
            let near = 1e-3 * if (upper - lower).is_finite() { upper - lower } else { 1.0 };
            own.parameter_name(index) == name && parameter.null.is_some_and(|null| (value - null).abs() <= near)
        })
    })
}

/// What `comparison` leaves at each joint.
pub(super) fn left(comparison: &Comparison, runs: &[&Run], error: ErrorSignal) -> Vec<JointResidual> {
    let mut sums: BTreeMap<(usize, bool), JointResidual> = BTreeMap::new();
    let mut add = |joint: usize,
                   held_out: bool,
                   squares: f64,
                   samples: f64,
                   correlation: f64,
                   noise: Option<f64>,
                   white: bool| {
        let sum = sums.entry((joint, held_out)).or_insert(JointResidual {
            joint,
            held_out,
            squares: 0.0,
            samples: 0.0,
            correlation: 1.0,
            noise_squares: Some(0.0),
            white: true,
        });
        sum.correlation = (sum.correlation * sum.samples + correlation * samples) / (sum.samples + samples).max(1.0);
        sum.squares += squares;
        sum.samples += samples;
        sum.noise_squares = sum.noise_squares.zip(noise).map(|(sum, noise)| sum + noise * noise * samples);
        sum.white &= white;
    };
    for (reported, run) in comparison.runs.iter().zip(runs) {
        let held_out = run.role == Role::Validate;
        for (slot, joint) in reported.joints.iter().enumerate() {
            if error == ErrorSignal::Torque {
                let Some(torque) = reported.torque.get(slot) else { continue };
                let used = torque.residual.iter().zip(&torque.used).filter(|(_, used)| **used);
                let squares: f64 = used.map(|(value, _)| value * value).sum();
                if torque.n_used() == 0 {
                    continue;
                }
                // A stage that takes the command away takes the error along; that explains nothing.
                let share = torque.delivered_share().unwrap_or(1.0).min(1.0);
                let squares = squares / (share * share).max(f64::MIN_POSITIVE);
                let correlation = correlation_time(&counted(&torque.residual, &torque.used), torque.n_used());
                add(joint.joint, held_out, squares, torque.n_used() as f64, correlation, None, false);
            } else if let (Some(rmse), Some(simulated)) = (joint.rmse, &reported.simulated) {
                let measured = &run.log.q[joint.joint];
                // A joint that stands still here moves in another run, or tells nothing.
                let noise_floor = if joint.noise_floor > 0.0 {
                    joint.noise_floor
                } else {
                    runs.iter().map(|other| noise_of_log(&other.log.q[joint.joint])).fold(0.0, f64::max)
                };
                // What moves without noise has as much as a fit takes it to have.
                let noise_floor =
                    if moves(run, joint.joint) { noise_floor.max(noise_of(measured)) } else { noise_floor };
                if noise_floor == 0.0 {
                    continue;
                }
                let mut residual: Vec<f64> =
                    measured.iter().zip(&simulated[slot]).map(|(measured, model)| measured - model).collect();
                let (mut squares, mut white) = (rmse * rmse * residual.len() as f64, joint.white);
                // What a fit does not see is not judged either.
                let cut = run.n_cut().min(residual.len());
                if cut == residual.len() {
                    continue;
                }
                if cut > 0 {
                    residual.drain(..cut);
                    squares = residual.iter().map(|error| error * error).sum();
                    white = is_white(&residual);
                }
                let samples = residual.len() as f64;
                let correlation = correlation_time(&residual, residual.len());
                add(joint.joint, held_out, squares, samples, correlation, Some(noise_floor), white);
            } else {
                // A run that cannot be simulated to its end is not one without error.
                let noise = Some(joint.noise_floor);
                add(joint.joint, held_out, f64::INFINITY, run.log.t.len() as f64, 1.0, noise, false);
            }
        }
    }
    sums.into_values().collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A fit that left nothing, not even a file.
    pub(crate) fn empty() -> Refit {
        Refit {
            candidate: None,
            model: String::new(),
            status: FitStatus::Converged,
            followed: SearchExtent::ToItsEnd,
            parameters: Vec::new(),
            unknowns: 0.0,
            rmse_fit: None,
            rmse_validate: None,
            torque_percent_fit: None,
            torque_percent_validate: None,
            left: Vec::new(),
            blocks: Vec::new(),
        }
    }

    /// What the watcher says of each of these iterations: rate of the observer [1/s] and cost.
    fn heard(watcher: &mut Watcher, reported: &[(f64, f64)]) -> Vec<SearchControl> {
        reported.iter().map(|(observer, cost)| watcher.hears(*observer, *cost)).collect()
    }

    #[test]
    fn a_fit_that_falls_or_is_good_is_followed() {
        let falling: Vec<(f64, f64)> = (0..40).map(|k| (0.0, 1e4 * 0.9_f64.powi(k))).collect();
        let good = [(0.0, 0.6); 40];
        for reported in [&falling[..], &good] {
            let mut watcher = Watcher::new(Some(FOR_A_CANDIDATE), CostLimits::default(), true);
            assert!(heard(&mut watcher, reported).iter().all(|watch| *watch == SearchControl::Continue));
            assert!(!watcher.had_enough && !watcher.gave_up);
        }
    }

    #[test]
    fn a_poor_fit_in_a_flat_valley_is_left() {
        let flat = [(0.0, 100.0); 40];
        for (limits, iterations) in [(FOR_A_CANDIDATE, 8), (FOR_THE_MODEL, 20)] {
            let mut watcher = Watcher::new(Some(limits), CostLimits::default(), false);
            let first = heard(&mut watcher, &flat).iter().position(|watch| *watch == SearchControl::GoodEnough);
            assert_eq!(first, Some(iterations), "{limits:?}");
            assert!(watcher.had_enough);
        }
        let mut thorough = Watcher::new(None, CostLimits::default(), false);
        assert!(heard(&mut thorough, &flat).iter().all(|watch| *watch == SearchControl::Continue));
    }

    #[test]
    fn a_joint_that_is_free_in_no_held_out_run_is_judged_by_the_others() {
        let left = |joint, held_out, squares| JointResidual {
            joint,
            held_out,
            squares,
            samples: 1.0,
            correlation: 1.0,
            noise_squares: Some(1.0),
            white: true,
        };
        let refit = Refit { left: vec![left(4, false, 9.0), left(4, true, 1.0), left(5, false, 400.0)], ..empty() };
        assert_eq!(refit.judged().map(|left| (left.joint, left.held_out)).collect::<Vec<_>>(), [(4, true), (5, false)]);
        assert_eq!(refit.worst_ratio(), Some(20.0));
        assert_eq!(empty().worst_ratio(), None, "nothing is judged");
    }

    #[test]
    fn a_search_that_long_steps_stop_above_the_noise_is_reported_with_short_ones() {
        let stuck = |cost| WithObserver { cost, is_stuck: true, substeps: 20 };
        let done = |cost| WithObserver { cost, is_stuck: false, substeps: 60 };
        let never = || -> Option<WithObserver> { panic!("short steps are not worth their time") };
        assert_eq!(cost_of(&done(26.0), never), 26.0);
        assert_eq!(cost_of(&stuck(0.7), never), 0.7);
        assert_eq!(cost_of(&stuck(26.0), || Some(done(0.27))), 0.27);
        assert_eq!(cost_of(&stuck(26.0), || Some(stuck(30.0))), 26.0);
        assert_eq!(cost_of(&stuck(26.0), || None), 26.0);
    }

    #[test]
    fn a_fit_breaks_down_where_it_comes_to_no_minimum_far_from_the_noise() {
        let fitted = |status, squares: f64, noise_squares| {
            let left = JointResidual {
                joint: 0,
                held_out: false,
                squares,
                samples: 100.0,
                correlation: 1.0,
                noise_squares,
                white: false,
            };
            Refit { status, left: vec![left], ..empty() }
        };
        let noise = Some(1.0);
        for squares in [100.0, f64::INFINITY, f64::NAN] {
            for status in [FitStatus::NumericalError, FitStatus::HeldByBound] {
                assert!(broke_down(&fitted(status, squares, noise)), "{squares}");
            }
            assert!(!broke_down(&fitted(FitStatus::Converged, squares, noise)), "{squares}");
        }
        assert!(!broke_down(&fitted(FitStatus::NumericalError, 1.2, noise)), "what is left is near the noise");
        assert!(!broke_down(&fitted(FitStatus::NumericalError, 100.0, None)), "the noise is not known");
    }

    #[test]
    fn a_rival_of_what_leaves_only_noise_is_stopped_where_an_observer_does_not_bring_it_near() {
        let cost_limits = CostLimits { reached: Some(0.5), only_noise: true, ..CostLimits::default() };
        let stopped = |cost_limits, reported: &[(f64, f64)]| {
            heard(&mut Watcher::new(None, cost_limits, false), reported)
                .iter()
                .position(|watch| *watch == SearchControl::Stop)
        };
        let far = [(100.0, 80.0), (30.0, 60.0), (30.0, 50.0), (10.0, 90.0), (10.0, 70.0), (3.0, 200.0)];
        assert_eq!(stopped(cost_limits, &far), Some(1));
        assert_eq!(stopped(CostLimits { only_noise: false, ..cost_limits }, &far), None);
        let near = [(100.0, 80.0), (30.0, 14.0), (10.0, 90.0), (10.0, 14.0), (3.0, 80.0), (3.0, 1.0), (0.0, 90.0)];
        assert_eq!(stopped(cost_limits, &near), None);
    }

    #[test]
    fn a_fit_far_above_anothers_is_stopped() {
        let far = [(3.0, 100.0), (0.0, 100.0), (0.0, 90.0)];
        let far: Vec<(f64, f64)> = far.into_iter().cycle().take(60).collect();
        let cost_limits = CostLimits { reached: Some(0.5), ..CostLimits::default() };
        let stopped = heard(&mut Watcher::new(None, cost_limits, false), &far)
            .iter()
            .position(|watch| *watch == SearchControl::Stop);
        // Two of three are without an observer.
        assert_eq!(stopped, Some(22));
    }

    #[test]
    fn many_joints_that_do_not_follow_their_logs_with_an_observer_are_given_up() {
        let reported = [(100.0, 150.0), (30.0, 5000.0), (10.0, 20_000.0)];
        let last = |limits: SearchLimits, has_many_joints: bool| {
            let mut watcher = Watcher::new(Some(limits), CostLimits::default(), has_many_joints);
            let heard = heard(&mut watcher, &reported);
            assert_eq!(heard[..2], [SearchControl::Continue; 2]);
            (heard[2], watcher.gave_up)
        };
        assert_eq!(last(FOR_THE_MODEL, true), (SearchControl::Stop, true));
        assert_eq!(last(FOR_A_CANDIDATE, true), (SearchControl::GoodEnough, false));
        assert_eq!(last(FOR_THE_MODEL, false), (SearchControl::Continue, false));
    }
}
