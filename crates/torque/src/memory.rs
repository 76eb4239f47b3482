//! What models share along one motion: most of those that a screening tries differ in a single effect.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

use super::{Motion, rigid};
use dynid_dynamics::{system::StateKey, system::System};

/// Values along one [`Motion`], kept for other systems of the same configuration. What is found does not depend on what is
/// remembered.
#[derive(Debug, Default)]
pub struct Memory {
    /// Tracks of effects' states, n_samples x the effect's states.
    tracks: Known<StateKey>,
    /// Torques of the rigid body by the bits of what its kernel has prepared.
    rigid: Known<Vec<u64>>,
}

impl Memory {
    pub(super) fn track(&self, key: StateKey, integrate: impl FnOnce() -> Vec<f64>) -> Arc<Vec<f64>> {
        self.tracks.get(key, integrate)
    }

    pub(super) fn rigid(&self, system: &System, motion: &Motion) -> Arc<Vec<f64>> {
        let key = system.prepared().iter().map(|value| value.to_bits()).collect();
        self.rigid.get(key, || rigid(system, motion))
    }
}

/// Columns by their keys.
#[derive(Debug)]
struct Known<K>(Mutex<HashMap<K, Arc<Vec<f64>>>>);

impl<K> Default for Known<K> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Eq + Hash> Known<K> {
    /// The column of `key`, computed where it is not known. Nobody waits while it is computed: two may compute the same.
    fn get(&self, key: K, compute: impl FnOnce() -> Vec<f64>) -> Arc<Vec<f64>> {
        /// As many numbers are kept, 16 MB; what is about to exceed them forgets all.
        const MOST: usize = 2_000_000;
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(column) = lock().get(&key) {
            return Arc::clone(column);
        }
        let column = Arc::new(compute());
        let mut known = lock();
        let kept: usize = known.values().map(|column| column.len()).sum();
        if kept + column.len() > MOST {
            known.clear();
        }
        known.insert(key, Arc::clone(&column));
        column
    }
}
