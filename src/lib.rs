//! dynid.

pub mod experiment;
pub mod fit;
pub mod log;
pub mod signal;
