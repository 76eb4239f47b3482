//! Devices of users: files that are read while the program runs.

use std::{
    collections::HashMap,
    fmt, fs, io,
    path::{Component, Path, PathBuf},
    sync::{Mutex, MutexGuard, OnceLock, PoisonError},
};

use crate::{Device, ModelError, device, devices, did_you_mean, document, library::device_text};

/// Why there is no device of that name.
#[derive(Debug)]
pub enum NoDevice {
    /// None of the library's, and no path of a file.
    Unknown {
        /// As asked for.
        name: String,
    },
    /// A file that cannot be read.
    Unreadable {
        /// Where it was looked for.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
    /// A file that is wrong.
    Wrong(ModelError),
}

impl NoDevice {
    /// What to do about it.
    pub fn remedy(&self) -> String {
        match self {
            NoDevice::Unknown { name } => {
                let known = devices().iter().map(|device| device.id.as_str());
                format!("{}; a device of your own is named by its file: \"{name}.toml\"", did_you_mean(name, known))
            }
            NoDevice::Unreadable { .. } => {
                "name an existing device file, from the folder of the file that names it".to_owned()
            }
            NoDevice::Wrong(_) => "mend the device file; `dynid devices FILE` checks it".to_owned(),
        }
    }
}

impl fmt::Display for NoDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoDevice::Unknown { name } => write!(f, "there is no device `{name}`"),
            NoDevice::Unreadable { path, error } => write!(f, "{}: cannot be read: {error}", path.display()),
            NoDevice::Wrong(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for NoDevice {}

/// The device that a file in `folder` names: one of the library's by its id, or a device file by its path (`arm.toml`), from that
/// folder. What was read stays until the process ends; the same file with the same text is the same device.
///
/// # Errors
/// A name that is neither, or a file that is unreadable or wrong.
pub fn device_named(name: &str, folder: &Path) -> Result<&'static Device, NoDevice> {
    if !is_path(name) {
        return device(name).ok_or_else(|| NoDevice::Unknown { name: name.to_owned() });
    }
    let path = folder.join(name);
    let read = document::read_text(&path).and_then(|text| Ok((absolute(&path)?, text)));
    let (file, text) = read.map_err(|error| NoDevice::Unreadable { path: path.clone(), error })?;
    interned(&text, &path, file).map_err(NoDevice::Wrong)
}

/// The device of a text that is to lie at `file`, which need not be there. It stays until the process ends; the same text for the same
/// file is the same device.
///
/// # Errors
/// A text that is wrong, with its place.
pub fn device_of_text(text: &str, file: &Path) -> Result<&'static Device, ModelError> {
    interned(text, file, absolute(file).unwrap_or_else(|_| file.to_owned()))
}

/// The text of a device's file: one of the library's, or as it was read.
pub fn text_of(device: &'static Device) -> Option<String> {
    if device.file.is_none() {
        return device_text(&device.id).map(str::to_owned);
    }
    let known = known();
    known.iter().find(|(_, known)| std::ptr::eq(**known, device)).map(|((_, text), _)| text.clone())
}

/// What was read, by file and text.
type Known = HashMap<(PathBuf, String), &'static Device>;

fn known() -> MutexGuard<'static, Known> {
    static READ: OnceLock<Mutex<Known>> = OnceLock::new();
    READ.get_or_init(Mutex::default).lock().unwrap_or_else(PoisonError::into_inner)
}

/// `path` is for messages.
fn interned(text: &str, path: &Path, file: PathBuf) -> Result<&'static Device, ModelError> {
    let mut known = known();
    let key = (file, text.to_owned());
    if let Some(&device) = known.get(&key) {
        return Ok(device);
    }
    let own = Device::parse_own(text, path, key.0.clone())?;
    let own: &'static Device = Box::leak(Box::new(own));
    known.insert(key, own);
    Ok(own)
}

impl Device {
    /// How a file in `folder` names the device, as [`device_named`] finds it again: its id, or the path of its file from there.
    pub fn name_from(&self, folder: &Path) -> String {
        self.file.as_ref().map_or_else(|| self.id.clone(), |file| path_from(file, folder))
    }
}

/// The path of a file as a file in `folder` writes it: from there, with slashes.
pub fn path_from(file: &Path, folder: &Path) -> String {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let both = absolute(file).ok().zip(fs::canonicalize(here).ok());
    let path = both.and_then(|(file, here)| relative(&file, &here)).unwrap_or_else(|| file.to_owned());
    path.to_string_lossy().replace(std::path::MAIN_SEPARATOR, "/")
}

/// Links in the folders are followed, one that is the file itself is not: its name is the device's.
fn absolute(path: &Path) -> io::Result<PathBuf> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Ok(fs::canonicalize(folder)?.join(path.file_name().unwrap_or_default()))
}

/// The path from a folder to a file, both absolute; none where they share no root.
fn relative(file: &Path, folder: &Path) -> Option<PathBuf> {
    let shared = file.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    (shared > 0).then(|| up.chain(file.components().skip(shared)).collect())
}

/// Whether a name of a device is the path of its file.
fn is_path(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}
