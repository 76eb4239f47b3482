//! Identified values back in the description that a device was imported from.
//!
//! The description is read as the importer reads it, so that it is known which links were merged into which frame and which joints
//! follow which. Then numbers are changed where they stand; all other text stays.
//!
//! Where several links move as one, only their sum was identified. The first of them gets the sum less what the others state, where a
//! body can be that; else it gets all, and the others have no mass any more.

mod bodies;
mod edits;
mod kinematics;
mod losses;

use std::collections::BTreeMap;

use dynid_model::{Device, JointKind, ModelError, Source};
use roxmltree::{Document, Node};

use crate::{
    Format,
    assemble::{self, Seat},
    draft::Draft,
    mjcf::{self, Conventions},
    motion::{Motions, motions},
    tree::{self, Tree},
    urdf::{self, Robot},
    xml,
};
use edits::Edits;

/// What a description is to say of a robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Identified {
    /// Bodies by the frame of the device that they move with: mass, centroid and inertia about it, in the axes of the frame and in the
    /// order of [`dynid_model::Link::SYMBOLS`]. A frame that is not named carries nothing.
    pub bodies: BTreeMap<String, [f64; 10]>,
    /// As the device's joints.
    pub joints: Vec<JointValues>,
    /// The acceleration of free fall in base axes \[m/s^2\].
    pub gravity: [f64; 3],
}

/// What acts at a joint beside rigid bodies.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointValues {
    /// Torque per speed [N*m*s/rad or N*s/m].
    pub viscous: f64,
    /// Torque against the direction of motion [N*m or N].
    pub coulomb: f64,
    /// Inertia of the rotor, seen at the joint [kg*m^2 or kg].
    pub rotor_inertia: f64,
    /// Torque per deflection [N*m/rad or N/m].
    pub stiffness: f64,
    /// Position without torque of the spring [rad or m].
    pub rest_position: f64,
}

/// A description with other values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Described {
    /// The text.
    pub text: String,
    /// What has no place in it, and what was changed that one would not expect; a sentence each.
    pub notes: Vec<String>,
}

/// The description `source` of `device`, which was imported from it, with other values.
///
/// # Errors
/// What is wrong in the description, or where it is none of this device.
pub(crate) fn written_back(
    source: &Source,
    format: Format,
    device: &Device,
    identified: &Identified,
) -> Result<Described, ModelError> {
    let robot = match format {
        Format::Urdf => urdf::read(source)?,
        Format::Mjcf => mjcf::read(source)?,
    };
    let tree = tree::grow(source, &robot)?;
    let draft = assemble::draft(source, &robot, &tree, None)?;
    let motions = motions(source, &robot, &tree)?;
    let mut notes = Vec::new();
    refuse_other_joints(source, &robot, &motions, device)?;
    kinematics::compare(source, &robot, &draft, device, &mut notes)?;
    refuse_other_frames(source, &robot, &draft, device, identified)?;

    let xml = xml::tolerant(source)?;
    let document = Document::parse(&xml).map_err(|error| source.error(0..1, format!("this is no XML: {error}")))?;
    let (_, seats) = assemble::frames(&robot, &tree, &motions);
    let mut description = Description {
        format,
        robot: &robot,
        tree: &tree,
        motions: &motions,
        draft: &draft,
        seats: &seats,
        elements: document.descendants().map(|node| (node.range().start, node)).collect(),
        radians_per_angle: match format {
            Format::Urdf => 1.0,
            Format::Mjcf => Conventions::read(source, document.root_element())?.radians_per_angle,
        },
        edits: Edits::new(&source.text),
        notes,
    };
    bodies::write(&mut description, identified);
    losses::write(&mut description, identified);
    write_gravity(&mut description, document.root_element(), identified.gravity);
    let Description { edits, notes, .. } = description;
    Ok(Described { text: edits.applied(), notes })
}

/// What is known of a description, and what changes in it.
struct Description<'a> {
    format: Format,
    robot: &'a Robot,
    tree: &'a Tree,
    motions: &'a Motions,
    draft: &'a Draft,
    seats: &'a [Seat],
    /// By where they begin.
    elements: BTreeMap<usize, Node<'a, 'a>>,
    radians_per_angle: f64,
    edits: Edits<'a>,
    notes: Vec<String>,
}

impl<'a> Description<'a> {
    fn element_at(&self, place: &std::ops::Range<usize>) -> Option<Node<'a, 'a>> {
        self.elements.get(&place.start).copied()
    }
}

const REMEDY: &str =
    "name the file that `dynid device import` made the model's device from, or import this one and fit anew";

fn refuse_other_joints(source: &Source, robot: &Robot, motions: &Motions, device: &Device) -> Result<(), ModelError> {
    let (found, expected) = (motions.variables.len(), device.joints.len());
    if found != expected {
        let message = format!(
            "this describes a robot of {}, the model's device `{}` has {expected}",
            xml::counted(found, "joint"),
            device.id
        );
        return Err(source.error(robot.place.clone(), message).help(REMEDY));
    }
    for (number, (joint, own)) in motions.variables.iter().zip(&device.joints).enumerate() {
        let joint = &robot.joints[*joint];
        if joint.name != own.title {
            let message = format!(
                "joint {number} is `{}` here, and `{}` in the model's device `{}`",
                joint.name, own.title, device.id
            );
            return Err(source.error(joint.place.clone(), message).help(REMEDY));
        }
        if joint.kind.is_angle() != (own.kind == JointKind::Revolute) {
            let message =
                format!("joint `{}` turns or slides otherwise in the model's device `{}`", joint.name, device.id);
            return Err(source.error(joint.place.clone(), message).help(REMEDY));
        }
    }
    Ok(())
}

/// Every body must be of a frame that the description has.
fn refuse_other_frames(
    source: &Source,
    robot: &Robot,
    draft: &Draft,
    device: &Device,
    identified: &Identified,
) -> Result<(), ModelError> {
    let is_known = |name: &str| draft.frames.iter().any(|frame| frame.name == name);
    match identified.bodies.keys().find(|name| !is_known(name)) {
        Some(name) => {
            let message = format!(
                "the model's device `{}` has a link at frame `{name}`, which is no link that moves here",
                device.id
            );
            Err(source.error(robot.place.clone(), message).help(REMEDY))
        }
        None => Ok(()),
    }
}

/// A difference of gravity that rounding explains, relative to its size.
const ROUNDING: f64 = 1e-12;

fn write_gravity(description: &mut Description, root: Node, gravity: [f64; 3]) {
    let stated = description.draft.gravity;
    let size = stated.iter().chain(&gravity).fold(0.0_f64, |size, component| size.max(component.abs()));
    if stated.iter().zip(&gravity).all(|(a, b)| (a - b).abs() <= ROUNDING * size) {
        return;
    }
    let [x, y, z] = gravity.map(|component| format!("{component:?}"));
    match description.format {
        Format::Urdf => description
            .notes
            .push(format!("gravity has no place in a URDF: in the base's axes it is {x} {y} {z} m/s^2 in the model")),
        Format::Mjcf => match xml::child(root, "option") {
            Some(option) => description.edits.set(option, "gravity", &format!("{x} {y} {z}")),
            None => description.edits.add_child(root, &format!("<option gravity=\"{x} {y} {z}\"/>")),
        },
    }
}
