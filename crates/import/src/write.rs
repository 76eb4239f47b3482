//! The text of a device file.

use std::fmt::Write;

use crate::{
    draft::{Draft, Effect, Frame, Link},
    number::Number,
    pose::Turned,
    urdf::Kind,
};

/// How much these effects' parameters may be by default (effects/*.toml of the model); above, a file states bounds.
const LARGEST: [(&str, f64); 3] = [("viscous", 100.0), ("coulomb", 200.0), ("rotor_inertia", 100.0)];

pub(crate) fn device_file(draft: &Draft) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write(draft, &mut text);
    text
}

fn write(draft: &Draft, text: &mut String) -> std::fmt::Result {
    writeln!(text, "# {}: written by `dynid device import`.", one_line(&draft.title))?;
    if !draft.notes.is_empty() {
        writeln!(text, "#")?;
        draft.notes.iter().try_for_each(|note| writeln!(text, "# - {}", one_line(note)))?;
    }
    writeln!(text, "title = {}\nsource = {}\n", quoted(&draft.title), quoted(&draft.source))?;
    text.push_str(UNITS);
    write_base(draft, text)?;
    text.push_str(KINEMATICS);
    draft.frames.iter().try_for_each(|frame| write_frame(draft, frame, text))?;
    let end = &draft.end_point;
    writeln!(text, "]\n\n# Where a hand or a tool would be: the origin of link {}. A guess.", one_line(&end.name))?;
    let [x, y, z] = end.point.each_ref().map(Number::toml);
    writeln!(text, "[end_point]\nframe = {}\npoint = [{x}, {y}, {z}]", quoted(&draft.frames[end.frame].name))?;
    for (number, joint) in draft.joints.iter().enumerate() {
        let is_angle = joint.kind != Kind::Prismatic;
        let limit = |number: &Number| if is_angle { number.toml_angle() } else { number.toml() };
        let [lowest, highest] = joint.position.each_ref().map(limit);
        writeln!(text, "\n[[joint]]               # q{number}\ntitle = {}", quoted(&joint.title))?;
        writeln!(text, "position = [{lowest}, {highest}]")?;
        writeln!(text, "speed = {}\ntorque = {}", joint.speed.toml(), joint.torque.toml())?;
        if !is_angle {
            writeln!(text, "command = \"N\"")?;
        }
    }
    text.push_str(BOUNDS);
    for (number, link) in (1..).zip(&draft.links) {
        write_link(draft, number, link, text)?;
    }
    write_identification(draft, text)?;
    draft.effects.iter().try_for_each(|effect| write_effect(effect, text))
}

const UNITS: &str = "\
# What the numbers of this file are in. Only SI; stating it keeps degrees and millimetres out.
[units]
angle = \"rad\"
length = \"m\"
mass = \"kg\"
inertia = \"kg*m^2\"
time = \"s\"
command = \"N*m\"

";

const KINEMATICS: &str = "
# A frame is its parent's, moved by xyz, turned by roll, pitch and yaw (about fixed x, then y, then z), then turned about or
# moved along its axis.
[kinematics]
convention = \"transform\"
frames = [
";

const BOUNDS: &str = "
# Bounds of the numbers below: fractions of the values. A description states none; these are guesses.
[bounds]
mass = 0.5
centroid = 0.3
inertia = 1.2
";

fn write_base(draft: &Draft, text: &mut String) -> std::fmt::Result {
    let size = draft.gravity.iter().map(|component| component * component).sum::<f64>().sqrt();
    let up = draft.gravity.map(|component| Number::from(-component / size).toml());
    let up = if size > 0.0 { up.join(", ") } else { "0, 0, 1".to_owned() };
    writeln!(text, "# How the robot is mounted is a guess: its base stands upright.")?;
    writeln!(text, "[base]\ngravity = {}\nup = [{up}]", Number::from(size).toml())
}

fn write_frame(draft: &Draft, frame: &Frame, text: &mut String) -> std::fmt::Result {
    let parent = frame.parent.map_or("base", |parent| &draft.frames[parent].name);
    write!(text, "  {{ name = {}, parent = {}", quoted(&frame.name), quoted(parent))?;
    let three = |numbers: [String; 3]| format!("[{}]", numbers.join(", "));
    if frame.xyz.iter().any(|number| number.value != 0.0) {
        write!(text, ", xyz = {}", three(frame.xyz.each_ref().map(Number::toml)))?;
    }
    match &frame.turned {
        Turned::Angles(rpy) => {
            let rpy = rpy.each_ref().map(Number::toml_angle);
            if rpy.iter().any(|angle| angle != "0") {
                write!(text, ", rpy = {}", three(rpy))?;
            }
        }
        Turned::Matrix(rows) => {
            let rows = rows.map(|row| three(row.map(|entry| Number::from(entry).toml())));
            write!(text, ", matrix = {}", three(rows))?;
        }
    }
    let key = if frame.is_angle { "turn" } else { "slide" };
    let axis = three(frame.axis.each_ref().map(Number::toml));
    writeln!(text, ", axis = {axis}, {key} = \"{}\" }},", frame.motion)
}

fn write_link(draft: &Draft, number: usize, link: &Link, text: &mut String) -> std::fmt::Result {
    text.push('\n');
    if let Some(remark) = &link.remark {
        writeln!(text, "# {}", one_line(remark))?;
    }
    writeln!(text, "[[link]]                # {number}")?;
    writeln!(text, "title = {}\nframe = {}", quoted(&link.title), quoted(&draft.frames[link.frame].name))?;
    let mut symbols = dynid_model::Link::SYMBOLS.iter().zip(&link.inertial);
    symbols.try_for_each(|(symbol, number)| writeln!(text, "{symbol} = {}", number.toml()))
}

/// Each joint alone, from the tips to the base; in a chain one more joint each step; all together.
fn write_identification(draft: &Draft, text: &mut String) -> std::fmt::Result {
    let n_joints = draft.joints.len();
    let row = |joints: std::ops::Range<usize>| {
        let joints: Vec<String> = joints.map(|joint| joint.to_string()).collect();
        format!("  [{}],\n", joints.join(", "))
    };
    text.push_str("\n[identification]\nconfigurations = [\n");
    (0..n_joints).for_each(|joint| text.push_str(&row(joint..joint + 1)));
    let is_chain = draft.is_chain();
    // Of a chain, the last two joints, the last three, .. all; of a tree, all.
    let firsts: Vec<usize> = if is_chain { (0..n_joints.saturating_sub(1)).rev().collect() } else { vec![0] };
    firsts.iter().filter(|_| n_joints > 1).for_each(|first| text.push_str(&row(*first..n_joints)));
    text.push_str("]\n");
    let last = if n_joints == 1 { 1 } else { n_joints + firsts.len() };
    let mut methods = vec![("isolated", (1..=n_joints).rev().collect::<Vec<_>>())];
    if is_chain && n_joints > 1 {
        methods.push(("coupling", (n_joints..=last).collect()));
    }
    methods.push(("together", vec![last]));
    for (name, sequence) in methods {
        writeln!(text, "\n[[identification.method]]\nname = \"{name}\"\nsequence = {sequence:?}")?;
    }
    Ok(())
}

fn write_effect(effect: &Effect, text: &mut String) -> std::fmt::Result {
    let Effect { id, joint, symbol, value } = effect;
    let is_large = LARGEST.iter().any(|(large, largest)| large == id && value.value > *largest);
    let value = match is_large {
        true => {
            format!("{{ value = {}, lower = 0, upper = {} }}", value.toml(), Number::from(2.0 * value.value).toml())
        }
        false => value.toml(),
    };
    writeln!(text, "\n[[effect]]\nid = \"{id}\"\njoint = {joint}\n{symbol} = {value}")
}

/// A TOML basic string.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for character in text.chars() {
        match character {
            '"' | '\\' => quoted.extend(['\\', character]),
            control if control.is_control() => quoted.push_str(&format!("\\u{:04X}", control as u32)),
            other => quoted.push(other),
        }
    }
    quoted + "\""
}

/// What may stand in a comment.
fn one_line(text: &str) -> String {
    text.chars().map(|character| if character.is_control() { ' ' } else { character }).collect()
}
