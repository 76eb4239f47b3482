//! What would each effect explain at each place? Asked without a fit, by one step of Gauss and Newton (a score test).
//!
//! At the fitted model every candidate's own unknowns, and with them all others, take the step that raises the likelihood most. An
//! effect that does nothing at its null is asked there: all such share one evaluation, as so many more columns of one derivative.
//! What no derivative at a null shows (a dead zone, a delay, an elastic joint) is asked at a few finite values. A model that is held
//! to its logs firmly shows other effects than one that runs nearly free, so each is asked at a few rates.

use std::collections::BTreeMap;
use std::ops::Range;

use dynid_dynamics::simulate::{self, Input, Predictor};
use dynid_dynamics::system::{PlacedEffect, SystemError};
use dynid_identify::position::{FitRun, Unknown, first_state};
use dynid_identify::prediction::{Plan, PredictionProblem, Tangent};
use dynid_logs::experiment::Run;
use dynid_user_model::Model;
use rayon::prelude::*;

use crate::candidate::{Candidate, Probe, Step, instance, keep_orders};

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
    /// The step that this takes from where its effect vanishes, by parameter; none where it was asked as it is.
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

    /// Whether it was asked at values of its own.
    pub fn is_tried(&self) -> bool {
        self.step.is_empty()
    }
}

/// What is asked of a model.
pub struct ScoreTest<'a> {
    model: &'a Model,
    runs: &'a [Run],
    /// The same runs with the model's equations.
    ready: Vec<FitRun>,
    initial: Vec<Vec<f64>>,
    rates: Vec<BTreeMap<usize, f64>>,
    /// Its predictions of the first samples of each run.
    first: Vec<Option<Vec<f64>>>,
    /// The model as it is at each of the rates, and its cost once its own unknowns have taken their step.
    without: Vec<Option<(Tangent, f64)>>,
    plan: Plan,
    /// Integration steps for what is stiffer than the model.
    stiffer: Plan,
    expected: &'a (dyn Fn(&str) -> Option<f64> + Sync),
}

/// Rates at which candidates are asked, as multiples of the fitted ones.
pub const RATES: [f64; 3] = [1.0, 0.3, 0.1];
/// Columns, and states of effects, that one evaluation takes at most.
const MOST_COLUMNS: usize = 160;
const MOST_STATES: usize = 8;
/// The first samples tell whether an effect does nothing.
const FIRST: usize = 300;

impl<'a> ScoreTest<'a> {
    /// At `model`, with the rates, the initial positions and the integration steps of a fit to runs of which `runs` are the beginnings.
    ///
    /// # Errors
    /// The model makes no equations for a run.
    pub fn new(
        model: &'a Model,
        rates: &BTreeMap<usize, f64>,
        (initial, plan): (&[Vec<f64>], &Plan),
        runs: &'a [Run],
        expected: &'a (dyn Fn(&str) -> Option<f64> + Sync),
    ) -> Result<Self, SystemError> {
        let ready = runs.iter().map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<_>, _>>()?;
        let multiplied = |factor: f64| rates.iter().map(move |(joint, rate)| (*joint, rate.max(LEAST_RATE) * factor));
        let rates = RATES.iter().map(|factor| multiplied(*factor).collect()).collect();
        let initial = initial.to_vec();
        let (first, without) = (Vec::new(), Vec::new());
        let mut test = Self {
            model,
            runs,
            ready,
            initial,
            rates,
            first,
            without,
            plan: plan.clone(),
            stiffer: plan.stiffer(),
            expected,
        };
        test.first = test.ready.iter().enumerate().map(|(run, ready)| test.first_of(run, ready)).collect();
        let without = |rates: &BTreeMap<usize, f64>| {
            let problem = test.problem(model, test.ready.clone(), rates);
            let tangent = Tangent::new(&problem, plan)?;
            let cost = tangent.own_cost()?;
            Some((tangent, cost))
        };
        test.without = test.rates.par_iter().map(without).collect();
        Ok(test)
    }

    /// What the probes promise at the best of these rates, by their place among [`RATES`], the most promising first; `go_on` is asked
    /// between them.
    pub fn ask(
        &self,
        probes: &[(Candidate, Vec<Probe>)],
        rates: Range<usize>,
        go_on: &(dyn Fn() -> bool + Sync),
    ) -> Vec<Start> {
        let all: Vec<(usize, usize)> =
            probes.iter().enumerate().flat_map(|(own, (_, probes))| (0..probes.len()).map(move |k| (own, k))).collect();
        let vanish: Vec<bool> =
            all.par_iter().map(|(own, k)| go_on() && self.vanishes(&probes[*own].0, &probes[*own].1[*k])).collect();
        let mut chunks: Vec<Vec<(usize, usize)>> = Vec::new();
        let (mut columns, mut states) = (0, 0);
        // With whether they take a step.
        let mut jobs: Vec<(Vec<(usize, usize)>, bool)> = Vec::new();
        // What takes another law's place does so at all joints at once.
        let mut instead: BTreeMap<(&str, usize), Vec<(usize, usize)>> = BTreeMap::new();
        for (place, vanishes) in all.iter().zip(&vanish) {
            let (candidate, own) = &probes[place.0];
            let own = &own[place.1];
            let is_instead = self.takes_a_place(own);
            if !vanishes {
                jobs.push((vec![*place], false));
                continue;
            }
            if is_instead {
                instead.entry((candidate.effect.as_str(), place.1)).or_default().push(*place);
                continue;
            }
            let more = instance(&own.model, candidate).map_or(0, |instance| instance.effect.states.len());
            if chunks.is_empty() || columns + own.steps.len() > MOST_COLUMNS || states + more > MOST_STATES {
                chunks.push(Vec::new());
                (columns, states) = (0, 0);
            }
            columns += own.steps.len();
            states += more;
            if let Some(chunk) = chunks.last_mut() {
                chunk.push(*place);
            }
        }
        chunks.extend(instead.into_values());
        jobs.extend(chunks.into_iter().map(|chunk| (chunk, true)));
        let asked: Vec<Vec<Option<Start>>> = jobs
            .par_iter()
            .map(|(places, have_steps)| match (go_on(), have_steps) {
                (false, _) => Vec::new(),
                (true, true) => self.all_with_steps(places, probes, &rates),
                (true, false) => places.iter().map(|place| self.at_values(*place, probes, &rates)).collect(),
            })
            .collect();
        let mut starts: Vec<Start> = asked.into_iter().flatten().flatten().collect();
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

    /// Whether a probe's effect takes the place of one of the model's.
    fn takes_a_place(&self, probe: &Probe) -> bool {
        probe.model.effects.len() <= self.model.effects.len()
    }

    /// Whether a probe has steps to take and does nothing before it takes them: beside others, by the null values of its effect, which
    /// the library has made sure of; in another's place, by what it predicts of the first run that feels it.
    fn vanishes(&self, candidate: &Candidate, probe: &Probe) -> bool {
        if probe.steps.is_empty() {
            return false;
        }
        let Some(instance) = instance(&probe.model, candidate) else { return false };
        if !self.takes_a_place(probe) {
            let nulls = instance.effect.parameters.iter().zip(&instance.parameters);
            return nulls
                .filter_map(|(own, parameter)| Some((own.null?, parameter.value)))
                .all(|(null, value)| null == value);
        }
        let run = self.runs.iter().position(|run| candidate.joint.is_none_or(|joint| run.free.contains(&joint)));
        let Some((run, Some(without))) = run.map(|run| (run, &self.first[run])) else { return false };
        let ready = FitRun::of_run(&probe.model, &self.runs[run]).ok();
        let with = ready.and_then(|ready| self.first_of(run, &ready));
        with.is_some_and(|with| with.iter().zip(without).all(|(one, other)| (one - other).abs() <= 1e-12))
    }

    /// Predictions of the first samples of a run.
    fn first_of(&self, run: usize, ready: &FitRun) -> Option<Vec<f64>> {
        let rates: Vec<f64> = ready.system.kernel().free.iter().map(|joint| self.rates[0][joint]).collect();
        let predictor = Predictor { position: &ready.position, rates: &rates, schemes: self.plan.of_run(run) };
        let input = Input { time: &ready.time, command: &ready.command, intersample: ready.intersample };
        let options = simulate::Options { substeps: 1, ..simulate::Options::default() };
        let found = simulate::predict(&ready.system, &input.first(FIRST), &predictor, &first_state(ready), &options);
        Some(found.ok()?.q)
    }

    /// Probes that take a step; where one has no derivative there, the others are asked without it.
    fn all_with_steps(
        &self,
        chunk: &[(usize, usize)],
        probes: &[(Candidate, Vec<Probe>)],
        rates: &Range<usize>,
    ) -> Vec<Option<Start>> {
        match self.with_steps(chunk, probes, rates) {
            Some(found) => found,
            None if chunk.len() < 2 => vec![None; chunk.len()],
            None => {
                let (one, other) = chunk.split_at(chunk.len() / 2);
                let mut found = self.all_with_steps(one, probes, rates);
                found.extend(self.all_with_steps(other, probes, rates));
                found
            }
        }
    }

    /// Probes that do nothing before they take their step, all in one evaluation; or a single one.
    fn with_steps(
        &self,
        chunk: &[(usize, usize)],
        probes: &[(Candidate, Vec<Probe>)],
        rates: &Range<usize>,
    ) -> Option<Vec<Option<Start>>> {
        let mut effects: Vec<PlacedEffect> = Vec::new();
        let mut unknowns: Vec<Vec<Unknown>> = Vec::new();
        // Effects that stand beside those of the model share it; what takes the place of one stands there.
        let is_instead = chunk.iter().any(|(own, k)| self.takes_a_place(&probes[*own].1[*k]));
        let mut model = self.model.clone();
        for (number, (own, k)) in chunk.iter().enumerate() {
            let (candidate, probe) = (&probes[*own].0, &probes[*own].1[*k]);
            let named = |name: &str| if is_instead { name.to_owned() } else { format!("{name}#{number}") };
            let unknown = |step: &Step| Unknown {
                name: named(&step.name),
                value: step.from,
                expected: step.from,
                lower: f64::NEG_INFINITY,
                upper: f64::INFINITY,
            };
            unknowns.push(probe.steps.iter().map(unknown).collect());
            if is_instead {
                model.add_effect(&candidate.effect, candidate.joint, candidate.from).ok()?;
                model = model.with_values_of(&probe.model);
            } else {
                let placed = probe.model.placed(instance(&probe.model, candidate)?).ok()?;
                let names = placed.names.iter().map(|name| named(name)).collect();
                let state_names = placed.state_names.iter().map(|name| named(name)).collect();
                effects.push(PlacedEffect { names, state_names, ..placed });
            }
        }
        let model = &model;
        let with = |run: &Run| FitRun::of_run_with(model, run, &effects);
        let ready: Vec<FitRun> = self.runs.iter().map(with).collect::<Result<_, _>>().ok()?;
        let mut best: Vec<Option<Start>> = vec![None; chunk.len()];
        for (rates, without) in self.rates.iter().zip(&self.without).take(rates.end).skip(rates.start) {
            let Some((tangent, without)) = without else { continue };
            let unknowns: Vec<Unknown> = unknowns.iter().flatten().cloned().collect();
            let spreads = vec![f64::INFINITY; unknowns.len()];
            let problem = PredictionProblem { unknowns, spreads, ..self.problem(model, ready.clone(), rates) };
            // States that the model does not have may need shorter steps.
            let reduced = tangent.reduced(&problem, &self.plan);
            let reduced = match reduced {
                None if chunk.len() > 1 => return None,
                None => tangent.reduced(&problem, &self.stiffer),
                reduced => reduced,
            };
            let Some(reduced) = reduced else { continue };
            let mut place = 0;
            for (number, (own, k)) in chunk.iter().enumerate() {
                let (candidate, probe) = (&probes[*own].0, &probes[*own].1[*k]);
                let places: Vec<usize> = (place..place + probe.steps.len()).collect();
                place += probe.steps.len();
                let bounds: Vec<(f64, f64)> = probe
                    .steps
                    .iter()
                    .map(|step| {
                        let ends = (step.range.0 * step.unit, step.range.1 * step.unit);
                        (ends.0.min(ends.1), ends.0.max(ends.1))
                    })
                    .collect();
                let promise = reduced.promise(&places, &bounds);
                let gain = without - promise.cost;
                if !gain.is_finite() || best[number].as_ref().is_some_and(|best| best.promise >= gain) {
                    continue;
                }
                // The fit itself takes the step, with all other unknowns and no further than it keeps its promise.
                let (candidate, model) = (candidate.clone(), probe.model.clone());
                let step = probe.steps.iter().map(|step| step.name.clone()).zip(promise.step).collect();
                best[number] = Some(Start { candidate, model, promise: gain, probe: *k, step });
            }
        }
        Some(best)
    }

    /// A probe at finite values, against the model without it.
    fn at_values(
        &self,
        (own, k): (usize, usize),
        probes: &[(Candidate, Vec<Probe>)],
        rates: &Range<usize>,
    ) -> Option<Start> {
        let (candidate, probe) = (&probes[own].0, &probes[own].1[k]);
        let ready: Vec<FitRun> =
            self.runs.iter().map(|run| FitRun::of_run(&probe.model, run)).collect::<Result<_, _>>().ok()?;
        let asked = self.rates.iter().zip(&self.without).take(rates.end).skip(rates.start);
        let gains = asked.filter_map(|(rates, without)| {
            let (tangent, without) = without.as_ref()?;
            let problem = self.problem(&probe.model, ready.clone(), rates);
            // A transmission may need shorter steps than the model without it.
            let cost = tangent.cost(&problem, &self.plan).or_else(|| tangent.cost(&problem, &self.stiffer));
            let gain = without - cost?;
            gain.is_finite().then_some(gain)
        });
        let best = gains.max_by(f64::total_cmp);
        let (candidate, model) = (candidate.clone(), probe.model.clone());
        Some(Start { candidate, model, promise: best?, probe: k, step: Vec::new() })
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

/// A model that its logs trust altogether is asked at this rate [1/s] all the same.
const LEAST_RATE: f64 = 1.0;
