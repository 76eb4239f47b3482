//! A function of eight states at once, in registers as wide as the processor's.

use super::{LANES, Lanes, vector::Vector};
use crate::Scalar;

/// A quantity of eight states.
pub type Eight = [f64; 8];

/// A function of `I` numbers with `O` results, for any scalar. What it calls is compiled for wide registers only where it is
/// `#[inline(always)]`, and closures that it hands to others mostly are not.
pub trait Lanewise<const I: usize, const O: usize> {
    /// The results.
    fn of<S: Scalar>(&self, given: &[S; I]) -> [S; O];
}

/// How many numbers are worked on at once. There are only widths that the processor has, and the bits do not depend on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Width(Register);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Register {
    /// Of any 64-bit machine.
    Two,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Width {
    /// The widest that the processor has. Asking it takes longer than what is computed with the answer: keep it.
    pub fn widest() -> Width {
        Self::all().last().unwrap_or(Width(Register::Two))
    }

    /// All that the processor has, from the narrowest on.
    pub fn all() -> impl Iterator<Item = Width> {
        #[cfg(target_arch = "x86_64")]
        let wide = super::x86::found();
        #[cfg(not(target_arch = "x86_64"))]
        let wide: [Option<Register>; 0] = [];
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

    /// A function of eight states, each with the bits that it would have alone.
    #[inline]
    pub fn of_eight<const I: usize, const O: usize>(
        self,
        function: &impl Lanewise<I, O>,
        given: &[Eight; I],
        results: &mut [Eight; O],
    ) {
        match self.0 {
            Register::Two => in_parts::<Lanes, LANES, I, O>(function, given, results),
            #[cfg(target_arch = "x86_64")]
            Register::Avx2 => super::x86::in_avx2(function, given, results),
            #[cfg(target_arch = "x86_64")]
            Register::Avx512 => super::x86::in_avx512(function, given, results),
        }
    }
}

/// The same, so many states after the other.
#[inline(always)]
pub(super) fn in_parts<V, const LANES: usize, const I: usize, const O: usize>(
    function: &impl Lanewise<I, O>,
    given: &[Eight; I],
    results: &mut [Eight; O],
) where
    V: Vector + From<[f64; LANES]> + Into<[f64; LANES]>,
{
    for part in 0..8 / LANES {
        let mut lanes = [V::constant(0.0); I];
        for (lanes, row) in lanes.iter_mut().zip(given) {
            *lanes = V::from(row.as_chunks().0[part]);
        }
        for (row, result) in results.iter_mut().zip(function.of(&lanes)) {
            row.as_chunks_mut().0[part] = result.into();
        }
    }
}

/// The entry of a table from the generic function, whose arguments and results stand one behind the other.
macro_rules! of_eight {
    ($function:ident, [$($argument:ident: $n:literal),*], [$($result:ident: $m:literal),*]) => {{
        struct Own;
        impl $crate::Lanewise<{ 0 $(+ $n)* }, { 0 $(+ $m)* }> for Own {
            #[inline(always)]
            fn of<S: $crate::Scalar>(&self, given: &[S; 0 $(+ $n)*]) -> [S; 0 $(+ $m)*] {
                let mut results = [S::constant(0.0); 0 $(+ $m)*];
                let rest = given.as_slice();
                $(let Some(($argument, rest)) = rest.split_first_chunk::<$n>() else { return results };)*
                let rest_of_results = results.as_mut_slice();
                $(let Some(($result, rest_of_results)) = rest_of_results.split_first_chunk_mut::<$m>() else {
                    return results;
                };)*
                $function($($argument,)* $($result),*);
                results
            }
        }
        |width, given, results| match (given.try_into(), results.try_into()) {
            (Ok(given), Ok(results)) => width.of_eight(&Own, given, results),
            _ => $crate::wrong_length(),
        }
    }};
}
pub(crate) use of_eight;
