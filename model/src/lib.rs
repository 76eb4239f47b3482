//! Robots and physical effects as data: typed, validated, with errors that point at the line.
//!
//! A *device* (`devices/*.toml`) is a mechanism: joints, Denavit-Hartenberg frames, links, locking
//! configurations. An *effect* (`effects/*.toml`) is one physical effect: a formula with parameters that vanishes
//! at its null value. An *input* (`inputs/*.toml`) is what a published experiment played on a device. This crate reads and checks both; it computes nothing.

pub mod device;
pub mod device_reader;
pub mod document;
pub mod effect;
mod effect_reader;
pub mod error;
pub mod expression;
mod identifier;
pub mod inertia;
pub mod input;
pub mod instance;
pub mod library;
pub mod parameter;
pub mod parser;
mod shipped;
pub mod unit;

pub use device::{
    Configuration, Convention, DefaultEffect, Device, Frame, Joint, JointKind, Length, Link, Method, sha256_hex,
};
pub use effect::{Effect, EffectParameter, EffectState, Origin, Place, Replacement, Scope, Stage};
pub use error::{ModelError, Source, did_you_mean, nearest};
pub use expression::Expression;
pub use input::{JointInput, NamedInput, Quantity};
pub use library::{device, devices, effect, effects, inputs};
pub use parameter::Parameter;
