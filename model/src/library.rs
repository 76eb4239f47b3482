//! The devices, effects and inputs of `devices/`, `effects/` and `inputs/`, built in.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use crate::{
    Device, Effect, NamedInput,
    error::ModelError,
    own_effects::{NoEffects, effect_files},
    shipped::read_effects,
};

// (id, path, text) of each file, written by the build script, which has read them all with the readers of this crate.
include!(concat!(env!("OUT_DIR"), "/library.rs"));

/// Every device, by id.
pub fn devices() -> &'static [Device] {
    static DEVICES: OnceLock<Vec<Device>> = OnceLock::new();
    DEVICES.get_or_init(|| {
        let read = |(path, text): &(&str, &str)| checked(Device::parse(text, Path::new(path)));
        DEVICE_FILES.iter().map(read).collect()
    })
}

/// The device of that id.
pub fn device(id: &str) -> Option<&'static Device> {
    devices().iter().find(|device| device.id == id)
}

/// The text of a device's file.
pub fn device_text(id: &str) -> Option<&'static str> {
    let of_id = |path: &str| Path::new(path).file_stem().is_some_and(|stem| stem == id);
    DEVICE_FILES.iter().find(|(path, _)| of_id(path)).map(|&(_, text)| text)
}

/// Set when it is first used.
static EFFECTS: OnceLock<Vec<Effect>> = OnceLock::new();

/// Every effect, by id: those that ship, and those of [`add_effects`].
pub fn effects() -> &'static [Effect] {
    EFFECTS.get_or_init(|| checked(read_effects(EFFECT_FILES)))
}

/// Adds the effect files of a folder to the library, for all that this process does. To be called before anything reads the
/// library; the files are held to what those that ship are.
///
/// # Errors
/// A folder or file that cannot be read, a file that is wrong or has the name of one that ships, a library in use.
pub fn add_effects(folder: &Path) -> Result<(), NoEffects> {
    let own = effect_files(folder, EFFECT_FILES)?;
    let own = own.iter().map(|(path, text)| (path.as_str(), text.as_str()));
    let mut files: Vec<(&str, &str)> = EFFECT_FILES.iter().copied().chain(own).collect();
    files.sort_by_key(|&(path, _)| Path::new(path).file_name());
    let effects = read_effects(&files).map_err(NoEffects::Wrong)?;
    EFFECTS.set(effects).map_err(|_| NoEffects::TooLate { folder: folder.to_owned() })
}

/// The effect of that id.
pub fn effect(id: &str) -> Option<&'static Effect> {
    effects().iter().find(|effect| effect.id == id)
}

/// Whether an effect is one of those that ship.
pub fn is_shipped(effect: &Effect) -> bool {
    let ships = |(path, _): &(&str, &str)| Path::new(path).file_stem().is_some_and(|id| id == effect.id.as_str());
    EFFECT_FILES.iter().any(ships) && effects().iter().any(|known| std::ptr::eq(known, effect))
}

/// Inputs of published experiments with a device; none where the library knows none.
pub fn inputs(device: &Device) -> &'static [NamedInput] {
    static INPUTS: OnceLock<BTreeMap<&str, Vec<NamedInput>>> = OnceLock::new();
    let all = INPUTS.get_or_init(|| {
        let read = |device: &'static Device| {
            let file = INPUT_FILES
                .iter()
                .find(|(path, _)| Path::new(path).file_stem().is_some_and(|id| id == device.id.as_str()));
            let inputs = file.map(|(path, text)| checked(NamedInput::parse(text, Path::new(path), device)));
            (device.id.as_str(), inputs.unwrap_or_default())
        };
        devices().iter().map(read).collect()
    });
    let known = self::device(&device.id).is_some_and(|own| own.is_same_as(device));
    all.get(device.id.as_str()).filter(|_| known).map_or(&[], Vec::as_slice)
}

impl Device {
    /// Reads a device file whose default effects are the library's, to be built in: its id names a module of Rust.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        Self::parse_with(text, path, effects())
    }

    /// Reads the text of a user's device file, which lies at `file`; `path` is for messages, and its stem is the id.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse_own(text: &str, path: &Path, file: PathBuf) -> Result<Self, ModelError> {
        let id = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let device = Self::parse_as(text, path, effects(), |_| Ok(id))?;
        Ok(Device { file: Some(file), ..device })
    }
}

/// The build script has read the same text by the same code, so this cannot fail in a crate that was built.
fn checked<T>(read: Result<T, ModelError>) -> T {
    match read {
        Ok(read) => read,
        Err(error) => unreachable!("the build script accepted a file that is wrong: {error}"),
    }
}
