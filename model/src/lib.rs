//! Robots and physical effects as data: TOML files read into checked types, with errors that point at the line.
//!
//! A *device* (`devices/*.toml`, [`Device`]) is a mechanism: joints, Denavit-Hartenberg frames, links, configurations of locked and
//! free joints. An *effect* (`effects/*.toml`, [`Effect`]) is one physical effect: a formula with parameters that vanishes at its
//! null value. An *input* (`inputs/*.toml`, [`NamedInput`]) is what a published experiment played on a device. Those that ship
//! are embedded at build time ([`devices`], [`effects`], [`inputs`]), a user's are read at run time ([`device_named`], [`add_effects`]); their formats are described in `devices/README.md` and
//! `effects/README.md`. This crate reads and checks; it simulates nothing.
//!
//! Reading: [`document`] gives typed access to any TOML text with places, [`Source::error`] makes an error that points at one,
//! [`did_you_mean`] names the nearest known name, [`instance::read_instances`] reads an `[[effect]]` table of a device or of a
//! user's model.
//!
//! # Names of parameters
//!
//! | name | what |
//! | --- | --- |
//! | `link.<n>.<m, x, y, z, Ixx, Ixy, Ixz, Iyy, Iyz, Izz>` | inertial parameter of link n, from 1 |
//! | `length.<symbol>` | length of the frames table |
//! | `base.<gx, gy, gz>` | gravity in base axes; only components that are not zero |
//! | `joint.<i>.<effect>.<symbol>` | parameter of an effect at joint i, from 0 |
//! | `joint.<i>.<effect>.<from>.<symbol>` | parameter of an effect of an ordered pair of joints |
//! | `device.<effect>.<symbol>` | parameter of an effect of the whole device |
//!
//! # What the equations depend on
//!
//! [`Device::structure_digest`] covers the structure, not the values: a changed value never needs new equations. A frame's
//! `theta` and `alpha` are affine in revolute joint variables with integer factors and hold no lengths; in `d` and `a` prismatic
//! variables stand affinely with constant factors. The reader rejects anything else.

pub mod device;
pub mod device_reader;
pub mod document;
pub mod effect;
mod effect_reader;
pub mod error;
pub mod expression;
mod identifier;
pub mod input;
pub mod instance;
pub mod library;
pub mod own_device;
pub mod own_effects;
pub mod parameter;
pub mod parser;
pub mod physical_consistency;
mod shipped;
pub mod transform;
pub mod unit;

pub use device::{
    Configuration, Convention, DefaultEffect, Device, Frame, Joint, JointKind, Length, Link, Method, sha256_hex,
};
pub use effect::{Effect, EffectParameter, EffectState, Origin, Place, Replacement, Scope, Stage};
pub use error::{ModelError, Source, did_you_mean, nearest};
pub use expression::Expression;
pub use input::{JointInput, NamedInput, Quantity};
pub use library::{add_effects, device, devices, effect, effects, inputs};
pub use own_device::{NoDevice, device_named, device_of_text, path_from, text_of};
pub use own_effects::NoEffects;
pub use parameter::Parameter;
