//! Fits.
pub mod sensitivity;
