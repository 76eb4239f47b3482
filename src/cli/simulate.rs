//! `dynid simulate`: what positions would the model have shown under the logged torques?

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use dynid::{Experiment, Run, SimulateSettings, Simulated};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_tables::{Format, ending};
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::table_file::{LogFormat, log_file};
use super::{Answer, Outcome, inputs, progress};

/// Play the commanded torques of every run on a model and write the positions that it shows.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid simulate experiment.toml --out-dir simulated                        the device's default model
  dynid simulate experiment.toml --model fitted.toml --out-dir simulated

Writes one log per run, named as the run's own: t, tau0.., q0..; locked joints stay where the log has them.
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
    /// What the logs are written as: csv, parquet or arrow.
    #[arg(long, value_name = "FORMAT", default_value = "csv")]
    format: LogFormat,
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
    let format = arguments.format.0;
    let targets = targets(&experiment, &arguments.out_dir, format)?;
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
        write_new(target, &log_file(log(run, result), format), overwrite)?;
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
fn targets(experiment: &Experiment, folder: &Path, format: Format) -> anyhow::Result<Vec<PathBuf>> {
    let files = experiment.runs.iter().map(|run| run.file.as_str());
    let names = names(files, format).map_err(|(number, file)| anyhow!("run {number} has no file name: `{file}`"))?;
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// A name of its own for each; else number (from 1) and path of the one without a name.
fn names<'a>(files: impl Iterator<Item = &'a str>, format: Format) -> Result<Vec<PathBuf>, (usize, &'a str)> {
    let mut names: Vec<PathBuf> = Vec::new();
    for (number, file) in (1..).zip(files) {
        let name = Path::new(file).file_name().ok_or((number, file))?.to_string_lossy();
        // Without the ending of any log, which may be of two parts: csv.gz.
        let stem = ending(Path::new(file)).map_or(&*name, |ending| &name[..name.len() - ending.len() - 1]);
        let named = |stem: &str| PathBuf::from(format!("{stem}.{}", format.ending()));
        let mut name = named(stem);
        let mut suffixes = number..;
        while names.contains(&name)
            && let Some(suffix) = suffixes.next()
        {
            name = named(&format!("{stem}-{suffix}"));
        }
        names.push(name);
    }
    Ok(names)
}

fn log(run: &Run, played: &Simulated) -> Vec<(String, Vec<f64>)> {
    let n_joints = run.log.q.len();
    let command = |joint: usize| played.command.iter().skip(joint).step_by(n_joints).copied().collect();
    let position = |joint: usize| match run.free.iter().position(|&free| free == joint) {
        Some(slot) => played.position.iter().skip(slot).step_by(run.free.len()).copied().collect(),
        None => run.log.q[joint].clone(),
    };
    let mut columns = vec![("t".to_owned(), run.log.t.clone())];
    columns.extend((0..n_joints).map(|joint| (format!("tau{joint}"), command(joint))));
    columns.extend((0..n_joints).map(|joint| (format!("q{joint}"), position(joint))));
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_runs_share_a_name() {
        let files = ["x-3.csv", "x.csv", "b/x.csv", "c/x.csv", "x-4.csv"];
        let names = names(files.into_iter(), Format::Csv).unwrap();
        assert_eq!(names, ["x-3.csv", "x.csv", "x-4.csv", "x-5.csv", "x-4-5.csv"].map(PathBuf::from));
    }

    #[test]
    fn names_end_as_what_is_written() {
        let files = ["logs/a.csv.gz", "a.parquet", "b.1"];
        let names = names(files.into_iter(), Format::Parquet).unwrap();
        assert_eq!(names, ["a.parquet", "a-2.parquet", "b.1.parquet"].map(PathBuf::from));
    }
}
