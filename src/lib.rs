//! dynid.

pub mod experiment;
pub mod log;
pub mod signal;
