//! From named equations to Rust kernels, without computer algebra.
//!
//! [`Program`] is a shared graph of scalar operations; [`Kir`] is its text, which people review.

pub mod kir;
pub mod program;

pub use kir::{Form, Kir, KirError};
pub use program::{Input, Node, Operation, OperationCounts, Program, Split};
