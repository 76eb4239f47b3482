//! `dynid simulate`: what positions would the model have shown under the logged torques?

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use dynid::{Experiment, Run, SimulateSettings, Simulated};
use dynid_files::{Overwrite, check_output, write_new};
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, inputs, progress};

/// Play the commanded torques of every run on a model and write the positions that it shows.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid simulate experiment.toml --out-dir simulated                        the device's default model
  dynid simulate experiment.toml --model fitted.toml --out-dir simulated

Writes one CSV per run, in the format of the logs: t, tau0.., q0..; locked joints stay where the log has them.
Every run starts at the position that explains the log best, at rest unless it says moving = true. A planned run, whose
log holds what `dynid excite` wrote, has no positions yet: it says where all joints start, e.g. start = [0, 0.1]. A run
with a controller starts at the log's first position, and what its controller commands takes the place of the logged
torques.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Folder for the simulated logs; it is made if it is not there.
    #[arg(long, value_name = "FOLDER")]
    out_dir: PathBuf,
    /// Overwrite files that are there.
    #[arg(long)]
    force: bool,
    /// Integration steps per sample; without it, as few as an estimate of each interval's error asks for, within a
    /// ten-millionth of the motion.
    #[arg(long, value_name = "N")]
    substeps: Option<usize>,
}

/// Simulates every run, then writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let experiment = inputs::planned_experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let overwrite = Overwrite::if_forced(arguments.force);
    let targets = targets(&experiment, &arguments.out_dir)?;
    if arguments.out_dir.is_dir() {
        targets.iter().try_for_each(|target| check_output(target, overwrite))?;
    }
    let settings = SimulateSettings { substeps: arguments.substeps };
    let simulated = progress::counted("runs simulated", &|| false, |progress| {
        dynid::simulate(&model, &experiment, &settings, progress)
    })?;
    std::fs::create_dir_all(&arguments.out_dir)
        .map_err(|error| anyhow!("cannot make the folder {}: {error}", arguments.out_dir.display()))?;
    let mut table = Table::new(&[
        ("run", Align::Left),
        ("joint", Align::Right),
        ("off the log by, RMS", Align::Right),
        ("integration within", Align::Right),
        ("written", Align::Left),
    ]);
    let mut runs: Vec<Value> = Vec::new();
    for ((run, result), target) in experiment.runs.iter().zip(&simulated).zip(&targets) {
        write_new(target, &log(run, result), overwrite)?;
        let rmse = |slot: usize| result.rmse.as_ref().map(|rmse| rmse[slot]);
        for (slot, joint) in run.free.iter().enumerate() {
            let off = rmse(slot).map_or_else(|| "planned".to_owned(), |rmse| format!("{rmse:.3e}"));
            let within = format!("{:.0e}", result.integration[slot]);
            table.row([run.file.clone(), joint.to_string(), off, within, target.display().to_string()]);
        }
        let joints: Vec<Value> = run
            .free
            .iter()
            .enumerate()
            .map(|(slot, joint)| json!({ "joint": joint, "rmse": rmse(slot), "integration": result.integration[slot] }))
            .collect();
        runs.push(json!({ "file": run.file, "out": target.display().to_string(), "joints": joints }));
    }
    Ok(Outcome { text: table.text(), json: json!({ "runs": runs }), answer: Answer::Yes })
}

/// One file a run, named as its log; where that name is taken, it is numbered by its run, or further up until it is free.
fn targets(experiment: &Experiment, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let files = experiment.runs.iter().map(|run| run.file.as_str());
    let names = names(files).map_err(|(number, file)| anyhow!("run {number} has no file name: `{file}`"))?;
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// A name of its own for each; else number (from 1) and path of the one without a name.
fn names<'a>(files: impl Iterator<Item = &'a str>) -> Result<Vec<PathBuf>, (usize, &'a str)> {
    let mut names: Vec<PathBuf> = Vec::new();
    for (number, file) in (1..).zip(files) {
        let mut name = PathBuf::from(Path::new(file).file_name().ok_or((number, file))?);
        let stem = name.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut suffixes = number..;
        while names.contains(&name)
            && let Some(suffix) = suffixes.next()
        {
            name = PathBuf::from(format!("{stem}-{suffix}.csv"));
        }
        names.push(name);
    }
    Ok(names)
}

fn log(run: &Run, played: &Simulated) -> String {
    let n_joints = run.log.q.len();
    let names = |kind: &str| (0..n_joints).map(|joint| format!(",{kind}{joint}")).collect::<String>();
    let mut text = format!("t{}{}\n", names("tau"), names("q"));
    for (sample, t) in run.log.t.iter().enumerate() {
        let _ = write!(text, "{t}");
        for torque in &played.command[sample * n_joints..(sample + 1) * n_joints] {
            let _ = write!(text, ",{torque}");
        }
        for joint in 0..n_joints {
            let q = match run.free.iter().position(|&free| free == joint) {
                Some(slot) => played.position[sample * run.free.len() + slot],
                None => run.log.q[joint][sample],
            };
            let _ = write!(text, ",{q}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_runs_share_a_name() {
        let files = ["x-3.csv", "x.csv", "b/x.csv", "c/x.csv", "x-4.csv"];
        let names = names(files.into_iter()).unwrap();
        assert_eq!(names, ["x-3.csv", "x.csv", "x-4.csv", "x-5.csv", "x-4-5.csv"].map(PathBuf::from));
    }
}
