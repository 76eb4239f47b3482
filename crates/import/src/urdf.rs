//! What a URDF says: links and joints with the places of their elements. The format: <http://wiki.ros.org/urdf/XML>.

use std::{collections::BTreeMap, ops::Range};

use dynid_model::{ModelError, Source};
use roxmltree::{Document, Node};

use crate::{
    number::Number,
    pose::{Origin, Turned},
    xml::{self, child, number, numbers, required_number, tag, text},
};

#[derive(Debug)]
pub(crate) struct Robot {
    pub name: String,
    pub links: Vec<Link>,
    pub joints: Vec<Joint>,
    /// The acceleration of free fall in base axes \[m/s^2\].
    pub gravity: [f64; 3],
    /// What has no place in a device file.
    pub notes: Vec<String>,
    /// Where `<robot>` begins.
    pub place: Range<usize>,
}

#[derive(Debug)]
pub(crate) struct Link {
    pub name: String,
    pub inertial: Option<Inertial>,
    pub place: Range<usize>,
}

/// `<inertial>`, as it is written: about the centroid, in the axes of `origin`.
#[derive(Debug)]
pub(crate) struct Inertial {
    pub origin: Origin,
    pub mass: Number,
    /// `Ixx Ixy Ixz Iyy Iyz Izz`
    pub moments: [Number; 6],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Fixed,
    Revolute,
    /// Revolute without ends.
    Continuous,
    Prismatic,
}

impl Kind {
    pub fn is_angle(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous)
    }
}

#[derive(Debug)]
pub(crate) struct Joint {
    pub name: String,
    pub kind: Kind,
    pub parent: (String, Range<usize>),
    pub child: (String, Range<usize>),
    pub origin: Origin,
    pub axis: [Number; 3],
    pub limits: Option<Limits>,
    pub damping: Option<Number>,
    pub friction: Option<Number>,
    /// Inertia of what turns with the joint but is no part of its link.
    pub rotor: Option<Number>,
    /// Of a spring at the joint.
    pub stiffness: Option<Number>,
    pub mimic: Option<Mimic>,
    pub place: Range<usize>,
}

#[derive(Debug)]
pub(crate) struct Limits {
    pub lower: Number,
    pub upper: Number,
    pub speed: Option<Number>,
    pub torque: Option<Number>,
}

#[derive(Debug)]
pub(crate) struct Mimic {
    pub joint: (String, Range<usize>),
    pub factor: Number,
    pub factor_place: Range<usize>,
    pub offset: Number,
}

/// Names in `<link>` and `<joint>` that are read or mean nothing to dynamics.
const READ: [&str; 10] =
    ["inertial", "origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "link", "joint"];

/// What robots are used in, unless they say otherwise.
pub(crate) const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// A moment of inertia that a program computed and that should be 0 [kg m^2].
const ROUNDED_ZERO: f64 = -1e-12;

pub(crate) fn read(source: &Source) -> Result<Robot, ModelError> {
    let xml = xml::tolerant(source)?;
    let document = Document::parse(&xml).map_err(|error| source.error(0..1, format!("this is no XML: {error}")))?;
    xml::refuse_xacro(source, &document)?;
    let root = document.root_element();
    if !root.has_tag_name("robot") {
        let message = format!("expected `<robot>`, found `<{}>`", root.tag_name().name());
        return Err(source
            .error(tag(root), message)
            .help("a URDF has one element `<robot name=\"..\">` with all others in it"));
    }
    let mut robot = Robot {
        name: root.attribute("name").map_or("", str::trim).to_owned(),
        links: Vec::new(),
        joints: Vec::new(),
        gravity: GRAVITY,
        notes: Vec::new(),
        place: tag(root),
    };
    let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
    let mut leave_out = |node: Node| {
        *left_out.entry(node.tag_name().name().to_owned()).or_insert(0) += 1;
    };
    for node in root.children().filter(Node::is_element) {
        match node.tag_name().name() {
            "link" => robot.links.push(read_link(source, node)?),
            "joint" => robot.joints.push(read_joint(source, node)?),
            _ => {
                leave_out(node);
                continue;
            }
        }
        node.children()
            .filter(|child| child.is_element() && !READ.contains(&child.tag_name().name()))
            .for_each(&mut leave_out);
    }
    robot.notes = notes_of_left_out(&left_out);
    let links: Vec<_> = robot.links.iter().map(|link| (link.name.as_str(), link.place.clone())).collect();
    let joints: Vec<_> = robot.joints.iter().map(|joint| (joint.name.as_str(), joint.place.clone())).collect();
    refuse_twins(source, "link", &links)?;
    refuse_twins(source, "joint", &joints)?;
    if robot.links.is_empty() {
        return Err(source
            .error(robot.place, "the robot has no link")
            .help("a URDF has `<link>` and `<joint>` elements; was this one cut short?"));
    }
    Ok(robot)
}

fn refuse_twins(source: &Source, what: &str, names: &[(&str, Range<usize>)]) -> Result<(), ModelError> {
    for (index, (name, place)) in names.iter().enumerate() {
        if names[..index].iter().any(|(earlier, _)| earlier == name) {
            return Err(source
                .error(place.clone(), format!("there is already a {what} `{name}`"))
                .help(format!("{what}s have different names")));
        }
    }
    Ok(())
}

fn read_link(source: &Source, node: Node) -> Result<Link, ModelError> {
    let (name, _) = text(source, node, "name")?;
    let inertial = child(node, "inertial").map(|node| read_inertial(source, node, name)).transpose()?;
    Ok(Link { name: name.to_owned(), inertial, place: tag(node) })
}

fn read_inertial(source: &Source, node: Node, link: &str) -> Result<Inertial, ModelError> {
    let required = |name: &str, remedy: &str| {
        child(node, name).ok_or_else(|| {
            source.error(tag(node), format!("the `<inertial>` of link `{link}` has no `<{name}>`")).help(remedy)
        })
    };
    let mass_node = required("mass", "add `<mass value=\"..\"/>`")?;
    let mass = required_number(source, mass_node, "value")?;
    if mass.value < 0.0 {
        let (_, place) = text(source, mass_node, "value")?;
        return Err(source
            .error(place, format!("the mass of link `{link}` is negative: {} kg", mass.value))
            .help("a mass is at least 0"));
    }
    let inertia =
        required("inertia", "add `<inertia ixx=\"..\" ixy=\"..\" ixz=\"..\" iyy=\"..\" iyz=\"..\" izz=\"..\"/>`")?;
    let mut moments = [Number::ZERO; 6];
    for (moment, name) in moments.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
        *moment = required_number(source, inertia, name)?;
        let is_negative = moment.value < 0.0 && matches!(name, "ixx" | "iyy" | "izz");
        if is_negative && moment.value > ROUNDED_ZERO {
            *moment = Number::ZERO;
        } else if is_negative {
            let (_, place) = text(source, inertia, name)?;
            return Err(source
                .error(place, format!("no body has a negative moment of inertia: `{name}` of link `{link}`"))
                .help(
                    "moments are about the centroid, in kg m^2, and at least 0; only ixy, ixz and iyz may be negative",
                ));
        }
    }
    Ok(Inertial { origin: read_origin(source, node)?, mass, moments })
}

fn read_origin(source: &Source, parent: Node) -> Result<Origin, ModelError> {
    let mut origin = Origin::IDENTITY;
    if let Some(node) = child(parent, "origin") {
        if let Some(xyz) = finite_three(source, node, "xyz")? {
            origin.xyz = xyz;
        }
        if let Some(rpy) = finite_three(source, node, "rpy")? {
            origin.turned = Turned::Angles(rpy);
        }
    }
    Ok(origin)
}

fn finite_three(source: &Source, node: Node, name: &str) -> Result<Option<[Number; 3]>, ModelError> {
    let found = numbers::<3>(source, node, name)?;
    if found.iter().flatten().any(|number| number.value.is_infinite()) {
        let (_, place) = text(source, node, name)?;
        return Err(source.error(place, format!("`{name}` must be finite")).help("give three numbers"));
    }
    Ok(found)
}

fn read_joint(source: &Source, node: Node) -> Result<Joint, ModelError> {
    let (name, _) = text(source, node, "name")?;
    let (kind, kind_place) = text(source, node, "type")?;
    let kind = match kind {
        "fixed" => Kind::Fixed,
        "revolute" => Kind::Revolute,
        "continuous" => Kind::Continuous,
        "prismatic" => Kind::Prismatic,
        "floating" | "planar" => {
            return Err(source
                .error(kind_place, format!("joint `{name}` is {kind}: a device has joints of one variable each"))
                .help(
                    "write it as `fixed`, or as several revolute and prismatic joints with links of no mass between",
                ));
        }
        other => {
            let known = dynid_model::did_you_mean(other, ["revolute", "continuous", "prismatic", "fixed"]);
            return Err(source.error(kind_place, format!("unknown type `{other}` of joint `{name}`")).help(known));
        }
    };
    let link_of = |end: &str| -> Result<(String, Range<usize>), ModelError> {
        let node = child(node, end).ok_or_else(|| {
            source
                .error(tag(node), format!("joint `{name}` has no `<{end}>`"))
                .help(format!("add `<{end} link=\"..\"/>`"))
        })?;
        let (name, place) = text(source, node, "link")?;
        Ok((name.to_owned(), place))
    };
    let (parent, child_link) = (link_of("parent")?, link_of("child")?);
    let origin = read_origin(source, node)?;
    let mut axis = [Number::from(1.0), Number::ZERO, Number::ZERO];
    if let Some(axis_node) = child(node, "axis").filter(|_| kind != Kind::Fixed) {
        axis = finite_three(source, axis_node, "xyz")?.unwrap_or(axis);
        if axis.iter().all(|component| component.value == 0.0) {
            let (_, place) = text(source, axis_node, "xyz")?;
            return Err(source
                .error(place, format!("the axis of joint `{name}` has length 0"))
                .help("give a direction, e.g. `xyz=\"0 0 1\"`"));
        }
    }
    let or_zero = |node, name| Ok::<_, ModelError>(number(source, node, name)?.unwrap_or(Number::ZERO));
    let limits = child(node, "limit").map(|node| {
        Ok(Limits {
            lower: or_zero(node, "lower")?,
            upper: or_zero(node, "upper")?,
            speed: number(source, node, "velocity")?,
            torque: number(source, node, "effort")?,
        })
    });
    let mut losses = [None, None];
    if let Some(node) = child(node, "dynamics") {
        for (loss, key) in losses.iter_mut().zip(["damping", "friction"]) {
            *loss = node.has_attribute(key).then(|| required_number(source, node, key)).transpose()?;
            if loss.as_ref().is_some_and(|loss| loss.value < 0.0) {
                let (_, place) = text(source, node, key)?;
                return Err(source
                    .error(place, format!("the {key} of joint `{name}` is negative: it would drive the joint"))
                    .help("turn the sign around, or remove it"));
            }
        }
    }
    let [damping, friction] = losses;
    let mimic = child(node, "mimic").filter(|_| kind != Kind::Fixed).map(|node| {
        let (joint, place) = text(source, node, "joint")?;
        let factor =
            node.has_attribute("multiplier").then(|| required_number(source, node, "multiplier")).transpose()?;
        let factor_place = text(source, node, "multiplier").map_or(tag(node), |(_, place)| place);
        let offset = node.has_attribute("offset").then(|| required_number(source, node, "offset")).transpose()?;
        Ok(Mimic {
            joint: (joint.to_owned(), place),
            factor: factor.unwrap_or(Number::from(1.0)),
            factor_place,
            offset: offset.unwrap_or(Number::ZERO),
        })
    });
    Ok(Joint {
        name: name.to_owned(),
        kind,
        parent,
        child: child_link,
        origin,
        axis,
        limits: limits.transpose()?,
        damping,
        friction,
        rotor: None,
        stiffness: None,
        mimic: mimic.transpose()?,
        place: tag(node),
    })
}

/// A sentence for each kind of element that has no place in a device file.
fn notes_of_left_out(left_out: &BTreeMap<String, usize>) -> Vec<String> {
    let reason = |name: &str| match name {
        "visual" | "collision" | "material" => "a device file has no shapes",
        "transmission" => "torques are those of the joints; gear ratios and motor constants are stated in a model",
        "gazebo" => "settings of a simulator",
        "sensor" => "a log names its columns itself",
        "safety_controller" => "settings of a controller",
        "calibration" => "positions are those of the log",
        _ => "nothing here knows it",
    };
    let sentence = |(name, count): (&String, &usize)| format!("left out: {count} <{name}> ({})", reason(name));
    left_out.iter().map(sentence).collect()
}
