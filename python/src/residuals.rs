//! Residuals and their Jacobian, for optimisers in Python.

use dynid_identify::residuals::{Evaluated, Residuals as Own};
use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArrayDyn, PyArrayLike1};
use pyo3::prelude::*;

use crate::arrays::shaped;
use crate::errors::raised;
use crate::experiment::Experiment;
use crate::given::natural;
use crate::model::Model;
use crate::work;

/// Half the sum of its squares is what a fit of the position or torque error makes small.
#[pyclass(frozen, module = "dynid")]
pub struct Residuals {
    own: Own,
    /// How many they are.
    count: usize,
    model: dynid::Model,
}

type Point<'py> = PyArrayLike1<'py, f64, AllowTypeChange>;

#[pymethods]
impl Residuals {
    #[new]
    #[pyo3(signature = (model, experiment, error="position", *, free=None, substeps=None))]
    fn new(
        py: Python<'_>,
        model: &Model,
        experiment: &Bound<'_, PyAny>,
        error: &str,
        #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
        #[pyo3(from_py_with = natural)] substeps: Option<usize>,
    ) -> PyResult<Self> {
        // Users have `dynid.Experiment`, which holds ours.
        let experiment: Experiment = experiment.getattr("_own")?.extract().map_err(PyErr::from)?;
        let (model, experiment) = (model.0.clone(), experiment.get()?);
        if !matches!(error, "position" | "torque") {
            return Err(raised(format!(
                "error: expected \"position\" or \"torque\", found \"{error}\"; correct the value"
            )));
        }
        let (own, count) = work::done(py, None, |_| -> Result<(Own, usize), dynid::Error> {
            let runs = experiment.runs_with_free(free.as_deref())?;
            let own = match error {
                "torque" => Own::of_torque(&model, &runs)?,
                _ => Own::of_position(&model, &runs, substeps)?,
            };
            let count = own.at(own.start()).map_or(0, |residuals| residuals.len());
            Ok((own, count))
        })?;
        Ok(Self { own, count, model })
    }

    /// Names of the unknowns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.own.names()
    }

    /// The model's values, and where the logs begin.
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.own.start().to_vec().into_pyarray(py)
    }

    /// Least and largest values.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
        let (lower, upper) = self.own.bounds();
        (lower.into_pyarray(py), upper.into_pyarray(py))
    }

    /// The residuals at `x`; infinite where the logs cannot be simulated.
    fn __call__<'py>(&self, py: Python<'py>, x: Point<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let x = self.point(&x)?;
        let residuals = py.detach(|| self.own.at(&x).unwrap_or_else(|| vec![f64::INFINITY; self.count]));
        Ok(residuals.into_pyarray(py))
    }

    /// Their derivatives at `x`, one row a residual.
    fn jacobian<'py>(&self, py: Python<'py>, x: Point<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let x = self.point(&x)?;
        let Some(Evaluated { residuals, jacobian }) = py.detach(|| self.own.with_jacobian(&x)) else {
            return Err(raised("the logs cannot be simulated at these values; start from other values"));
        };
        shaped(py, jacobian, &[residuals.len(), x.len()])
    }

    /// The model with the parameters of `x`.
    fn model(&self, x: Point<'_>) -> PyResult<Model> {
        let mut model = self.model.clone();
        for (name, value) in self.own.names().iter().zip(self.point(&x)?) {
            if model.parameter(name).is_some() {
                model.set_value(name, value).map_err(raised)?;
            }
        }
        Ok(model.into())
    }

    fn __repr__(&self) -> String {
        format!("<dynid.Residuals: {} of {} unknowns>", self.count, self.own.start().len())
    }
}

impl Residuals {
    fn point(&self, x: &Point<'_>) -> PyResult<Vec<f64>> {
        let x = x.as_array().to_vec();
        let (found, count) = (x.len(), self.own.start().len());
        if found != count {
            return Err(raised(format!("x has {found} values; give one for each of the {count} unknowns in `names`")));
        }
        Ok(x)
    }
}
