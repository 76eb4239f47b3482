//! A number by itself: sines, cosines and the exponential as of several at once, to the same bits.

use crate::{
    Scalar,
    lanes::{exponential, trigonometry},
};

impl Scalar for f64 {
    #[inline]
    fn constant(value: f64) -> f64 {
        value
    }
    // Part of the kernel: the angles stay in registers.
    #[inline(always)]
    fn sines_cosines<const N: usize>(angles: [f64; N]) -> ([f64; N], [f64; N]) {
        trigonometry::sin_cos(angles)
    }
    fn tan(self) -> f64 {
        libm::tan(self)
    }
    fn tanh(self) -> f64 {
        libm::tanh(self)
    }
    #[inline]
    fn exp(self) -> f64 {
        exponential::exp(self)
    }
    fn ln(self) -> f64 {
        libm::log(self)
    }
    #[inline]
    fn sqrt(self) -> f64 {
        libm::sqrt(self)
    }
    #[inline]
    fn abs(self) -> f64 {
        f64::abs(self)
    }
    #[inline]
    fn sign(self) -> f64 {
        if self > 0.0 {
            1.0
        } else if self < 0.0 {
            -1.0
        } else {
            // Keeps a NaN.
            self * 0.0
        }
    }
    #[inline]
    fn if_less(a: f64, b: f64, then: f64, otherwise: f64) -> f64 {
        if a < b { then } else { otherwise }
    }
}
