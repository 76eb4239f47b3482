//! [`Vector`]: what sines and exponentials need of several numbers in one register.

use crate::Scalar;

/// Several numbers in one register of the machine, whose bits may be taken for whole numbers.
pub(crate) trait Vector: Scalar {
    /// These bits in every lane.
    fn of_bits(bits: u64) -> Self;
    /// Bits that are set in both.
    fn both(self, other: Self) -> Self;
    /// Bits that are set in one of the two.
    fn either(self, other: Self) -> Self;
    /// The sum of the bits as whole numbers.
    fn plus_bits(self, other: Self) -> Self;
    /// The difference of the bits as whole numbers.
    fn minus_bits(self, other: Self) -> Self;
    /// Bits moved up.
    fn left<const BY: u32>(self) -> Self;
    /// Bits moved down.
    fn right<const BY: u32>(self) -> Self;
    /// Whether every lane is at most `limit` in size; false for NaN.
    fn all_within(self, limit: f64) -> bool;
    /// Each lane by itself.
    fn each(self, of: impl Fn(f64) -> f64) -> Self;
}

/// [`Scalar`] and what belongs to it, of a type that has the operations of a [`Vector`]: the register's own are named.
macro_rules! scalar_of_vector {
    ($vector:ty { add: $add:expr, sub: $sub:expr, mul: $mul:expr, div: $div:expr, sqrt: $sqrt:expr, constant: $constant:expr, if_less: $if_less:expr $(,)? }) => {
        impl core::ops::Add for $vector {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                $add(self, other)
            }
        }

        impl core::ops::Sub for $vector {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                $sub(self, other)
            }
        }

        impl core::ops::Mul for $vector {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                $mul(self, other)
            }
        }

        impl core::ops::Div for $vector {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                $div(self, other)
            }
        }

        impl core::ops::Neg for $vector {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.either(Self::of_bits(1 << 63))
            }
        }

        impl $crate::Scalar for $vector {
            #[inline(always)]
            fn constant(value: f64) -> Self {
                $constant(value)
            }
            #[inline(always)]
            fn sines_cosines<const M: usize>(angles: [Self; M]) -> ([Self; M], [Self; M]) {
                $crate::lanes::trigonometry::of_several(angles)
            }
            fn tan(self) -> Self {
                self.each($crate::Scalar::tan)
            }
            fn tanh(self) -> Self {
                self.each($crate::Scalar::tanh)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                $crate::lanes::exponential::of_lanes(self)
            }
            fn ln(self) -> Self {
                self.each($crate::Scalar::ln)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.both(Self::of_bits(!(1 << 63)))
            }
            #[inline(always)]
            fn sign(self) -> Self {
                let [zero, one] = [0.0, 1.0].map(Self::constant);
                // Keeps a NaN.
                let otherwise = Self::if_less(self, zero, -one, self * zero);
                Self::if_less(zero, self, one, otherwise)
            }
            #[inline(always)]
            fn if_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self {
                $if_less(a, b, then, otherwise)
            }
        }
    };
}
pub(crate) use scalar_of_vector;
