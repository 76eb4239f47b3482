//! From a tree of links and joints to what stands in a device file.

use std::collections::BTreeMap;

use dynid_model::device_reader::MOST_JOINTS;
use dynid_model::{ModelError, Source, did_you_mean};

use crate::{
    body::{Body, as_written},
    draft::{Draft, Effect, EndPoint, Frame, Joint, Link},
    motion::{Motions, motions},
    number::Number,
    pose::{Pose, Turned, without_rounding},
    tree::Tree,
    urdf::{self, Kind, Robot},
    xml::counted,
};

/// Where a link ended up: the frame that it moves with (none: it stands still), its pose there, and how many fixed joints lie
/// between.
#[derive(Debug, Clone)]
pub(crate) struct Seat {
    pub frame: Option<usize>,
    pub pose: Pose,
    fixed_depth: usize,
}

/// # Errors
/// What no device can be: joints that move nothing, nothing that has a mass, a mimic that has no place.
pub(crate) fn draft(source: &Source, robot: &Robot, tree: &Tree, end_point: Option<&str>) -> Result<Draft, ModelError> {
    if robot.links.iter().all(|link| link.inertial.is_none()) {
        return Err(source
            .error(robot.place.clone(), "no link has an `<inertial>`: the file describes shapes, not dynamics")
            .help("add mass, centroid and inertia to the links, as guesses if need be; a fit improves them"));
    }
    let motions = motions(source, robot, tree)?;
    if motions.variables.is_empty() {
        return Err(source
            .error(robot.place.clone(), "no joint moves")
            .help("a device has a joint at least; make one `revolute` or `prismatic`"));
    }
    if let Some(beyond) = motions.variables.get(MOST_JOINTS) {
        let message = format!("{} joints move, more than {MOST_JOINTS}", motions.variables.len());
        return Err(source
            .error(robot.joints[*beyond].place.clone(), message)
            .help("describe what moves together as a device of its own"));
    }
    let mut notes = Vec::new();
    let (frames, seats) = frames(robot, tree, &motions);
    refuse_idle_joints(source, robot, tree, &motions)?;
    let mut links = Vec::new();
    for frame in 0..frames.len() {
        let here: Vec<usize> = tree.order.iter().copied().filter(|link| seats[*link].frame == Some(frame)).collect();
        links.extend(merged_link(robot, &seats, frame, &here, &mut notes));
    }
    let still: Vec<&str> = tree
        .order
        .iter()
        .filter(|link| seats[**link].frame.is_none() && robot.links[**link].inertial.is_some())
        .map(|link| robot.links[*link].name.as_str())
        .collect();
    if !still.is_empty() {
        notes.push(format!("left out, because they stand still: {}", still.join(", ")));
    }
    let joints = motions.variables.iter().map(|joint| limits(robot, *joint, &mut notes)).collect();
    let effects = losses(robot, &motions, &mut notes);
    note_mimics(robot, tree, &motions, &mut notes);
    let last = match end_point {
        Some(name) => named(source, robot, &seats, name)?,
        None => farthest(tree, &frames, &seats),
    };
    let verb = if end_point.is_none() { "is taken to be" } else { "is" };
    let end_point = end_point_at(robot, &seats, last, verb, &mut notes);
    note_rough_angles(robot, &mut notes);
    notes.extend(robot.notes.iter().cloned());
    let title = if robot.name.is_empty() { "Robot without a name".to_owned() } else { robot.name.clone() };
    let file = source.path.file_name().map_or("a robot description".into(), |name| name.to_string_lossy());
    let source = format!("Imported from {file}");
    Ok(Draft { title, gravity: robot.gravity, source, frames, joints, links, end_point, effects, notes })
}

/// A frame for each joint that moves, parents first, and the seat of every link.
pub(crate) fn frames(robot: &Robot, tree: &Tree, motions: &Motions) -> (Vec<Frame>, Vec<Seat>) {
    let root = Seat { frame: None, pose: Pose::identity(), fixed_depth: 0 };
    let mut seats = vec![root; robot.links.len()];
    let mut frames: Vec<Frame> = Vec::new();
    for &link in &tree.order {
        let Some(number) = tree.joint_of[link] else { continue };
        let (joint, before) = (&robot.joints[number], seats[tree.parent_of[number]].clone());
        let Some(motion) = motions.of.get(&number) else {
            let pose = before.pose.then(&joint.origin.pose());
            seats[link] = Seat { frame: before.frame, pose, fixed_depth: before.fixed_depth + 1 };
            continue;
        };
        let (xyz, turned) = before.pose.placement(&joint.origin);
        seats[link] = Seat { frame: Some(frames.len()), pose: Pose::identity(), fixed_depth: 0 };
        frames.push(Frame {
            name: frame_name(&robot.links[link].name, robot),
            parent: before.frame,
            xyz,
            turned,
            axis: joint.axis.clone(),
            is_angle: joint.kind.is_angle(),
            joint: motion.variable,
            motion: motion.expression.clone(),
        });
    }
    (frames, seats)
}

/// The name of the link; `base` is a device's for what stands still.
fn frame_name(link: &str, robot: &Robot) -> String {
    if link != "base" {
        return link.to_owned();
    }
    let mut name = "base_link".to_owned();
    while robot.links.iter().any(|link| link.name == name) {
        name.push('_');
    }
    name
}

/// A joint that moves no mass has no equation of motion.
fn refuse_idle_joints(source: &Source, robot: &Robot, tree: &Tree, motions: &Motions) -> Result<(), ModelError> {
    let mut is_idle = vec![true; motions.variables.len()];
    for (link, own) in (0..).zip(&robot.links) {
        if own.inertial.as_ref().is_none_or(|inertial| Body::of(inertial).is_nothing()) {
            continue;
        }
        let mut at = link;
        while let Some(joint) = tree.joint_of[at] {
            if let Some(motion) = motions.of.get(&joint) {
                is_idle[motion.variable] = false;
            }
            at = tree.parent_of[joint];
        }
    }
    let Some(variable) = is_idle.iter().position(|idle| *idle) else { return Ok(()) };
    let joint = &robot.joints[motions.variables[variable]];
    let child = &joint.child.0;
    Err(source
        .error(
            joint.place.clone(),
            format!("joint `{}` moves no mass: neither link `{child}` nor what it carries has any", joint.name),
        )
        .help(format!("add an `<inertial>` to link `{child}`, or make the joint `fixed`")))
}

/// The body that moves with a frame, if there is one.
fn merged_link(robot: &Robot, seats: &[Seat], frame: usize, here: &[usize], notes: &mut Vec<String>) -> Option<Link> {
    let mut bodies = Vec::new();
    let mut with_mass = Vec::new();
    for &link in here {
        let Some(inertial) = &robot.links[link].inertial else { continue };
        let body = Body::of(inertial);
        if !body.is_nothing() {
            bodies.push(body.seen_from(&seats[link].pose));
            with_mass.push(link);
        }
    }
    if bodies.is_empty() {
        return None;
    }
    let names: Vec<&str> = with_mass.iter().map(|link| robot.links[*link].name.as_str()).collect();
    let title = robot.links[here[0]].name.clone();
    let mut remark = (names.len() > 1).then(|| format!("Merged, because they move as one: {}", names.join(", ")));
    let body = Body::merged(&bodies);
    let inertial = if let Some((mended, why)) = body.mended() {
        let rise = (mended.inertia.trace() - body.inertia.trace()) / 2.0;
        let note = format!(
            "no body has the inertia of link `{title}` ({why}): the two smaller moments were raised by {rise:.2e} kg*m^2 each"
        );
        remark = Some(remark.map_or(String::new(), |remark| remark + "; ") + &note);
        notes.push(note);
        mended.values().map(|value| Number::from(to_ten_digits(value)))
    } else {
        // A body alone, in the axes of its frame, keeps its text.
        let alone = with_mass.first().filter(|link| with_mass.len() == 1 && seats[**link].pose == Pose::identity());
        let written = alone.and_then(|link| robot.links[*link].inertial.as_ref()).and_then(as_written);
        written.unwrap_or_else(|| body.values().map(Number::from))
    };
    Some(Link { title, frame, inertial, remark })
}

/// A number that was changed anyway need not have all its digits.
fn to_ten_digits(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}

fn limits(robot: &Robot, joint: usize, notes: &mut Vec<String>) -> Joint {
    let joint = &robot.joints[joint];
    let endless = [Number::from(f64::NEG_INFINITY), Number::from(f64::INFINITY)];
    let mut position = endless.clone();
    if joint.kind != Kind::Continuous {
        match &joint.limits {
            Some(limits) if limits.lower.value < limits.upper.value => {
                position = [limits.lower.clone(), limits.upper.clone()];
            }
            Some(_) => notes.push(format!("joint `{}` states no range of motion, so it has no ends here", joint.name)),
            None => notes.push(format!("joint `{}` states no limits, so it has none here", joint.name)),
        }
    }
    let mut positive = |stated: Option<&Number>, what: &str| match stated {
        Some(number) if number.value > 0.0 => number.clone(),
        Some(number) => {
            notes.push(format!(
                "joint `{}` states a {what} limit of {}, which is taken as unknown",
                joint.name, number.value
            ));
            Number::from(f64::INFINITY)
        }
        None => Number::from(f64::INFINITY),
    };
    let limits = joint.limits.as_ref();
    Joint {
        title: joint.name.clone(),
        kind: joint.kind,
        position,
        speed: positive(limits.and_then(|limits| limits.speed.as_ref()), "speed"),
        torque: positive(limits.and_then(|limits| limits.torque.as_ref()), "torque"),
    }
}

/// Damping, friction and rotors, where they are stated. What a follower loses, its leader feels:
/// `tau = sum f Fv (f dq) + |f| Fc sign(dq) + f Ia (f ddq)`.
fn losses(robot: &Robot, motions: &Motions, notes: &mut Vec<String>) -> Vec<Effect> {
    let mut sums: BTreeMap<(usize, usize), Number> = BTreeMap::new();
    for (number, joint) in (0..).zip(&robot.joints) {
        let Some(motion) = motions.of.get(&number) else { continue };
        let square = motion.factor.powi(2);
        let stated = [(&joint.damping, square), (&joint.friction, motion.factor.abs()), (&joint.rotor, square)];
        for (kind, (loss, factor)) in (0..).zip(stated) {
            let Some(loss) = loss.as_ref().filter(|loss| loss.value != 0.0) else { continue };
            sums.entry((motion.variable, kind))
                .and_modify(|sum| *sum = Number::from(sum.value + factor * loss.value))
                .or_insert_with(|| if factor == 1.0 { loss.clone() } else { Number::from(factor * loss.value) });
        }
    }
    let names = [("viscous", "Fv"), ("coulomb", "Fc"), ("rotor_inertia", "Ia")];
    let effect = |((joint, kind), value): ((usize, usize), Number)| {
        let (id, symbol) = names[kind];
        Effect { id, joint, symbol, value }
    };
    let effects: Vec<Effect> = sums.into_iter().map(effect).collect();
    let count = |id: &str| effects.iter().filter(|effect| effect.id == id).count();
    for (id, key) in [("viscous", "damping"), ("coulomb", "friction"), ("rotor_inertia", "armature")] {
        if count(id) > 0 {
            notes.push(format!("`{key}` became the effect `{id}` of {}", counted(count(id), "joint")));
        }
    }
    effects
}

fn note_mimics(robot: &Robot, tree: &Tree, motions: &Motions, notes: &mut Vec<String>) {
    let followers: Vec<String> = tree
        .order
        .iter()
        .filter_map(|link| tree.joint_of[*link])
        .filter(|joint| robot.joints[*joint].mimic.is_some())
        .filter_map(|joint| Some(format!("{} = {}", robot.joints[joint].name, motions.of.get(&joint)?.expression)))
        .collect();
    if !followers.is_empty() {
        notes.push(format!(
            "joints that follow others are no joints of the device, and their limits are left out: {}",
            followers.join(", ")
        ));
    }
}

/// A link that moves, by its name.
fn named(source: &Source, robot: &Robot, seats: &[Seat], name: &str) -> Result<usize, ModelError> {
    let Some(link) = robot.links.iter().position(|link| link.name == name) else {
        let known = did_you_mean(name, robot.links.iter().map(|link| link.name.as_str()));
        let message = format!("there is no link `{name}` for the end point");
        return Err(source.error(robot.place.clone(), message).help(known));
    };
    if seats[link].frame.is_none() {
        let message = format!("link `{name}` does not move: it is no end point");
        return Err(source.error(robot.place.clone(), message).help("name a link that a joint moves"));
    }
    Ok(link)
}

/// The link at the far end of the longest chain: a guess, where none is named.
fn farthest(tree: &Tree, frames: &[Frame], seats: &[Seat]) -> usize {
    let mut depths: Vec<usize> = Vec::new();
    for frame in frames {
        depths.push(1 + frame.parent.map_or(0, |parent| depths[parent]));
    }
    // The first of the deepest.
    let frame = (0..frames.len()).rev().max_by_key(|frame| depths[*frame]).unwrap_or_default();
    let here = tree.order.iter().copied().filter(|link| seats[*link].frame == Some(frame));
    here.rev().max_by_key(|link| seats[*link].fixed_depth).unwrap_or_default()
}

fn end_point_at(robot: &Robot, seats: &[Seat], link: usize, verb: &str, notes: &mut Vec<String>) -> EndPoint {
    let frame = seats[link].frame.unwrap_or_default();
    let Pose { place, .. } = seats[link].pose;
    let point = [0, 1, 2].map(|axis| Number::from(without_rounding(place[axis])));
    let name = robot.links[link].name.clone();
    let turned = if seats[link].pose.is_turned() { "; its orientation is left out" } else { "" };
    notes.push(format!("the end point {verb} the origin of link `{name}`{turned}"));
    EndPoint { frame, point, name }
}

/// Angles such as 1.5708 cost operations that a quarter turn does not.
fn note_rough_angles(robot: &Robot, notes: &mut Vec<String>) {
    let is_rough = |joint: &&urdf::Joint| match &joint.origin.turned {
        Turned::Angles(rpy) => rpy.iter().any(Number::is_rough_quarter_turn),
        Turned::Matrix(_) => false,
    };
    let names: Vec<&str> = robot.joints.iter().filter(is_rough).map(|joint| joint.name.as_str()).collect();
    if !names.is_empty() {
        notes.push(format!(
            "angles of these joints are near quarter turns, but are written with too few digits to be taken for them \
             (write pi/2 in the device file where that is meant; the equations become shorter): {}",
            names.join(", ")
        ));
    }
}
