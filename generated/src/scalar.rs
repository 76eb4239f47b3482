//! What kernels compute with.

use core::ops::{Add, Div, Mul, Neg, Sub};

/// A number as kernels need it: `f64`, several at once ([`crate::Lanes`]) or with derivatives ([`crate::Dual`]).
///
/// All functions are pure Rust and give the same bits on every platform.
pub trait Scalar:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A constant.
    fn constant(value: f64) -> Self;
    /// Sines and cosines of several angles (rad) at once.
    fn sines_cosines<const N: usize>(angles: [Self; N]) -> ([Self; N], [Self; N]);
    /// Tangent.
    fn tan(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// -1, 0 or 1.
    fn sign(self) -> Self;
    /// `then` where `a < b`, else `otherwise`.
    fn if_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self;
    /// The smaller of two.
    fn minimum(self, other: Self) -> Self {
        Self::if_less(self, other, self, other)
    }
    /// The larger of two.
    fn maximum(self, other: Self) -> Self {
        Self::if_less(other, self, self, other)
    }
}
