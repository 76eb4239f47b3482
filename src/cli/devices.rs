//! `dynid devices`: what is known about the mechanisms.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use dynid_model::{Device, JointKind, device_named, document::read_text, library::device_text};
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome};

/// List the devices, show one in detail, or check a device file.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid devices                        the list
  dynid devices freedom6s              joints, links, configurations and default effects of one
  dynid devices my_arm.toml            the same of a device file of yours: is it right? what is in it?

A device of your own is one TOML file: wherever a device is named, in an experiment, a model or a command, the path of
its file does as well. Its equations are formed when they are first asked for. `dynid devices planar2r --file` prints
the smallest, commented, to start from.")]
pub struct Arguments {
    /// Id of a device, e.g. `freedom6s`, or the path of a device file.
    pub device: Option<String>,
    /// Print the device's file, to start one of your own from.
    #[arg(long, requires = "device")]
    file: bool,
    /// Read and check this device file instead; nothing is built.
    #[arg(long, value_name = "FILE", conflicts_with = "device")]
    pub check: Option<PathBuf>,
}

/// Lists them.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    if let Some(text) = arguments.device.as_deref().filter(|_| arguments.file).map(file).transpose()? {
        return Ok(Outcome { json: json!({ "file": text }), text, answer: Answer::Yes });
    }
    let checked = arguments.check.as_deref().map(read).transpose()?;
    let devices: Vec<&Device> = match (&checked, &arguments.device) {
        (Some(device), _) => vec![device],
        (None, Some(id)) => vec![find(id)?],
        (None, None) => dynid_model::devices().iter().collect(),
    };
    let text = match devices.as_slice() {
        [device] if checked.is_some() || arguments.device.is_some() => detail(device),
        _ => list(&devices),
    };
    let json = json!({ "devices": devices.into_iter().map(described).collect::<Vec<_>>() });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// The device with that id or of that file, or an error that says what to do.
pub fn find(name: &str) -> anyhow::Result<&'static Device> {
    device_named(name, Path::new("")).map_err(|error| anyhow!("{error}; {}", error.remedy()))
}

fn file(name: &str) -> anyhow::Result<String> {
    let device = find(name)?;
    match &device.file {
        Some(path) => Ok(read_text(path)?),
        None => Ok(device_text(&device.id).unwrap_or_default().to_owned()),
    }
}

fn read(path: &Path) -> anyhow::Result<Device> {
    let text = read_text(path)
        .map_err(|error| anyhow!("{}: cannot be read: {error}; give the path of a device file", path.display()))?;
    Ok(Device::parse_own(&text, path, path.to_owned())?)
}

fn list(devices: &[&Device]) -> String {
    let mut table = Table::new(&[
        ("device", Align::Left),
        ("joints", Align::Right),
        ("links", Align::Right),
        ("configurations", Align::Right),
        ("", Align::Left),
    ]);
    for device in devices {
        table.row([
            device.id.clone(),
            device.joints.len().to_string(),
            device.links.len().to_string(),
            device.configurations.len().to_string(),
            device.title.clone(),
        ]);
    }
    table.text()
}

fn detail(device: &Device) -> String {
    let mut text = format!("{}: {}\n{}\n\n", device.id, device.title, device.source);
    let mut joints = Table::new(&[
        ("joint", Align::Left),
        ("kind", Align::Left),
        ("range", Align::Left),
        ("default effects", Align::Left),
        ("", Align::Left),
    ]);
    for (index, joint) in device.joints.iter().enumerate() {
        let effects: Vec<&str> = device
            .effects
            .iter()
            .filter(|effect| effect.joint == Some(index))
            .map(|effect| effect.id.as_str())
            .collect();
        let [from, to] = joint.position_limits;
        joints.row([
            format!("q{index}"),
            kind(joint.kind).to_owned(),
            format!("{from:.4} to {to:.4} {}", unit(joint.kind)),
            effects.join(", "),
            joint.title.clone(),
        ]);
    }
    text.push_str(&joints.text());
    let mut links =
        Table::new(&[("link", Align::Left), ("mass [kg]", Align::Right), ("frame", Align::Left), ("", Align::Left)]);
    for (number, link) in (1..).zip(&device.links) {
        let frame = device.frames.get(link.frame).map_or("", |frame| frame.name.as_str());
        links.row([
            format!("{number}"),
            format!("{:.4}", link.inertial[0].value),
            frame.to_owned(),
            link.title.clone(),
        ]);
    }
    let _ = write!(text, "\n{}\n", links.text());
    if let Some((frame, [x, y, z])) = end_point(device) {
        let _ = writeln!(text, "  end point: {x} {y} {z} m in frame {frame}");
    }
    for (number, configuration) in (1..).zip(&device.configurations) {
        let _ = writeln!(text, "  configuration {number}: free {:?}", configuration.free);
    }
    for method in &device.methods {
        let _ = writeln!(text, "  method {}: configurations {:?}", method.name, method.sequence);
    }
    text
}

/// The end point's frame and its place in that.
fn end_point(device: &Device) -> Option<(&str, [f64; 3])> {
    let end_point = device.end_point.as_ref()?;
    Some((device.frames.get(end_point.frame)?.name.as_str(), end_point.point))
}

fn described(device: &Device) -> Value {
    let joints: Vec<Value> = device
        .joints
        .iter()
        .enumerate()
        .map(|(index, joint)| {
            json!({
                "joint": index,
                "kind": kind(joint.kind),
                "title": joint.title,
                "position_limits": joint.position_limits,
                // JSON knows no infinity: an unknown limit is null
                "speed_limit": Some(joint.speed_limit).filter(|limit| limit.is_finite()),
                "torque_limit": Some(joint.torque_limit).filter(|limit| limit.is_finite()),
            })
        })
        .collect();
    let configurations: Vec<Value> = (1..)
        .zip(&device.configurations)
        .map(|(number, configuration)| json!({ "number": number, "free": configuration.free }))
        .collect();
    let methods: Vec<Value> =
        device.methods.iter().map(|method| json!({ "name": method.name, "sequence": method.sequence })).collect();
    let effects: Vec<Value> = device
        .effects
        .iter()
        .map(|effect| json!({ "id": effect.id, "joint": effect.joint, "from": effect.from }))
        .collect();
    json!({
        "id": device.id,
        "title": device.title,
        "source": device.source,
        "joints": joints,
        "n_links": device.links.len(),
        "end_point": end_point(device).map(|(frame, point)| json!({ "frame": frame, "point": point })),
        "configurations": configurations,
        "methods": methods,
        "effects": effects,
    })
}

fn kind(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "revolute",
        JointKind::Prismatic => "prismatic",
    }
}

fn unit(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "rad",
        JointKind::Prismatic => "m",
    }
}
