//! The identified model in a controller.
//!
//! What stands here runs within a controller's tick: no allocation, no lock, no panic. Everything is made ready when it
//! is constructed; a tick walks flat arrays and has the same bits wherever it runs.

mod compensation;
mod estimator;
mod share;

pub use compensation::{Compensation, CompensationError, Shares};
pub use estimator::Estimator;
pub use share::{Holding, largest_inertia_share};
