//! Numbers with derivatives.

use core::ops::{Add, Div, Mul, Neg, Sub};

use crate::Scalar;

/// A number and its partial derivatives by `N` variables (forward mode). At a kink (`abs`, `sign`, a choice) the
/// derivative is that of the branch taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const N: usize> {
    /// The number.
    pub value: f64,
    /// Its partial derivatives.
    pub partials: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// The variable in place `place`; beyond `N` it is a constant.
    pub fn variable(value: f64, place: usize) -> Self {
        let mut partials = [0.0; N];
        if let Some(partial) = partials.get_mut(place) {
            *partial = 1.0;
        }
        Dual { value, partials }
    }

    /// `value` with the partial derivatives scaled by `slope`: the chain rule.
    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        Dual { value, partials: self.partials.map(|partial| slope * partial) }
    }

    #[inline(always)]
    fn product(self, other: Self) -> Self {
        self.combine(other, self.value * other.value, |a, b| a * other.value + self.value * b)
    }

    #[inline(always)]
    fn combine(self, other: Self, value: f64, of: impl Fn(f64, f64) -> f64) -> Self {
        let mut partials = self.partials;
        for (a, b) in partials.iter_mut().zip(other.partials) {
            *a = of(*a, b);
        }
        Dual { value, partials }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.combine(other, self.value + other.value, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.combine(other, self.value - other.value, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.product(other)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        let reciprocal = 1.0 / other.value;
        self.combine(other, quotient, |a, b| (a - quotient * b) * reciprocal)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Scalar for Dual<N> {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Dual { value, partials: [0.0; N] }
    }
    #[inline]
    fn sines_cosines<const M: usize>(angles: [Self; M]) -> ([Self; M], [Self; M]) {
        let (sines, cosines) = Scalar::sines_cosines(angles.map(|angle| angle.value));
        let (mut by_sine, mut by_cosine) = (angles, angles);
        for ((angle, s), c) in by_sine.iter_mut().zip(sines).zip(cosines) {
            *angle = angle.chain(s, c);
        }
        for ((angle, s), c) in by_cosine.iter_mut().zip(sines).zip(cosines) {
            *angle = angle.chain(c, -s);
        }
        (by_sine, by_cosine)
    }
    fn tan(self) -> Self {
        let value = self.value.tan();
        self.chain(value, 1.0 + value * value)
    }
    fn tanh(self) -> Self {
        let value = self.value.tanh();
        self.chain(value, 1.0 - value * value)
    }
    fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }
    fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        self.chain(value, 0.5 / value)
    }
    fn abs(self) -> Self {
        self.chain(self.value.abs(), self.value.sign())
    }
    fn sign(self) -> Self {
        Self::constant(self.value.sign())
    }
    fn if_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self {
        if a.value < b.value { then } else { otherwise }
    }
}
