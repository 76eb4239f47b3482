//! What would each effect explain at each place? Asked without a fit, by one step of Gauss and Newton (a score test).
//!
//! At the fitted model every candidate's own unknowns, and with them all others, take the step that raises the likelihood most. An
//! effect that does nothing at its null is asked there: all such share one evaluation, as so many more columns of one derivative.
//! What no derivative at a null shows (a dead zone, a delay, an elastic joint) is asked at a few finite values. A model that is held
//! to its logs firmly shows other effects than one that runs nearly free, so each is asked at a few rates.

use std::collections::BTreeMap;

use dynid_dynamics::simulate::{self, Input, Predictor};
use dynid_dynamics::system::{PlacedEffect, SystemError};
use dynid_identify::position::{FitRun, Unknown, first_state};
use dynid_identify::prediction::{Expansion, PredictionProblem};
use dynid_logs::experiment::Run;
use dynid_user_model::Model;
use rayon::prelude::*;

use crate::candidate::{Candidate, Probe, instance};

/// A candidate with values to start a fit from, and what they promise.
#[derive(Debug, Clone)]
pub struct Start {
    /// What is added.
    pub candidate: Candidate,
    /// The model with it.
    pub model: Model,
    /// By how much the log likelihood of what was looked at would rise.
    pub promise: f64,
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
    /// Cost of the model as it is at each of the rates, once its own unknowns have taken their step.
    without: Vec<Option<f64>>,
    substeps: usize,
    expected: &'a (dyn Fn(&str) -> Option<f64> + Sync),
}

/// Rates at which candidates are asked, as multiples of the fitted ones.
const RATES: [f64; 3] = [1.0, 0.3, 0.1];
/// Columns, and states of effects, that one evaluation takes at most.
const MOST_COLUMNS: usize = 160;
const MOST_STATES: usize = 8;
/// Integration steps so many times shorter than the model's are tried for what stands in the drive path.
const SHORTER: [usize; 3] = [1, 4, 16];
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
        (initial, substeps): (&[Vec<f64>], usize),
        runs: &'a [Run],
        expected: &'a (dyn Fn(&str) -> Option<f64> + Sync),
    ) -> Result<Self, SystemError> {
        let ready = runs.iter().map(|run| FitRun::of_run(model, run)).collect::<Result<Vec<_>, _>>()?;
        let multiplied = |factor: f64| rates.iter().map(move |(joint, rate)| (*joint, rate.max(LEAST_RATE) * factor));
        let rates = RATES.iter().map(|factor| multiplied(*factor).collect()).collect();
        let initial = initial.to_vec();
        let (first, without) = (Vec::new(), Vec::new());
        let mut test = Self { model, runs, ready, initial, rates, first, without, substeps, expected };
        test.first = test.ready.iter().map(|ready| test.first_of(ready)).collect();
        test.without =
            test.rates.par_iter().map(|rates| test.cost(model, test.ready.clone(), rates, test.substeps)).collect();
        Ok(test)
    }

    /// Cost of a model at its values and these rates, once all its unknowns have taken their step.
    fn cost(&self, model: &Model, ready: Vec<FitRun>, rates: &BTreeMap<usize, f64>, substeps: usize) -> Option<f64> {
        let expansion = Expansion::new(&self.problem(model, ready, rates), substeps)?;
        Some(expansion.reduced(&[])?.cost())
    }

    /// Every probe's promise, those of one candidate together; `go_on` is asked between them.
    pub fn ask(&self, probes: &[(Candidate, Vec<Probe>)], go_on: &(dyn Fn() -> bool + Sync)) -> Vec<Start> {
        let all: Vec<(usize, usize)> =
            probes.iter().enumerate().flat_map(|(own, (_, probes))| (0..probes.len()).map(move |k| (own, k))).collect();
        let vanish: Vec<bool> = all.par_iter().map(|(own, k)| go_on() && self.vanishes(&probes[*own].1[*k])).collect();
        let mut chunks: Vec<Vec<(usize, usize)>> = Vec::new();
        let (mut columns, mut states) = (0, 0);
        let mut jobs: Vec<Vec<(usize, usize)>> = Vec::new();
        for (place, vanishes) in all.iter().zip(&vanish) {
            let (candidate, own) = &probes[place.0];
            let own = &own[place.1];
            if !vanishes {
                jobs.push(vec![*place]);
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
        let n_chunks = chunks.len();
        chunks.extend(jobs);
        let asked: Vec<((usize, usize), Option<Start>)> = chunks
            .par_iter()
            .enumerate()
            .flat_map_iter(|(index, chunk)| {
                let found = match (go_on(), index < n_chunks) {
                    (false, _) => Vec::new(),
                    (true, true) => self.all_at_null(chunk, probes),
                    (true, false) => chunk.iter().map(|place| self.at_values(*place, probes)).collect(),
                };
                chunk.iter().copied().zip(found)
            })
            .collect();
        asked.into_iter().filter_map(|(_, start)| start).collect()
    }

    fn problem(&self, model: &Model, runs: Vec<FitRun>, rates: &BTreeMap<usize, f64>) -> PredictionProblem {
        PredictionProblem {
            initial: self.initial.clone(),
            rates: rates.clone(),
            keeps_rates: false,
            ..PredictionProblem::of_runs(model, self.expected, runs)
        }
    }

    /// Whether a probe has steps to take and does nothing before it takes them.
    fn vanishes(&self, probe: &Probe) -> bool {
        if probe.steps.is_empty() {
            return false;
        }
        let ready = self.runs.iter().map(|run| FitRun::of_run(&probe.model, run).ok());
        ready.zip(&self.first).all(|(ready, without)| match (ready.and_then(|ready| self.first_of(&ready)), without) {
            (Some(with), Some(without)) => with.iter().zip(without).all(|(one, other)| (one - other).abs() <= 1e-12),
            _ => false,
        })
    }

    /// Predictions of the first samples of a run.
    fn first_of(&self, ready: &FitRun) -> Option<Vec<f64>> {
        let rates: Vec<f64> = ready.system.kernel().free.iter().map(|joint| self.rates[0][joint]).collect();
        let predictor = Predictor { position: &ready.position, rates: &rates, every: 1 };
        let input = Input { time: &ready.time, command: &ready.command, intersample: ready.intersample };
        let options = simulate::Options { substeps: self.substeps, ..simulate::Options::default() };
        let found = simulate::predict(&ready.system, &input.first(FIRST), &predictor, &first_state(ready), &options);
        Some(found.ok()?.q)
    }

    /// Probes that do nothing as yet; where one has no derivative there, the others are asked without it.
    fn all_at_null(&self, chunk: &[(usize, usize)], probes: &[(Candidate, Vec<Probe>)]) -> Vec<Option<Start>> {
        match self.at_null(chunk, probes) {
            Some(found) => found,
            None if chunk.len() < 2 => vec![None; chunk.len()],
            None => {
                let (one, other) = chunk.split_at(chunk.len() / 2);
                let mut found = self.all_at_null(one, probes);
                found.extend(self.all_at_null(other, probes));
                found
            }
        }
    }

    /// Probes that do nothing as yet, all in one evaluation.
    fn at_null(&self, chunk: &[(usize, usize)], probes: &[(Candidate, Vec<Probe>)]) -> Option<Vec<Option<Start>>> {
        let mut effects: Vec<PlacedEffect> = Vec::new();
        let mut unknowns: Vec<Vec<Unknown>> = Vec::new();
        for (number, (own, k)) in chunk.iter().enumerate() {
            let (candidate, probe) = (&probes[*own].0, &probes[*own].1[*k]);
            let placed = probe.model.placed(instance(&probe.model, candidate)?).ok()?;
            let named = |name: &str| format!("{name}#{number}");
            unknowns.push(
                probe
                    .steps
                    .iter()
                    .map(|step| Unknown {
                        name: named(&step.name),
                        value: step.from,
                        expected: step.from,
                        lower: f64::NEG_INFINITY,
                        upper: f64::INFINITY,
                    })
                    .collect(),
            );
            let names = placed.names.iter().map(|name| named(name)).collect();
            let state_names = placed.state_names.iter().map(|name| named(name)).collect();
            effects.push(PlacedEffect { names, state_names, ..placed });
        }
        let ready: Vec<FitRun> = self
            .runs
            .iter()
            .map(|run| FitRun::of_run_with(self.model, run, &effects))
            .collect::<Result<_, _>>()
            .ok()?;
        let mut best: Vec<Option<Start>> = vec![None; chunk.len()];
        for (rates, without) in self.rates.iter().zip(&self.without) {
            let Some(without) = without else { continue };
            let mut problem = self.problem(self.model, ready.clone(), rates);
            let first = problem.unknowns.len();
            // The model's own come first; then these, which no prior holds.
            problem.unknowns.extend(unknowns.iter().flatten().cloned());
            problem.spreads.resize(problem.unknowns.len(), f64::INFINITY);
            let own: Vec<usize> = (first..problem.unknowns.len()).collect();
            let reduced = Expansion::new(&problem, self.substeps)?.reduced(&own)?;
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
                let units: Vec<f64> = probe.steps.iter().zip(&promise.step).map(|(step, by)| by / step.unit).collect();
                best[number] =
                    Some(Start { candidate: candidate.clone(), model: probe.at(1.0, &units), promise: gain });
            }
        }
        Some(best)
    }

    /// A probe at finite values, against the model without it.
    fn at_values(&self, (own, k): (usize, usize), probes: &[(Candidate, Vec<Probe>)]) -> Option<Start> {
        let (candidate, probe) = (&probes[own].0, &probes[own].1[k]);
        let ready: Vec<FitRun> =
            self.runs.iter().map(|run| FitRun::of_run(&probe.model, run)).collect::<Result<_, _>>().ok()?;
        // A transmission may need shorter steps than the model without it.
        let gains = self.rates.iter().zip(&self.without).filter_map(|(rates, without)| {
            let cost = |shorter: usize| self.cost(&probe.model, ready.clone(), rates, shorter * self.substeps);
            let gain = (*without)? - SHORTER.into_iter().find_map(cost)?;
            gain.is_finite().then_some(gain)
        });
        let best = gains.max_by(f64::total_cmp);
        Some(Start { candidate: candidate.clone(), model: probe.model.clone(), promise: best? })
    }
}

/// A model that its logs trust altogether is asked at this rate [1/s] all the same.
const LEAST_RATE: f64 = 1.0;
