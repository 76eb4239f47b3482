//! From named equations to Rust kernels, without computer algebra.
//!
//! [`Program`] is a shared graph of scalar operations; [`Kir`] is its text, which people review.
//! [`kernel::Configuration`] and [`effect::EffectKernels`] turn equations and formulas into the programs of kernels,
//! [`end_point::EndPoint`] makes those of a device's kinematics, [`emit`] writes them as Rust.

pub mod effect;
pub mod emit;
pub mod end_point;
pub mod kernel;
pub mod kir;
pub mod program;

pub use kir::{Form, Kir, KirError};
pub use program::{Input, Node, Operation, OperationCounts, Program, Split};
