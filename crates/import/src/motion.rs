//! Which joint variable moves which joint, and how.

use std::collections::HashMap;

use dynid_model::{ModelError, Source, did_you_mean};

use crate::{
    tree::Tree,
    urdf::{Joint, Kind, Mimic, Robot},
};

/// What a joint of the description does with a joint variable.
#[derive(Debug)]
pub(crate) struct Motion {
    /// Number of the variable.
    pub variable: usize,
    pub factor: f64,
    /// `q1`, `-q1 + pi/2`, `2*q0`.
    pub expression: String,
}

#[derive(Debug)]
pub(crate) struct Motions {
    /// Joints of the description that are joint variables, in order.
    pub variables: Vec<usize>,
    /// Of every joint that moves.
    pub of: HashMap<usize, Motion>,
}

pub(crate) fn motions(source: &Source, robot: &Robot, tree: &Tree) -> Result<Motions, ModelError> {
    let moving = |joint: &usize| robot.joints[*joint].kind != Kind::Fixed;
    let carried: Vec<usize> = tree.order.iter().filter_map(|link| tree.joint_of[*link]).filter(moving).collect();
    let variables: Vec<usize> = carried.iter().copied().filter(|joint| robot.joints[*joint].mimic.is_none()).collect();
    let mut of = HashMap::new();
    for joint in carried {
        let motion = match &robot.joints[joint].mimic {
            None => {
                let variable = variables.iter().position(|own| *own == joint).unwrap_or_default();
                Motion { variable, factor: 1.0, expression: format!("q{variable}") }
            }
            Some(mimic) => followed(source, robot, &robot.joints[joint], mimic, &variables)?,
        };
        of.insert(joint, motion);
    }
    Ok(Motions { variables, of })
}

fn followed(
    source: &Source,
    robot: &Robot,
    joint: &Joint,
    mimic: &Mimic,
    variables: &[usize],
) -> Result<Motion, ModelError> {
    let (name, place) = &mimic.joint;
    let error = |message: String, remedy: String| Err(source.error(place.clone(), message).help(remedy));
    let Some(leader) = robot.joints.iter().position(|joint| joint.name == *name) else {
        let known = did_you_mean(name, variables.iter().map(|joint| robot.joints[*joint].name.as_str()));
        return error(format!("joint `{}` mimics `{name}`, which is no joint", joint.name), known);
    };
    let leading = &robot.joints[leader];
    if let Some(next) = &leading.mimic {
        let message = format!("joint `{}` mimics `{name}`, which itself mimics `{}`", joint.name, next.joint.0);
        let remedy = if next.joint.0 == joint.name {
            "one of them must be free".to_owned()
        } else {
            format!("mimic `{}` instead, with both multipliers and offsets put together", next.joint.0)
        };
        return error(message, remedy);
    }
    let Some(variable) = variables.iter().position(|own| *own == leader) else {
        return error(
            format!("joint `{}` mimics `{name}`, which is fixed", joint.name),
            "make one of the two `fixed` or the other movable".to_owned(),
        );
    };
    if leading.kind.is_angle() != joint.kind.is_angle() {
        let measure = |joint: &Joint| if joint.kind.is_angle() { "an angle" } else { "a distance" };
        let message =
            format!("joint `{}` is {} and mimics `{name}`, which is {}", joint.name, measure(joint), measure(leading));
        return error(message, "a device's joints follow joints of their own kind; leave the mimic out".to_owned());
    }
    let factor = mimic.factor.value;
    if factor == 0.0 {
        return Err(source
            .error(mimic.factor_place.clone(), format!("joint `{}` mimics `{name}` with the factor 0", joint.name))
            .help("a joint that does not move is `fixed`"));
    }
    let sign = if factor < 0.0 { "-" } else { "" };
    let size = match factor.abs() {
        1.0 => String::new(),
        size if size.fract() == 0.0 && size < 1e6 => format!("{size}*"),
        size => format!("{size:?}*"),
    };
    let offset = mimic.offset.term(joint.kind.is_angle());
    Ok(Motion { variable, factor, expression: format!("{sign}{size}q{variable}{offset}") })
}
