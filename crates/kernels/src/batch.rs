//! Equations of many states that do not depend on each other, on all threads; forward dynamics eight at once, derivatives two.
//!
//! Arrays have a row per state, in the order of the free joints. The bits are those of one state after the other.

use std::sync::LazyLock;

use dynid_generated::{Eight, Kernel, LANES, Lanes, Scalar, Width};
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;

/// Fewer than these are not worth a thread (states): a numerical choice.
const WORTH: usize = 1024;

/// `ddq = D^-1 (tau - h)` of every state.
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

/// `tau = D ddq + h` of every state.
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn inverse_dynamics(kernel: &Kernel, prepared: &[f64], given: [&[f64]; 3], tau: &mut [f64]) {
    let work = |[q, dq, ddq]: [&[f64]; 3], [tau]: [&mut [f64]; 1]| {
        kernel.functions.inverse_dynamics(prepared, q, dq, ddq, tau);
    };
    each(kernel, given, [tau], [1], &work);
}

/// The inertia matrix D (n x n) of every state.
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn inertia(kernel: &Kernel, prepared: &[f64], q: &[f64], d: &mut [f64]) {
    let work = |[q]: [&[f64]; 1], [d]: [&mut [f64]; 1]| kernel.functions.inertia(prepared, q, d);
    each(kernel, [q], [d], [kernel.free.len()], &work);
}

/// The torque of gravity of every state.
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn gravity(kernel: &Kernel, prepared: &[f64], q: &[f64], phi: &mut [f64]) {
    let work = |[q]: [&[f64]; 1], [phi]: [&mut [f64]; 1]| kernel.functions.gravity(prepared, q, phi);
    each(kernel, [q], [phi], [1], &work);
}

/// The torque without acceleration, `h = C dq + phi`, of every state.
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn bias(kernel: &Kernel, prepared: &[f64], given: [&[f64]; 2], h: &mut [f64]) {
    let work = |[q, dq]: [&[f64]; 2], [h]: [&mut [f64]; 1]| kernel.functions.bias(prepared, q, dq, h);
    each(kernel, given, [h], [1], &work);
}

/// `tau = D ddq + h` of every state, and its derivatives by q and dq (n x n each); the one by ddq is [`inertia`].
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn inverse_dynamics_gradient(kernel: &Kernel, prepared: &[f64], given: [&[f64]; 3], results: [&mut [f64]; 3]) {
    let n = kernel.free.len();
    let own: Vec<Lanes> = prepared.iter().map(|value| Lanes::constant(*value)).collect();
    // Two states are rows of one, twice as wide.
    let work = |given: [&[f64]; 3], results: [&mut [f64]; 3]| {
        let states = given[0].len() / n;
        let lanes = given.map(|rows| {
            let of_slot = |slot: usize| Lanes::new(std::array::from_fn(|lane| rows[lane.min(states - 1) * n + slot]));
            (0..n).map(of_slot).collect::<Vec<Lanes>>()
        });
        let mut room = [n, n * n, n * n].map(|count| vec![Lanes::constant(0.0); count]);
        let ([q, dq, ddq], [tau, by_q, by_dq]) = (&lanes, &mut room);
        kernel.functions.inverse_dynamics_gradient_lanes(&own, q, dq, ddq, tau, by_q, by_dq);
        for (result, lanes) in results.into_iter().zip(room) {
            for (lane, row) in result.chunks_exact_mut(lanes.len()).enumerate() {
                row.iter_mut().zip(&lanes).for_each(|(value, lanes)| *value = lanes.to_array()[lane]);
            }
        }
    };
    in_groups(kernel, given, results, [1, n, n], LANES, &work);
}

/// `ddq = D^-1 (tau - h)` of every state, and its derivatives by q, dq and tau (n x n each).
///
/// With the torque `tau(q, dq, ddq)` of [`inverse_dynamics`] they are `-D^-1 d tau / d q`, `-D^-1 d tau / d dq` and `D^-1`, by the implicit
/// function theorem (Carpentier & Mansard 2018).
///
/// # Panics
/// Where a length does not fit the kernel.
pub fn forward_dynamics_gradient(kernel: &Kernel, prepared: &[f64], given: [&[f64]; 3], results: [&mut [f64]; 4]) {
    let n = kernel.free.len();
    let [q, dq, _] = given;
    let [ddq, by_q, by_dq, by_tau] = results;
    forward_dynamics(kernel, prepared, given, ddq);
    let mut tau = vec![0.0; ddq.len()];
    inverse_dynamics_gradient(kernel, prepared, [q, dq, ddq], [&mut tau, by_q, by_dq]);
    let work = |[q]: [&[f64]; 1], [by_q, by_dq, by_tau]: [&mut [f64]; 3]| {
        let mut d = DMatrix::zeros(n, n);
        kernel.functions.inertia(prepared, q, d.as_mut_slice());
        // Of a mechanism with masses D is positive definite; where it is not, there is no answer.
        let inverse = Cholesky::new(d).map_or_else(|| DMatrix::from_element(n, n, f64::NAN), |d| d.inverse());
        for by in [by_q, by_dq] {
            let solved = -(&inverse * DMatrix::from_row_slice(n, n, by));
            by.copy_from_slice(solved.transpose().as_slice());
        }
        by_tau.copy_from_slice(inverse.as_slice());
    };
    each(kernel, [q], [by_q, by_dq, by_tau], [n, n, n], &work);
}

/// Does `work` for every state, whose results are so many times as wide as its rows.
fn each<const A: usize, const R: usize>(
    kernel: &Kernel,
    given: [&[f64]; A],
    results: [&mut [f64]; R],
    widths: [usize; R],
    work: &(impl Fn([&[f64]; A], [&mut [f64]; R]) + Sync),
) {
    in_groups(kernel, given, results, widths, 1, work);
}

/// Does `work` for so many states at a time; the last ones may be fewer.
fn in_groups<const A: usize, const R: usize>(
    kernel: &Kernel,
    given: [&[f64]; A],
    results: [&mut [f64]; R],
    widths: [usize; R],
    group: usize,
    work: &(impl Fn([&[f64]; A], [&mut [f64]; R]) + Sync),
) {
    let n = kernel.free.len();
    let states = given[0].len() / n;
    let is_right = given.iter().all(|rows| rows.len() == states * n)
        && results.iter().zip(widths).all(|(rows, width)| rows.len() == states * n * width);
    assert!(is_right, "one row of the free joints per state, in each array");
    parted(n, (given, results), widths, group, work);
}

/// Arguments and results, a row per state.
type Rows<'g, 'r, const A: usize, const R: usize> = ([&'g [f64]; A], [&'r mut [f64]; R]);

fn parted<const A: usize, const R: usize>(
    n: usize,
    rows: Rows<'_, '_, A, R>,
    widths: [usize; R],
    group: usize,
    work: &(impl Fn([&[f64]; A], [&mut [f64]; R]) + Sync),
) {
    let states = rows.0[0].len() / n;
    if states > WORTH {
        let (first, rest) = split(n, rows, widths, states / 2 / group * group);
        let parted = |rows| parted(n, rows, widths, group, work);
        rayon::join(|| parted(first), || parted(rest));
        return;
    }
    let mut left = rows;
    for done in (0..states).step_by(group) {
        let (now, rest) = split(n, left, widths, group.min(states - done));
        work(now.0, now.1);
        left = rest;
    }
}

/// The rows of the first so many states, and of the others.
fn split<'g, 'r, const A: usize, const R: usize>(
    n: usize,
    (given, results): Rows<'g, 'r, A, R>,
    widths: [usize; R],
    states: usize,
) -> (Rows<'g, 'r, A, R>, Rows<'g, 'r, A, R>) {
    let given = given.map(|rows| rows.split_at(states * n));
    let empty = || std::array::from_fn::<&mut [f64], R, _>(|_| Default::default());
    let (mut first, mut rest) = (empty(), empty());
    for (place, rows) in results.into_iter().enumerate() {
        (first[place], rest[place]) = rows.split_at_mut(states * n * widths[place]);
    }
    ((given.map(|(first, _)| first), first), (given.map(|(_, rest)| rest), rest))
}

/// States to lanes; lanes without a state keep what they held, which nobody reads.
fn gather(rows: &[f64], lanes: &mut [Eight]) {
    for (lane, row) in rows.chunks_exact(lanes.len()).enumerate() {
        lanes.iter_mut().zip(row).for_each(|(values, value)| values[lane] = *value);
    }
}
