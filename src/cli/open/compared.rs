//! Comparisons in memory: what `dynid compare` says, with every trace that it comes from.

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use dynid::sentences;
use dynid::{CompareSettings, Compared, Finding, Model, Run};
use dynid_judge::compare::{RunComparison, locate, locate::Signal};
use dynid_model::sha256_hex;
use dynid_torque::{JointTerms, terms};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};

use super::super::named::all_named_by;
use super::App;
use super::answer::{Answered, Asked, Refusal, blocking};
use super::folder::digest_of;
use super::logs::{Loaded, loaded, position_unit};
use super::recent::Room;
use super::series::Trace;
use crate::cli::inputs;

/// A comparison.
pub struct Comparison {
    loaded: Arc<Loaded>,
    /// By their index in the experiment.
    runs: HashMap<usize, OfRun>,
    answer: Value,
}

/// One run of it.
struct OfRun {
    compared: RunComparison,
    traces: HashMap<String, Arc<Trace>>,
}

impl Room for Comparison {
    /// Its traces, as much again for what they were made from, and the experiment, which may be kept by nobody else.
    fn bytes(&self) -> usize {
        let traces = self.runs.values().flat_map(|run| run.traces.values());
        2 * traces.map(|trace| trace.bytes()).sum::<usize>() + self.loaded.bytes()
    }
}

impl Comparison {
    /// A series of a run: of the comparison, such as `residual:4`, or of its log, of which `measured:4` is `q4`.
    pub fn trace(&self, run: usize, name: &str) -> Result<Arc<Trace>, Refusal> {
        if let Some(trace) = self.runs.get(&run).and_then(|run| run.traces.get(name)) {
            return Ok(Arc::clone(trace));
        }
        let of_log = name.strip_prefix("measured:").map(|joint| format!("q{joint}"));
        self.loaded.trace(run, of_log.as_deref().unwrap_or(name))
    }

    /// A run, and what was compared of it.
    pub fn run(&self, run: usize) -> Result<(&Run, &RunComparison), Refusal> {
        let compared = self.runs.get(&run).ok_or_else(|| Refusal::missing(format!("run {run} was not compared")))?;
        Ok((self.loaded.run(run)?, &compared.compared))
    }

    /// The device.
    pub fn device(&self) -> &'static dynid::Device {
        self.loaded.experiment.device
    }
}

/// The comparison of a key that was answered before.
pub fn found(app: &App, key: &str) -> Result<Arc<Comparison>, Refusal> {
    let found = app.comparisons.find(key, |_| true);
    found.ok_or_else(|| Refusal::missing("this comparison is not kept any more; ask for it again"))
}

#[derive(Deserialize)]
pub struct ComparedAsked {
    experiment: String,
    model: Option<String>,
    free: Option<Vec<usize>>,
}

/// `POST api/compared`
pub async fn compared(State(app): State<Arc<App>>, Asked(asked): Asked<ComparedAsked>) -> Answered {
    // Who waits holds no thread, and whoever is gone by then asks for nothing.
    let waiting = Arc::clone(&app);
    let _turn = waiting.comparing.acquire().await?;
    blocking(move || {
        let loaded = loaded(&app, &asked.experiment)?;
        let (model, digest) = model(&app, &loaded, asked.model.as_deref())?;
        let key = sha256_hex(format!("{} {digest} {:?}", loaded.digest, asked.free).as_bytes());
        let key = key[..32].to_owned();
        let made = || Comparison::new(&key, Arc::clone(&loaded), &model, asked.free);
        Ok(Json(app.comparisons.find_or(&key, |_| true, made)?.answer.clone()))
    })
    .await
}

/// The model of a request, or the device's own; and what tells it from others.
pub fn model(app: &App, loaded: &Loaded, path: Option<&str>) -> Result<(Model, String), Refusal> {
    let path = path.map(|path| app.folder.place(path)).transpose()?;
    let digest = match &path {
        Some(path) => {
            app.folder.check_references(path)?;
            let mut files = all_named_by(path);
            files.push(path.clone());
            digest_of(&files)
        }
        None => loaded.experiment.device.id.clone(),
    };
    Ok((app.effects.known(inputs::model(path.as_deref(), &loaded.experiment))?, digest))
}

impl Comparison {
    fn new(key: &str, loaded: Arc<Loaded>, model: &Model, free: Option<Vec<usize>>) -> Result<Self, Refusal> {
        let experiment = &loaded.experiment;
        let of_free = experiment.runs_with_free(free.as_deref())?;
        let is_of = |run: &Run| of_free.iter().any(|own| std::ptr::eq(*own, run));
        let indices: Vec<usize> = (0..experiment.runs.len()).filter(|index| is_of(&experiment.runs[*index])).collect();
        let settings = CompareSettings { free };
        let Compared { errors, predictions, findings } =
            dynid::compare(model, experiment, &settings, &|_| ControlFlow::Continue(()))?;
        let mut json = sentences::compare::json(&errors, &predictions, &findings)?;
        crate::cli::note_kernels(&mut json);
        let made: Vec<(Vec<JointTerms>, Vec<Value>)> = indices
            .par_iter()
            .zip(&errors.runs)
            .enumerate()
            .map(|(place, (&index, compared))| {
                let run = &experiment.runs[index];
                let own: Vec<&Finding> = findings.iter().filter(|finding| finding.run_index == place).collect();
                let spans = locate::spans(model, run, compared, &own);
                let of_finding = |(finding, spans): (&&Finding, &Option<Vec<[f64; 2]>>)| {
                    json!({
                        "run": index,
                        "joint": finding.joint,
                        "error": finding.error,
                        "sentence": sentences::finding::sentence(finding),
                        "whole": spans.is_none(),
                        "spans": spans.as_deref().unwrap_or_default(),
                    })
                };
                // A motion that cannot be filtered has no terms; a note of the comparison says so.
                (terms(model, run).unwrap_or_default(), own.iter().zip(&spans).map(of_finding).collect())
            })
            .collect();
        // As they are told: the most telling first, of whichever run.
        let mut told: Vec<std::vec::IntoIter<Value>> = Vec::new();
        let mut runs = HashMap::new();
        let mut described = Vec::new();
        for ((&index, compared), (terms, findings)) in indices.iter().zip(errors.runs).zip(made) {
            told.push(findings.into_iter());
            let traces = traces(&loaded, index, &compared, terms);
            described.push(of_run(&loaded, index, &compared, &traces));
            let traces = traces.into_iter().map(|(name, trace)| (name, Arc::new(trace))).collect();
            runs.insert(index, OfRun { compared, traces });
        }
        let findings: Vec<Value> = findings.iter().filter_map(|finding| told[finding.run_index].next()).collect();
        let answer = json!({ "key": key, "runs": described, "findings": findings, "json": json });
        Ok(Self { loaded, runs, answer })
    }
}

/// All series of a run but those of its log, by name.
fn traces(loaded: &Loaded, index: usize, compared: &RunComparison, terms: Vec<JointTerms>) -> Vec<(String, Trace)> {
    let run = &loaded.experiment.runs[index];
    let t = loaded.time(index);
    let mut traces = Vec::new();
    for (slot, joint) in run.free.iter().enumerate() {
        let measured = &run.log.q[*joint];
        if let Some(simulated) = compared.simulated.as_ref().map(|simulated| &simulated[slot]) {
            let residual = measured.iter().zip(simulated).map(|(measured, simulated)| measured - simulated).collect();
            traces.push((format!("simulated:{joint}"), Trace::new(Arc::clone(&t), simulated.clone())));
            traces.push((format!("residual:{joint}"), Trace::new(Arc::clone(&t), residual)));
        }
        if let Some(torque) = compared.torque.get(slot) {
            let t = Arc::new(torque.time.clone());
            traces.push((format!("torque:{joint}"), Trace::new(Arc::clone(&t), torque.torque.clone())));
            traces.push((format!("torque_residual:{joint}"), Trace::new(t, torque.residual.clone())));
        }
    }
    for JointTerms { joint, time, mut terms, .. } in terms {
        let t = Arc::new(time);
        // The last is what is left, which is the torque error.
        terms.pop();
        let named = terms.into_iter().map(|(name, values)| (format!("term:{name}:{joint}"), values));
        traces.extend(named.map(|(name, values)| (name, Trace::new(Arc::clone(&t), values))));
    }
    traces
}

fn of_run(loaded: &Loaded, index: usize, compared: &RunComparison, traces: &[(String, Trace)]) -> Value {
    let device = loaded.experiment.device;
    let joints = compared.joints.iter().map(|joint| {
        let of_joint = traces.iter().filter_map(|(name, _)| name.strip_suffix(&format!(":{}", joint.joint)));
        let series: Vec<&str> = ["measured"].into_iter().chain(of_joint).collect();
        json!({
            "joint": joint.joint,
            "unit": position_unit(device, joint.joint),
            "command_unit": device.joints[joint.joint].command_unit,
            "rmse": joint.rmse,
            "noise": joint.noise_floor,
            "torque_percent": joint.torque_percent,
            "terms": series.iter().filter_map(|name| name.strip_prefix("term:")).collect::<Vec<_>>(),
            "series": series,
        })
    });
    json!({
        "run": index,
        "file": compared.file,
        "role": compared.role,
        "lost": compared.lost,
        "notes": sentences::compare::notes(compared),
        "joints": joints.collect::<Vec<Value>>(),
    })
}

/// The name of an error, as requests say it.
pub fn error_named(name: Option<&str>) -> Result<Option<Signal>, Refusal> {
    match name {
        None => Ok(None),
        Some("torque") => Ok(Some(Signal::Torque)),
        Some("position") => Ok(Some(Signal::Position)),
        Some(other) => Err(Refusal::bad(format!("`{other}` is no error; ask for torque or position"))),
    }
}
