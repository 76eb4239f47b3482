//! dynid.

pub mod experiment;
pub mod fit;
pub mod log;
pub mod plot;
pub mod report;
pub mod signal;
