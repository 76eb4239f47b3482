//! The devices and effects of `devices/` and `effects/`, built in.

use std::{path::Path, sync::OnceLock};

use crate::{Device, Effect, error::ModelError, shipped::read_effects};

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
