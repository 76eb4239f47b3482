//! Sampled signals: uniform resampling, zero-phase low-pass filtering, differentiation, spectra.
//!
//! The torque error needs velocities and accelerations that lag nothing. They come from a Butterworth low-pass that runs
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
