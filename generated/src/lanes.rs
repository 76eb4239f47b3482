//! Two numbers side by side.

use core::ops::{Add, BitAnd, BitXor, Div, Mul, Neg, Sub};

use wide::{bytemuck::cast, f64x2, u64x2};

use crate::{Scalar, exponential, trigonometry};

/// How many numbers [`Lanes`] holds: what one vector register of any 64-bit machine does.
pub const LANES: usize = 2;

/// Numbers on which a kernel works at once, each with the bits that it would have alone.
///
/// They are one vector of the machine, not an array whose loops the compiler would have to find anew: the gradient of a
/// configuration of six joints takes rustc as long as for `f64`, where with arrays it takes minutes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lanes(f64x2);

impl Lanes {
    /// From one number per lane.
    #[inline(always)]
    pub fn new([first, second]: [f64; LANES]) -> Self {
        // Not by way of an array: stored as two numbers and loaded as one vector, it would have to wait for the cache.
        let [lanes, _] = f64x2::transpose([f64x2::splat(first), f64x2::splat(second)]);
        Lanes(lanes)
    }

    /// One number per lane.
    #[inline(always)]
    pub fn to_array(self) -> [f64; LANES] {
        self.0.to_array()
    }

    #[inline(always)]
    pub(crate) fn bits(self) -> Bits {
        Bits(cast(self.0))
    }

    /// Whether every lane is at most `limit` in size; false for NaN.
    #[inline(always)]
    pub(crate) fn all_within(self, limit: f64) -> bool {
        Scalar::abs(self).0.simd_le(f64x2::splat(limit)).all()
    }

    #[inline(always)]
    fn each(self, of: impl Fn(f64) -> f64) -> Self {
        Lanes::new(self.to_array().map(of))
    }
}

/// The bits of two numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bits(u64x2);

impl Bits {
    #[inline(always)]
    pub(crate) fn splat(bits: u64) -> Self {
        Bits(u64x2::splat(bits))
    }

    #[inline(always)]
    pub(crate) fn numbers(self) -> Lanes {
        Lanes(cast(self.0))
    }

    #[inline(always)]
    pub(crate) fn plus(self, other: Self) -> Self {
        Bits(self.0 + other.0)
    }

    #[inline(always)]
    pub(crate) fn minus(self, other: Self) -> Self {
        Bits(self.0 - other.0)
    }

    #[inline(always)]
    pub(crate) fn left<const BY: u32>(self) -> Self {
        Bits(self.0 << BY)
    }

    #[inline(always)]
    pub(crate) fn right<const BY: u32>(self) -> Self {
        Bits(self.0 >> BY)
    }
}

impl BitAnd for Bits {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Bits(self.0 & other.0)
    }
}

impl BitXor for Bits {
    type Output = Self;
    #[inline(always)]
    fn bitxor(self, other: Self) -> Self {
        Bits(self.0 ^ other.0)
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Lanes(self.0 + other.0)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Lanes(self.0 - other.0)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Lanes(self.0 * other.0)
    }
}

impl Div for Lanes {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Lanes(self.0 / other.0)
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        (self.bits() ^ Bits::splat(1 << 63)).numbers()
    }
}

impl Scalar for Lanes {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Lanes(f64x2::splat(value))
    }
    #[inline]
    fn sines_cosines<const M: usize>(angles: [Self; M]) -> ([Self; M], [Self; M]) {
        let (mut sines, mut cosines) = (angles, angles);
        for ((angle, sine), cosine) in angles.iter().zip(&mut sines).zip(&mut cosines) {
            (*sine, *cosine) = trigonometry::of_lanes(*angle);
        }
        (sines, cosines)
    }
    fn tan(self) -> Self {
        self.each(Scalar::tan)
    }
    fn tanh(self) -> Self {
        self.each(Scalar::tanh)
    }
    #[inline]
    fn exp(self) -> Self {
        exponential::of_lanes(self)
    }
    fn ln(self) -> Self {
        self.each(Scalar::ln)
    }
    #[inline]
    fn sqrt(self) -> Self {
        Lanes(self.0.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        (self.bits() & Bits::splat(!(1 << 63))).numbers()
    }
    #[inline]
    fn sign(self) -> Self {
        self.each(Scalar::sign)
    }
    #[inline(always)]
    fn if_less(a: Self, b: Self, then: Self, otherwise: Self) -> Self {
        Lanes(a.0.simd_lt(b.0).select(then.0, otherwise.0))
    }
}
