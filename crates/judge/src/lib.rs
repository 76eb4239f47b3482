//! Model validation: how far a model is from logs, where, and which model of a lineage is best.
//!
//! - [`compare::compare`]: position error and torque error of every run and joint;
//! - [`compare::locate`](compare::locate()): what these errors follow and where they lie, as [`compare::Finding`]s, the most
//!   significant first. The position error of a simulation that has lost its log is left out, and so is the torque error of a
//!   joint whose position error is white noise. Findings that hold nothing beyond a stronger one (reversals are slow) are named
//!   beside it; what both errors show is reported once;
//! - [`predictions::predictions`]: how likely the logs are under its one-step predictions, which need no choice between the two;
//! - [`ladder::ladder`]: the models of a lineage on the same runs, with BIC; [`ladder::Lineage`] is what the digests in `[fit]`
//!   say of their descent.
//!
//! Regressions and correlations count independent samples by `effective_samples` of `dynid-signal`; means,
//! sums and shares of regions by its `correlation_time`.

pub mod compare;
mod error;
pub mod ladder;
pub mod predictions;

pub use error::CompareError;
