//! Several numbers side by side.

mod eight;
pub(crate) mod exponential;
pub(crate) mod trigonometry;
mod vector;
#[cfg(target_arch = "x86_64")]
mod x86;

use wide::{
    bytemuck::cast,
    {f64x2, u64x2},
};

use crate::Scalar;

pub(crate) use eight::of_eight;
pub use eight::{Eight, Lanewise, Width};
use vector::{Vector, scalar_of_vector};

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
    fn bits(self) -> u64x2 {
        cast(self.0)
    }
}

impl From<[f64; LANES]> for Lanes {
    #[inline(always)]
    fn from(numbers: [f64; LANES]) -> Self {
        Self::new(numbers)
    }
}

impl From<Lanes> for [f64; LANES] {
    #[inline(always)]
    fn from(lanes: Lanes) -> Self {
        lanes.to_array()
    }
}

impl Vector for Lanes {
    #[inline(always)]
    fn of_bits(bits: u64) -> Self {
        Lanes(cast(u64x2::splat(bits)))
    }
    #[inline(always)]
    fn both(self, other: Self) -> Self {
        Lanes(cast(self.bits() & other.bits()))
    }
    #[inline(always)]
    fn either(self, other: Self) -> Self {
        Lanes(cast(self.bits() ^ other.bits()))
    }
    #[inline(always)]
    fn plus_bits(self, other: Self) -> Self {
        Lanes(cast(self.bits() + other.bits()))
    }
    #[inline(always)]
    fn minus_bits(self, other: Self) -> Self {
        Lanes(cast(self.bits() - other.bits()))
    }
    #[inline(always)]
    fn left<const BY: u32>(self) -> Self {
        Lanes(cast(self.bits() << BY))
    }
    #[inline(always)]
    fn right<const BY: u32>(self) -> Self {
        Lanes(cast(self.bits() >> BY))
    }
    #[inline(always)]
    fn all_within(self, limit: f64) -> bool {
        Scalar::abs(self).0.simd_le(f64x2::splat(limit)).all()
    }
    #[inline(always)]
    fn each(self, of: impl Fn(f64) -> f64) -> Self {
        Lanes::new(self.to_array().map(of))
    }
}

scalar_of_vector!(Lanes {
    add: |a: Lanes, b: Lanes| Lanes(a.0 + b.0),
    sub: |a: Lanes, b: Lanes| Lanes(a.0 - b.0),
    mul: |a: Lanes, b: Lanes| Lanes(a.0 * b.0),
    div: |a: Lanes, b: Lanes| Lanes(a.0 / b.0),
    sqrt: |a: Lanes| Lanes(a.0.sqrt()),
    constant: |value| Lanes(f64x2::splat(value)),
    if_less: |a: Lanes, b: Lanes, then: Lanes, otherwise: Lanes| Lanes(a.0.simd_lt(b.0).select(then.0, otherwise.0)),
});
