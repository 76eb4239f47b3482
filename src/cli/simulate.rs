//! `dynid simulate`: what positions would the model have shown under the logged torques?

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{anyhow, bail};
use dynid::experiment::{Experiment, Run};
use dynid::fit::position::{self, FitRun, Options, RunError};
use dynid::output::{Overwrite, check_output, write_new};
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, inputs};

/// Play the commanded torques of every run on a model and write the positions that it shows.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid simulate experiment.toml --out-dir simulated                        the device's default model
  dynid simulate experiment.toml --model fitted.toml --out-dir simulated

Writes one CSV per run, in the format of the logs: t, tau0.., q0..; locked joints stay where the log has them.
Every run starts at rest, at the position that explains the log best.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Folder for the simulated logs; it is made if it is not there.
    #[arg(long, value_name = "FOLDER")]
    out_dir: PathBuf,
    /// Overwrite files that are there.
    #[arg(long)]
    force: bool,
    /// Integration steps per sample.
    #[arg(long, value_name = "N", default_value_t = Options::default().substeps)]
    substeps: usize,
}

/// Simulates every run, then writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let experiment = inputs::experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let overwrite = if arguments.force { Overwrite::Force } else { Overwrite::Refuse };
    let targets = targets(&experiment, arguments)?;
    if arguments.out_dir.is_dir() {
        targets.iter().try_for_each(|target| check_output(target, overwrite))?;
    }
    let options = Options { substeps: arguments.substeps.max(1), ..Options::default() };
    let mut simulated = Vec::new();
    for run in &experiment.runs {
        simulated.push(position::judge(&FitRun::of_run(&model, run)?, &options)?);
    }
    std::fs::create_dir_all(&arguments.out_dir)
        .map_err(|error| anyhow!("cannot make the folder {}: {error}", arguments.out_dir.display()))?;
    let mut table = Table::new(&[
        ("run", Align::Left),
        ("joint", Align::Right),
        ("off the log by, RMS", Align::Right),
        ("written", Align::Left),
    ]);
    let mut runs: Vec<Value> = Vec::new();
    for ((run, result), target) in experiment.runs.iter().zip(&simulated).zip(&targets) {
        write_new(target, &log(run, result), overwrite)?;
        for (joint, rmse) in run.free.iter().zip(&result.rmse) {
            table.row([run.file.clone(), joint.to_string(), format!("{rmse:.3e}"), target.display().to_string()]);
        }
        let joints: Vec<Value> =
            run.free.iter().zip(&result.rmse).map(|(joint, rmse)| json!({ "joint": joint, "rmse": rmse })).collect();
        runs.push(json!({ "file": run.file, "out": target.display().to_string(), "joints": joints }));
    }
    Ok(Outcome { text: table.text(), json: json!({ "runs": runs }), answer: Answer::Yes })
}

/// One file a run, named as its log; runs of the same log are numbered.
fn targets(experiment: &Experiment, arguments: &Arguments) -> anyhow::Result<Vec<PathBuf>> {
    let mut targets: Vec<PathBuf> = Vec::new();
    for (index, run) in experiment.runs.iter().enumerate() {
        let Some(name) = PathBuf::from(&run.file).file_name().map(PathBuf::from) else {
            bail!("run {} has no file name: `{}`", index + 1, run.file);
        };
        let plain = arguments.out_dir.join(&name);
        targets.push(if targets.contains(&plain) {
            let stem = name.file_stem().unwrap_or_default().to_string_lossy();
            arguments.out_dir.join(format!("{stem}-{}.csv", index + 1))
        } else {
            plain
        });
    }
    Ok(targets)
}

fn log(run: &Run, result: &RunError) -> String {
    let n_joints = run.log.q.len();
    let names = |kind: &str| (0..n_joints).map(|joint| format!(",{kind}{joint}")).collect::<String>();
    let mut text = format!("t{}{}\n", names("tau"), names("q"));
    for (sample, t) in run.log.t.iter().enumerate() {
        let _ = write!(text, "{t}");
        for column in &run.log.tau {
            let _ = write!(text, ",{}", column[sample]);
        }
        for joint in 0..n_joints {
            let q = match run.free.iter().position(|&free| free == joint) {
                Some(slot) => result.simulated[sample * run.free.len() + slot],
                None => run.log.q[joint][sample],
            };
            let _ = write!(text, ",{q}");
        }
        text.push('\n');
    }
    text
}
