//! Damping, friction, rotors and springs of joints.

use std::collections::BTreeMap;

use super::{Description, Identified, JointValues};
use crate::{
    Format,
    urdf::{Joint, Kind},
    xml::child,
};

/// A number of a joint that the importer makes an effect of.
struct Loss {
    /// The effect, and its value.
    effect: &'static str,
    value: fn(&JointValues) -> f64,
    /// What the description states.
    stated: fn(&Joint) -> Option<f64>,
    /// What the leader feels of a follower with this factor, relative to the follower's own.
    share: fn(f64) -> f64,
    /// Names of the attribute in a URDF, where it has one, and in an MJCF.
    attributes: (Option<&'static str>, &'static str),
}

const LOSSES: [Loss; 3] = [
    Loss {
        effect: "viscous",
        value: |values| values.viscous,
        stated: |joint| joint.damping.as_ref().map(|number| number.value),
        share: |factor| factor.powi(2),
        attributes: (Some("damping"), "damping"),
    },
    Loss {
        effect: "coulomb",
        value: |values| values.coulomb,
        stated: |joint| joint.friction.as_ref().map(|number| number.value),
        share: f64::abs,
        attributes: (Some("friction"), "frictionloss"),
    },
    Loss {
        effect: "rotor_inertia",
        value: |values| values.rotor_inertia,
        stated: |joint| joint.rotor.as_ref().map(|number| number.value),
        share: |factor| factor.powi(2),
        attributes: (None, "armature"),
    },
];

/// Joints whose numbers are the description's own keep their text.
pub(super) fn write(description: &mut Description, identified: &Identified) {
    // What one joint gets in URDF's `<dynamics>`: both at once, since the element may have to be added.
    let mut new: BTreeMap<usize, Vec<(&'static str, f64)>> = BTreeMap::new();
    for (variable, values) in identified.joints.iter().enumerate() {
        for loss in &LOSSES {
            let (of_urdf, of_mjcf) = loss.attributes;
            let attribute = if description.format == Format::Mjcf { Some(of_mjcf) } else { of_urdf };
            for (joint, value) in divided(description, variable, values, loss) {
                match attribute {
                    Some(attribute) => new.entry(joint).or_default().push((attribute, value)),
                    None => description.notes.push(format!(
                        "`{}` of joint `{}`, {value:?}, has no place in a URDF",
                        loss.effect, description.robot.joints[joint].name
                    )),
                }
            }
        }
        if description.format == Format::Mjcf {
            write_spring(description, variable, values);
        }
    }
    for (joint, values) in new {
        write_joint(description, joint, &values);
    }
}

/// Which joints of the description get which value, where the sum is another than it states: the leader what its followers leave.
fn divided(description: &mut Description, variable: usize, values: &JointValues, loss: &Loss) -> Vec<(usize, f64)> {
    let value = (loss.value)(values);
    let stated = description.draft.effects.iter().find(|own| own.id == loss.effect && own.joint == variable);
    if stated.map_or(0.0, |own| own.value.value) == value {
        return Vec::new();
    }
    let leader = description.motions.variables[variable];
    let joints = &description.robot.joints;
    let of_followers: Vec<(usize, f64)> = (0..joints.len())
        .filter(|joint| *joint != leader)
        .filter_map(|joint| {
            let motion = description.motions.of.get(&joint).filter(|motion| motion.variable == variable)?;
            let own = (loss.stated)(&joints[joint]).filter(|own| *own != 0.0)?;
            Some((joint, (loss.share)(motion.factor) * own))
        })
        .collect();
    let rest = value - of_followers.iter().map(|(_, own)| own).sum::<f64>();
    if rest >= 0.0 {
        return vec![(leader, rest)];
    }
    description.notes.push(format!(
        "joint `{}` has the whole `{}` of the joints that follow it, which have none now",
        joints[leader].name, loss.effect
    ));
    std::iter::once((leader, value)).chain(of_followers.into_iter().map(|(joint, _)| (joint, 0.0))).collect()
}

fn write_joint(description: &mut Description, joint: usize, values: &[(&'static str, f64)]) {
    let joint = &description.robot.joints[joint];
    let Some(element) = description.element_at(&joint.place) else { return };
    let edits = &mut description.edits;
    if description.format == Format::Mjcf {
        values.iter().for_each(|(attribute, value)| edits.set_numbers(element, attribute, &[*value]));
        return;
    }
    match child(element, "dynamics") {
        Some(dynamics) => {
            values.iter().for_each(|(attribute, value)| edits.set_numbers(dynamics, attribute, &[*value]))
        }
        None => {
            let attributes: Vec<String> = values.iter().map(|(name, value)| format!("{name}=\"{value:?}\"")).collect();
            edits.add_child(element, &format!("<dynamics {}/>", attributes.join(" ")));
        }
    }
}

/// A spring that the model does not have is taken out: the importer leaves it to the model.
fn write_spring(description: &mut Description, variable: usize, values: &JointValues) {
    let joint = &description.robot.joints[description.motions.variables[variable]];
    let stated = joint.stiffness.as_ref().map_or(0.0, |number| number.value);
    if stated == 0.0 && values.stiffness == 0.0 {
        return;
    }
    let Some(element) = description.element_at(&joint.place) else { return };
    description.edits.set_numbers(element, "stiffness", &[values.stiffness]);
    if values.stiffness != 0.0 {
        let unit = if joint.kind == Kind::Prismatic { 1.0 } else { description.radians_per_angle };
        description.edits.set_numbers(element, "springref", &[values.rest_position / unit]);
    } else {
        description.notes.push(format!("joint `{}` has no spring now: the model has none", joint.name));
    }
}
