//! Work on many things at a time, with somebody who hears of it and may stop it.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::Error;

/// So many of so many runs or models are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Done {
    /// So many.
    pub done: usize,
    /// Of so many.
    pub of: usize,
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
