//! Equations of motion for whole arrays.

use dynid_kernels::batch;
use numpy::{PyArrayDyn, PyArrayLike1};
use pyo3::prelude::*;

use crate::arrays::{Array, rows, shape_of_states, shaped};
use crate::errors::raised;

/// The equations of motion of a rigid body, some of whose joints are free.
///
/// Arrays have any shape whose last axis is that of the free joints, ascending; one state alone is an array of one axis. States are computed
/// on all threads, accelerations eight at once; the bits do not depend on that.
#[pyclass(frozen, module = "dynid")]
pub struct Kernel {
    kernel: &'static dynid_generated::Kernel,
    n_joints: usize,
    prepared: Vec<f64>,
}

type Result<'py> = PyResult<Bound<'py, PyArrayDyn<f64>>>;

impl Kernel {
    /// With the values of `model`; all joints are free where it is not said, locked ones stand at 0.
    pub fn new(
        model: &dynid::Model,
        free: Option<Vec<usize>>,
        locked: Option<PyArrayLike1<'_, f64>>,
    ) -> PyResult<Self> {
        let n_joints = model.device.joints.len();
        let mut free = free.unwrap_or_else(|| (0..n_joints).collect());
        free.sort_unstable();
        let locked = locked.map_or_else(|| vec![0.0; n_joints], |locked| locked.as_array().to_vec());
        if locked.len() != n_joints {
            let found = locked.len();
            return Err(raised(format!("locked has {found} positions; give one for each of the {n_joints} joints")));
        }
        let system = model.system(&free, |joint| locked[joint]).map_err(raised)?;
        Ok(Self { kernel: system.kernel(), n_joints, prepared: system.prepared().to_vec() })
    }

    /// The shape of the states, which is that of all arguments.
    fn shape(&self, arguments: &[(&str, &Array<'_>)]) -> PyResult<Vec<usize>> {
        let n = self.kernel.free.len();
        let (first, array) = arguments[0];
        let shape = shape_of_states(first, array, n)?;
        for (name, array) in &arguments[1..] {
            let other = shape_of_states(name, array, n)?;
            if other != shape {
                let what = format!("{first} has states of the shape {shape:?}, {name} of {other:?}");
                return Err(raised(format!("{what}; give both for the same states")));
            }
        }
        Ok(shape)
    }

    /// `work` on these arguments, without Python's lock.
    fn on<'py, const A: usize, const R: usize>(
        &self,
        py: Python<'py>,
        arguments: [(&str, &Array<'py>); A],
        results: [Of; R],
        work: impl Fn([&[f64]; A], [&mut [f64]; R]) + Send + Sync,
    ) -> PyResult<[Bound<'py, PyArrayDyn<f64>>; R]> {
        let n = self.kernel.free.len();
        let shape = self.shape(&arguments)?;
        let given = arguments.map(|(_, array)| rows(array));
        let slices: [&[f64]; A] = std::array::from_fn(|place| &*given[place]);
        let shapes = results.map(|of| match of {
            Of::Joint => [&shape[..], &[n]].concat(),
            Of::Pair => [&shape[..], &[n, n]].concat(),
        });
        let mut found = shapes.each_ref().map(|shape| vec![0.0; shape.iter().product()]);
        py.detach(|| work(slices, found.each_mut().map(Vec::as_mut_slice)));
        let mut arrays = Vec::with_capacity(R);
        for (found, shape) in found.into_iter().zip(shapes) {
            arrays.push(shaped(py, found, &shape)?);
        }
        arrays.try_into().map_err(|_| raised("a result is missing; this is a mistake of the program"))
    }
}

/// What a result has an entry for.
#[derive(Clone, Copy)]
enum Of {
    Joint,
    Pair,
}

#[pymethods]
impl Kernel {
    /// The free joints, ascending: what the last axis of every array stands for.
    #[getter]
    fn free(&self) -> Vec<usize> {
        self.kernel.free.to_vec()
    }

    /// Accelerations: `D^-1 (tau - h)`.
    fn forward_dynamics<'py>(&self, py: Python<'py>, q: Array<'py>, dq: Array<'py>, tau: Array<'py>) -> Result<'py> {
        let work = |given: [&[f64]; 3], [ddq]: [&mut [f64]; 1]| {
            batch::forward_dynamics(self.kernel, &self.prepared, given, ddq);
        };
        let [ddq] = self.on(py, [("q", &q), ("dq", &dq), ("tau", &tau)], [Of::Joint], work)?;
        Ok(ddq)
    }

    /// Accelerations and their derivatives by q, dq and tau.
    fn forward_dynamics_derivatives<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        dq: Array<'py>,
        tau: Array<'py>,
    ) -> PyResult<[Bound<'py, PyArrayDyn<f64>>; 4]> {
        let work = |given: [&[f64]; 3], results: [&mut [f64]; 4]| {
            batch::forward_dynamics_gradient(self.kernel, &self.prepared, given, results);
        };
        let results = [Of::Joint, Of::Pair, Of::Pair, Of::Pair];
        self.on(py, [("q", &q), ("dq", &dq), ("tau", &tau)], results, work)
    }

    /// Torques: `D ddq + h`.
    fn inverse_dynamics<'py>(&self, py: Python<'py>, q: Array<'py>, dq: Array<'py>, ddq: Array<'py>) -> Result<'py> {
        let work = |given: [&[f64]; 3], [tau]: [&mut [f64]; 1]| {
            batch::inverse_dynamics(self.kernel, &self.prepared, given, tau);
        };
        let [tau] = self.on(py, [("q", &q), ("dq", &dq), ("ddq", &ddq)], [Of::Joint], work)?;
        Ok(tau)
    }

    /// Torques and their derivatives by q, dq and ddq.
    fn inverse_dynamics_derivatives<'py>(
        &self,
        py: Python<'py>,
        q: Array<'py>,
        dq: Array<'py>,
        ddq: Array<'py>,
    ) -> PyResult<[Bound<'py, PyArrayDyn<f64>>; 4]> {
        let work = |given: [&[f64]; 3], [tau, by_q, by_dq, by_ddq]: [&mut [f64]; 4]| {
            batch::inverse_dynamics_gradient(self.kernel, &self.prepared, given, [tau, by_q, by_dq]);
            batch::inertia(self.kernel, &self.prepared, given[0], by_ddq);
        };
        let results = [Of::Joint, Of::Pair, Of::Pair, Of::Pair];
        self.on(py, [("q", &q), ("dq", &dq), ("ddq", &ddq)], results, work)
    }

    /// Inertia matrices D.
    fn mass_matrix<'py>(&self, py: Python<'py>, q: Array<'py>) -> Result<'py> {
        let work = |[q]: [&[f64]; 1], [d]: [&mut [f64]; 1]| batch::inertia(self.kernel, &self.prepared, q, d);
        let [d] = self.on(py, [("q", &q)], [Of::Pair], work)?;
        Ok(d)
    }

    /// Torques of gravity.
    fn gravity<'py>(&self, py: Python<'py>, q: Array<'py>) -> Result<'py> {
        let work = |[q]: [&[f64]; 1], [phi]: [&mut [f64]; 1]| batch::gravity(self.kernel, &self.prepared, q, phi);
        let [phi] = self.on(py, [("q", &q)], [Of::Joint], work)?;
        Ok(phi)
    }

    /// Torques without acceleration: `h = C dq + gravity`.
    fn bias<'py>(&self, py: Python<'py>, q: Array<'py>, dq: Array<'py>) -> Result<'py> {
        let work = |given: [&[f64]; 2], [h]: [&mut [f64]; 1]| batch::bias(self.kernel, &self.prepared, given, h);
        let [h] = self.on(py, [("q", &q), ("dq", &dq)], [Of::Joint], work)?;
        Ok(h)
    }

    fn __repr__(&self) -> String {
        let free = self.kernel.free;
        format!("<dynid.Kernel of {}: {} of {} joints free, {free:?}>", self.kernel.device, free.len(), self.n_joints)
    }
}
