//! The few things that were asked for last.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::answer::Refusal;

/// Bytes that all that is kept may take, about: logs of a million rows and six joints, compared with several models, beside a browser
/// and four commands on a small laptop.
const BUDGET: usize = 1 << 30;
/// Experiments, comparisons and trials: none of them drives out another.
const KINDS: usize = 3;

/// What takes room.
pub trait Room {
    /// About how much, with what it makes when it is asked (bytes).
    fn bytes(&self) -> usize;
}

/// The few things of a kind that were asked for last, by their keys, which say what they were made from.
pub struct Recent<T> {
    most: usize,
    kept: Mutex<VecDeque<(String, Arc<T>)>>,
    making: Mutex<()>,
}

impl<T: Room> Recent<T> {
    /// So many at most, and no more than there is room for; the newest always.
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
        while kept.len() > 1 && kept.iter().map(|(_, own)| own.bytes()).sum::<usize>() > BUDGET / KINDS {
            kept.pop_back();
        }
        Ok(made)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sample(usize);

    impl Room for Sample {
        fn bytes(&self) -> usize {
            self.0
        }
    }

    #[test]
    fn what_is_large_drives_out_the_oldest_and_is_kept_itself() {
        let recent = Recent::new(4);
        let keep = |key: &str, bytes: usize| recent.find_or(key, |_| true, || Ok(Sample(bytes))).unwrap();
        let is_kept = |key: &str| recent.find(key, |_| true).is_some();
        let part = BUDGET / KINDS / 3;
        for key in ["a", "b", "c"] {
            keep(key, part);
        }
        assert!(["a", "b", "c"].into_iter().all(is_kept));
        keep("d", part);
        assert_eq!(["d", "c", "b", "a"].map(is_kept), [true, true, true, false]);
        keep("e", 2 * BUDGET);
        assert_eq!(["e", "d", "c", "b"].map(is_kept), [true, false, false, false]);
        for key in ["f", "g", "h", "i"] {
            keep(key, 0);
        }
        assert_eq!(["e", "f", "g", "h", "i"].map(is_kept), [false, true, true, true, true], "so many at most");
    }
}
