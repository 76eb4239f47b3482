//! `dynid tour`: the loop on a log that the program carries, and a page that shows it.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{anyhow, bail};
use dynid::experiment::{Experiment, Role, Run};
use dynid::fit::position::{FitRun, Options, RunError, judge};
use dynid::identify::{self, Identified};
use dynid::model::Model;
use dynid::output::{Overwrite, check_output, write_new};
use dynid::plot::Panel;
use dynid::report::{self, Errors, Figures, ParameterRow, Parameters, Provenance, Verdict, number};
use dynid::tour::{FILES, truth};
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, inputs, progress};

/// Identify one joint of a robot from logs that the program carries, and write a page that shows it.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid tour                     into dynid-tour, or dynid-tour-2 if that is there
  dynid tour --out-dir here      into a folder of your choice

The folder then holds all that the loop needs, to go on by hand: the experiment, its logs, the believed and the fitted
model, and report.html, which opens with no network.")]
pub struct Arguments {
    /// Where to; without it the first of dynid-tour, dynid-tour-2, .. that is not there.
    #[arg(long, value_name = "FOLDER")]
    out_dir: Option<PathBuf>,
    /// Overwrite the tour's files where they are there.
    #[arg(long)]
    force: bool,
}

const FITTED: &str = "fitted.toml";
const REPORT: &str = "report.html";

/// Walks through the loop beside the folder that it is for; a tour that fails leaves nothing behind.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = if arguments.force { Overwrite::Force } else { Overwrite::Refuse };
    let (folder, taken) = folder(arguments, overwrite)?;
    let mut partial = folder.clone().into_os_string();
    partial.push(format!(".{}.partial", std::process::id()));
    let partial = PathBuf::from(partial);
    let outcome = walk(&partial, &folder, taken.as_deref()).and_then(|outcome| {
        settle(&partial, &folder)?;
        Ok(outcome)
    });
    if outcome.is_err() {
        // the first error is the one to tell
        let _ = fs::remove_dir_all(&partial);
    }
    outcome
}

/// Does everything in `partial`; what is told is about `folder`.
fn walk(partial: &Path, folder: &Path, taken: Option<&Path>) -> anyhow::Result<Outcome> {
    fs::create_dir_all(partial).map_err(|error| anyhow!("cannot make the folder {}: {error}", partial.display()))?;
    let put = |name: &str, text: &str| write_new(&partial.join(name), text, Overwrite::Refuse);
    for (name, text) in FILES {
        put(name, text)?;
    }
    let experiment = inputs::experiment(&partial.join("experiment.toml"))?;
    let believed = inputs::model(Some(&partial.join("believed.toml")), &experiment)?;
    let runs: Vec<&Run> = experiment.runs.iter().collect();
    let options = Options::default();

    let before = errors(&believed, &runs, &options)?;
    let started = Instant::now();
    let error = identify::default_error(&believed, &runs);
    let found = progress::shown(|told| identify::identify(&believed, &experiment, &runs, error, &options, told))?;
    let fit_seconds = started.elapsed().as_secs_f64();
    let after = errors(&found.model, &runs, &options)?;

    let tour = Tour { experiment: &experiment, believed: &believed, before, found, after, fit_seconds };
    put(FITTED, &tour.found.model.to_toml())?;
    put(REPORT, &tour.page())?;
    Ok(Outcome { text: tour.story(folder, taken), json: tour.json(folder), answer: Answer::Yes })
}

/// Moves what was made to where it belongs.
fn settle(partial: &Path, folder: &Path) -> anyhow::Result<()> {
    let told = |error: std::io::Error| anyhow!("cannot write {}: {error}", folder.display());
    if !folder.exists() {
        return fs::rename(partial, folder).map_err(told);
    }
    for entry in fs::read_dir(partial).map_err(told)? {
        let entry = entry.map_err(told)?;
        fs::rename(entry.path(), folder.join(entry.file_name())).map_err(told)?;
    }
    fs::remove_dir(partial).map_err(told)
}

/// Where to write, and the name that was taken, if another had to be found.
fn folder(arguments: &Arguments, overwrite: Overwrite) -> anyhow::Result<(PathBuf, Option<PathBuf>)> {
    let plain = PathBuf::from("dynid-tour");
    let chosen = match &arguments.out_dir {
        Some(folder) => folder.clone(),
        None if overwrite == Overwrite::Force || !plain.exists() => plain.clone(),
        None => {
            let next =
                (2..1000).map(|number| PathBuf::from(format!("dynid-tour-{number}"))).find(|path| !path.exists());
            let Some(next) = next else {
                bail!("dynid-tour and its 998 successors are all there; give a folder with --out-dir");
            };
            return Ok((next, Some(plain)));
        }
    };
    if chosen.exists() && !chosen.is_dir() {
        bail!("{} is a file; give a folder with --out-dir", chosen.display());
    }
    if chosen.is_dir() {
        for name in FILES.map(|(name, _)| name).into_iter().chain([FITTED, REPORT]) {
            check_output(&chosen.join(name), overwrite)?;
        }
    }
    Ok((chosen, None))
}

fn errors(model: &Model, runs: &[&Run], options: &Options) -> anyhow::Result<Vec<RunError>> {
    runs.iter()
        .map(|run| {
            let run = FitRun::of_run(model, run).map_err(dynid::error::Error::from)?;
            Ok(judge(&run, options)?)
        })
        .collect()
}

struct Tour<'a> {
    experiment: &'a Experiment,
    believed: &'a Model,
    before: Vec<RunError>,
    found: Identified,
    after: Vec<RunError>,
    fit_seconds: f64,
}

/// A run with its errors before and after.
struct Judged<'a> {
    run: &'a Run,
    joint: usize,
    before: f64,
    after: f64,
    noise: f64,
}

impl Tour<'_> {
    fn judged(&self) -> Vec<Judged<'_>> {
        let mut judged = Vec::new();
        for (index, run) in self.experiment.runs.iter().enumerate() {
            let (before, after) = (&self.before[index], &self.after[index]);
            for (slot, &joint) in run.free.iter().enumerate() {
                let (before, noise, after) = (before.rmse[slot], after.noise[slot], after.rmse[slot]);
                judged.push(Judged { run, joint, before, after, noise });
            }
        }
        judged
    }

    /// The three sentences that matter.
    fn sentences(&self) -> Vec<String> {
        let judged = self.judged();
        let held_out: Vec<&Judged> = judged.iter().filter(|judged| judged.run.role == Role::Validate).collect();
        let open = self.found.parameters.iter().filter(|parameter| !parameter.identifiable).count();
        let mut sentences = vec![format!(
            "The fit moved {} parameters and took {} iterations and {:.1} s.",
            self.found.parameters.len(),
            self.found.iterations,
            self.fit_seconds
        )];
        for judged in held_out {
            sentences.push(format!(
                "On {}, which it never saw, the error fell from {} to {} rad RMS; the log's own noise is {} rad.",
                judged.run.file,
                number(judged.before),
                number(judged.after),
                number(judged.noise)
            ));
        }
        sentences.push(match open {
            0 => "Every parameter is determined by the logs.".to_owned(),
            _ => format!(
                "{open} of the parameters act only together with others, so the logs do not determine them one by one."
            ),
        });
        sentences
    }

    fn story(&self, folder: &Path, taken: Option<&Path>) -> String {
        let device = self.believed.device;
        let mut text = String::from("dynid tour: one joint of a robot, identified from logs\n\n");
        let free: Vec<String> = self
            .experiment
            .runs
            .first()
            .map(|run| {
                run.free.iter().map(|&joint| format!("joint {joint} ({})", device.joints[joint].title)).collect()
            })
            .unwrap_or_default();
        let _ = writeln!(
            text,
            "robot    {}: {} joints, {} links; {} is free, the others are locked",
            device.title,
            device.joints.len(),
            device.links.len(),
            free.join(", ")
        );
        for run in &self.experiment.runs {
            let seconds = run.log.t.last().copied().unwrap_or_default();
            let _ = writeln!(
                text,
                "log      {}: {} samples, {seconds:.0} s, {}",
                run.file,
                run.log.len(),
                match run.role {
                    Role::Fit => "to fit to",
                    Role::Validate => "to be judged by",
                }
            );
        }
        text.push_str("         made by an independent simulator (tests/plant), so the truth is known here\n\n");
        let mut table = Table::new(&[
            ("error, RMS [rad]", Align::Left),
            ("", Align::Left),
            ("believed", Align::Right),
            ("fitted", Align::Right),
            ("noise of the log", Align::Right),
        ]);
        for judged in self.judged() {
            table.row([
                judged.run.file.clone(),
                judged.run.role.to_string(),
                number(judged.before),
                number(judged.after),
                number(judged.noise),
            ]);
        }
        text.push_str(&table.text());
        text.push('\n');
        let truth = truth();
        let mut table = Table::new(&[
            ("parameter", Align::Left),
            ("believed", Align::Right),
            ("fitted", Align::Right),
            ("\u{b1}", Align::Right),
            ("truth", Align::Right),
            ("", Align::Left),
        ]);
        for parameter in &self.found.parameters {
            let told = |value: Option<f64>| value.map_or_else(|| "\u{2014}".to_owned(), number);
            table.row([
                parameter.name.clone(),
                number(parameter.start),
                number(parameter.value),
                told(parameter.std_error),
                told(truth.get(&parameter.name).copied()),
                if parameter.identifiable { String::new() } else { "not alone".to_owned() },
            ]);
        }
        text.push_str(&table.text());
        text.push('\n');
        for sentence in self.sentences() {
            let _ = writeln!(text, "{sentence}");
        }
        if let Some(taken) = taken {
            let _ = writeln!(text, "\n{} was there already and is kept.", taken.display());
        }
        let folder = folder.display();
        // as it was called: a fresh build is not on anybody's path
        let program = std::env::args().next().unwrap_or_else(|| "dynid".to_owned());
        let _ = writeln!(text, "\nThe page:  {folder}/{REPORT}");
        text.push_str("Go on by hand:\n");
        let _ = writeln!(text, "  {program} compare {folder}/experiment.toml --model {folder}/{FITTED}");
        let _ =
            writeln!(text, "  {program} fit {folder}/experiment.toml --model {folder}/believed.toml --out again.toml");
        text
    }

    fn json(&self, folder: &Path) -> Value {
        let runs: Vec<Value> = self
            .judged()
            .iter()
            .map(|judged| {
                json!({
                    "file": judged.run.file,
                    "role": judged.run.role.to_string(),
                    "joint": judged.joint,
                    "rmse_before": judged.before,
                    "rmse_after": judged.after,
                    "noise_floor": judged.noise,
                })
            })
            .collect();
        json!({
            "folder": folder.display().to_string(),
            "report": folder.join(REPORT).display().to_string(),
            "status": self.found.status.as_str(),
            "iterations": self.found.iterations,
            "wall_seconds": self.fit_seconds,
            "runs": runs,
        })
    }

    fn page(&self) -> String {
        let judged = self.judged();
        let errors = Errors {
            models: vec!["believed".to_owned(), "fitted".to_owned(), "noise of the log".to_owned()],
            rows: judged
                .iter()
                .map(|judged| {
                    let values = vec![judged.before, judged.after, judged.noise];
                    (judged.run.file.clone(), judged.run.role.to_string(), judged.joint, values)
                })
                .collect(),
            quantity: "RMS [rad]".to_owned(),
            note: "Measured minus simulated position. The runs to validate by took no part in the fit.".to_owned(),
        };
        let held_out = |errors: &[RunError], what: &str| Figures {
            title: format!("Held out: {what}"),
            panels: self
                .experiment
                .runs
                .iter()
                .zip(errors)
                .filter(|(run, _)| run.role == Role::Validate)
                .flat_map(|(run, error)| panels(run, error))
                .collect(),
            note: "Above: position. Below: what is left; the grey band is twice the log's noise.".to_owned(),
        };
        let truth = truth();
        let units: std::collections::BTreeMap<String, String> = self
            .believed
            .effects
            .iter()
            .flat_map(|instance| {
                instance
                    .effect
                    .parameters
                    .iter()
                    .enumerate()
                    .map(|(index, parameter)| (instance.parameter_name(index), parameter.unit.clone()))
            })
            .collect();
        let parameters = Parameters {
            rows: self
                .found
                .parameters
                .iter()
                .map(|parameter| ParameterRow {
                    name: parameter.name.clone(),
                    unit: units.get(&parameter.name).cloned().unwrap_or_else(|| inertial_unit(&parameter.name).to_owned()),
                    start: parameter.start,
                    value: parameter.value,
                    std_error: parameter.std_error,
                    identifiable: parameter.identifiable,
                    truth: truth.get(&parameter.name).copied(),
                })
                .collect(),
            note: "Truth: the values that the simulator used. Not alone: the logs determine it only together with others; \
                   it stays where the bounds and the believed value put it."
                .to_owned(),
        };
        let verdict = Verdict { sentences: self.sentences() };
        let provenance = Provenance {
            entries: vec![
                ("logs".to_owned(), format!("sha256 {}", self.experiment.digest)),
                ("believed model".to_owned(), format!("sha256 {}", self.believed.digest())),
                ("fitted model".to_owned(), format!("sha256 {}", self.found.model.digest())),
                ("device".to_owned(), self.believed.device.id.clone()),
                ("program".to_owned(), format!("dynid {}", env!("CARGO_PKG_VERSION"))),
                ("command".to_owned(), "dynid tour".to_owned()),
            ],
            ..Provenance::default()
        };
        report::page(
            "One joint of a robot, identified from its logs",
            &[
                &verdict,
                &errors,
                &held_out(&self.before, "the model as it was believed"),
                &held_out(&self.after, "the model as it was fitted"),
                &parameters,
                &provenance,
            ],
        )
    }
}

/// Unit of a link's inertial parameter, by its name.
fn inertial_unit(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("m") => "kg",
        Some("x" | "y" | "z") => "m",
        _ => "kg*m^2",
    }
}

fn panels(run: &Run, error: &RunError) -> Vec<Panel> {
    let n_free = run.free.len();
    run.free
        .iter()
        .enumerate()
        .map(|(slot, &joint)| Panel {
            title: format!("{}, joint {joint}", run.file),
            quantity: "position".to_owned(),
            unit: "rad".to_owned(),
            time: run.log.t.clone(),
            measured: run.log.q[joint].clone(),
            predicted: error.simulated.iter().skip(slot).step_by(n_free).copied().collect(),
            noise_floor: Some(error.noise[slot]),
        })
        .collect()
}
