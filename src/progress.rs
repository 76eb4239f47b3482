//! Work on many things at a time, with somebody who hears of it and may stop it.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use dynid_diagnose::{Event, Screened};
use dynid_identify::identify::Progress;
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::{DiagnoseProgress, Error, FitProgress};

/// So many of so many runs or models are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Done {
    /// So many.
    pub done: usize,
    /// Of so many.
    pub of: usize,
}

impl Done {
    /// For programs, as `dynid --progress json` prints it; `what` the parts are, e.g. `runs compared`.
    pub fn json(&self, what: &str) -> Value {
        json!({ "progress": "count", "what": what, "done": self.done, "of": self.of })
    }
}

impl FitProgress<'_> {
    /// For programs, as `dynid --progress json` prints it.
    pub fn json(&self) -> Value {
        match self {
            Self::FirstEstimate(label) => {
                let note = format!("{label} stands where it vanishes; it starts from a first estimate by the logs");
                json!({ "progress": "note", "note": note })
            }
            Self::Search(error) => json!({ "progress": "search", "error": error.to_string() }),
            Self::Iteration(Progress { iteration, cost, step, observer, start, configuration }) => json!({
                "progress": "iteration",
                "iteration": iteration,
                "cost": cost,
                "step": step,
                "observer": (*observer > 0.0).then_some(observer),
                "start": start,
                "configuration": configuration,
            }),
        }
    }
}

impl DiagnoseProgress<'_> {
    /// For programs, as `dynid --progress json` prints it; `None` where it only works on.
    pub fn json(&self) -> Option<Value> {
        let Self::Event(event) = self else { return None };
        Some(match event {
            Event::FittingModel => json!({ "progress": "fitting_model" }),
            Event::Asking(count) => json!({ "progress": "asking", "candidates": count }),
            Event::Screened(screened) => {
                let gain = |own: &Screened| json!({ "candidate": own.candidate.to_string(), "gain": own.position.map(|two| -0.5 * two) });
                json!({ "progress": "screened", "candidates": screened.iter().map(gain).collect::<Vec<Value>>() })
            }
            Event::Comparing(count) => json!({ "progress": "comparing", "candidates": count }),
            Event::Searched(key, state) => json!({
                "progress": "searched",
                "candidate": candidate(key),
                "search": key,
                "cost": state.cost,
                "iterations": state.iterations + state.search.iterations,
                "done": state.is_done,
            }),
        })
    }
}

/// The candidate that a search is for, as it stands in its key; `None` where that is the model itself.
fn candidate(key: &str) -> Option<&str> {
    let (_, search) = key.rsplit_once("> ")?;
    if let Some(candidate) = search.strip_suffix(", final") {
        return Some(candidate);
    }
    // In a race each start has a number.
    let (start, _) = search.rsplit_once(", round ")?;
    start.rsplit_once(' ').map(|(candidate, _)| candidate)
}

/// Does `work` for each of `items` in parallel; results in their order.
///
/// # Errors
/// The first error in the order of the items; [`Error::Stopped`] where `progress` breaks before all are done.
pub(crate) fn each<T: Sync, R: Send>(
    items: &[T],
    progress: &(dyn Fn(Done) -> ControlFlow<()> + Sync),
    work: impl Fn(&T) -> Result<R, Error> + Sync,
) -> Result<Vec<R>, Error> {
    let (done, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results: Vec<Result<R, Error>> = items
        .par_iter()
        .map(|item| {
            if stopped.load(Ordering::Relaxed) {
                return Err(Error::Stopped);
            }
            let result = work(item);
            let done = 1 + done.fetch_add(1, Ordering::Relaxed);
            if progress(Done { done, of: items.len() }).is_break() {
                stopped.store(true, Ordering::Relaxed);
            }
            result
        })
        .collect();
    results.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_names_its_candidate() {
        let asked = |key| candidate(key).unwrap_or("the model");
        assert_eq!(asked("step 1.0 > `backlash` at joint 4 12, round 3"), "`backlash` at joint 4");
        assert_eq!(asked("step 1 > `lugre` at joint 4, final"), "`lugre` at joint 4");
        assert_eq!(asked("step 1 > best, round 1"), "the model");
        assert_eq!(asked("the model itself"), "the model");
    }

    #[test]
    fn results_keep_their_order_and_a_stop_ends_the_work() {
        let items: Vec<usize> = (0..100).collect();
        let all = each(&items, &|_| ControlFlow::Continue(()), |item| Ok(2 * item)).expect("none fails");
        assert_eq!(all, items.iter().map(|item| 2 * item).collect::<Vec<_>>());
        let worked = AtomicUsize::new(0);
        let stopped = each(&items, &|_| ControlFlow::Break(()), |_| {
            worked.fetch_add(1, Ordering::Relaxed);
            Ok(())
        });
        assert!(matches!(stopped, Err(Error::Stopped)), "{stopped:?}");
        assert!(worked.into_inner() < 100, "what had not begun does not begin");
    }
}
