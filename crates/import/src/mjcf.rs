//! What an MJCF says, as the links and joints of a URDF. The format: <https://mujoco.readthedocs.io/en/stable/XMLreference.html>.
//!
//! A body is a link. Its joints turn it one after another about axes through points of its own frame: each but the last carries a
//! link without mass, and where the last one's point is not the body's origin, the body is fixed to what that joint carries.

use std::{collections::BTreeMap, f64::consts::PI, ops::Range};

use dynid_model::{ModelError, Source};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

use crate::{
    number::Number,
    pose::{Origin, Pose, stated},
    urdf::{GRAVITY, Inertial, Joint, Kind, Limits, Link, Robot},
    xml::{self, child, numbers, tag},
};

/// Elements within each other.
const DEEPEST: usize = 256;

/// Elements of a body that mean nothing to dynamics, or are read elsewhere.
const READ: [&str; 4] = ["body", "joint", "inertial", "geom"];

pub(crate) fn read(source: &Source) -> Result<Robot, ModelError> {
    let xml = xml::tolerant(source)?;
    let document = Document::parse(&xml).map_err(|error| source.error(0..1, format!("this is no XML: {error}")))?;
    let root = document.root_element();
    if !root.has_tag_name("mujoco") {
        let message = format!("expected `<mujoco>`, found `<{}>`", root.tag_name().name());
        return Err(source.error(tag(root), message).help("an MJCF has one element `<mujoco>` with all others in it"));
    }
    let unresolved = ["include", "frame", "replicate", "attach", "composite", "flexcomp"];
    if let Some(node) = root.descendants().find(|node| unresolved.contains(&node.tag_name().name())) {
        return Err(source.error(tag(node), format!("`<{}>` is left in", node.tag_name().name())).help(
            "save the compiled model first: `mujoco.mj_saveLastXML(\"robot.xml\", model)` writes all bodies out",
        ));
    }
    let mut reader = Reader {
        source,
        conventions: Conventions::read(source, root)?,
        classes: classes(root),
        left_out: BTreeMap::new(),
    };
    let Some(world) = child(root, "worldbody") else {
        return Err(source.error(tag(root), "there is no `<worldbody>`").help("bodies stand in it"));
    };
    let option = child(root, "option").map(|node| numbers::<3>(source, node, "gravity")).transpose()?.flatten();
    let mut robot = Robot {
        name: root.attribute("model").map_or("", str::trim).to_owned(),
        gravity: option.map_or(GRAVITY, |gravity| gravity.map(|component| component.value)),
        links: vec![Link { name: "world".to_owned(), inertial: None, place: tag(world) }],
        joints: Vec::new(),
        notes: Vec::new(),
        place: tag(root),
    };
    for body in world.children().filter(|node| node.has_tag_name("body")) {
        reader.body(body, "world", None, false, &mut robot)?;
    }
    for node in root.children().filter(Node::is_element) {
        let name = node.tag_name().name();
        if ["actuator", "sensor", "tendon", "equality", "contact", "keyframe"].contains(&name) {
            let count = node.children().filter(Node::is_element).count();
            reader.left_out.insert(name.to_owned(), count);
        }
    }
    robot.notes.extend(reader.left_out.iter().map(|(name, count)| format!("left out: {count} of <{name}>")));
    for attribute in ["gravcomp", "settotalmass"] {
        let count = root.descendants().filter(|node| node.attribute(attribute).is_some()).count();
        if count > 0 {
            robot.notes.push(format!("left out: {count} of `{attribute}`"));
        }
    }
    Ok(robot)
}

/// `<compiler>`
pub(crate) struct Conventions {
    pub radians_per_angle: f64,
    euler: String,
    ranges_are_limits: bool,
}

impl Conventions {
    pub fn read(source: &Source, root: Node) -> Result<Self, ModelError> {
        let compilers: Vec<Node> = root.children().filter(|node| node.has_tag_name("compiler")).collect();
        let find = |key: &str| compilers.iter().rev().find_map(|node| node.attribute_node(key));
        let refuse = |key: &str, value: &str, message: &str, remedy: &str| match find(key) {
            Some(found) if found.value() == value => Err(source.error(found.range(), message).help(remedy)),
            _ => Ok(()),
        };
        let save = "save the compiled model: `mujoco.mj_saveLastXML(\"robot.xml\", model)`";
        refuse("coordinate", "global", "coordinates are global", save)?;
        refuse("inertiafromgeom", "true", "inertias are to come from shapes, which are not read here", save)?;
        let euler = find("eulerseq").map_or("xyz", |found| found.value());
        if euler.len() != 3 || !euler.chars().all(|axis| "xyzXYZ".contains(axis)) {
            let place = find("eulerseq").map_or(tag(root), |found| found.range());
            return Err(source.error(place, format!("unknown sequence of axes `{euler}`")).help("write e.g. \"xyz\""));
        }
        let is_radian = find("angle").is_some_and(|found| found.value() == "radian");
        Ok(Self {
            radians_per_angle: if is_radian { 1.0 } else { PI / 180.0 },
            euler: euler.to_owned(),
            ranges_are_limits: find("autolimits").is_none_or(|found| found.value() != "false"),
        })
    }
}

/// `<default>`: the elements of each class, its own first, then those that it inherits.
struct Class<'a> {
    elements: Vec<Node<'a, 'a>>,
}

fn classes<'a>(root: Node<'a, 'a>) -> BTreeMap<String, Class<'a>> {
    let mut found = BTreeMap::new();
    let mut waiting: Vec<(Node, Vec<Node>)> =
        root.children().filter(|node| node.has_tag_name("default")).map(|node| (node, Vec::new())).collect();
    while let Some((node, inherited)) = waiting.pop() {
        let own = node.children().filter(|node| node.is_element() && !node.has_tag_name("default"));
        let elements: Vec<Node> = own.chain(inherited).collect();
        let nested = node.children().filter(|node| node.has_tag_name("default"));
        waiting.extend(nested.map(|node| (node, elements.clone())));
        found.insert(node.attribute("class").unwrap_or("main").to_owned(), Class { elements });
    }
    found
}

struct Reader<'a> {
    source: &'a Source,
    conventions: Conventions,
    classes: BTreeMap<String, Class<'a>>,
    left_out: BTreeMap<String, usize>,
}

/// An element, then the defaults that it falls back to.
struct Stated<'a>(Vec<Node<'a, 'a>>);

impl<'a> Stated<'a> {
    fn with(&self, name: &str) -> Option<Node<'a, 'a>> {
        self.0.iter().copied().find(|node| node.has_attribute(name))
    }

    fn text(&self, name: &str) -> Option<&'a str> {
        self.with(name).and_then(|node| node.attribute(name))
    }

    fn numbers<const COUNT: usize>(&self, source: &Source, name: &str) -> Result<Option<[Number; COUNT]>, ModelError> {
        let found = self.with(name).map(|node| numbers::<COUNT>(source, node, name)).transpose()?.flatten();
        match (&found, self.with(name)) {
            (Some(numbers), Some(node)) if numbers.iter().any(|number| !number.value.is_finite()) => {
                let place = node.attribute_node(name).map_or(tag(node), |attribute| attribute.range());
                Err(source.error(place, format!("`{name}` must be finite")).help("give numbers"))
            }
            _ => Ok(found),
        }
    }

    fn place(&self, name: &str) -> Range<usize> {
        let attribute = self.with(name).and_then(|node| node.attribute_node(name));
        attribute.map_or(tag(self.0[0]), |attribute| attribute.range_value())
    }
}

impl<'a> Reader<'a> {
    fn stated(&self, node: Node<'a, 'a>, class: Option<&str>) -> Result<Stated<'a>, ModelError> {
        let name = node.attribute("class").or(class).unwrap_or("main");
        let mut elements = vec![node];
        match self.classes.get(name) {
            Some(class) => {
                elements.extend(class.elements.iter().filter(|own| own.tag_name().name() == node.tag_name().name()))
            }
            None if name != "main" => {
                let known = dynid_model::did_you_mean(name, self.classes.keys().map(String::as_str));
                return Err(self.source.error(tag(node), format!("unknown class `{name}`")).help(known));
            }
            None => {}
        }
        Ok(Stated(elements))
    }

    /// A body and those in it; whether it moves with what carries it.
    fn body(
        &mut self,
        node: Node<'a, 'a>,
        parent: &str,
        class: Option<&'a str>,
        moves: bool,
        robot: &mut Robot,
    ) -> Result<(), ModelError> {
        if node.ancestors().count() > DEEPEST {
            let message = format!("bodies are nested more than {DEEPEST} elements deep");
            return Err(self.source.error(tag(node), message).help("a chain of so many bodies is no robot"));
        }
        let class = node.attribute("childclass").or(class);
        let count = robot.links.len();
        let name = node.attribute("name").map_or_else(|| format!("body_{count}"), |name| name.trim().to_owned());
        let pose = self.pose(&Stated(vec![node]))?;
        for own in node.children().filter(Node::is_element) {
            let what = own.tag_name().name();
            if what == "freejoint"
                || (what == "joint" && ["free", "ball"].contains(&own.attribute("type").unwrap_or("")))
            {
                return Err(self
                    .source
                    .error(tag(own), format!("body `{name}` moves freely: a device has joints of one variable each"))
                    .help("remove the joint, so that the body stands still, or write three hinges for a ball"));
            }
            if !READ.contains(&what) || what == "geom" {
                *self.left_out.entry(what.to_owned()).or_insert(0) += 1;
            }
        }
        let joints: Vec<Node> = node.children().filter(|node| node.has_tag_name("joint")).collect();
        let inertial = child(node, "inertial").map(|node| self.inertial(node, &name)).transpose()?;
        let moves = moves || !joints.is_empty();
        for geom in node.children().filter(|node| node.has_tag_name("geom") && moves && inertial.is_none()) {
            let mass = self.stated(geom, class)?.numbers::<1>(self.source, "mass")?;
            if mass.is_none_or(|[mass]| mass.value != 0.0) {
                return Err(self
                    .source
                    .error(tag(geom), format!("body `{name}` takes its mass from shapes, which are not read here"))
                    .help("state an `<inertial>`; MuJoCo computes it: body_mass, body_ipos, body_iquat and body_inertia of its model"));
            }
        }
        // Where the frame before stands: at the point of the joint before, in the axes of the body.
        let mut from = parent.to_owned();
        let mut origin = pose;
        let mut anchor = [Number::ZERO; 3];
        let is_zero = |point: &[Number; 3]| point.iter().all(|own| own.value == 0.0);
        for (number, own) in joints.iter().enumerate() {
            let stated = self.stated(*own, class)?;
            let point = stated.numbers::<3>(self.source, "pos")?.unwrap_or([Number::ZERO; 3]);
            let step = [0, 1, 2].map(|axis| point[axis].value - anchor[axis].value);
            let moved = Pose { rotation: Matrix3::identity(), place: Vector3::from(step) };
            if step != [0.0; 3] {
                let whole = origin.pose().then(&moved);
                origin = Origin { xyz: [0, 1, 2].map(|axis| Number::from(whole.place[axis])), turned: origin.turned };
            }
            let is_last = number + 1 == joints.len() && is_zero(&point);
            let to = if is_last { name.clone() } else { format!("{name} (joint {})", number + 1) };
            let joint_name = own.attribute("name").map_or_else(|| format!("{name} {}", number + 1), str::to_owned);
            if stated.numbers::<1>(self.source, "stiffness")?.is_some_and(|[own]| own.value != 0.0) {
                robot
                    .notes
                    .push(format!("left out: the spring of joint `{joint_name}`; `dynid add spring` has its law"));
            }
            robot.joints.push(self.joint(&stated, joint_name, (&from, &to), origin)?);
            if !is_last {
                robot.links.push(Link { name: to.clone(), inertial: None, place: tag(*own) });
            }
            (from, origin, anchor) = (to, Origin::IDENTITY, point);
        }
        if from != name {
            let back = anchor.map(|own| Number::from(-own.value));
            let origin = if joints.is_empty() { origin } else { Origin { xyz: back, ..Origin::IDENTITY } };
            robot.joints.push(fixed(&from, &name, origin, tag(node)));
        }
        robot.links.push(Link { name: name.clone(), inertial, place: tag(node) });
        for nested in node.children().filter(|node| node.has_tag_name("body")) {
            self.body(nested, &name, class, moves, robot)?;
        }
        Ok(())
    }

    fn joint(
        &self,
        stated: &Stated,
        name: String,
        (from, to): (&str, &str),
        origin: Origin,
    ) -> Result<Joint, ModelError> {
        let source = self.source;
        let is_angle = match stated.text("type").unwrap_or("hinge") {
            "hinge" => true,
            "slide" => false,
            other => {
                return Err(source
                    .error(stated.place("type"), format!("joint `{name}` is a `{other}`"))
                    .help("a device has hinges and slides"));
            }
        };
        let number = |key: &str| Ok::<_, ModelError>(stated.numbers::<1>(source, key)?.map(|[number]| number));
        let axis = stated.numbers::<3>(source, "axis")?.unwrap_or([Number::ZERO, Number::ZERO, Number::from(1.0)]);
        if axis.iter().all(|component| component.value == 0.0) {
            let message = format!("the axis of joint `{name}` has length 0");
            return Err(source.error(stated.place("axis"), message).help("give a direction, e.g. `axis=\"0 0 1\"`"));
        }
        if number("ref")?.is_some_and(|reference| reference.value != 0.0) {
            let message = format!("joint `{name}` is not 0 where it stands in the file");
            return Err(source.error(stated.place("ref"), message).help("turn the body instead, and remove `ref`"));
        }
        let unit = if is_angle { self.conventions.radians_per_angle } else { 1.0 };
        let scaled = |number: Number| if unit == 1.0 { number } else { Number::from(number.value * unit) };
        let is_limited = match stated.text("limited") {
            Some("true") => true,
            Some("false") => false,
            _ => self.conventions.ranges_are_limits,
        };
        let range = stated.numbers::<2>(source, "range")?.filter(|_| is_limited);
        let torque = stated
            .numbers::<2>(source, "actuatorfrcrange")?
            .map(|[low, high]| Number::from(low.value.abs().max(high.value.abs())));
        let is_endless = range.is_none();
        let [lower, upper] = match range {
            Some(range) => range.map(scaled),
            None => [f64::NEG_INFINITY, f64::INFINITY].map(Number::from),
        };
        let place = tag(stated.0[0]);
        let kind = match (is_angle, is_endless) {
            (true, true) => Kind::Continuous,
            (true, false) => Kind::Revolute,
            (false, _) => Kind::Prismatic,
        };
        Ok(Joint {
            kind,
            axis,
            limits: Some(Limits { lower, upper, speed: None, torque }),
            damping: number("damping")?,
            friction: number("frictionloss")?,
            rotor: number("armature")?,
            stiffness: number("stiffness")?,
            ..fixed(from, to, origin, place)
        }
        .named(name))
    }

    fn inertial(&self, node: Node<'a, 'a>, body: &str) -> Result<Inertial, ModelError> {
        let (source, own) = (self.source, Stated(vec![node]));
        let mass = xml::required_number(source, node, "mass")?;
        if mass.value < 0.0 {
            let message = format!("the mass of body `{body}` is negative: {} kg", mass.value);
            return Err(source.error(own.place("mass"), message).help("a mass is at least 0"));
        }
        let zero = || Number::ZERO;
        let moments = if let Some([xx, yy, zz, xy, xz, yz]) = own.numbers::<6>(source, "fullinertia")? {
            [xx, xy, xz, yy, yz, zz]
        } else if let Some([xx, yy, zz]) = own.numbers::<3>(source, "diaginertia")? {
            [xx, zero(), zero(), yy, zero(), zz]
        } else {
            let message = format!("the `<inertial>` of body `{body}` states no inertia");
            return Err(source.error(tag(node), message).help("add `diaginertia=\"xx yy zz\"`"));
        };
        if [0, 3, 5].into_iter().any(|place| moments[place].value < 0.0) {
            let message = format!("no body has a negative moment of inertia: body `{body}`");
            return Err(source.error(tag(node), message).help("moments are about the centroid, and at least 0"));
        }
        Ok(Inertial { origin: self.pose(&own)?, mass, moments })
    }

    /// `pos` and one of the ways to state an orientation.
    fn pose(&self, stated_in: &Stated) -> Result<Origin, ModelError> {
        let source = self.source;
        let unit = self.conventions.radians_per_angle;
        let xyz = stated_in.numbers::<3>(source, "pos")?.unwrap_or([Number::ZERO; 3]);
        let vector = |numbers: &[Number]| Vector3::from([0, 1, 2].map(|axis| numbers[axis].value));
        let none = |name: &str, what: &str| {
            Err(source.error(stated_in.place(name), format!("`{name}` {what}")).help("give a direction"))
        };
        let rotation = if let Some(quaternion) = stated_in.numbers::<4>(source, "quat")? {
            let [w, x, y, z] = quaternion.map(|number| number.value);
            if [w, x, y, z] == [0.0; 4] {
                return none("quat", "is zero");
            }
            UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix()
        } else if let Some(about) = stated_in.numbers::<4>(source, "axisangle")? {
            let Some(axis) = nalgebra::Unit::try_new(vector(&about), 0.0) else {
                return none("axisangle", "has an axis of length 0");
            };
            Rotation3::from_axis_angle(&axis, Number::from(about[3].value * unit).angle())
        } else if let Some(angles) = stated_in.numbers::<3>(source, "euler")? {
            let about = |axis: char, angle: f64| {
                let axis = match axis.to_ascii_lowercase() {
                    'x' => Vector3::x_axis(),
                    'y' => Vector3::y_axis(),
                    _ => Vector3::z_axis(),
                };
                Rotation3::from_axis_angle(&axis, angle)
            };
            let sequence = self.conventions.euler.chars().zip(angles.map(|angle| angle.value * unit));
            sequence.fold(Rotation3::identity(), |sum, (axis, angle)| {
                // Small letters turn with the body, capitals do not.
                if axis.is_ascii_lowercase() { sum * about(axis, angle) } else { about(axis, angle) * sum }
            })
        } else if let Some(axes) = stated_in.numbers::<6>(source, "xyaxes")? {
            let x = vector(&axes[..3]).normalize();
            let y = vector(&axes[3..]);
            let y = (y - x * x.dot(&y)).normalize();
            if !(x + y).iter().all(|component| component.is_finite()) {
                return none("xyaxes", "names no two axes");
            }
            Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]))
        } else if stated_in.with("zaxis").is_some() {
            return none("zaxis", "is not read here; state `quat` or `xyaxes`");
        } else {
            Rotation3::identity()
        };
        let turned =
            if rotation == Rotation3::identity() { Origin::IDENTITY.turned } else { stated(rotation.matrix()) };
        Ok(Origin { xyz, turned })
    }
}

fn fixed(from: &str, to: &str, origin: Origin, place: Range<usize>) -> Joint {
    Joint {
        name: format!("{to} (fixed)"),
        kind: Kind::Fixed,
        parent: (from.to_owned(), place.clone()),
        child: (to.to_owned(), place.clone()),
        origin,
        axis: [Number::ZERO, Number::ZERO, Number::from(1.0)],
        limits: None,
        damping: None,
        friction: None,
        rotor: None,
        stiffness: None,
        mimic: None,
        place,
    }
}

impl Joint {
    fn named(self, name: String) -> Self {
        Self { name, ..self }
    }
}
