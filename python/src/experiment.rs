//! Experiments.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use dynid_logs::experiment::ExperimentError;
use dynid_logs::log::LogError;
use dynid_tables::Table;
use numpy::{AllowTypeChange, IntoPyArray, PyArrayLike1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::device::Device;
use crate::errors::raised;
use crate::given::natural;
use crate::work;

/// Logs of a device, and what was free in each; what `dynid.Experiment` stands on.
#[pyclass(module = "dynid._dynid", from_py_object)]
#[derive(Clone)]
pub struct Experiment {
    device: &'static dynid::Device,
    path: PathBuf,
    /// `None` without a run.
    runs: Option<Arc<dynid::Experiment>>,
}

impl Experiment {
    /// With its runs.
    ///
    /// # Errors
    /// There is none.
    pub fn get(&self) -> PyResult<Arc<dynid::Experiment>> {
        let none = || raised("the experiment has no run; add one: experiment.add(log, role=\"fit\")");
        self.runs.clone().ok_or_else(none)
    }

    fn push(&mut self, run: dynid::Run) {
        let runs = self.runs.take().map_or_else(Vec::new, |runs| Arc::unwrap_or_clone(runs).runs);
        let runs = runs.into_iter().chain([run]).collect();
        self.runs = Some(Arc::new(dynid::Experiment::of_runs(&self.path, self.device, runs)));
    }

    fn run(&self, index: usize) -> PyResult<dynid::Run> {
        let experiment = self.get()?;
        let count = experiment.runs.len();
        experiment
            .runs
            .get(index)
            .cloned()
            .ok_or_else(|| raised(format!("there is no run {index}; there are {count}, from 0")))
    }
}

/// File, role, free joints, samples, duration (s) and payload of a run.
type Described = (String, String, Vec<usize>, usize, f64, Option<String>);

/// Settings of a run and its columns.
type Given<'py> = (String, Bound<'py, PyDict>);

#[pymethods]
impl Experiment {
    #[new]
    fn new(device: &Device) -> Self {
        Self { device: device.device, path: PathBuf::from("experiment"), runs: None }
    }

    /// Reads an experiment file with its logs.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, planned: bool) -> PyResult<Self> {
        let load = if planned { dynid::Experiment::load_planned } else { dynid::Experiment::load };
        let experiment = work::done(py, None, |_| load(path))?;
        Ok(Self { device: experiment.device, path: experiment.path.clone(), runs: Some(Arc::new(experiment)) })
    }

    /// Adds the run that `settings` say (a JSON object with the keys of a `[[run]]`), whose log is these columns or the file at `path`.
    fn add(
        &mut self,
        py: Python<'_>,
        settings: &str,
        columns: Option<&Bound<'_, PyDict>>,
        path: Option<PathBuf>,
    ) -> PyResult<()> {
        let settings: toml::Table = serde_json::from_str(settings).map_err(raised)?;
        let columns = columns.map(table).transpose()?;
        let device = self.device;
        let run = work::done(py, None, |_| -> Result<dynid::Run, ExperimentError> {
            let log = match (columns, path) {
                (Some(columns), _) => columns,
                (None, path) => {
                    let path = path.unwrap_or_default();
                    let wrong = |error| ExperimentError::GivenLog(Box::new(LogError::of_table(&path, error)));
                    Table::open(&path).map_err(wrong)?
                }
            };
            dynid::Run::given(device, &settings.to_string(), Path::new(""), &log)
        })?;
        self.push(run);
        Ok(())
    }

    /// The mechanism.
    #[getter]
    fn device(&self) -> Device {
        self.device.into()
    }

    /// SHA-256 of every number of the logs.
    #[getter]
    fn digest(&self) -> PyResult<String> {
        Ok(self.get()?.digest.clone())
    }

    /// What its runs are.
    fn runs(&self) -> Vec<Described> {
        let described = |run: &dynid::Run| {
            let t = &run.log.t;
            let duration = t.last().zip(t.first()).map_or(0.0, |(last, first)| last - first);
            (run.file.clone(), run.role.to_string(), run.free.clone(), t.len(), duration, run.payload.clone())
        };
        self.runs.iter().flat_map(|experiment| experiment.runs.iter().map(described)).collect()
    }

    /// A run's settings (TOML) and its columns in SI, of which `restored` makes it again.
    fn given<'py>(&self, py: Python<'py>, #[pyo3(from_py_with = natural)] run: usize) -> PyResult<Given<'py>> {
        let (settings, columns) = self.run(run)?.as_given();
        let dict = PyDict::new(py);
        for (name, values) in columns {
            dict.set_item(name, values.into_pyarray(py))?;
        }
        Ok((settings, dict))
    }

    /// The experiment of these runs.
    #[staticmethod]
    fn restored(device: &Device, path: PathBuf, runs: Vec<Given<'_>>) -> PyResult<Self> {
        let mut made = Vec::with_capacity(runs.len());
        for (settings, columns) in runs {
            let table = table(&columns)?;
            made.push(dynid::Run::given(device.device, &settings, Path::new(""), &table).map_err(raised)?);
        }
        let device = device.device;
        let runs = (!made.is_empty()).then(|| Arc::new(dynid::Experiment::of_runs(&path, device, made)));
        Ok(Self { device, path, runs })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let count = self.runs.as_ref().map_or(0, |experiment| experiment.runs.len());
        let runs = (0..count).map(|run| self.given(py, run)).collect::<PyResult<Vec<_>>>()?;
        let device: Device = self.device.into();
        Ok((py.get_type::<Self>().getattr("restored")?, (device, self.path.clone(), runs).into_pyobject(py)?))
    }
}

/// Columns as a table.
fn table(columns: &Bound<'_, PyDict>) -> PyResult<Table> {
    let mut table = Vec::with_capacity(columns.len());
    for (name, values) in columns.iter() {
        let name: String = name.extract()?;
        let values: PyArrayLike1<'_, f64, AllowTypeChange> = values
            .extract()
            .map_err(|_| raised(format!("column `{name}` is no row of numbers; give one number for each sample")))?;
        let length = table.first().map_or(values.len()?, |(_, first): &(String, Vec<f64>)| first.len());
        let values = values.as_array().to_vec();
        if values.len() != length {
            let found = values.len();
            return Err(raised(format!(
                "column `{name}` has {found} samples, the others {length}; give one for each sample"
            )));
        }
        table.push((name, values));
    }
    Ok(Table::of_numbers(table))
}
