//! Reading all files of the library together.

use std::path::Path;

use crate::{effect::Effect, effect_reader::check_replaces, error::ModelError};

/// Reads `(path, text)` of every effect file and checks what they say about each other.
///
/// # Errors
/// The first thing that is wrong, with its place.
pub fn read_effects(files: &[(&str, &str)]) -> Result<Vec<Effect>, ModelError> {
    let read = |(path, text): &(&str, &str)| Effect::parse(text, Path::new(path));
    let mut effects = files.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    let all = effects.clone();
    for (effect, (path, text)) in effects.iter_mut().zip(files) {
        check_replaces(effect, text, Path::new(path), &all)?;
    }
    Ok(effects)
}
