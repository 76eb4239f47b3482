//! Models.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dynid::Addition;
use dynid_model::Parameter;
use numpy::PyArrayLike1;
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyList, PyTuple};

use crate::device::Device;
use crate::effect::Effect;
use crate::errors::{raised, write};
use crate::given::{names, natural};
use crate::kernel::Kernel;

/// A device, the effects that it is believed to have, and parameter values.
#[pyclass(frozen, module = "dynid", from_py_object)]
#[derive(Clone)]
pub struct Model(pub dynid::Model);

impl From<dynid::Model> for Model {
    fn from(model: dynid::Model) -> Self {
        Self(model)
    }
}

/// Value, bounds and unit of a parameter, and whether it is fixed, after its name.
type Row = (String, f64, f64, f64, bool, Option<String>, Option<f64>);

#[pymethods]
impl Model {
    #[new]
    #[pyo3(signature = (device, effects=None))]
    fn new(device: &Device, effects: Option<Vec<Effect>>) -> PyResult<Self> {
        let Some(effects) = effects else { return Ok(dynid::Model::of_device(device.device).into()) };
        let effects: Vec<Addition> = effects.into_iter().map(Addition::from).collect();
        dynid::with_effects(device.device, &effects).map(Self).map_err(raised)
    }

    /// Reads a model file.
    #[staticmethod]
    #[pyo3(signature = (path, *, clip=false))]
    fn load(path: PathBuf, clip: bool) -> PyResult<Self> {
        let read = if clip { dynid::Model::load_clipped(&path) } else { dynid::Model::load(&path) };
        read.map(Self).map_err(raised)
    }

    /// Reads the text of a model file of `device`.
    #[staticmethod]
    fn from_toml(device: &Device, text: &str) -> PyResult<Self> {
        dynid::Model::parse_of(device.device, text, Path::new("model")).map(Self).map_err(raised)
    }

    /// Writes the model file.
    #[pyo3(signature = (path, *, overwrite=false))]
    fn save(&self, path: PathBuf, overwrite: bool) -> PyResult<()> {
        if let Some(file) = self.0.device.file.as_ref().filter(|file| !file.is_file()) {
            return Err(raised(format!(
                "the model's device has no file that {} could name; write it first: model.device.save() makes {}",
                path.display(),
                file.display()
            )));
        }
        write(&path, &self.0.to_toml_at(&path), overwrite)
    }

    /// The text of its file, to lie in the working folder.
    fn as_toml(&self) -> String {
        self.0.to_toml()
    }

    /// The mechanism.
    #[getter]
    fn device(&self) -> Device {
        self.0.device.into()
    }

    /// The effects, in the order of the file, with all their values.
    #[getter]
    fn effects(&self) -> Vec<Effect> {
        let effect = |own: &dynid_user_model::EffectInstance| Effect {
            id: own.effect.id.clone(),
            joint: own.joint,
            from_: own.from,
            values: own.effect.parameters.iter().map(|own| own.symbol.clone()).zip(own.values()).collect(),
        };
        self.0.effects.iter().map(effect).collect()
    }

    /// What a person should know about its file.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.0.notes.clone()
    }

    /// SHA-256 of every parameter.
    #[getter]
    fn digest(&self) -> String {
        self.0.digest()
    }

    /// Names of all parameters.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.0.names()
    }

    /// Name, value, bounds, whether it is fixed, unit and standard error of every parameter.
    fn _rows(&self) -> Vec<Row> {
        let errors = self.0.fit.as_ref().map(|fit| &fit.std_error);
        let row = |(name, own): (String, Parameter)| {
            let (unit, error) = (self.0.unit(&name), errors.and_then(|errors| errors.get(&name).copied()));
            (name, own.value, own.lower, own.upper, own.fixed, unit, error)
        };
        self.0.parameters().into_iter().map(row).collect()
    }

    /// The same as a DataFrame.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("dynid._frames")?.call_method1("parameters", (self._rows(),))
    }

    /// For notebooks.
    fn _repr_html_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("dynid._html")?.call_method1("model", (self.__repr__(), self._rows()))
    }

    fn __getitem__(&self, name: &str) -> PyResult<f64> {
        Ok(self.0.require(name).map_err(raised)?.value)
    }

    fn __contains__(&self, name: &Bound<'_, PyAny>) -> bool {
        name.extract::<String>().is_ok_and(|name| self.0.parameter(&name).is_some())
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        PyList::new(py, self.0.names())?.try_iter()
    }

    /// The model with other values of some parameters.
    fn with_values(&self, values: BTreeMap<String, f64>) -> PyResult<Self> {
        let mut model = self.0.clone();
        for (name, value) in values {
            dynid::set_value(&mut model, &name, value).map_err(raised)?;
        }
        Ok(Self(model))
    }

    /// The model in which some parameters keep their values in fits, or are let go with `fixed=False`.
    #[pyo3(signature = (names, fixed=true))]
    fn fix(&self, #[pyo3(from_py_with = names)] names: Vec<String>, fixed: bool) -> PyResult<Self> {
        let mut model = self.0.clone();
        for name in names {
            let parameter = model.require(&name).map_err(raised)?;
            model.set(&name, Parameter { fixed, ..parameter }).map_err(raised)?;
        }
        Ok(Self(model))
    }

    /// The model with an effect more, where it does nothing yet but for the values that are said.
    fn add(&self, effect: Effect) -> PyResult<Self> {
        let (model, _) = dynid::add(&self.0, &effect.into()).map_err(raised)?;
        Ok(Self(model))
    }

    /// The model without an effect.
    #[pyo3(signature = (id, joint=None, from_=None))]
    fn remove(
        &self,
        id: &str,
        #[pyo3(from_py_with = natural)] joint: Option<usize>,
        #[pyo3(from_py_with = natural)] from_: Option<usize>,
    ) -> PyResult<Self> {
        let mut model = self.0.clone();
        model.remove_effect(id, joint, from_).map_err(raised)?;
        Ok(Self(model))
    }

    /// The equations of the rigid body with the model's values.
    #[pyo3(signature = (free=None, *, locked=None))]
    fn kernel(
        &self,
        #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
        locked: Option<PyArrayLike1<'_, f64>>,
    ) -> PyResult<Kernel> {
        Kernel::new(&self.0, free, locked)
    }

    fn __repr__(&self) -> String {
        let labels: Vec<String> = self.0.effects.iter().map(|effect| effect.label()).collect();
        format!("<dynid.Model of {}: {}>", self.0.device.id, labels.join(", "))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0.device.is_same_as(other.0.device) && self.0.digest() == other.0.digest()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let device: Device = self.0.device.into();
        Ok((py.get_type::<Self>().getattr("from_toml")?, (device, self.0.to_toml()).into_pyobject(py)?))
    }
}
