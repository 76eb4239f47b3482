//! The command line: verbs, each a file; this one reads the arguments and is the only one that prints results.
//!
//! A verb returns an [`Outcome`]: text for people, one JSON object for programs, and whether the answer is yes. Results
//! go to stdout, progress and errors to stderr.

/// Tells something on stderr. Whoever reads it may have read enough, which is no reason to die, as `eprintln!` would.
macro_rules! say {
    ($($told:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stderr(), $($told)*);
    }};
}

mod add;
mod check;
mod compare;
mod device;
mod devices;
mod diagnose;
mod excite;
mod export;
mod fit;
mod fleet;
mod inputs;
mod interrupt;
mod job;
mod ladder;
mod named;
mod new;
mod open;
mod plan;
mod progress;
pub mod readers;
mod report;
mod simulate;
mod table;
mod table_file;
mod tabulate;
mod tour;
mod wall;

use std::env;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use clap::{Parser, Subcommand};
use dynid_model::error::shortened;

/// Identify the dynamics of a robot from logged torques and positions.
#[derive(Parser)]
#[command(name = "dynid", version, max_term_width = 100, after_help = HELP)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
    /// Print one JSON object on stdout, and nothing else there.
    #[arg(long, global = true)]
    json: bool,
    /// A folder of effect files of your own, which join the library. Without it, that of the environment variable
    /// DYNID_EFFECTS; without that, `effects` beside the model or the experiment, where there is one.
    #[arg(long, global = true, value_name = "DIR")]
    effects: Option<PathBuf>,
    /// How progress is told on stderr: bars where that is a terminal, or one JSON object a line.
    #[arg(long, global = true, value_enum, value_name = "FORM", default_value = "bars", hide_short_help = true)]
    progress: progress::Form,
    /// Stop as by Ctrl-C once stdin ends: then the program that started this one has ended, or wishes so.
    #[arg(long, global = true, hide = true)]
    stop_with_stdin: bool,
}

const HELP: &str = "\
The loop, all of it plain files:
  dynid new      run-1.csv run-2.csv --device robot.urdf         an experiment and a model, guessed from logs
  dynid plan     freedom6s --method isolated                     which joints to free, and what that reveals
  dynid excite   freedom6s --list                                what to play on the robot
  dynid check    experiment.toml                                 what the logs cannot answer, and what looks wrong
  dynid fit      experiment.toml --out fitted.toml               parameters from logs
  dynid compare  experiment.toml --model fitted.toml             how far off, and where
  dynid diagnose experiment.toml --model fitted.toml             which effect is missing
  dynid add      coulomb --joint 2 --model fitted.toml --out better.toml
  dynid ladder   experiment.toml believed.toml fitted.toml       models of a lineage on the same runs
  dynid report   experiment.toml fitted.toml --out report.html   one page that opens with no network
  dynid table    believed.toml fitted.toml                       parameters side by side, with their errors
  dynid simulate experiment.toml --model fitted.toml --out-dir runs
  dynid export   fitted.toml --as c --out robot.c                for other programs: also URDF, MJCF, JSON
  dynid wall     compare --model fitted.toml                     virtual walls, touched by many hands
  dynid open     experiment.toml                                 all of it on a live page
  dynid job      jobs --out results --shard 1/16                 the same for many robots and nights
  dynid fleet    results --out fleet.html                        what has changed on which, and since when

A robot of your own? `dynid new --help` if you have logs; else `dynid device import robot.urdf --out robot.toml`.
Never seen it work? `dynid tour` goes through this loop on logs that it carries, in seconds.

Exit status: 0 done; 1 it worked and the answer is no; 2 bad input, with one error that says what and where; 130 Ctrl-C
stopped it: `fit` goes on with --resume, `diagnose` with the same command.";

#[derive(Subcommand)]
enum Verb {
    /// An experiment and a model from logs and a device, every guess stated.
    New(new::Arguments),
    /// What is known about the devices: joints, links, configurations, default effects.
    Devices(devices::Arguments),
    /// A device file from a URDF or an MJCF.
    Device(device::Arguments),
    /// Which joints to free, in which order, and what each step reveals.
    Plan(plan::Arguments),
    /// What to play on the robot so that its motion tells the parameters.
    Excite(Box<excite::Arguments>),
    /// The positions that a model shows under the torques of the logs.
    Simulate(simulate::Arguments),
    /// What logs cannot answer, how to excite what is missing, and what looks wrong in them.
    Check(check::Arguments),
    /// Parameters from logs.
    Fit(fit::Arguments),
    /// How far a model is from the logs, and where.
    Compare(compare::Arguments),
    /// Which physical effect a model lacks, and where.
    Diagnose(diagnose::Arguments),
    /// A model with one effect more.
    Add(add::Arguments),
    /// The models of a lineage on the same runs: watch the error fall.
    Ladder(ladder::Arguments),
    /// One page with all that is known of a model and its logs.
    Report(report::Arguments),
    /// Parameters of several models side by side.
    Table(tabulate::Arguments),
    /// The loop on a live page, in the browser.
    Open(open::Arguments),
    /// See the loop done, in seconds, on logs that the program carries.
    Tour(tour::Arguments),
    /// A model for other programs: URDF, MJCF, C or JSON.
    Export(export::Arguments),
    /// Touch a virtual wall: walls under many hands, and better walls.
    Wall(wall::Arguments),
    /// The same work on many experiments, models or seeds.
    Job(job::Arguments),
    /// What has changed on which of many robots, and since when.
    Fleet(fleet::Arguments),
}

/// What a verb has to say.
struct Outcome {
    /// For people.
    text: String,
    /// For programs; one object.
    json: serde_json::Value,
    answer: Answer,
}

#[derive(PartialEq)]
enum Answer {
    Yes,
    No,
    /// Stopped on request, to go on later.
    Interrupted,
}

impl Verb {
    /// The files that it reads: models and experiments, then device files. An id of a device lies nowhere.
    fn inputs(&self) -> Vec<&Path> {
        fn model_and_experiment<'a>(model: &'a Option<PathBuf>, experiment: &'a Path) -> Vec<&'a Path> {
            model.as_deref().into_iter().chain([experiment]).collect()
        }
        fn paths(paths: &[PathBuf]) -> impl Iterator<Item = &Path> {
            paths.iter().map(PathBuf::as_path)
        }
        match self {
            Verb::New(own) => vec![Path::new(&own.device)],
            Verb::Device(_) | Verb::Tour(_) | Verb::Job(_) | Verb::Fleet(_) => Vec::new(),
            Verb::Open(own) => own.files(),
            Verb::Devices(own) => {
                own.check.as_deref().into_iter().chain(own.device.as_deref().map(Path::new)).collect()
            }
            Verb::Plan(own) => own.model.as_deref().into_iter().chain(own.device.as_deref().map(Path::new)).collect(),
            Verb::Excite(own) => {
                let device = own.device.as_deref().map(Path::new);
                own.model.as_deref().into_iter().chain(paths(&own.between)).chain(device).collect()
            }
            Verb::Simulate(own) => model_and_experiment(&own.model, &own.experiment),
            Verb::Check(own) => model_and_experiment(&own.model, &own.experiment),
            Verb::Fit(own) => model_and_experiment(&own.model, &own.experiment),
            Verb::Compare(own) => model_and_experiment(&own.model, &own.experiment),
            Verb::Diagnose(own) => model_and_experiment(&own.model, &own.experiment),
            Verb::Add(own) => vec![&own.model],
            Verb::Export(own) => vec![&own.model],
            Verb::Ladder(own) => paths(&own.models).chain([own.experiment.as_path()]).collect(),
            Verb::Report(own) => paths(&own.models).chain([own.experiment.as_path()]).collect(),
            Verb::Table(own) => paths(&own.models).collect(),
            Verb::Wall(own) => own.files(),
        }
    }
}

/// The folder of a user's effects that was named, by an option or the environment.
fn own_effects(arguments: &Arguments) -> Option<PathBuf> {
    let named = || env::var_os("DYNID_EFFECTS").filter(|folder| !folder.is_empty()).map(PathBuf::from);
    arguments.effects.clone().or_else(named)
}

/// The folder of a user's effects that joins the library: one that was named, or one beside what is read.
fn effects_beside(arguments: &Arguments) -> Option<PathBuf> {
    let beside = || {
        let of_input = |path: &Path| if path.is_dir() { path.join("effects") } else { path.with_file_name("effects") };
        let mut folders = arguments.verb.inputs().into_iter().map(of_input);
        folders.find(|folder| folder.is_dir())
    };
    own_effects(arguments).or_else(beside)
}

/// Lets a user's effects join the library.
fn read_effects(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(folder) = effects_beside(arguments) {
        dynid_model::add_effects(&folder)?;
    }
    Ok(())
}

fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.verb {
        Verb::New(arguments) => new::run(arguments),
        Verb::Devices(arguments) => devices::run(arguments),
        Verb::Device(arguments) => device::run(arguments),
        Verb::Plan(arguments) => plan::run(arguments),
        Verb::Excite(arguments) => excite::run(arguments),
        Verb::Simulate(arguments) => simulate::run(arguments),
        Verb::Check(arguments) => check::run(arguments),
        Verb::Fit(arguments) => fit::run(arguments),
        Verb::Compare(arguments) => compare::run(arguments),
        Verb::Diagnose(arguments) => diagnose::run(arguments),
        Verb::Add(arguments) => add::run(arguments),
        Verb::Ladder(arguments) => ladder::run(arguments),
        Verb::Report(arguments) => report::run(arguments),
        Verb::Table(arguments) => tabulate::run(arguments),
        Verb::Open(_) | Verb::Tour(tour::Arguments { open: true, .. }) if arguments.json => {
            anyhow::bail!("`open` prints an address, no JSON: leave --json out")
        }
        Verb::Open(own) => open::run(own, own_effects(arguments).as_deref()),
        Verb::Tour(own) => {
            let (outcome, made) = tour::run(own)?;
            if !own.open || outcome.answer != Answer::Yes {
                return Ok(outcome);
            }
            print(&outcome, false)?;
            open::run(&made, own_effects(arguments).as_deref())
        }
        Verb::Export(arguments) => export::run(arguments),
        Verb::Wall(arguments) => wall::run(arguments),
        Verb::Job(own) => job::run(own, own_effects(arguments).as_deref()),
        Verb::Fleet(arguments) => fleet::run(arguments),
    }
}

/// The command that runs this program once more, where that is not its own file.
static PROGRAM: OnceLock<Vec<OsString>> = OnceLock::new();

/// Reads the arguments (the first is the program's name), runs the verb, prints and returns the exit status. What is run once more, for
/// jobs, is this program's own file, or the command `again`.
pub fn main(arguments: impl IntoIterator<Item = OsString>, again: Option<Vec<OsString>>) -> u8 {
    if let Some(again) = again.filter(|again| !again.is_empty()) {
        // It is said once a process.
        let _ = PROGRAM.set(again);
    }
    let arguments = Arguments::parse_from(arguments);
    progress::choose(arguments.progress);
    if arguments.stop_with_stdin {
        interrupt::when_stdin_ends();
    }
    let result = read_effects(&arguments).and_then(|()| outcome(&arguments));
    match result.and_then(|outcome| print(&outcome, arguments.json).map(|()| outcome.answer)) {
        Ok(Answer::Yes) => 0,
        Ok(Answer::No) => 1,
        Ok(Answer::Interrupted) => interrupt::STATUS,
        Err(error) => {
            say!("error: {}", told(&error));
            2
        }
    }
}

/// Bytes of an error: it quotes what stands in a file, which may be the names of any number of columns.
const LONGEST_ERROR: usize = 8000;

/// What the program says of an error.
fn told(error: &anyhow::Error) -> String {
    shortened(with_causes(error), LONGEST_ERROR)
}

/// An error with its causes, but for those that it names itself.
fn with_causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |told, cause| match told.as_str() {
        "" => cause,
        told if told.contains(&cause) => told.to_owned(),
        told => format!("{told}: {cause}"),
    })
}

/// Runs the verb, and says in JSON where kernels are interpreted, which is slower.
fn outcome(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut outcome = run(arguments)?;
    note_kernels(&mut outcome.json);
    Ok(outcome)
}

/// The command that runs this very program once more, even where its file was replaced since it began.
fn program() -> std::io::Result<Command> {
    if let Some([program, first @ ..]) = PROGRAM.get().map(Vec::as_slice) {
        let mut command = Command::new(program);
        command.args(first);
        return Ok(command);
    }
    let running = Path::new("/proc/self/exe");
    Ok(Command::new(if running.exists() { running.to_owned() } else { env::current_exe()? }))
}

fn note_kernels(json: &mut serde_json::Value) {
    if let (true, Some(object)) = (dynid_kernels::are_interpreted(), json.as_object_mut()) {
        object.insert("kernels".to_owned(), "interpreted".into());
    }
}

fn print(outcome: &Outcome, json: bool) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    let written = if json { writeln!(stdout, "{}", outcome.json) } else { write!(stdout, "{}", outcome.text) };
    match written.and_then(|()| stdout.flush()) {
        // whoever reads has read enough, e.g. `dynid devices | head -1`
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => Ok(written?),
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use anyhow::Context;

    use super::*;

    #[test]
    fn an_error_is_told_with_its_causes_and_each_once() {
        let cause = || io::Error::other("the disk is full");
        let outer = Err::<(), _>(cause()).context("cannot remove x").unwrap_err();
        assert_eq!(with_causes(&outer), "cannot remove x: the disk is full");
        let named = dynid_files::FileError::Unwritable { path: "x".into(), source: cause() };
        assert_eq!(with_causes(&named.into()), "cannot write x: the disk is full; nothing was written");
    }
}
