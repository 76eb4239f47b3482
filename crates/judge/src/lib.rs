//! How far a model is from logs, where, and which model of a lineage is best.

pub mod compare;
mod error;
pub mod ladder;

pub use error::CompareError;
