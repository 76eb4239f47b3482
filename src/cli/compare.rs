//! `dynid compare`: how far a model is from the logs, per run and joint.

use std::fmt::Write;
use std::path::PathBuf;

use clap::ValueEnum;
use dynid::compare::{Comparison, JointComparison, RunComparison, compare};
use dynid::experiment::Run;
use dynid::output::{Overwrite, check_output, write_new};
use dynid::plot::{self, Panel};
use dynid::report::number;
use dynid_model::{Device, JointKind};
use serde_json::Value;

use super::table::{Align, Table};
use super::{Answer, Outcome, inputs};

/// Say how far a model is from the logs, per run and joint, and draw it.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid compare experiment.toml --model fitted.toml
  dynid compare experiment.toml --model fitted.toml --picture overlay.svg
  dynid compare experiment.toml --model fitted.toml --free 4        only runs with just joint 4 free
  dynid compare experiment.toml                                     the device's default model

Two errors are told where they can be computed. Position: measured minus simulated from the commanded torque; `noise`
is the log's own, so an RMS error near it leaves nothing to explain, and `white` says that the rest has no pattern.
Torque: commanded minus what the measured, filtered motion needs, as a share of the torque.
Judge a fitted model by the runs whose role is `validate`: it has not seen them.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Draw measured, model and residual of every run and joint into this SVG file.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Which error the picture and the table show; both are always in the JSON.
    #[arg(long, value_enum, default_value_t = Shown::Both)]
    error: Shown,
    /// Overwrite the picture if it is there.
    #[arg(long)]
    force: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Shown {
    Torque,
    Position,
    Both,
}

/// Compares, draws.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = if arguments.force { Overwrite::Force } else { Overwrite::Refuse };
    if let Some(picture) = &arguments.picture {
        check_output(picture, overwrite)?;
    }
    let experiment = inputs::experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let runs: Vec<&Run> = inputs::runs(&experiment, arguments.free.as_deref())?;
    let comparison = compare(&model, &runs)?;
    let mut text = table(&comparison, arguments.error);
    text.push_str(&summary(&comparison));
    if let Some(picture) = &arguments.picture {
        let panels = panels(model.device, &runs, &comparison, arguments.error);
        write_new(picture, &plot::standalone(&panels), overwrite)?;
        let _ = writeln!(text, "drawn: {}", picture.display());
    }
    let json = json(&comparison)?;
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// The comparison as programs read it.
pub fn json(comparison: &Comparison) -> anyhow::Result<Value> {
    Ok(serde_json::to_value(comparison)?)
}

/// Errors of all runs in one line each: fitted to, and held out.
pub fn summary(comparison: &Comparison) -> String {
    let mut text = String::new();
    for (what, rmse, percent) in [
        ("runs to fit to", comparison.rmse_fit, comparison.torque_percent_fit),
        ("held-out runs", comparison.rmse_validate, comparison.torque_percent_validate),
    ] {
        let parts: Vec<String> = [
            rmse.map(|rmse| format!("position {} RMS", number(rmse))),
            percent.map(|percent| format!("torque {percent:.1} %")),
        ]
        .into_iter()
        .flatten()
        .collect();
        if !parts.is_empty() {
            let _ = writeln!(text, "{what}: {}", parts.join(", "));
        }
    }
    text
}

fn table(comparison: &Comparison, shown: Shown) -> String {
    let mut columns = vec![("run", Align::Left), ("role", Align::Left), ("joint", Align::Right)];
    if shown != Shown::Torque {
        columns.extend([
            ("position RMS", Align::Right),
            ("noise", Align::Right),
            ("largest", Align::Right),
            ("fit %", Align::Right),
            ("white", Align::Left),
        ]);
    }
    if shown != Shown::Position {
        columns.extend([("torque RMS", Align::Right), ("torque %", Align::Right)]);
    }
    let mut table = Table::new(&columns);
    let told = |value: Option<f64>| value.map_or_else(|| "\u{2014}".to_owned(), number);
    let percent = |value: Option<f64>| value.map_or_else(|| "\u{2014}".to_owned(), |value| format!("{value:.1}"));
    for run in &comparison.runs {
        for joint in &run.joints {
            let mut cells = vec![run.file.clone(), run.role.clone(), joint.joint.to_string()];
            if shown != Shown::Torque {
                cells.extend([
                    told(joint.rmse),
                    number(joint.noise_floor),
                    told(joint.max_abs),
                    percent(joint.fit_percent),
                    if joint.white { "yes" } else { "no" }.to_owned(),
                ]);
            }
            if shown != Shown::Position {
                cells.extend([told(joint.torque_rmse), percent(joint.torque_percent)]);
            }
            table.cells(cells);
        }
    }
    let mut text = table.text();
    for run in &comparison.runs {
        for note in &run.notes {
            let _ = writeln!(text, "note: {}: {note}", run.file);
        }
    }
    text
}

fn panels(device: &Device, runs: &[&Run], comparison: &Comparison, shown: Shown) -> Vec<Panel> {
    let mut panels = Vec::new();
    for (run, compared) in runs.iter().zip(&comparison.runs) {
        for (slot, joint) in compared.joints.iter().enumerate() {
            let kind = device.joints[joint.joint].kind;
            if shown != Shown::Torque {
                panels.extend(position_panel(run, compared, slot, joint, kind));
            }
            if shown != Shown::Position {
                panels.extend(torque_panel(compared, slot, kind));
            }
        }
    }
    panels
}

fn position_panel(
    run: &Run,
    compared: &RunComparison,
    slot: usize,
    joint: &JointComparison,
    kind: JointKind,
) -> Option<Panel> {
    Some(Panel {
        title: format!("{}, joint {}, {}", compared.file, joint.joint, compared.role),
        quantity: "position".to_owned(),
        unit: if kind == JointKind::Prismatic { "m" } else { "rad" }.to_owned(),
        time: run.log.t.clone(),
        measured: run.log.q[joint.joint].clone(),
        predicted: compared.simulated.as_ref()?.get(slot)?.clone(),
        noise_floor: Some(joint.noise_floor),
    })
}

fn torque_panel(compared: &RunComparison, slot: usize, kind: JointKind) -> Option<Panel> {
    let error = compared.torque.get(slot)?;
    // samples that do not count leave gaps
    let counted = |values: &[f64]| -> Vec<f64> {
        values.iter().zip(&error.used).map(|(&value, &used)| if used { value } else { f64::NAN }).collect()
    };
    let predicted: Vec<f64> = error.torque.iter().zip(&error.residual).map(|(tau, left)| tau - left).collect();
    Some(Panel {
        title: format!("{}, joint {}, {}", compared.file, error.joint, compared.role),
        quantity: "torque".to_owned(),
        unit: if kind == JointKind::Prismatic { "N" } else { "N m" }.to_owned(),
        time: error.time.clone(),
        measured: counted(&error.torque),
        predicted: counted(&predicted),
        noise_floor: None,
    })
}
