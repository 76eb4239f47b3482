//! `dynid device import`: a device file from another description of a robot.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::Subcommand;
use dynid::device_from_description;
use dynid_files::{Overwrite, check_output, write_new};
use serde_json::json;

use super::{Answer, Outcome};

/// Make a device file of a robot that another format describes.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Turn a URDF or an MJCF into a device file.
    Import(ImportArguments),
}

#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid device import robot.urdf --out robot.toml
  dynid devices robot.toml                          what is in it
  dynid plan robot.toml                             what its motions reveal

Links, inertials, axes at any angle, limits, mimic joints, branches, damping and friction are taken over; bodies on fixed
joints are merged. What has no place in a device file, and what was guessed, is listed and stands at its head.")]
struct ImportArguments {
    /// The description: a URDF, or MuJoCo's format (MJCF) with explicit inertials. Expand xacro first.
    file: PathBuf,
    /// Where to write the device file.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The link whose origin is the end point, where a hand or a tool is; without it the one farthest from the base.
    #[arg(long, value_name = "LINK")]
    end_point: Option<String>,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
}

/// Does what is asked.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.verb {
        Verb::Import(arguments) => import(arguments),
    }
}

fn import(arguments: &ImportArguments) -> anyhow::Result<Outcome> {
    let ImportArguments { file, out, end_point, force } = arguments;
    let overwrite = Overwrite::if_forced(*force);
    check_output(out, overwrite)?;
    if out.extension().is_none_or(|extension| extension != "toml") {
        bail!("--out {}: a device file is named by its path, which ends in `.toml`", out.display());
    }
    let text = dynid_files::read(file)?;
    let imported = device_from_description(&text, file, end_point.as_deref())?;
    // It is read back before it is written: what is written is right.
    let device = dynid_model::Device::parse_own(&imported.toml, out, out.clone())?;
    write_new(out, &imported.toml, overwrite)?;
    let mut said = format!("{}: {} joints, {} links\n", device.title, device.joints.len(), device.links.len());
    for note in &imported.notes {
        let _ = writeln!(said, "  {note}");
    }
    let _ = writeln!(said, "written: {}; `dynid devices {}` shows it", out.display(), out.display());
    let json = json!({
        "device": device.name_from(Path::new("")),
        "joints": device.joints.len(),
        "links": device.links.len(),
        "notes": imported.notes,
        "out": out.display().to_string(),
    });
    Ok(Outcome { text: said, json, answer: Answer::Yes })
}
