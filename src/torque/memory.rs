//! What models share along one motion: most of those that a screening tries differ in a single effect.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

use super::{Motion, rigid};
use crate::system::{StateKey, System};

/// Values along one [`Motion`], kept for other systems of the same configuration. What is found does not depend on what is
/// remembered.
#[derive(Debug, Default)]
pub struct Memory {
    /// Tracks of effects' states, n_samples x the effect's states.
    tracks: Mutex<HashMap<StateKey, Arc<Vec<f64>>>>,
    /// Torques of the rigid body by the bits of what its kernel has prepared.
    rigid: Mutex<HashMap<Vec<u64>, Arc<Vec<f64>>>>,
}

impl Memory {
    pub(super) fn track(&self, key: StateKey, integrate: impl FnOnce() -> Vec<f64>) -> Arc<Vec<f64>> {
        remembered(&self.tracks, key, integrate)
    }

    pub(super) fn rigid(&self, system: &System, motion: &Motion) -> Arc<Vec<f64>> {
        let key = system.prepared().iter().map(|value| value.to_bits()).collect();
        remembered(&self.rigid, key, || rigid(system, motion))
    }
}

/// The value of `key`, computed where it is not known. Nobody waits while it is computed: two may compute the same.
fn remembered<K: Eq + Hash>(
    known: &Mutex<HashMap<K, Arc<Vec<f64>>>>,
    key: K,
    compute: impl FnOnce() -> Vec<f64>,
) -> Arc<Vec<f64>> {
    /// Numbers that are kept: 32 MB of them.
    const MOST: usize = 4_000_000;
    let lock = || known.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(value) = lock().get(&key) {
        return Arc::clone(value);
    }
    let value = Arc::new(compute());
    let mut known = lock();
    if (known.len() + 1) * value.len() > MOST {
        known.clear();
    }
    known.insert(key, Arc::clone(&value));
    value
}
