//! Digital signal processing of logs: resampling to a uniform grid ([`Grid`]), zero-phase low-pass filtering ([`Lowpass`]),
//! differentiation ([`first_derivative`], [`second_derivative`]), power spectra ([`power_spectrum`]), tests of whiteness
//! ([`is_white`]) and the [`statistics`] of correlated samples.
//!
//! The torque error needs velocities and accelerations without delay. They come from a Butterworth low-pass filter that runs
//! over the samples forwards and backwards (no phase, gain squared) and from central differences over nine samples. What is
//! compared with them passes the same filter.

mod filter;
mod resample;
mod spectrum;
pub mod statistics;
mod whiteness;

pub use filter::{Lowpass, decimate, first_derivative, second_derivative};
pub use resample::{Gap, Grid, held, median_step, straight};
pub use spectrum::{PowerSpectrum, motion_bandwidth, power_spectrum};
pub use whiteness::{WHITENESS_BOUND, is_white, whiteness};
