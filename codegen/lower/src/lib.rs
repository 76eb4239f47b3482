//! Code generation without computer algebra: from named equations (`.kir`) and formulas of effects to kernels in Rust and C.
//!
//! [`Program`] is a shared graph of scalar operations; [`Kir`] is its text, which people review; the module [`kir`] describes the
//! format. [`kernel::Configuration`] makes the programs of a configuration's kernels, [`effect::EffectKernels`] those of an effect,
//! [`end_point::EndPoint`] those of a device's kinematics; [`emit`] writes them as Rust, [`c99`] as C.

pub mod c99;
pub mod effect;
pub mod emit;
pub mod end_point;
pub mod kernel;
pub mod kir;
mod names;
pub mod program;

pub use kir::{Form, Kir, KirError};
pub use program::{Input, Node, Operation, OperationCounts, Program, Split};
