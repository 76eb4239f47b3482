//! Forward dynamics of eight states at once, in registers as wide as the processor's.

use super::{LANES, Lanes, vector::Vector};
use crate::Scalar;

/// A quantity of eight states.
pub type Eight = [f64; 8];

/// How many states are worked on at once. There is only what the processor has, and the bits do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Width(Register);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Register {
    /// Of any 64-bit machine.
    Two,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Width {
    /// The widest that the processor has; where there is no operating system to ask, the one that is always there.
    pub fn widest() -> Width {
        Self::all().last().unwrap_or(Width(Register::Two))
    }

    /// All that the processor has, from the narrowest on.
    pub fn all() -> impl Iterator<Item = Width> {
        #[cfg(all(target_arch = "x86_64", not(target_os = "none")))]
        let wide = [
            std::is_x86_feature_detected!("avx2").then_some(Register::Avx2),
            std::is_x86_feature_detected!("avx512f").then_some(Register::Avx512),
        ];
        #[cfg(not(all(target_arch = "x86_64", not(target_os = "none"))))]
        let wide = [];
        core::iter::once(Register::Two).chain(wide.into_iter().flatten()).map(Width)
    }

    /// How many numbers.
    pub fn lanes(self) -> usize {
        match self.0 {
            Register::Two => LANES,
            #[cfg(target_arch = "x86_64")]
            Register::Avx2 => 4,
            #[cfg(target_arch = "x86_64")]
            Register::Avx512 => 8,
        }
    }
}

/// The forward dynamics of a configuration, as a function of any scalar.
pub(crate) trait ForwardDynamics<const P: usize, const N: usize> {
    fn of<S: Scalar>(prepared: &[S; P], states: [&[S; N]; 3], ddq: &mut [S; N]);
}

/// Of eight states: positions, speeds and torques to accelerations.
pub(crate) fn forward_dynamics_of_eight<K: ForwardDynamics<P, N>, const P: usize, const N: usize>(
    Width(register): Width,
    prepared: &[f64; P],
    states: [&[Eight; N]; 3],
    ddq: &mut [Eight; N],
) {
    match register {
        Register::Two => in_parts::<K, Lanes, LANES, P, N>(prepared, states, ddq),
        #[cfg(target_arch = "x86_64")]
        Register::Avx2 => super::x86::in_avx2::<K, P, N>(prepared, states, ddq),
        #[cfg(target_arch = "x86_64")]
        Register::Avx512 => super::x86::in_avx512::<K, P, N>(prepared, states, ddq),
    }
}

/// The same, `LANES` states after the other.
#[inline(always)]
pub(super) fn in_parts<K, V, const LANES: usize, const P: usize, const N: usize>(
    prepared: &[f64; P],
    states: [&[Eight; N]; 3],
    ddq: &mut [Eight; N],
) where
    K: ForwardDynamics<P, N>,
    V: Vector + From<[f64; LANES]> + Into<[f64; LANES]>,
{
    let prepared = prepared.map(V::constant);
    for part in 0..8 / LANES {
        let [q, dq, tau] = states.map(|rows| rows.map(|row| V::from(row.as_chunks().0[part])));
        let mut results = [V::constant(0.0); N];
        K::of(&prepared, [&q, &dq, &tau], &mut results);
        for (row, result) in ddq.iter_mut().zip(results) {
            row.as_chunks_mut().0[part] = result.into();
        }
    }
}

/// The entry of a table of kernels from the generic function.
macro_rules! in_eight {
    ($function:ident, $n_prepared:literal, $n_free:literal) => {{
        struct Own;
        impl $crate::lanes::ForwardDynamics<$n_prepared, $n_free> for Own {
            #[inline(always)]
            fn of<S: $crate::Scalar>(
                prepared: &[S; $n_prepared],
                [q, dq, tau]: [&[S; $n_free]; 3],
                ddq: &mut [S; $n_free],
            ) {
                $function(prepared, q, dq, tau, ddq);
            }
        }
        |width, prepared, q, dq, tau, ddq| match (
            prepared.try_into(),
            q.try_into(),
            dq.try_into(),
            tau.try_into(),
            ddq.try_into(),
        ) {
            (Ok(prepared), Ok(q), Ok(dq), Ok(tau), Ok(ddq)) => {
                $crate::lanes::forward_dynamics_of_eight::<Own, $n_prepared, $n_free>(width, prepared, [q, dq, tau], ddq)
            }
            _ => $crate::wrong_length(),
        }
    }};
}
pub(crate) use in_eight;
