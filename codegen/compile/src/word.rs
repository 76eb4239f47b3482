//! The scalars that machine code computes with.

use dynid_generated::{LANES, Lanes, Scalar};

mod sealed {
    pub trait Sealed {}
}

/// A scalar that is a register of the machine: `f64` or [`Lanes`].
pub trait Word: Scalar + Send + Sync + sealed::Sealed + 'static {
    /// How many numbers it is.
    const NUMBERS: usize;
}

impl sealed::Sealed for f64 {}

impl Word for f64 {
    const NUMBERS: usize = 1;
}

impl sealed::Sealed for Lanes {}

impl Word for Lanes {
    const NUMBERS: usize = LANES;
}
