//! From a robot description (URDF or MJCF) to a device file.
//!
//! [`device_from_urdf`] reads a URDF and writes the text of a device file whose frames are general transforms:
//!
//! | URDF | device file |
//! | --- | --- |
//! | `<joint>` that moves | a frame with `turn` or `slide`, and a `[[joint]]` unless it is a `<mimic>` |
//! | `<joint type="fixed">` | nothing: what it carries is merged into the body before it |
//! | `<inertial>` | a `[[link]]`, about its centroid in the axes of its frame |
//! | `<limit>` | `position`, `speed`, `torque` |
//! | `<dynamics>` | effects `viscous` and `coulomb` |
//! | everything else | a note |
//!
//! [`device_from_mjcf`] does the same for MuJoCo's format: hinges, slides and explicit `<inertial>`s; several joints of a body get frames
//! without a link between them.
//!
//! [`description_with`] goes the other way: identified values into a copy of the description that a device was imported from.
//!
//! What is wrong is an error that points at the line of the description. Whatever is guessed, changed or left out is in
//! [`Imported::notes`] and stands at the head of the device file.

#![warn(missing_docs)]

mod assemble;
mod body;
mod draft;
mod mjcf;
mod motion;
mod number;
mod pose;
mod tree;
mod urdf;
mod write;
mod written_back;
mod xml;

use std::path::Path;

use dynid_model::{Device, ModelError, Source};

pub use written_back::{Described, Identified, JointValues};

/// A format of robot descriptions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// That of ROS.
    Urdf,
    /// That of MuJoCo.
    Mjcf,
}

impl Format {
    /// That of a description, as its root element says; a URDF where nothing says so.
    ///
    /// # Errors
    /// Text that is no XML.
    pub fn of(text: &str, path: &Path) -> Result<Self, ModelError> {
        let text = xml::tolerant(&Source::new(path, text))?;
        let is_mjcf = roxmltree::Document::parse(&text)
            .is_ok_and(|document| document.root_element().tag_name().name() == "mujoco");
        Ok(if is_mjcf { Self::Mjcf } else { Self::Urdf })
    }
}

/// A device file, and what its makers should know about it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Imported {
    /// The text of the device file.
    pub toml: String,
    /// What had no place in it, and what was guessed or changed; a sentence each.
    pub notes: Vec<String>,
}

/// Turns the text of a URDF, which lies at `path`, into a device file.
///
/// # Errors
/// The first thing that is wrong in the URDF, with its place and the remedy.
pub fn device_from_urdf(text: &str, path: &Path) -> Result<Imported, ModelError> {
    let source = Source::new(path, text);
    imported(&source, &urdf::read(&source)?, None)
}

/// Turns the text of an MJCF (MuJoCo's format), which lies at `path`, into a device file.
///
/// Bodies need an explicit `<inertial>`; hinges and slides become joints, `armature` the effect `rotor_inertia`.
///
/// # Errors
/// The first thing that is wrong in the MJCF, or that a device file has no place for although it moves the robot.
pub fn device_from_mjcf(text: &str, path: &Path) -> Result<Imported, ModelError> {
    let source = Source::new(path, text);
    imported(&source, &mjcf::read(&source)?, None)
}

/// Turns the text of a URDF or an MJCF, as its root element says, into a device file. Its end point is the origin of the link of that
/// name; without one that of the link farthest from the base.
///
/// # Errors
/// As [`device_from_urdf`] and [`device_from_mjcf`]; an end point that is no link that moves.
pub fn device_from_description(text: &str, path: &Path, end_point: Option<&str>) -> Result<Imported, ModelError> {
    let source = Source::new(path, text);
    let robot = match Format::of(text, path)? {
        Format::Mjcf => mjcf::read(&source)?,
        Format::Urdf => urdf::read(&source)?,
    };
    imported(&source, &robot, end_point)
}

/// The description `text`, which lies at `path` and which `device` was imported from, with other values; all other text stays.
///
/// # Errors
/// What is wrong in the description, or where it is none of this device.
pub fn description_with(
    text: &str,
    path: &Path,
    device: &Device,
    identified: &Identified,
) -> Result<Described, ModelError> {
    written_back::written_back(&Source::new(path, text), Format::of(text, path)?, device, identified)
}

fn imported(source: &Source, robot: &urdf::Robot, end_point: Option<&str>) -> Result<Imported, ModelError> {
    let tree = tree::grow(source, robot)?;
    let draft = assemble::draft(source, robot, &tree, end_point)?;
    Ok(Imported { toml: write::device_file(&draft), notes: draft.notes })
}
