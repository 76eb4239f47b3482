//! A wall that is a plane in space, met by the end point of the whole device in a hand.
//!
//! What a joint's wall leaves out is here: the wall's force reaches several joints at once and moves them along the wall too,
//! weight and friction of all joints are in the hand, and the handle turns. The hand grips the point in three directions like
//! the hand on a joint in one, and holds the handle's orientation like a spring. At the start it holds the device still with
//! a constant force and moment, and it goes on with them.
//!
//! A wall's file is written for a joint; here it is used as if the handle were at [`Setting::lever`]: depth over lever in,
//! torque over lever out.

mod compare;
mod contact;
mod measure;
mod setting;

pub use compare::{Case, compare};
pub use contact::{Contact, Met, contact};
pub use measure::Coupling;
pub use setting::Setting;

pub use super::StartError;

/// The setting that the program carries.
pub const SETTING: &str = include_str!("shipped/space.toml");
