//! Kernels of the equations of motion: straight-line functions for every configuration of every device, and for every effect.
//!
//! | what | found by |
//! | --- | --- |
//! | [`Kernel`]: D, C, phi, inverse and forward dynamics, regressor, gradient of one configuration | [`kernel()`], [`kernels`] |
//! | [`EffectKernel`]: one effect and its Jacobian | [`effect()`], [`effects`] |
//! | [`EndPoint`]: pose and Jacobian of a device's end point | [`end_point()`] |
//!
//! `build.rs` lowers the checked-in equations (`<device>/c<NN>.kir`) and the effects (`model/effects/*.toml`) to
//! Rust. This crate needs no operating system, allocates nothing and has no panic path in a release build: a slice
//! of a wrong length makes a kernel return without writing.
//!
//! Matrices are row-major; vectors are in the order of [`Kernel::free`]; units are SI and radians.
//!
//! # Scalars
//!
//! The functions behind the tables are generic over [`Scalar`], e.g. `dynid_generated::freedom6s::c07::inertia::<S>` and
//! `dynid_generated::effect_library::lugre::eval::<S>`. The tables hold the instances for `f64`, and those for [`Lanes`] (two
//! numbers in one vector register, each with the bits that it would have alone) that a simulation or a fit calls. [`Dual`] is
//! instantiated where it is used: `prepare_gradient` is `prepare` over `Dual`. Forward dynamics and the effects are there for eight states
//! at once, too ([`Eight`]), in registers as wide as the processor's ([`Width`]), to the same bits.
//!
//! Sines, cosines and exponentials are this crate's own (below 1 unit in the last place, several at once), other
//! functions are those of the crate `libm`: the same bits on every platform, with or without `std`.
//!
//! # Stale equations
//!
//! `build.rs` takes a `.kir` file whose header holds the device's `structure_digest` (`dynid-model`). For a device without
//! current ones it derives them by itself (`dynid-equations`), to the same bytes as the computer algebra system.
#![no_std]

mod alone;
mod dual;
mod effect;
mod end_point;
mod gradient;
mod kernel;
mod lanes;
mod scalar;

use kernel::checked;

pub use dual::Dual;
pub use effect::{EffectFunctions, EffectKernel, EffectTable, N_SIGNALS, Signal};
pub use end_point::{EndPoint, EndPointFunctions, EndPointTable};
pub use kernel::{Kernel, KernelFunctions, KernelTable, Operations};
pub use lanes::{Eight, LANES, Lanes, Lanewise, Width};
pub use scalar::Scalar;

include!(concat!(env!("OUT_DIR"), "/library.rs"));

/// All kernels, by device and configuration.
pub fn kernels() -> &'static [&'static Kernel] {
    KERNELS
}

/// The kernel of a device's configuration, numbered from 1.
pub fn kernel(device: &str, configuration: usize) -> Option<&'static Kernel> {
    KERNELS.iter().copied().find(|kernel| kernel.device == device && kernel.configuration == Some(configuration))
}

/// Where the end point of a device is and how it moves, where the device's file names one.
pub fn end_point(device: &str) -> Option<&'static EndPoint> {
    END_POINTS.iter().copied().find(|end_point| end_point.device == device)
}

/// All effects, by id.
pub fn effects() -> &'static [&'static EffectKernel] {
    effect_library::EFFECTS
}

/// The effect of this id.
pub fn effect(id: &str) -> Option<&'static EffectKernel> {
    effects().iter().copied().find(|effect| effect.id == id)
}

/// Says in a debug build that a kernel was given a slice of a wrong length.
#[cold]
fn wrong_length() {
    debug_assert!(false, "every slice has the length that the kernel's table states");
}
