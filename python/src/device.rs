//! Devices.

use std::path::{Path, PathBuf};

use dynid_model::{device_of_text, text_of};
use numpy::PyArrayLike1;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::errors::{raised, write};
use crate::given::natural;
use crate::kernel::Kernel;
use crate::model::Model;

/// A mechanism: its joints, links and default effects.
#[pyclass(frozen, module = "dynid")]
pub struct Device {
    pub device: &'static dynid::Device,
    notes: Vec<String>,
}

impl From<&'static dynid::Device> for Device {
    fn from(device: &'static dynid::Device) -> Self {
        Self { device, notes: Vec::new() }
    }
}

#[pymethods]
impl Device {
    /// Reads a device file (TOML).
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("toml")) {
            let help = "a device file ends in `.toml`; descriptions are read by Device.from_urdf, and those that ship are in dynid.devices";
            return Err(raised(format!("{}: no device file; {help}", path.display())));
        }
        let device = dynid::device_named(&path.to_string_lossy(), Path::new(""));
        Ok(device.map_err(|error| raised(format!("{error}; {}", error.remedy())))?.into())
    }

    /// Turns a URDF (or an MJCF) into a device.
    #[staticmethod]
    #[pyo3(signature = (path, *, end_point=None))]
    fn from_urdf(path: PathBuf, end_point: Option<&str>) -> PyResult<Self> {
        let text = dynid_files::read(&path).map_err(raised)?;
        let dynid::Imported { toml, notes } =
            dynid::device_from_description(&text, &path, end_point).map_err(raised)?;
        let device = device_of_text(&toml, &path.with_extension("toml")).map_err(raised)?;
        Ok(Self { device, notes })
    }

    /// The device of the text of a device file that is to lie at `path`.
    #[staticmethod]
    fn from_toml(text: &str, path: PathBuf) -> PyResult<Self> {
        Ok(device_of_text(text, &path).map_err(raised)?.into())
    }

    #[staticmethod]
    fn _shipped(id: &str) -> PyResult<Self> {
        let help = "it belongs to another version of dynid";
        Ok(dynid::device(id).ok_or_else(|| raised(format!("there is no device `{id}`; {help}")))?.into())
    }

    /// Writes the device file; a model file names its device by it.
    #[pyo3(signature = (path=None, *, overwrite=false))]
    fn save(&self, path: Option<PathBuf>, overwrite: bool) -> PyResult<Self> {
        let Some(path) = path.or_else(|| self.device.file.clone()) else {
            return Err(raised(format!("device `{}` ships with dynid; give a path for a copy", self.device.id)));
        };
        let text = self.as_toml();
        write(&path, &text, overwrite)?;
        Ok(Self { device: device_of_text(&text, &path).map_err(raised)?, notes: self.notes.clone() })
    }

    /// The text of its file.
    fn as_toml(&self) -> String {
        text_of(self.device).unwrap_or_default()
    }

    /// Its name.
    #[getter]
    fn id(&self) -> &str {
        &self.device.id
    }

    /// What it is, in a line.
    #[getter]
    fn title(&self) -> &str {
        &self.device.title
    }

    /// Titles of its joints, by index.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.device.joints.iter().map(|joint| joint.title.as_str()).collect()
    }

    /// What an import guessed, changed or left out.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// The equations of motion of the joints `free` (all where it is left out); the others stand at `locked`.
    #[pyo3(signature = (free=None, *, locked=None))]
    fn kernel(
        &self,
        #[pyo3(from_py_with = natural)] free: Option<Vec<usize>>,
        locked: Option<PyArrayLike1<'_, f64>>,
    ) -> PyResult<Kernel> {
        Kernel::new(&dynid::Model::of_device(self.device), free, locked)
    }

    /// The default model.
    fn model(&self) -> Model {
        dynid::Model::of_device(self.device).into()
    }

    fn __repr__(&self) -> String {
        format!("<dynid.Device {}: {} joints>", self.device.id, self.device.joints.len())
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.device.is_same_as(other.device)
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        self.device.id.hash(&mut hasher);
        hasher.finish()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let class = py.get_type::<Self>();
        match &self.device.file {
            None => Ok((class.getattr("_shipped")?, (self.id(),).into_pyobject(py)?)),
            Some(file) => Ok((class.getattr("from_toml")?, (self.as_toml(), file).into_pyobject(py)?)),
        }
    }
}

/// Ids of the devices that ship.
#[pyfunction]
pub fn shipped() -> Vec<&'static str> {
    dynid::devices().iter().map(|device| device.id.as_str()).collect()
}

/// Adds the effect files of a folder to the library; to be called before anything else.
#[pyfunction]
pub fn add_effects(folder: PathBuf) -> PyResult<()> {
    dynid::add_effects(&folder).map_err(raised)
}

/// Writes the logs and the model that `dynid tour` starts from into a folder.
#[pyfunction]
#[pyo3(signature = (folder, *, overwrite=false))]
pub fn tour(folder: PathBuf, overwrite: bool) -> PyResult<()> {
    std::fs::create_dir_all(&folder)
        .map_err(|error| raised(format!("cannot make the folder {}: {error}", folder.display())))?;
    dynid::tour::FILES.iter().try_for_each(|(name, text)| write(&folder.join(name), text, overwrite))
}
