//! `dynid export`: a model for other programs.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use clap::ValueEnum;
use dynid::{DescriptionFormat, Exported, Model};
use dynid_files::{Overwrite, check_output, write_new};
use serde_json::json;

use super::{Answer, Outcome};

/// Write a model for other programs: into a copy of its URDF or MJCF, as C for a controller, or as JSON.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid export fitted.toml --as urdf --from robot.urdf --out identified.urdf
  dynid export fitted.toml --as mjcf --from robot.xml --out identified.xml
  dynid export fitted.toml --as c --out robot.c                    one C99 file; its head says how to use it
  dynid export fitted.toml --as c --free 1,3 --out robot.c         joints 1 and 3 move, the others are locked
  dynid export fitted.toml --as json                               links, joints and effects, with standard deviations

`--from` is the file that `dynid device import` made the model's device from. Mass, centroid and inertia of its links, damping,
friction and (MJCF) armature, springs and gravity become the model's; all other text stays. Where links move as one, their sum is the
model's. What the format has no place for is listed.")]
pub struct Arguments {
    /// The model.
    pub model: PathBuf,
    /// What to write.
    #[arg(long = "as", value_name = "FORMAT")]
    format: Format,
    /// The URDF or MJCF that the model's device was imported from; it is not changed.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Where to write it. JSON is printed where there is none.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// C only: the joints that move; without it, all.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// C only: positions of all joints [rad or m], at which those that do not move are locked; those of joints that move are not used. Without it, 0.
    #[arg(long, value_delimiter = ',', value_name = "POSITIONS", allow_hyphen_values = true)]
    posture: Option<Vec<f64>>,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// A copy of the URDF of `--from`.
    Urdf,
    /// A copy of the MJCF (MuJoCo's format) of `--from`.
    Mjcf,
    /// Kernels, values and effects as one C99 file.
    C,
    /// Values and formulas.
    Json,
}

/// Reads, exports, writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    refuse_what_does_not_go_together(arguments)?;
    let overwrite = Overwrite::if_forced(arguments.force);
    if let Some(out) = &arguments.out {
        check_output(out, overwrite)?;
    }
    let model = Model::load(&arguments.model)?;
    let exported = match arguments.format {
        Format::Urdf => description(&model, DescriptionFormat::Urdf, arguments)?,
        Format::Mjcf => description(&model, DescriptionFormat::Mjcf, arguments)?,
        Format::C => c99(&model, arguments)?,
        Format::Json => {
            let json = dynid::as_json(&model);
            let text = format!("{}\n", serde_json::to_string_pretty(&json)?);
            if arguments.out.is_none() {
                return Ok(Outcome { text, json, answer: Answer::Yes });
            }
            Exported { text, notes: Vec::new() }
        }
    };
    let Some(out) = &arguments.out else { bail!("--out is missing: name the file to write") };
    write_new(out, &exported.text, overwrite)?;
    let mut text = String::new();
    for note in &exported.notes {
        let _ = writeln!(text, "  {note}");
    }
    let _ = writeln!(text, "written: {}", out.display());
    let json = json!({
        "device": model.device.name_from(Path::new("")),
        "model_digest": model.digest(),
        "notes": exported.notes,
        "out": out.display().to_string(),
    });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

fn refuse_what_does_not_go_together(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { format, from, out, free, posture, .. } = arguments;
    let is_description = matches!(format, Format::Urdf | Format::Mjcf);
    if is_description && from.is_none() {
        bail!("--from is missing: name the URDF or MJCF that the model's device was imported from");
    }
    if !is_description && from.is_some() {
        bail!("--from: only a URDF or an MJCF is written into a copy of another file; leave it out");
    }
    if *format != Format::C && (free.is_some() || posture.is_some()) {
        bail!("--free and --posture are for `--as c`: the other formats have all joints; leave them out");
    }
    if *format != Format::Json && out.is_none() {
        bail!("--out is missing: name the file to write");
    }
    if let (Some(from), Some(out)) = (from, out)
        && fs::canonicalize(from).is_ok_and(|from| fs::canonicalize(out).is_ok_and(|out| from == out))
    {
        bail!("--out {}: this is the file of --from, which stays as it is; choose another name", out.display());
    }
    Ok(())
}

fn description(model: &Model, format: DescriptionFormat, arguments: &Arguments) -> anyhow::Result<Exported> {
    let from = arguments.from.as_deref().ok_or_else(|| anyhow!("--from is missing"))?;
    let text = dynid_files::read(from)?;
    Ok(dynid::as_description(model, format, &text, from)?)
}

fn c99(model: &Model, arguments: &Arguments) -> anyhow::Result<Exported> {
    let n_joints = model.device.joints.len();
    let mut free = arguments.free.clone().unwrap_or_else(|| (0..n_joints).collect());
    free.sort_unstable();
    let posture = arguments.posture.clone().unwrap_or_else(|| vec![0.0; n_joints]);
    if posture.len() != n_joints {
        bail!("--posture: {} positions given, the device has {n_joints} joints; give one for each", posture.len());
    }
    if let Some(position) = posture.iter().find(|position| !position.is_finite()) {
        bail!("--posture: {position} is no position; give finite numbers");
    }
    Ok(dynid::as_c99(model, &free, &posture)?)
}
