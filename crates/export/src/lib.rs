//! From the user's model to what other programs read.
//!
//! | call | what it makes |
//! | --- | --- |
//! | [`as_description`] | a copy of a URDF or an MJCF with the model's values in it, its text otherwise untouched |
//! | [`as_c99`] | one C99 file: the kernels, the model's values and its effects, for a controller |
//! | [`as_json`] | links, joints and effects with their values and standard deviations |
//!
//! What a model has and a format has no place for is in [`Exported::notes`].

#![warn(missing_docs)]

mod bodies;
mod c99;
mod description;
mod json;

pub use c99::as_c99;
pub use description::{ExportError, as_description};
pub use dynid_import::Format;
pub use json::as_json;

/// The text of a file, and what a person should know about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// The text.
    pub text: String,
    /// What has no place in it, and what was changed that one would not expect; a sentence each.
    pub notes: Vec<String>,
}
