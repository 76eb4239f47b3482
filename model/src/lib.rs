//! Robots and physical effects as data: typed, validated, with errors that point at the line.
//!
//! A *device* (`devices/*.toml`) is a mechanism: joints, Denavit-Hartenberg frames, links, locking
//! configurations. An *effect* (`effects/*.toml`) is one physical effect: a formula with parameters that vanishes
//! at its null value. This crate reads and checks both; it computes nothing.

pub mod device;
pub mod effect;
pub mod expression;
pub mod parameter;

pub use device::{Configuration, Convention, Device, Frame, Joint, JointKind, Length, Link, Method};
pub use effect::{Effect, EffectParameter, EffectState, Place, Scope};
pub use expression::Expression;
pub use parameter::Parameter;
