//! An independent numeric simulator (the "plant") that makes test data; it shares no code with `codegen` or the runtime.
//!
//! It reads a [`Device`] as data and computes its dynamics from the rows of its frames table with numbers only
//! ([`Mechanism`]), so that agreement with the generated kernels means that two derivations agree. Slices hold one
//! entry per joint of the device, matrices are row-major, units are SI. [`effects`] is a second derivation of every effect;
//! [`hidden`] makes cases with a known missing effect.

pub mod effects;
pub mod hidden;
pub mod jet;
pub mod mechanism;
pub mod random;
pub mod recipe;

use dynid_model::Device;

pub use mechanism::{Mechanism, Motion};

/// Torque at every joint for a motion: `D ddq + C dq + phi`.
pub fn inverse_dynamics(
    device: &Device,
    parameters: &dyn Fn(&str) -> f64,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> Vec<f64> {
    Mechanism::new(device, parameters).inverse_dynamics(q, dq, ddq)
}

/// The inertia matrix `D`.
pub fn inertia(device: &Device, parameters: &dyn Fn(&str) -> f64, q: &[f64]) -> Vec<f64> {
    Mechanism::new(device, parameters).inertia(q)
}

/// The bias `C dq + phi`.
pub fn bias(device: &Device, parameters: &dyn Fn(&str) -> f64, q: &[f64], dq: &[f64]) -> Vec<f64> {
    Mechanism::new(device, parameters).bias(q, dq)
}

/// The gravity vector `phi`.
pub fn gravity(device: &Device, parameters: &dyn Fn(&str) -> f64, q: &[f64]) -> Vec<f64> {
    Mechanism::new(device, parameters).gravity(q)
}

/// The Christoffel matrix `C`.
pub fn coriolis(device: &Device, parameters: &dyn Fn(&str) -> f64, q: &[f64], dq: &[f64]) -> Vec<f64> {
    Mechanism::new(device, parameters).coriolis(q, dq)
}
