//! An effect, where it acts, and the values of its parameters.

use dynid::Addition;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::given::natural;

/// An effect of the library at its place.
#[pyclass(frozen, module = "dynid", from_py_object)]
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// Its name in the library.
    #[pyo3(get)]
    pub id: String,
    /// The joint that it acts on.
    #[pyo3(get)]
    pub joint: Option<usize>,
    /// The other joint of a pair.
    #[pyo3(get)]
    pub from_: Option<usize>,
    /// Values by symbols.
    pub values: Vec<(String, f64)>,
}

impl From<Effect> for Addition {
    fn from(Effect { id, joint, from_, values }: Effect) -> Self {
        Self { effect: id, joint, from: from_, values }
    }
}

#[pymethods]
impl Effect {
    #[new]
    #[pyo3(signature = (id, joint=None, from_=None, **values))]
    fn new(
        id: String,
        #[pyo3(from_py_with = natural)] joint: Option<usize>,
        #[pyo3(from_py_with = natural)] from_: Option<usize>,
        values: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let values = values.map_or_else(
            || Ok(Vec::new()),
            |values| {
                values.iter().map(|(symbol, value)| Ok((symbol.extract()?, value.extract()?))).collect::<PyResult<_>>()
            },
        )?;
        Ok(Self { id, joint, from_, values })
    }

    /// Values by symbols, as far as they were said.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let values = PyDict::new(py);
        self.values.iter().try_for_each(|(symbol, value)| values.set_item(symbol, value))?;
        Ok(values)
    }

    fn __repr__(&self) -> String {
        let joint = self.joint.map(|joint| format!(", joint={joint}"));
        let from = self.from_.map(|from| format!(", from_={from}"));
        let values = self.values.iter().map(|(symbol, value)| format!(", {symbol}={value:?}"));
        let arguments: String = joint.into_iter().chain(from).chain(values).collect();
        format!("dynid.Effect({:?}{arguments})", self.id)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self == other
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        Ok(((&self.id, self.joint, self.from_).into_pyobject(py)?, self.values(py)?))
    }
}
