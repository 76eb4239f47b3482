//! The calls of the library. Results are JSON as the program prints it, and models.

use std::path::PathBuf;

use dynid::{
    Begin, CheckSettings, Checkpoint, CompareSettings, Compared, DiagnoseSettings, ErrorSignal, FitSettings,
    LadderSettings, ReportSettings, SimulateSettings, Simulated, Weighting, sentences,
};
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;

use crate::arrays::shaped;
use crate::errors::{raised, write};
use crate::experiment::Experiment;
use crate::given::natural;
use crate::model::Model;
use crate::work;

type Listener<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

fn error_signal(error: Option<&str>) -> PyResult<Option<ErrorSignal>> {
    Ok(match error {
        None => None,
        Some("position") => Some(ErrorSignal::Position),
        Some("torque") => Some(ErrorSignal::Torque),
        Some("both") => Some(ErrorSignal::Both),
        Some("prediction") => Some(ErrorSignal::Prediction),
        Some(other) => {
            let expected = "\"prediction\", \"position\", \"torque\" or \"both\"";
            return Err(raised(format!("error: expected {expected}, found \"{other}\"; correct the value")));
        }
    })
}

fn json(value: serde_json::Result<Value>) -> Result<String, dynid::Error> {
    // What the library finds has names as keys, so that this cannot fail.
    Ok(value.unwrap_or_default().to_string())
}

/// A fit; the fitted model, whether it is a minimum, and the result.
#[pyfunction]
#[pyo3(signature = (
    model, experiment, *, error, free, method, weights, only, starts, seed, from_s, first_half, substeps, iterations, checkpoint, resume,
    progress
))]
#[allow(clippy::too_many_arguments)]
pub fn fit(
    py: Python<'_>,
    model: &Model,
    experiment: Experiment,
    error: Option<&str>,
    #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
    method: Option<String>,
    weights: &str,
    only: Vec<String>,
    #[pyo3(from_py_with = natural)] starts: usize,
    #[pyo3(from_py_with = natural)] seed: u64,
    from_s: Option<f64>,
    first_half: Option<f64>,
    #[pyo3(from_py_with = natural)] substeps: Option<usize>,
    #[pyo3(from_py_with = natural)] iterations: Option<usize>,
    checkpoint: Option<PathBuf>,
    resume: bool,
    progress: Listener<'_, '_>,
) -> PyResult<(Model, bool, String)> {
    let (model, experiment) = (&model.0, experiment.get()?);
    let begin = if resume { Begin::Resume } else { Begin::New };
    let default = FitSettings::default();
    let settings = FitSettings {
        error: error_signal(error)?,
        free,
        method,
        weighting: match weights {
            "noise" => Weighting::ByNoise,
            "method" => Weighting::OfMethod,
            other => {
                let message =
                    format!("weights: expected \"noise\" or \"method\", found \"{other}\"; correct the value");
                return Err(raised(message));
            }
        },
        only,
        starts,
        seed,
        from_s,
        first_half,
        substeps,
        iterations: iterations.unwrap_or(default.iterations),
        checkpoint: checkpoint.map(|path| Checkpoint { path, begin }),
    };
    work::done(py, progress, |reporter| {
        let found = dynid::fit(model, &experiment, &settings, &mut |told| reporter.tell(|| Some(told.json())))?;
        let runs = experiment.runs_with_free(settings.free.as_deref())?;
        let judged = dynid_judge::compare::compare(&found.model, &runs)?;
        if let Some(Checkpoint { path, .. }) = &settings.checkpoint {
            // The result is safe; what is left of the search would only be in the way of the next.
            let _ = dynid_identify::checkpoint::remove(path);
        }
        let json = sentences::fit::json(model, &found, &judged).to_string();
        Ok::<_, dynid::Error>((found.model.into(), found.status.may_update_model(), json))
    })
}

/// A comparison: the result, and what a picture of each run and joint shows.
#[pyfunction]
#[pyo3(signature = (model, experiment, *, free, progress))]
pub fn compare<'py>(
    py: Python<'py>,
    model: &Model,
    experiment: Experiment,
    #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
    progress: Listener<'_, '_>,
) -> PyResult<(String, Bound<'py, PyList>)> {
    let (model, experiment) = (&model.0, experiment.get()?);
    let settings = CompareSettings { free };
    let (json, panels) = work::done(py, progress, |reporter| {
        let tell = |done: dynid::Done| reporter.tell(|| Some(done.json("runs compared")));
        let Compared { errors, predictions, findings } = dynid::compare(model, &experiment, &settings, &tell)?;
        let runs = experiment.runs_with_free(settings.free.as_deref())?;
        let panels = dynid_report::panels(model.device, &runs, &errors, dynid_report::ShownErrors::Both);
        Ok::<_, dynid::Error>((json(sentences::compare::json(&errors, &predictions, &findings))?, panels))
    })?;
    let list = PyList::empty(py);
    for panel in panels {
        let dict = PyDict::new(py);
        dict.set_item("title", panel.title)?;
        dict.set_item("quantity", panel.quantity)?;
        dict.set_item("unit", panel.unit)?;
        dict.set_item("noise", panel.noise_floor)?;
        for (name, values) in [("t", panel.time), ("measured", panel.measured), ("model", panel.predicted)] {
            dict.set_item(name, values.into_pyarray(py))?;
        }
        list.append(dict)?;
    }
    Ok((json, list))
}

/// A diagnosis: the result, the model that was asked about after its fit, and the one with the effects that it lacked.
#[pyfunction]
#[pyo3(signature = (model, experiment, *, free, error, depth, progress))]
pub fn diagnose(
    py: Python<'_>,
    model: &Model,
    experiment: Experiment,
    #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
    error: Option<&str>,
    #[pyo3(from_py_with = natural)] depth: Option<usize>,
    progress: Listener<'_, '_>,
) -> PyResult<(String, Option<Model>, Option<Model>)> {
    let (model, experiment) = (&model.0, experiment.get()?);
    let settings = DiagnoseSettings { free, error: error_signal(error)?, depth, ..DiagnoseSettings::default() };
    work::done(py, progress, |reporter| {
        let found = dynid::diagnose(model, &experiment, &settings, &|told| reporter.tell(|| told.json()))?;
        let json = json(sentences::diagnosis::json(&found))?;
        Ok::<_, dynid::Error>((json, found.base.map(Model::from), found.better.map(Model::from)))
    })
}

/// Models of a lineage on the same runs.
#[pyfunction]
#[pyo3(signature = (models, experiment, *, free, progress))]
pub fn ladder(
    py: Python<'_>,
    models: Vec<(String, Model)>,
    experiment: Experiment,
    #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
    progress: Listener<'_, '_>,
) -> PyResult<String> {
    let (models, experiment) = (named(models), experiment.get()?);
    work::done(py, progress, |reporter| {
        let tell = |done: dynid::Done| reporter.tell(|| Some(done.json("models compared")));
        let ladder = dynid::ladder(&models, &experiment, &LadderSettings { free }, &tell)?;
        json(sentences::ladder::json(&ladder))
    })
}

fn named(models: Vec<(String, Model)>) -> Vec<(String, dynid::Model)> {
    models.into_iter().map(|(name, model)| (name, model.0)).collect()
}

/// Writes a page about the last of these models; its verdict in sentences.
#[pyfunction]
#[pyo3(signature = (models, experiment, path, *, diagnosis, overwrite, progress))]
pub fn report(
    py: Python<'_>,
    models: Vec<(String, Model)>,
    experiment: Experiment,
    path: PathBuf,
    diagnosis: Option<&str>,
    overwrite: bool,
    progress: Listener<'_, '_>,
) -> PyResult<Vec<String>> {
    let (models, experiment) = (named(models), experiment.get()?);
    let diagnosis = diagnosis.map(serde_json::from_str).transpose().map_err(raised)?;
    let settings = ReportSettings { diagnosis, commands: Vec::new() };
    let (page, sentences) = work::done(py, progress, |reporter| {
        let tell = |done: dynid::Done| reporter.tell(|| Some(done.json("models compared")));
        let report = dynid::report(&models, &experiment, &settings, &tell)?;
        Ok::<_, dynid::Error>((report.page(), report.sentences()))
    })?;
    write(&path, &page, overwrite)?;
    Ok(sentences)
}

/// What logs are worth.
#[pyfunction]
#[pyo3(signature = (model, experiment, *, free))]
pub fn check(
    py: Python<'_>,
    model: &Model,
    experiment: Experiment,
    #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
) -> PyResult<(String, String)> {
    let (model, experiment) = (&model.0, experiment.get()?);
    work::done(py, None, |_| {
        let checked = dynid::check(model, &experiment, &CheckSettings { free })?;
        Ok::<_, dynid::Error>((sentences::check::verdict(&checked), json(sentences::check::json(&checked, None))?))
    })
}

/// What a model shows of each run: arrays by names.
#[pyfunction]
#[pyo3(signature = (model, experiment, *, substeps, progress))]
pub fn simulate<'py>(
    py: Python<'py>,
    model: &Model,
    experiment: Experiment,
    #[pyo3(from_py_with = natural)] substeps: Option<usize>,
    progress: Listener<'_, '_>,
) -> PyResult<Bound<'py, PyList>> {
    let (model, experiment) = (&model.0, experiment.get()?);
    let simulated = work::done(py, progress, |reporter| {
        let tell = |done: dynid::Done| reporter.tell(|| Some(done.json("runs simulated")));
        dynid::simulate(model, &experiment, &SimulateSettings { substeps }, &tell)
    })?;
    let list = PyList::empty(py);
    for (run, Simulated { position, command, integration, rmse }) in experiment.runs.iter().zip(simulated) {
        let dict = PyDict::new(py);
        let n_samples = run.log.len();
        dict.set_item("file", &run.file)?;
        dict.set_item("free", &run.free)?;
        dict.set_item("t", run.log.t.clone().into_pyarray(py))?;
        dict.set_item("q", shaped(py, position, &[n_samples, run.free.len()])?)?;
        dict.set_item("tau", shaped(py, command, &[n_samples, run.log.tau.len()])?)?;
        dict.set_item("integration", integration.into_pyarray(py))?;
        dict.set_item("rmse", rmse.map(|rmse| rmse.into_pyarray(py)))?;
        list.append(dict)?;
    }
    Ok(list)
}
