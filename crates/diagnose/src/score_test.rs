//! What would each effect explain at each place? Asked without a fit, by one step of Gauss and Newton (a score test).
//!
//! At the fitted model every candidate's own unknowns, and with them all others, take the step that raises the likelihood most. Most
//! candidates are asked along the model's own predictions, which answer to their torques to first order. A transmission, and friction
//! with states of its own, hold the motion that moves them: they are simulated, at a few finite values. A model that is held
//! to its logs firmly shows other effects than one that runs nearly free, so each is asked at a few rates.

use std::collections::BTreeMap;

use dynid_dynamics::system::{System, SystemError};
use dynid_identify::position::FitRun;
use dynid_identify::prediction::{Change, Plan, PredictionProblem, Promise, Tangent};
use dynid_logs::experiment::Run;
use dynid_model::Place;
use dynid_user_model::Model;
use rayon::prelude::*;

use crate::candidate::{Candidate, Probe, instance, keep_orders};

/// A candidate with values to start a fit from, and what they promise.
#[derive(Debug, Clone)]
pub struct Start {
    /// What is added.
    pub candidate: Candidate,
    /// The model with it.
    pub model: Model,
    /// By how much the log likelihood of what was looked at would rise.
    pub promise: f64,
    /// Which of the candidate's probes it is.
    pub probe: usize,
    /// The step that is promised from there, by parameter.
    pub step: Vec<(String, f64)>,
}

impl Start {
    /// The model after the step.
    pub fn stepped(&self) -> Model {
        let mut model = self.model.clone();
        for (name, step) in &self.step {
            if let Some(own) = model.parameter(name) {
                // The name is the model's own.
                let _known = model.set_value(name, (own.value + step).clamp(own.lower, own.upper));
            }
        }
        keep_orders(&mut model);
        model
    }
}

/// By how much the log likelihood rises, and the step that it takes of each parameter.
type Promised = (f64, Vec<f64>);

/// What is asked of a model.
pub struct ScoreTest<'a> {
    runs: &'a [Run],
    initial: Vec<Vec<f64>>,
    rates: Vec<BTreeMap<usize, f64>>,
    /// The model as it is at each of the rates, and its cost once its own unknowns have taken their step.
    without: Vec<Option<(Tangent, f64)>>,
    plan: Plan,
    /// Integration steps for what is stiffer than the model.
    stiffer: Plan,
    expected: &'a (dyn Fn(&str) -> Option<f64> + Sync),
}

/// Rates at which candidates are asked, as multiples of the fitted ones.
pub const RATES: [f64; 3] = [1.0, 0.3, 0.1];
/// Columns that are asked together, at most, one for a probe and one for each of its parameters: one product of matrices takes them in.
const TOGETHER: usize = 32;
/// Of the probes asked together, so many that promise most at the first of the rates are asked at the others.
const AT_ALL_RATES: usize = 4;

impl<'a> ScoreTest<'a> {
    /// At `model`, with the rates, the initial positions and the integration steps of a fit to runs of which `runs` are the beginnings;
    /// asked at so many of [`RATES`].
    ///
    /// # Errors
    /// The model makes no equations for a run.
    pub fn new(
        model: &Model,
        (rates, n_rates): (&BTreeMap<usize, f64>, usize),
        (initial, plan): (&[Vec<f64>], &Plan),
        runs: &'a [Run],
        expected: &'a (dyn Fn(&str) -> Option<f64> + Sync),
    ) -> Result<Self, SystemError> {
        let ready = runs.iter().map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<_>, _>>()?;
        let rates = RATES.iter().take(n_rates).map(|factor| at_rates(rates, *factor)).collect();
        let (initial, stiffer) = (initial.to_vec(), plan.stiffer());
        let mut test = Self { runs, initial, rates, without: Vec::new(), plan: plan.clone(), stiffer, expected };
        let without = |rates: &BTreeMap<usize, f64>| {
            let tangent = Tangent::new(&test.problem(model, ready.clone(), rates), plan)?;
            let cost = tangent.own_cost()?;
            Some((tangent, cost))
        };
        test.without = test.rates.par_iter().map(without).collect();
        Ok(test)
    }

    /// What the probes promise at the best of the rates, the most promising first; `go_on` is asked between them.
    pub fn ask(&self, probes: &[(Candidate, Vec<Probe>)], go_on: &(dyn Fn() -> bool + Sync)) -> Vec<Start> {
        // Of one candidate: all that are simulated, or some that are asked along the model's predictions.
        let mut jobs: Vec<(usize, Vec<usize>, bool)> = Vec::new();
        for (own, (candidate, probes)) in probes.iter().enumerate() {
            let first = jobs.len();
            for (k, probe) in probes.iter().enumerate() {
                let is_simulated = self.is_simulated(candidate, probe);
                let columns = |together: &[usize]| (together.len() + 1) * (1 + probe.steps.len());
                let has_room = |(_, together, other): &&mut (usize, Vec<usize>, bool)| {
                    *other == is_simulated && (is_simulated || columns(together) <= TOGETHER)
                };
                match jobs[first..].iter_mut().rev().find(has_room) {
                    Some((_, together, _)) => together.push(k),
                    None => jobs.push((own, vec![k], is_simulated)),
                }
            }
        }
        let answer = |(own, places, is_simulated): &(usize, Vec<usize>, bool)| {
            let (candidate, probes) = &probes[*own];
            let asked: Vec<&Probe> = places.iter().map(|k| &probes[*k]).collect();
            let promises = match (go_on(), is_simulated) {
                (false, _) => vec![None; asked.len()],
                (true, true) => self.simulated(&asked),
                (true, false) => self.followed(&asked),
            };
            let start = |((k, probe), promise): ((&usize, &Probe), Option<Promised>)| {
                let (promise, step) = promise?;
                Some(Start {
                    candidate: candidate.clone(),
                    model: probe.model.clone(),
                    promise,
                    probe: *k,
                    step: probe.steps.iter().map(|step| step.name.clone()).zip(step).collect(),
                })
            };
            places.iter().zip(asked).zip(promises).filter_map(start).collect()
        };
        let asked: Vec<Vec<Start>> = jobs.par_iter().map(answer).collect();
        let mut starts: Vec<Start> = asked.into_iter().flatten().collect();
        sort(&mut starts);
        starts
    }

    fn problem(&self, model: &Model, runs: Vec<FitRun>, rates: &BTreeMap<usize, f64>) -> PredictionProblem {
        PredictionProblem {
            initial: self.initial.clone(),
            rates: rates.clone(),
            keeps_rates: false,
            ..PredictionProblem::of_runs(model, self.expected, runs)
        }
    }

    /// Whether what moves a probe's effect hangs on what it does itself: it stands between drive and joint, or has states that the motion
    /// drives and does something as it is.
    fn is_simulated(&self, candidate: &Candidate, probe: &Probe) -> bool {
        let Some(instance) = instance(&probe.model, candidate) else { return false };
        let reads_motion = || probe.model.placed(instance).is_ok_and(|placed| placed.reads_motion());
        let is_changed = || {
            let (systems, tangent) = (self.systems(&probe.model), self.without.iter().flatten().next());
            systems.zip(tangent).is_some_and(|(systems, (tangent, _))| tangent.is_changed(&systems))
        };
        instance.effect.place == Place::Transmission
            || (!instance.effect.states.is_empty() && reads_motion() && is_changed())
    }

    fn systems(&self, model: &Model) -> Option<Vec<System>> {
        self.runs.iter().map(|run| model.system_of(run).ok()).collect()
    }

    /// What probes promise along the model's predictions, and the steps that they take.
    fn followed(&self, probes: &[&Probe]) -> Vec<Option<Promised>> {
        let change = |probe: &&Probe| -> Option<Change> {
            let further = probe.steps.iter().map(|step| {
                let mut model = probe.model.clone();
                model.set_value(&step.name, step.from + step.unit).ok()?;
                Some((self.systems(&model)?, step.unit))
            });
            Some(Change { systems: self.systems(&probe.model)?, further: further.collect::<Option<_>>()? })
        };
        let changes: Vec<Option<Change>> = probes.iter().map(change).collect();
        let mut best: Vec<Option<Promised>> = vec![None; probes.len()];
        let mut asked: Vec<usize> = (0..probes.len()).filter(|k| changes[*k].is_some()).collect();
        for (tangent, without) in self.without.iter().flatten() {
            let found = tangent.reduced(&asked.iter().filter_map(|k| changes[*k].as_ref()).collect::<Vec<_>>());
            for (k, reduced) in asked.iter().zip(found) {
                let (probe, Some(reduced)) = (probes[*k], reduced) else { continue };
                let bounds = probe.steps.iter().map(|step| {
                    let ends = (step.range.0 * step.unit, step.range.1 * step.unit);
                    (ends.0.min(ends.1), ends.0.max(ends.1))
                });
                let Promise { cost, step } = reduced.promise(&bounds.collect::<Vec<_>>());
                let gain = without - cost;
                if gain.is_finite() && best[*k].as_ref().is_none_or(|best| best.0 < gain) {
                    best[*k] = Some((gain, step));
                }
            }
            let promise = |k: &usize| best[*k].as_ref().map_or(f64::NEG_INFINITY, |best| best.0);
            asked.sort_by(|a, b| promise(b).total_cmp(&promise(a)).then(a.cmp(b)));
            asked.truncate(AT_ALL_RATES);
        }
        best
    }

    /// What probes of one candidate promise that are simulated as they are: one after another of their values is varied, from those in
    /// the middle on, at the first of the rates; and the best of them is asked at the others too.
    fn simulated(&self, probes: &[&Probe]) -> Vec<Option<Promised>> {
        let mut found: Vec<Option<Option<f64>>> = vec![None; probes.len()];
        let n_shapes = probes.first().map_or(0, |probe| probe.shape.len());
        let middle = |shape: usize| {
            let mut values: Vec<usize> = probes.iter().map(|probe| probe.shape[shape]).collect();
            values.sort_unstable();
            values.dedup();
            values[values.len() / 2]
        };
        let middles: Vec<usize> = (0..n_shapes).map(middle).collect();
        let distance = |probe: &Probe| probe.shape.iter().zip(&middles).filter(|(own, middle)| own != middle).count();
        let Some(mut best) = (0..probes.len()).min_by_key(|k| distance(probes[*k])) else { return Vec::new() };
        for shape in 0..n_shapes.max(1) {
            let differ = |k: &usize| {
                let pairs = probes[*k].shape.iter().zip(&probes[best].shape).enumerate();
                pairs.filter(|(_, (one, other))| one != other).all(|(place, _)| place == shape)
            };
            let varied: Vec<usize> = (0..probes.len()).filter(differ).collect();
            for k in varied.iter().copied() {
                if found[k].is_none() {
                    found[k] = Some(self.simulated_at(probes[k], 0));
                }
            }
            let promise = |k: usize| found[k].flatten().unwrap_or(f64::NEG_INFINITY);
            let answered = varied.into_iter().filter(|k| found[*k].flatten().is_some());
            best = answered.max_by(|a, b| promise(*a).total_cmp(&promise(*b))).unwrap_or(best);
        }
        let others = (1..self.rates.len()).filter_map(|rate| self.simulated_at(probes[best], rate));
        found[best] = Some(others.chain(found[best].flatten()).max_by(f64::total_cmp));
        found.into_iter().map(|promise| Some((promise??, Vec::new()))).collect()
    }

    /// At one of the rates.
    fn simulated_at(&self, probe: &Probe, rate: usize) -> Option<f64> {
        let (tangent, without) = self.without[rate].as_ref()?;
        let ready: Vec<FitRun> =
            self.runs.iter().map(|run| FitRun::of_run(&probe.model, run)).collect::<Result<_, _>>().ok()?;
        let problem = self.problem(&probe.model, ready, &self.rates[rate]);
        // A transmission may need shorter steps than the model without it.
        let cost = tangent.cost(&problem, &self.plan).or_else(|| tangent.cost(&problem, &self.stiffer));
        Some(without - cost?).filter(|gain| gain.is_finite())
    }
}

/// The most promising first.
fn sort(starts: &mut [Start]) {
    starts.sort_by(|one, other| {
        other
            .promise
            .total_cmp(&one.promise)
            .then_with(|| (&one.candidate, one.probe).cmp(&(&other.candidate, other.probe)))
    });
}

/// The candidates that promise most, so many, of starts in that order.
pub fn promising(starts: &[Start], most: usize) -> Vec<Candidate> {
    let mut found: Vec<Candidate> = Vec::new();
    for start in starts {
        if found.len() < most && !found.contains(&start.candidate) {
            found.push(start.candidate.clone());
        }
    }
    found
}

/// Rates at which something is asked, as this multiple of fitted ones.
pub fn at_rates(fitted: &BTreeMap<usize, f64>, factor: f64) -> BTreeMap<usize, f64> {
    fitted.iter().map(|(joint, rate)| (*joint, rate.max(LEAST_RATE) * factor)).collect()
}

/// A model that its logs trust altogether is asked at this rate [1/s] all the same.
const LEAST_RATE: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::start;

    #[test]
    fn the_most_promising_come_first_and_each_candidate_once() {
        let mut starts = [
            start("dahl", 1.0, 0),
            start("coulomb", 5.0, 1),
            start("coulomb", 5.0, 0),
            start("backlash", 5.0, 9),
            start("dahl", 7.0, 2),
        ];
        sort(&mut starts);
        let order = starts.each_ref().map(|start| (start.candidate.effect.as_str(), start.probe));
        assert_eq!(order, [("dahl", 2), ("backlash", 9), ("coulomb", 0), ("coulomb", 1), ("dahl", 0)]);
        let names = |most: usize| promising(&starts, most).into_iter().map(|own| own.effect).collect::<Vec<_>>();
        assert_eq!(names(9), ["dahl", "backlash", "coulomb"]);
        assert_eq!(names(2), ["dahl", "backlash"]);
        assert!(names(0).is_empty());
    }

    #[test]
    fn a_model_that_is_trusted_altogether_is_asked_at_a_rate_all_the_same() {
        let rates = at_rates(&BTreeMap::from([(0, 20.0), (4, 0.0), (5, 0.9)]), 0.25);
        assert_eq!(rates, BTreeMap::from([(0, 5.0), (4, 0.25), (5, 0.25)]));
    }

    #[test]
    fn a_step_ends_at_the_bounds() {
        let step = |step: f64| {
            let steps = vec![("joint.0.viscous.Fv".to_owned(), step), ("joint.0.nothing.F".to_owned(), 1.0)];
            let stepped = Start { step: steps, ..start("coulomb", 0.0, 0) }.stepped();
            stepped.parameter("joint.0.viscous.Fv").expect("it has one").value
        };
        assert!((step(0.004) - 0.010).abs() < 1e-12);
        assert_eq!([step(-1.0), step(1.0)], [0.0, 0.1]);
    }
}
