//! Several numbers side by side.

use core::ops::{Add, Div, Mul, Neg, Sub};

use crate::{Scalar, trigonometry};

/// `N` numbers on which a kernel works at once; the compiler maps them to vector registers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lanes<const N: usize>(pub [f64; N]);

impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn each(self, of: impl Fn(f64) -> f64) -> Self {
        Lanes(self.0.map(of))
    }

    #[inline(always)]
    fn pairs(mut self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        for (a, b) in self.0.iter_mut().zip(other.0) {
            *a = of(*a, b);
        }
        self
    }
}

impl<const N: usize> Add for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.pairs(other, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.pairs(other, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.pairs(other, |a, b| a * b)
    }
}

impl<const N: usize> Div for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.pairs(other, |a, b| a / b)
    }
}

impl<const N: usize> Neg for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(|a| -a)
    }
}

impl<const N: usize> Scalar for Lanes<N> {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Lanes([value; N])
    }
    #[inline]
    fn sines_cosines<const M: usize>(angles: [Self; M]) -> ([Self; M], [Self; M]) {
        let pairs = angles.map(|angle| trigonometry::sin_cos(angle.0));
        (pairs.map(|(sines, _)| Lanes(sines)), pairs.map(|(_, cosines)| Lanes(cosines)))
    }
    fn tan(self) -> Self {
        self.each(Scalar::tan)
    }
    fn tanh(self) -> Self {
        self.each(Scalar::tanh)
    }
    fn exp(self) -> Self {
        self.each(Scalar::exp)
    }
    fn ln(self) -> Self {
        self.each(Scalar::ln)
    }
    #[inline]
    fn sqrt(self) -> Self {
        self.each(Scalar::sqrt)
    }
    #[inline]
    fn abs(self) -> Self {
        self.each(f64::abs)
    }
    #[inline]
    fn sign(self) -> Self {
        self.each(Scalar::sign)
    }
    #[inline]
    fn if_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self {
        let mut chosen = otherwise.0;
        for (((chosen, a), b), then) in chosen.iter_mut().zip(a.0).zip(b.0).zip(then.0) {
            *chosen = f64::if_less(a, b, then, *chosen);
        }
        Lanes(chosen)
    }
}
