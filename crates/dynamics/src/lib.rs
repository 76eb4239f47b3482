//! Equations of motion with numbers in them: forward simulation, evaluation along a given motion, and kinematics.
//!
//! - [`system::System`]: one configuration of a device, its kernel with parameter values, and the effects at their places;
//!   `dynid-user-model` makes one from a model file;
//! - [`simulate`]: integration over the commands of a log, open loop, closed loop, or corrected at each sample ([`simulate::Predictor`]);
//! - [`kinematics::Kinematics`]: pose, Jacobian and static torques of the end point.
//!
//! Numbers only: no file is read or written here, and no symbol is known.

pub mod kinematics;
pub mod simulate;
pub mod system;
