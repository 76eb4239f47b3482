//! A robot's equations with numbers in them: its motion under commands, its end point, and what both depend on.
//!
//! Numbers only: no file is read or written here. A [`System`](system::System) is made of a kernel and of effects at their places
//! (`dynid-user-model` makes one of a user's model).

pub mod kinematics;
pub mod simulate;
pub mod system;
