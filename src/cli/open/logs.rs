//! Experiments in memory: read once, and again when one of their files changes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use axum::Json;
use axum::extract::State;
use dynid::{Experiment, Run};
use dynid_logs::quality;
use dynid_model::{Device, JointKind, sha256_hex};
use dynid_sentences::quality::warning;
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};

use super::super::named::all_named_by;
use super::App;
use super::answer::{Answered, Asked, Refusal, blocking};
use super::files::{Named, named};
use super::folder::{Stamp, digest_of, with_slashes};
use super::recent::Room;
use super::series::Trace;

/// An experiment with what it was read from.
pub struct Loaded {
    pub experiment: Experiment,
    /// Of every number of the logs, and of the text of the experiment and of what it names.
    pub digest: String,
    files: Vec<(PathBuf, Option<Stamp>)>,
    /// As the file says of each run.
    rows: Vec<Option<[usize; 2]>>,
    times: Vec<Arc<Vec<f64>>>,
    /// What is told of it, made when it is first asked for.
    described: OnceLock<Value>,
    traces: Mutex<HashMap<(usize, String), Arc<Trace>>>,
}

impl Room for Loaded {
    /// Its logs, and as much again for traces that are drawn.
    fn bytes(&self) -> usize {
        2 * self.experiment.runs.iter().map(bytes_of_log).sum::<usize>()
    }
}

/// Numbers of a log (bytes).
pub fn bytes_of_log(run: &Run) -> usize {
    let log = &run.log;
    let columns = 1 + log.q.len() + log.tau.len() + log.reference.as_ref().map_or(0, Vec::len);
    columns * log.len() * size_of::<f64>()
}

impl Loaded {
    fn read(path: &Path) -> Result<Self, Refusal> {
        let named: Vec<PathBuf> = all_named_by(path).into_iter().chain([path.to_owned()]).collect();
        // Stamps are older than what is read: a file that changes meanwhile is read again.
        let files = named.iter().map(|path| (path.clone(), Stamp::of(path))).collect();
        let content = digest_of(&named);
        let experiment = Experiment::load(path)?;
        let times = experiment.runs.iter().map(|run| Arc::new(run.log.t.clone())).collect();
        let digest = sha256_hex(format!("{} {content}", experiment.digest).as_bytes());
        let rows = rows(&dynid_files::read(path)?, experiment.runs.len());
        Ok(Self { digest, files, rows, times, described: OnceLock::new(), traces: Mutex::default(), experiment })
    }

    fn is_current(&self) -> bool {
        self.files.iter().all(|(path, stamp)| Stamp::of(path) == *stamp)
    }

    pub fn run(&self, index: usize) -> Result<&Run, Refusal> {
        self.experiment.runs.get(index).ok_or_else(|| Refusal::missing(format!("the experiment has no run {index}")))
    }

    pub fn time(&self, run: usize) -> Arc<Vec<f64>> {
        Arc::clone(&self.times[run])
    }

    /// A column of a log: `q4`, `tau4`, `ref4`.
    pub fn trace(&self, index: usize, name: &str) -> Result<Arc<Trace>, Refusal> {
        let run = self.run(index)?;
        let key = (index, name.to_owned());
        if let Some(trace) = self.traces.lock().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return Ok(Arc::clone(trace));
        }
        let values = columns(run).into_iter().find(|(own, _)| own == name).map(|(_, values)| values.clone());
        let values = values.ok_or_else(|| Refusal::missing(format!("{} has no series `{name}`", run.file)))?;
        let trace = Arc::new(Trace::new(self.time(index), values));
        self.traces.lock().unwrap_or_else(PoisonError::into_inner).insert(key, Arc::clone(&trace));
        Ok(trace)
    }
}

/// The columns of a log that say something.
fn columns(run: &Run) -> Vec<(String, &Vec<f64>)> {
    let log = &run.log;
    let mut found = Vec::new();
    let kinds = [("q", Some(&log.q)), ("tau", Some(&log.tau)), ("ref", log.reference.as_ref())];
    for (kind, joints) in kinds {
        for (joint, values) in joints.into_iter().flatten().enumerate() {
            if run.free.contains(&joint) || values.iter().any(|value| *value != 0.0) {
                found.push((format!("{kind}{joint}"), values));
            }
        }
    }
    found
}

/// The unit of a joint's position.
pub fn position_unit(device: &Device, joint: usize) -> &'static str {
    units_of(device, joint).0
}

/// The units of a joint's position and of the torque about it, or the force along it.
pub fn units_of(device: &Device, joint: usize) -> (&'static str, &'static str) {
    if device.joints[joint].kind == JointKind::Prismatic { ("m", "N") } else { ("rad", "N*m") }
}

/// The experiment of a request.
pub fn loaded(app: &App, path: &str) -> Result<Arc<Loaded>, Refusal> {
    let path = app.folder.place(path)?;
    if !path.is_file() {
        return Err(Refusal::missing(format!("there is no file {}", path.display())));
    }
    app.folder.check_references(&path)?;
    app.experiments.find_or(&with_slashes(&path), Loaded::is_current, || Loaded::read(&path))
}

/// `GET api/experiment`
pub async fn experiment(State(app): State<Arc<App>>, query: Named) -> Answered {
    let path = named(&query, "path")?.to_owned();
    blocking(move || described(&app, &path).map(Json)).await
}

/// What is told of an experiment.
pub fn described(app: &App, path: &str) -> Result<Value, Refusal> {
    let loaded = loaded(app, path)?;
    let mut answer = loaded.described.get_or_init(|| of_all(&loaded)).clone();
    answer["path"] = path.into();
    Ok(answer)
}

fn of_all(loaded: &Loaded) -> Value {
    let Experiment { device, runs, .. } = &loaded.experiment;
    let joints = device.joints.iter().enumerate().map(|(number, joint)| {
        json!({
            "number": number,
            "name": joint.title,
            "unit": position_unit(device, number),
            "command_unit": joint.command_unit,
            "free": runs.iter().any(|run| run.free.contains(&number)),
        })
    });
    let joints: Vec<Value> = joints.collect();
    let runs: Vec<Value> = runs.par_iter().zip(&loaded.rows).enumerate().map(of_run).collect();
    json!({
        "device": { "id": device.id, "name": device.title, "joints": joints },
        "digest": loaded.digest,
        "runs": runs,
    })
}

fn of_run((index, (run, rows)): (usize, (&Run, &Option<[usize; 2]>))) -> Value {
    let quality = quality::of_run(run);
    let columns: Vec<String> = columns(run).into_iter().map(|(name, _)| name).collect();
    json!({
        "run": index,
        "file": run.file,
        "label": run.label(),
        "role": run.role.to_string(),
        "free": run.free,
        "rows": rows,
        "moving": run.settings.moving,
        "samples": run.log.len(),
        "t0": run.log.t.first(),
        "t1": run.log.t.last(),
        "rate_hz": quality.rate_hz,
        "closed_loop": !run.is_open_loop(),
        "payload": run.payload,
        "quality": quality.warnings.iter().map(warning).collect::<Vec<_>>(),
        "columns": columns,
    })
}

/// The `rows` of each run of an experiment, which was read and is right.
fn rows(text: &str, n_runs: usize) -> Vec<Option<[usize; 2]>> {
    let table: toml::Table = text.parse().unwrap_or_default();
    let of_run = |index: usize| table.get("run")?.get(index)?.get("rows")?.clone().try_into().ok();
    (0..n_runs).map(of_run).collect()
}

#[derive(Deserialize)]
pub struct RowsAsked {
    experiment: String,
    run: usize,
    from: f64,
    to: f64,
}

/// `POST api/rows`
pub async fn rows_between(State(app): State<Arc<App>>, Asked(asked): Asked<RowsAsked>) -> Answered {
    blocking(move || {
        let loaded = loaded(&app, &asked.experiment)?;
        let log = &loaded.run(asked.run)?.log;
        let first = loaded.rows[asked.run].map_or(0, |[first, _]| first);
        // Of the sample that so many samples are before: those that the log leaves out have rows of their own.
        let row = |samples: usize| {
            log.left_out.iter().fold(first + samples, |row, left_out| row + usize::from(*left_out <= row))
        };
        let from = log.t.partition_point(|t| *t < asked.from);
        let to = log.t.partition_point(|t| *t <= asked.to);
        if from >= to {
            return Err(Refusal::bad("no sample of the run lies between these times"));
        }
        Ok(Json(json!({ "rows": [row(from), row(to - 1) + 1] })))
    })
    .await
}
