//! Parameters tried by hand: a run simulated with other values, from where it was found to start.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use axum::Json;
use axum::extract::State;
use dynid::{Model, Run};
use dynid_dynamics::simulate::{self, Options, Steps};
use dynid_identify::position::{self, FitRun, first_state, occurs};
use dynid_identify::{steps_beside, strays};
use dynid_judge::compare::{LOST, closed_loop};
use dynid_logs::noise::noise_of_log;
use dynid_model::sha256_hex;
use dynid_signal::statistics::rms;
use serde::Deserialize;
use serde_json::{Value, json};

use super::App;
use super::answer::{Answered, Asked, Refusal, blocking};
use super::compared::model;
use super::files::put;
use super::folder::with_slashes;
use super::logs::{Loaded, bytes_of_log, loaded};
use super::recent::Room;
use super::series::{Trace, Window};

#[derive(Deserialize)]
pub struct ParametersAsked {
    experiment: String,
    model: Option<String>,
}

/// `POST api/parameters`
pub async fn parameters(State(app): State<Arc<App>>, Asked(asked): Asked<ParametersAsked>) -> Answered {
    blocking(move || {
        let loaded = loaded(&app, &asked.experiment)?;
        let (model, _) = model(&app, &loaded, asked.model.as_deref())?;
        let systems = loaded.experiment.runs.iter().map(|run| model.system_of(run));
        let systems = systems.collect::<Result<Vec<_>, _>>()?;
        let matter = model.names().into_iter().filter(|name| systems.iter().any(|system| occurs(system, name)));
        let parameters: Vec<Value> = matter.filter_map(|name| described(&model, &name)).collect();
        Ok(Json(json!({ "parameters": parameters })))
    })
    .await
}

fn described(model: &Model, name: &str) -> Option<Value> {
    let own = model.parameter(name)?;
    let symbol = name.rsplit('.').next().unwrap_or(name);
    let instance =
        model.effects.iter().find(|effect| name.strip_suffix(symbol) == Some(&format!("{}.", effect.place_name())));
    let place = name.split('.').nth(1).unwrap_or_default();
    let (label, joint, meaning) = match instance {
        Some(effect) => (
            effect.label().replace('`', ""),
            effect.joint,
            effect.effect.parameter(symbol).map(|own| own.title.as_str()),
        ),
        None if name.starts_with("link.") => (format!("link {place}"), None, Some(of_link(symbol))),
        None if name.starts_with("length.") => ("lengths".to_owned(), None, Some("a length of the device")),
        None => ("gravity".to_owned(), None, Some("gravity along an axis of the base")),
    };
    Some(json!({
        "name": name,
        "effect": label,
        "joint": joint,
        "value": own.value,
        "lower": own.lower,
        "upper": own.upper,
        "fixed": own.fixed,
        "std_error": model.fit.as_ref().and_then(|fit| fit.std_error.get(name)),
        "unit": model.unit(name),
        "meaning": meaning,
    }))
}

/// What a parameter of a link means.
fn of_link(symbol: &str) -> &'static str {
    match symbol {
        "m" => "mass",
        "x" | "y" | "z" => "centre of mass along an axis of the link's frame",
        "Ixx" | "Iyy" | "Izz" => "moment of inertia about an axis of the link's frame",
        _ => "entry of the inertia matrix off its diagonal",
    }
}

/// A run of a model, ready to be simulated with other values.
pub struct Trial {
    model: Model,
    fit_run: FitRun,
    /// Positions of the free joints, and their speeds where the run begins in motion.
    start: Vec<f64>,
    options: Options,
    t: Arc<Vec<f64>>,
    noise: Vec<f64>,
    bytes: usize,
}

impl Room for Trial {
    fn bytes(&self) -> usize {
        self.bytes
    }
}

impl Trial {
    fn new(loaded: &Loaded, run: usize, model: Model) -> Result<Self, Refusal> {
        let (run, t) = (loaded.run(run)?, loaded.time(run));
        let fit_run = FitRun { from_s: f64::NEG_INFINITY, first_half: 1.0, ..FitRun::of_run(&model, run)? };
        let options = Options { steps: steps_beside(run), ..Options::default() };
        let first = first_state(&fit_run);
        // As in a comparison: where the first sample loses the log, a better start does not bring it back.
        let follows = simulate::simulate(&fit_run.system, &fit_run.input(), &first, &options)
            .is_ok_and(|played| !strays(run, &by_joint(&played.q, run.free.len()), LOST));
        let settings = position::Options { steps: Some(options.steps), ..position::Options::default() };
        let better = if follows { position::initial_positions(&fit_run, &settings).ok() } else { None };
        let noise = run.free.iter().map(|&joint| noise_of_log(&run.log.q[joint])).collect();
        // The run of the fit has the log's numbers for itself.
        let bytes = bytes_of_log(run);
        Ok(Self { model, start: better.unwrap_or(first), fit_run, options, t, noise, bytes })
    }

    /// Positions of each free joint with these values: without any, those of a comparison; else with steps that no picture tells from
    /// them, several times as fast.
    fn simulated(&self, run: &Run, values: &BTreeMap<String, f64>) -> Result<Vec<Vec<f64>>, Refusal> {
        let mut system = self.fit_run.system.clone();
        let mut options = self.options;
        if !values.is_empty() {
            // What was made to evaluate the one system serves the other.
            let other = with(&self.model, values)?.system_of(run)?;
            system.set_parameters(other.link_parameters(), other.effect_parameters());
            options.steps = Steps::ADAPTIVE;
        }
        let played = match closed_loop(&system, run, &options)? {
            Some(played) => played?.0,
            None => simulate::simulate(&system, &self.fit_run.input(), &self.start, &options)?,
        };
        Ok(by_joint(&played.q, run.free.len()))
    }
}

fn by_joint(rows: &[f64], n_free: usize) -> Vec<Vec<f64>> {
    (0..n_free).map(|slot| rows.iter().skip(slot).step_by(n_free).copied().collect()).collect()
}

/// The model with other values, within their bounds.
fn with(model: &Model, values: &BTreeMap<String, f64>) -> Result<Model, Refusal> {
    let mut model = model.clone();
    for (name, value) in values {
        let own = model.require(name)?;
        if !own.contains(*value) {
            let sentence = format!(
                "{name} = {value} lies outside its bounds {} to {}; widen them in the model",
                own.lower, own.upper
            );
            return Err(Refusal::bad(sentence));
        }
        model.set_value(name, *value)?;
    }
    Ok(model)
}

#[derive(Deserialize)]
pub struct TryAsked {
    experiment: String,
    model: Option<String>,
    run: usize,
    values: BTreeMap<String, f64>,
    #[serde(flatten)]
    window: Window,
}

/// `POST api/try`
pub async fn attempt(State(app): State<Arc<App>>, Asked(asked): Asked<TryAsked>) -> Answered {
    blocking(move || {
        let TryAsked { experiment, model: path, run: index, values, window } = asked;
        let begun = Instant::now();
        let loaded = loaded(&app, &experiment)?;
        let (model, digest) = model(&app, &loaded, path.as_deref())?;
        let key = format!("{} {digest} {index}", loaded.digest);
        let trial = app.trials.find_or(&key, |_| true, || Trial::new(&loaded, index, model))?;
        let run = loaded.run(index)?;
        let mut series = Vec::new();
        let mut errors = Vec::new();
        for (slot, simulated) in trial.simulated(run, &values)?.into_iter().enumerate() {
            let joint = run.free[slot];
            let measured = &run.log.q[joint];
            let residual: Vec<f64> = measured.iter().zip(&simulated).map(|(measured, own)| measured - own).collect();
            errors.push(json!({ "joint": joint, "rmse": rms(&residual), "noise": trial.noise[slot] }));
            for (name, values) in [("simulated", simulated), ("residual", residual)] {
                let trace = Trace::new(Arc::clone(&trial.t), values);
                series.push(trace.columns(&format!("{name}:{joint}"), window));
            }
        }
        let ms = 1e3 * begun.elapsed().as_secs_f64();
        Ok(Json(json!({ "series": series, "rmse": errors, "ms": ms })))
    })
    .await
}

#[derive(Deserialize)]
pub struct TriedAsked {
    experiment: String,
    model: Option<String>,
    values: BTreeMap<String, f64>,
    out: String,
}

/// `POST api/tried`
pub async fn tried(State(app): State<Arc<App>>, Asked(asked): Asked<TriedAsked>) -> Answered {
    let out = app.folder.place(&asked.out)?;
    blocking(move || {
        let loaded = loaded(&app, &asked.experiment)?;
        let (model, _) = model(&app, &loaded, asked.model.as_deref())?;
        let _alone = app.writing();
        let mut model = with(&model, &asked.values)?;
        // As after `dynid add`: no fit found these values; the next one names this file as its parent.
        model.fit = None;
        let text = model.to_toml_at(&out);
        put(&out, &text, false)?;
        Ok(Json(json!({ "path": with_slashes(&out), "digest": sha256_hex(text.as_bytes()) })))
    })
    .await
}
