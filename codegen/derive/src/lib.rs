//! The arithmetic of a computer algebra system (Symbolica) for [`dynid_equations`], and the writer of what it derives:
//! `generated/<device>/cNN.kir` and `structure.toml`.
//!
//! The only crate that links Symbolica; nothing depends on it. The binary `dynid-derive` writes the files, or compares them with
//! `--check`. Files that do not change keep their time of modification; left-over `.kir` files of a device are removed. It holds a
//! lock of the operating system while Symbolica runs ([`session`]), and depends on nothing that would change the features that
//! Symbolica is compiled with, so that runs and tests share one build of it.

pub mod algebra;
pub mod output;
pub mod session;

pub use algebra::ByAlgebra;
