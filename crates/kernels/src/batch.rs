//! Forward dynamics of many states that do not depend on each other: eight at once, on all threads.

use std::sync::LazyLock;

use dynid_generated::{Eight, Kernel, Width};
use rayon::prelude::*;

/// Fewer than these are not worth a thread (states): a numerical choice.
const WORTH: usize = 1024;

/// `ddq = D^-1 (tau - h)` of every state: `q`, `dq`, `tau` and `ddq` have a row per state, in the order of the free joints. The bits
/// are those of one state after the other.
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn forward_dynamics(kernel: &Kernel, prepared: &[f64], [q, dq, tau]: [&[f64]; 3], ddq: &mut [f64]) {
    let n = kernel.free.len();
    let is_right = [q, dq, tau].iter().all(|rows| rows.len() == ddq.len()) && ddq.len().is_multiple_of(n);
    assert!(is_right && prepared.len() == kernel.prepared.len(), "one row of the free joints per state, in each array");
    if n == 0 {
        return;
    }
    static WIDTH: LazyLock<Width> = LazyLock::new(Width::widest);
    let width = *WIDTH;
    let own: Vec<Eight> = prepared.iter().map(|value| [*value; 8]).collect();
    let states =
        ddq.par_chunks_mut(8 * n).zip(q.par_chunks(8 * n)).zip(dq.par_chunks(8 * n)).zip(tau.par_chunks(8 * n));
    let rooms = || ([own.clone(), vec![[0.0; 8]; 3 * n]].concat(), vec![[0.0; 8]; n]);
    states.with_min_len(WORTH / 8).for_each_init(rooms, |(given, results), (((ddq, q), dq), tau)| {
        for (lanes, rows) in given[prepared.len()..].chunks_exact_mut(n).zip([q, dq, tau]) {
            gather(rows, lanes);
        }
        kernel.functions.forward_dynamics_of_eight(width, given, results);
        for (lane, row) in ddq.chunks_exact_mut(n).enumerate() {
            row.iter_mut().zip(&*results).for_each(|(ddq, result)| *ddq = result[lane]);
        }
    });
}

/// States to lanes; lanes without a state keep what they held, which nobody reads.
fn gather(rows: &[f64], lanes: &mut [Eight]) {
    for (lane, row) in rows.chunks_exact(lanes.len()).enumerate() {
        lanes.iter_mut().zip(row).for_each(|(values, value)| values[lane] = *value);
    }
}
