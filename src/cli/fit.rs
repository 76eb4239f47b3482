//! `dynid fit`: parameters from logs.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, anyhow};
use clap::ValueEnum;
use dynid::{Begin, Checkpoint, ErrorSignal, FitResult, FitSettings, FitSettingsError, Model, Weighting};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_identify::{checkpoint, position::Options};
use dynid_user_model::ErrorShare;
use serde_json::json;

use super::inputs::{self, Outside};
use super::interrupt::Interrupt;
use super::table::{Align, Table};
use super::{Answer, Outcome, compare, progress};

/// Fit a model's parameters to the runs whose role is `fit`, and judge it on the others.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid fit experiment.toml --out fitted.toml                        from the device's default model
  dynid fit experiment.toml --model believed.toml --out fitted.toml
  dynid fit experiment.toml --free 4 --out wrist.toml                only runs with just joint 4 free
  dynid fit experiment.toml --error torque --out fitted.toml
  dynid fit experiment.toml --method isolated --out fitted.toml      configuration after configuration, then all
  dynid fit experiment.toml --method isolated --out fitted.toml --resume      go on where Ctrl-C stopped it
  dynid fit experiment.toml --free 4 --starts 10 --out wrist.toml    do other starts end at the same cost?

Fitted is whatever the model does not fix and the runs depend on, within its bounds; links stay bodies that can be.

Which error is made small:
  prediction measured position minus the one predicted from the samples before (the likelihood of the logs)
  position   measured position minus the one simulated from the commanded torque
  torque     commanded torque minus the one that the measured, filtered motion needs
  both       torque first, then position from there
Without --error it is that of predictions, in open and in closed loop, whether a simulation follows the logs or not; with
--method, --starts or a weight of the first half it is position. The result says which it was.

A log is taken to begin at rest. One that does not, e.g. a part of a longer one, says moving = true in the experiment,
beside its file; then its initial speeds are estimated with its initial positions.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The model to start from; without it, the device's default.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Where to write the fitted model.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Overwrite the output if it is there, and what an unfinished fit kept for it.
    #[arg(long)]
    force: bool,
    /// Which error to make small.
    #[arg(long, value_enum)]
    error: Option<Kind>,
    /// Fit one configuration of this method of the device (or of `found`, the sequence that `dynid plan` finds) after
    /// another, each with what the earlier ones found, then all their runs together (position error).
    #[arg(long, value_name = "METHOD", conflicts_with = "free")]
    method: Option<String>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Integration steps per sample of the position error; without it, as few as move no position by more than about a
    /// hundredth of its log's noise. The thesis takes 60.
    #[arg(long, value_name = "N")]
    substeps: Option<usize>,
    /// Iterations at most.
    #[arg(long, value_name = "N", default_value_t = Options::default().iterations)]
    iterations: usize,
    /// Fit only these parameters: names, or patterns with `*`, e.g. `--only 'joint.4.*,link.7.Izz'`.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    only: Option<Vec<String>>,
    /// What weighs the joints' errors along a method: their noise alone, or the method's own weights on top (thesis
    /// Table 4.6) in the steps; the last fit of all runs weighs by noise.
    #[arg(long, value_enum, default_value_t = Weights::Noise)]
    weights: Weights,
    /// Leave so much of every log's beginning out of the position error, for its transient (thesis Eq. 4.3: 10 s). Also
    /// `from_s` in the experiment.
    #[arg(long, value_name = "SECONDS")]
    from_s: Option<f64>,
    /// Weight of the position error in the first half of every log (thesis Eq. 4.2: 0.5). Also `first_half` in the
    /// experiment.
    #[arg(long, value_name = "WEIGHT")]
    first_half: Option<f64>,
    /// Try so many starts, the model's own and others drawn within the bounds, and keep the best.
    #[arg(long, value_name = "N", default_value_t = 1)]
    starts: usize,
    /// What the starts are drawn from: the same seed, the same starts.
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Put a start that lies outside its stated bounds on the nearest one, and make a link that no body can be one near by,
    /// instead of refusing them.
    #[arg(long)]
    clip: bool,
    /// Go on with a fit that was stopped: ends with the same bits as one that was not.
    #[arg(long)]
    resume: bool,
}

/// What weighs the joints' errors along a method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Weights {
    Noise,
    Method,
}

/// What a fit makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    Torque,
    Position,
    Both,
    Prediction,
}

impl From<Kind> for ErrorSignal {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Torque => Self::Torque,
            Kind::Position => Self::Position,
            Kind::Both => Self::Both,
            Kind::Prediction => Self::Prediction,
        }
    }
}

/// Fits, judges, writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let overwrite = Overwrite::if_forced(arguments.force);
    check_output(&arguments.out, overwrite)?;
    let experiment = inputs::experiment(&arguments.experiment)?;
    let outside = if arguments.clip { Outside::Clip } else { Outside::Refuse };
    let model = inputs::start(arguments.model.as_deref(), &experiment, outside)
        .map_err(|error| or_clip(error, arguments.model.as_deref(), outside))?;
    let settings = settings(arguments);
    let mut interrupt = None;
    let mut deaf = None;
    // A fit of the torque error takes seconds: Ctrl-C ends it at once, and so it is not listened for.
    let mut stop = |begun: Option<ErrorSignal>| {
        if begun.is_some_and(|error| error != ErrorSignal::Torque) && interrupt.is_none() {
            match Interrupt::listen() {
                Ok(listening) => interrupt = Some(listening),
                Err(error) => deaf = Some(error),
            }
        }
        deaf.is_some() || interrupt.as_ref().is_some_and(Interrupt::is_asked)
    };
    let found = progress::of_fit(&mut stop, |progress| dynid::fit(&model, &experiment, &settings, progress));
    if let Some(error) = deaf {
        return Err(error);
    }
    let path = checkpoint::path_beside(&arguments.out);
    if let Err(Some(iterations)) = found.as_ref().map_err(dynid::Error::interrupted_after) {
        return Ok(interrupted(&path, iterations, started.elapsed().as_secs_f64()));
    }
    let found = found.map_err(as_options)?;
    let runs = experiment.runs_with_free(arguments.free.as_deref())?;
    let judged = dynid_judge::compare::compare(&found.model, &runs)?;

    let may_write = found.status.may_update_model();
    if may_write {
        write_new(&arguments.out, &found.model.to_toml_at(&arguments.out), overwrite)?;
    }
    checkpoint::remove(&path).with_context(|| format!("cannot remove {}", path.display()))?;
    let wall_seconds = started.elapsed().as_secs_f64();
    let mut json = dynid::sentences::fit::json(&model, &found, &judged);
    if let Some(object) = json.as_object_mut() {
        object.insert("wall_seconds".to_owned(), json!(wall_seconds));
        let out = may_write.then(|| arguments.out.display().to_string());
        object.insert("out".to_owned(), json!(out));
    }
    let mut text = as_text(&found, wall_seconds);
    text.push_str(&compare::summary(&judged));
    text.push_str(&if may_write {
        format!("written: {}\n", arguments.out.display())
    } else {
        "nothing was written: the fit did not end at a minimum; start from other values, or allow more iterations \
         (--iterations)\n"
            .to_owned()
    });
    Ok(Outcome { text, json, answer: if may_write { Answer::Yes } else { Answer::No } })
}

/// Says that `--clip` would help, where it would.
fn or_clip(error: anyhow::Error, path: Option<&Path>, outside: Outside) -> anyhow::Error {
    let is_clippable = |path: &Path| Model::load(path).is_err() && Model::load_clipped(path).is_ok();
    let helps = outside == Outside::Refuse && path.is_some_and(is_clippable);
    if helps {
        anyhow!("{}; or let --clip start from the nearest value allowed", super::with_causes(&error))
    } else {
        error
    }
}

/// What is asked for, as the library takes it.
fn settings(arguments: &Arguments) -> FitSettings {
    let begin = match (arguments.resume, arguments.force) {
        (true, _) => Begin::Resume,
        (false, true) => Begin::Overwrite,
        (false, false) => Begin::New,
    };
    FitSettings {
        error: arguments.error.map(ErrorSignal::from),
        free: arguments.free.clone(),
        method: arguments.method.clone(),
        weighting: match arguments.weights {
            Weights::Noise => Weighting::ByNoise,
            Weights::Method => Weighting::OfMethod,
        },
        only: arguments.only.clone().unwrap_or_default(),
        starts: arguments.starts,
        seed: arguments.seed,
        from_s: arguments.from_s,
        first_half: arguments.first_half,
        substeps: arguments.substeps,
        iterations: arguments.iterations,
        checkpoint: Some(Checkpoint { path: checkpoint::path_beside(&arguments.out), begin }),
    }
}

/// An error of the settings, said of the options that gave them.
fn as_options(error: dynid::Error) -> anyhow::Error {
    let dynid::Error::FitSettings(wrong) = error else { return error.into() };
    let text = match wrong {
        FitSettingsError::MethodOfTorque => {
            "a method is fitted to the position error; leave --error out, or use --free with --error torque"
        }
        FitSettingsError::PositionOnly => {
            "--starts and --first-half belong to the position error, --from-s and --resume to that of predictions, too, and \
             another is fitted here; leave them out, or say --error position"
        }
        FitSettingsError::WeightsWithoutMethod => {
            "--weights method weighs the steps of a method; say which with --method, or leave it out"
        }
        FitSettingsError::FromBelowZero => "--from-s takes a time after the log's first sample [s], not below 0",
        FitSettingsError::FirstHalfNotPositive => "--first-half takes a positive weight; the thesis's is 0.5",
    };
    anyhow!(text)
}

fn interrupted(checkpoint: &Path, iterations: usize, wall_seconds: f64) -> Outcome {
    let path = checkpoint.display();
    Outcome {
        text: format!(
            "stopped after {iterations} iterations of the search under way, {wall_seconds:.1} s; nothing is lost: \
             the same command with --resume goes on from {path}\n"
        ),
        json: json!({
            "status": "interrupted",
            "checkpoint": path.to_string(),
            "wall_seconds": wall_seconds,
        }),
        answer: Answer::Interrupted,
    }
}

fn as_text(found: &FitResult, wall_seconds: f64) -> String {
    let mut text = format!(
        "{} error: {} after {} iterations, {wall_seconds:.1} s; cost {} -> {}\n",
        found.error,
        found.status.as_str(),
        found.iterations,
        found.cost_before.map_or_else(|| "\u{2014}".to_owned(), number),
        number(found.cost_after)
    );
    let mut table = Table::new(&[
        ("parameter", Align::Left),
        ("start", Align::Right),
        ("fitted", Align::Right),
        ("\u{b1}", Align::Right),
        ("", Align::Left),
    ]);
    for parameter in &found.parameters {
        let mut flags = Vec::new();
        if !parameter.identifiable {
            flags.push("not determined by itself");
        }
        if parameter.held {
            flags.push("held by its bound");
        }
        table.row([
            parameter.name.clone(),
            number(parameter.start),
            number(parameter.value),
            parameter.std_error.map_or_else(|| "\u{2014}".to_owned(), number),
            flags.join(", "),
        ]);
    }
    text.push_str(&table.text());
    text.push_str(&open(found));
    text.push_str(&correlated(found));
    text.push_str(&steps(found));
    text.push_str(&budget(&found.budget));
    text.push_str(&tried(found));
    for note in &found.notes {
        let _ = writeln!(text, "note: {note}");
    }
    text
}

fn open(found: &FitResult) -> String {
    let mut text = String::new();
    if !found.open.is_empty() {
        let n_open = found.open.len();
        text.push_str(&format!(
            "{n_open} combination{} of parameters the data leave open; each keeps what the start says:\n",
            if n_open == 1 { "" } else { "s" }
        ));
        for parts in &found.open {
            let shown: Vec<String> = parts.iter().take(5).map(|(name, _)| name.clone()).collect();
            let more = if parts.len() > 5 { format!(" and {} more", parts.len() - 5) } else { String::new() };
            text.push_str(&format!("  {}{more}\n", shown.join(", ")));
        }
    }
    text
}

/// The pairs that are told apart worst.
fn correlated(found: &FitResult) -> String {
    /// Below this two parameters are told apart well enough.
    const STRONG: f64 = 0.95;
    const AT_MOST: usize = 5;
    let strong: Vec<_> = found.correlations.iter().filter(|pair| pair.value.abs() >= STRONG).take(AT_MOST).collect();
    if strong.is_empty() {
        return String::new();
    }
    let mut text = String::from("told apart worst (correlation of their errors; more in --json):\n");
    for pair in strong {
        let _ = writeln!(text, "  {:+.4}  {}, {}", pair.value, pair.one, pair.other);
    }
    text
}

/// What each configuration of a method gave before the fit of all runs.
fn steps(found: &FitResult) -> String {
    if found.steps.is_empty() {
        return String::new();
    }
    let mut table = Table::new(&[
        ("configuration", Align::Left),
        ("free", Align::Left),
        ("iterations", Align::Right),
        ("position RMS of each", Align::Left),
        ("", Align::Left),
    ]);
    for step in &found.steps {
        let joined = |parts: Vec<String>| parts.join(" ");
        table.row([
            step.configuration.to_string(),
            joined(step.free.iter().map(|joint| format!("q{joint}")).collect()),
            step.iterations.to_string(),
            joined(step.rmse.iter().map(|rmse| number(*rmse)).collect()),
            step.status.clone(),
        ]);
    }
    format!("the configurations, one after another, before the fit of all runs:\n{}", table.text())
}

/// Where each joint's remaining error comes from.
pub fn budget(shares: &[ErrorShare]) -> String {
    let Some(first) = shares.first() else { return String::new() };
    let mut columns: Vec<(String, Align)> = vec![
        ("configuration".to_owned(), Align::Left),
        ("joint".to_owned(), Align::Right),
        ("noise".to_owned(), Align::Right),
        ("residual".to_owned(), Align::Right),
        ("model off by".to_owned(), Align::Right),
    ];
    columns.extend(first.from.iter().map(|source| (format!("from {}", source.configuration), Align::Right)));
    columns.push(("from ranges".to_owned(), Align::Right));
    let columns: Vec<(&str, Align)> = columns.iter().map(|(name, align)| (name.as_str(), *align)).collect();
    let mut table = Table::new(&columns);
    for share in shares {
        let mut cells = vec![
            share.configuration.to_string(),
            share.joint.to_string(),
            number(share.noise_floor),
            number(share.rmse),
            number(share.remaining),
        ];
        cells.extend(share.from.iter().map(|source| number(source.rms)));
        cells.push(number(share.range));
        table.cells(cells);
    }
    format!(
        "error budget [rad or m, RMS]: how far each joint of the model may be off, and which configuration's noise (or \
         a range that no data narrow) that comes from:\n{}",
        table.text()
    )
}

/// What came of each start.
fn tried(found: &FitResult) -> String {
    let mut text = String::new();
    for (number_of, tried) in found.tried.iter().enumerate() {
        let kept = if number_of == found.best_start { ", kept" } else { "" };
        let cost = tried.cost.map_or_else(|| "\u{2014}".to_owned(), number);
        let _ = writeln!(text, "start {}: cost {cost}, {}{kept}", number_of + 1, tried.ended);
    }
    text
}
