//! The few things that were asked for last.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::answer::Refusal;

/// So many things by their keys, which say what they were made from.
pub struct Recent<T> {
    most: usize,
    kept: Mutex<VecDeque<(String, Arc<T>)>>,
    making: Mutex<()>,
}

impl<T> Recent<T> {
    pub fn new(most: usize) -> Self {
        Self { most, kept: Mutex::default(), making: Mutex::default() }
    }

    /// The thing of that key, if it is `still` good.
    pub fn find(&self, key: &str, still: impl Fn(&T) -> bool) -> Option<Arc<T>> {
        let mut kept = locked(&self.kept);
        let place = kept.iter().position(|(own, _)| own == key)?;
        let (key, found) = kept.remove(place)?;
        if !still(&found) {
            return None;
        }
        kept.push_front((key, Arc::clone(&found)));
        Some(found)
    }

    /// As [`Recent::find`], or made: once, however many ask for it.
    pub fn find_or(
        &self,
        key: &str,
        still: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T, Refusal>,
    ) -> Result<Arc<T>, Refusal> {
        if let Some(found) = self.find(key, &still) {
            return Ok(found);
        }
        let _alone = locked(&self.making);
        if let Some(found) = self.find(key, &still) {
            return Ok(found);
        }
        let made = Arc::new(make()?);
        let mut kept = locked(&self.kept);
        kept.push_front((key.to_owned(), Arc::clone(&made)));
        kept.truncate(self.most);
        Ok(made)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
