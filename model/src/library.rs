//! The devices, effects and inputs of `devices/`, `effects/` and `inputs/`, built in.

use std::{collections::BTreeMap, path::Path, sync::OnceLock};

use crate::{Device, Effect, NamedInput, error::ModelError, shipped::read_effects};

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

/// Every effect, by id.
pub fn effects() -> &'static [Effect] {
    static EFFECTS: OnceLock<Vec<Effect>> = OnceLock::new();
    EFFECTS.get_or_init(|| checked(read_effects(EFFECT_FILES)))
}

/// The effect of that id.
pub fn effect(id: &str) -> Option<&'static Effect> {
    effects().iter().find(|effect| effect.id == id)
}

/// Inputs of published experiments with a device; none where the library knows none.
pub fn inputs(device: &str) -> &'static [NamedInput] {
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
    all.get(device).map_or(&[], Vec::as_slice)
}

impl Device {
    /// Reads a device file whose default effects are the library's.
    ///
    /// # Errors
    /// The first thing that is wrong, with its place.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ModelError> {
        Self::parse_with(text, path, effects())
    }
}

/// The build script has read the same text by the same code, so this cannot fail in a crate that was built.
fn checked<T>(read: Result<T, ModelError>) -> T {
    match read {
        Ok(read) => read,
        Err(error) => unreachable!("the build script accepted a file that is wrong: {error}"),
    }
}
