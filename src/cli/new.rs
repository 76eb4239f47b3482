//! `dynid new`: an experiment and a model from logs and a device, every guess stated.

use std::fmt::Write;
use std::path::{Component, Path, PathBuf};

use anyhow::bail;
use dynid::{
    Device, FirstGuess, KnownOfLogs, Role, device_from_description, device_named, experiment_file, first_guess,
    model_file,
};
use dynid_files::{FileError, Overwrite, check_output, make_folder, write_together};
use dynid_first_guess::{ColumnGuess, RoleReason, RunGuess};
use dynid_format::number;
use dynid_sentences::{check, first_guess as sentences};
use serde_json::json;

use super::{Answer, Outcome};

/// Write an experiment and a model from logs and a device: columns, units, signs, free joints and runs to hold out are guessed,
/// each with its reason.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid new run-1.csv run-2.csv --device robot.urdf       writes experiment.toml, model.toml and robot.toml
  dynid new logs/*.csv --device my_robot.toml --out arm   into the folder arm, made where there is none
  dynid new log.csv --device planar2r --column tau1=motor_2 --free 0,1

Then `dynid fit experiment.toml --model model.toml --out fitted.toml` runs. What is guessed, and from what:
  columns   words and joints in their names (position[0], q_1, actual_q_0, elbow torque [Nm])
  units     a unit in a name, the sample rate, a speed column, jumps of a turn, what the device's values need for the motion
  signs     a torque against that motion which takes energy out of it
  joints    free are those that move by more than their noise
  runs      held out is what is named so, else the last fifth of the logs, else the last quarter of one

What the logs do not tell is one error, which says how to state it. The files say beside each guess why it was made.")]
pub struct Arguments {
    /// Logs of one header: CSV (also .gz, .zst), Parquet, Arrow, MATLAB or MCAP.
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// The robot: a device file, a URDF or an MJCF, or the name of a device that ships.
    #[arg(long)]
    pub device: String,
    /// The folder to write to.
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    out: PathBuf,
    /// Which column is what, where the guess is wrong: `--column q0=angle_a --column t=clock`.
    #[arg(long = "column", value_name = "OURS=LOG'S", value_parser = pair)]
    columns: Vec<(String, String)>,
    /// The joints that were free in all logs, where the motion does not tell, e.g. `--free 0,1`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Overwrite the files if they are there.
    #[arg(long)]
    force: bool,
}

const EXPERIMENT: &str = "experiment.toml";
const MODEL: &str = "model.toml";
const ROBOT: &str = "robot.toml";

/// Guesses and writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let Arguments { logs, device, out, columns, free, force } = arguments;
    let overwrite = Overwrite::if_forced(*force);
    // Files in the current folder are called by their names alone.
    let out: PathBuf = out.components().filter(|part| *part != Component::CurDir).collect();
    let at = |name: &str| out.join(name);
    for name in [EXPERIMENT, MODEL] {
        check_file(&at(name), overwrite)?;
    }
    let robot = robot(device, &at(ROBOT), overwrite)?;
    let known = KnownOfLogs { columns: columns.clone(), free: free.clone() };
    let guess = first_guess(robot.device, logs, &known)?;
    make_folder(&out)?;
    let mut files = vec![
        (at(EXPERIMENT), experiment_file(robot.device, logs, &guess, &out)),
        (at(MODEL), model_file(robot.device, &out)),
    ];
    files.extend(robot.file.clone().map(|text| (at(ROBOT), text)));
    write_together(&files, overwrite)?;

    let written: Vec<String> = files.iter().map(|(path, _)| path.display().to_string()).collect();
    let next = format!("dynid fit {} --model {} --out {}", written[0], written[1], at("fitted.toml").display());
    let mut json = sentences::json(&guess)?;
    json["device"] = robot.device.name_from(&out).into();
    json["device_notes"] = robot.notes.clone().into();
    json["logs"] = logs.iter().map(|log| log.display().to_string()).collect::<Vec<_>>().into();
    json["written"] = json!(written);
    json["next"] = next.clone().into();
    let text = text(&robot, logs, &guess) + &format!("written: {}\nnext: {next}\n", written.join(", "));
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// As [`check_output`]; a folder that is not there yet holds nothing to overwrite, and is made when all is known.
fn check_file(path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
    let is_to_be_made = path.parent().is_some_and(|folder| folder != Path::new("") && !folder.exists());
    if is_to_be_made { Ok(()) } else { check_output(path, overwrite) }
}

/// The device of the logs.
struct Robot {
    device: &'static Device,
    /// Its device file, where it was made from another description.
    file: Option<String>,
    notes: Vec<String>,
}

fn robot(name: &str, out: &Path, overwrite: Overwrite) -> anyhow::Result<Robot> {
    let path = Path::new(name);
    let is_description = path.extension().is_some_and(|extension| !extension.eq_ignore_ascii_case("toml"));
    if !is_description {
        return match device_named(name, Path::new("")) {
            Ok(device) => Ok(Robot { device, file: None, notes: Vec::new() }),
            Err(error) => bail!("--device {name}: {error}; {}", error.remedy()),
        };
    }
    check_file(out, overwrite)?;
    let imported = device_from_description(&dynid_files::read(path)?, path, None)?;
    let device = Device::parse_own(&imported.toml, out, out.to_owned())?;
    // As long as the process, like every device.
    let device: &'static Device = Box::leak(Box::new(device));
    Ok(Robot { device, file: Some(imported.toml), notes: imported.notes })
}

/// `q0=angle_a`
fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((ours, theirs)) if !ours.is_empty() && !theirs.is_empty() => Ok((ours.to_owned(), theirs.to_owned())),
        _ => Err("expected a name of dynid's and one of the log's, e.g. q0=angle_a".to_owned()),
    }
}

fn text(robot: &Robot, logs: &[PathBuf], guess: &FirstGuess) -> String {
    let joints = robot.device.joints.len();
    let mut text = format!("robot    {}, {joints} joint{}\n", robot.device.title, if joints == 1 { "" } else { "s" });
    for note in &robot.notes {
        let _ = writeln!(text, "         {note}");
    }
    for run in &guess.runs {
        let _ = writeln!(text, "log      {}", of_run(logs, run));
    }
    for kind in ["t", "q", "tau", "ref"] {
        let own: Vec<&ColumnGuess> = guess.columns.iter().filter(|column| column.kind() == kind).collect();
        if let Some(first) = own.first() {
            let names: Vec<String> =
                own.iter().map(|column| format!("{} is `{}`", column.logical, column.name)).collect();
            let _ = writeln!(text, "column   {} ({})", names.join(", "), sentences::column(first));
        }
    }
    for line in units(guess) {
        let _ = writeln!(text, "unit     {line}");
    }
    for remark in &guess.remarks {
        let _ = writeln!(text, "seen     {}", sentences::remark(remark));
    }
    for finding in check::findings(&guess.findings) {
        let _ = writeln!(text, "wrong?   {finding}");
    }
    text
}

fn of_run(logs: &[PathBuf], run: &RunGuess) -> String {
    let free: Vec<String> = run.free.iter().map(usize::to_string).collect();
    let part = run.rows.map_or(String::new(), |[from, to]| format!(" rows {from} to {to}"));
    let role = match run.role {
        Role::Fit => "to fit to",
        Role::Validate => "held out",
    };
    let why = match run.why {
        RoleReason::Rest => String::new(),
        ref why => format!(" ({})", sentences::role(why)),
    };
    format!(
        "{}{part}: {} samples, {} s at {} Hz; free: {}; {role}{why}",
        logs[run.log].display(),
        run.n_samples,
        number(run.duration_s),
        number(run.rate_hz),
        free.join(", ")
    )
}

/// Factors and their reasons, those of several columns that are alike on one line.
fn units(guess: &FirstGuess) -> Vec<String> {
    let mut said: Vec<(String, String, String)> = Vec::new();
    for column in &guess.columns {
        for factor in &column.factors {
            let (times, why) = (number(factor.factor), sentences::factor(column, factor));
            match said.iter_mut().find(|(_, other, because)| *other == times && *because == why) {
                Some((names, ..)) => *names += &format!(", {}", column.logical),
                None => said.push((column.logical.clone(), times, why)),
            }
        }
    }
    said.into_iter().map(|(names, times, why)| format!("{names} times {times}: {why}")).collect()
}
