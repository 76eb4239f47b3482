//! `dynid fit`: parameters from logs.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use clap::ValueEnum;
use dynid::experiment::Run;
use dynid::fit::position::Options;
use dynid::fit::sequence::Weighting;
use dynid::identify::{self, ErrorKind, Found, Identified};
use dynid::output::{Overwrite, check_output, write_new};
use dynid::report::number;
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, compare, inputs, progress};

/// Fit a model's parameters to the runs whose role is `fit`, and judge it on the others.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid fit experiment.toml --out fitted.toml                        from the device's default model
  dynid fit experiment.toml --model believed.toml --out fitted.toml
  dynid fit experiment.toml --free 4 --out wrist.toml                only runs with just joint 4 free
  dynid fit experiment.toml --error torque --out fitted.toml
  dynid fit experiment.toml --method isolated --out fitted.toml      configuration after configuration, then all

Fitted is whatever the model does not fix and the runs depend on, within its bounds; links stay bodies that can be.

Which error is made small:
  position   measured position minus the one simulated from the commanded torque
  torque     commanded torque minus the one that the measured, filtered motion needs
  both       torque first, then position from there
Without --error it is position where the model has a rest position (a spring) at every free joint of every run and no
run is in closed loop, for then the simulation stays near the log; torque otherwise. The result says which it was.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    experiment: PathBuf,
    /// The model to start from; without it, the device's default.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Where to write the fitted model.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Overwrite the output if it is there.
    #[arg(long)]
    force: bool,
    /// Which error to make small.
    #[arg(long, value_enum)]
    error: Option<Kind>,
    /// Fit one configuration of this method of the device after another, each with what the earlier ones found, then
    /// all their runs together (position error).
    #[arg(long, value_name = "METHOD", conflicts_with = "free")]
    method: Option<String>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Integration steps per sample of the position error.
    #[arg(long, value_name = "N", default_value_t = Options::default().substeps)]
    substeps: usize,
    /// Iterations at most.
    #[arg(long, value_name = "N", default_value_t = Options::default().iterations)]
    iterations: usize,
}

/// What a fit makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    Torque,
    Position,
    Both,
}

impl From<Kind> for ErrorKind {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Torque => Self::Torque,
            Kind::Position => Self::Position,
            Kind::Both => Self::Both,
        }
    }
}

/// Fits, judges, writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let overwrite = if arguments.force { Overwrite::Force } else { Overwrite::Refuse };
    check_output(&arguments.out, overwrite)?;
    let experiment = inputs::experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let runs: Vec<&Run> = inputs::runs(&experiment, arguments.free.as_deref())?;
    if arguments.method.is_some() && matches!(arguments.error, Some(Kind::Torque | Kind::Both)) {
        bail!("a method is fitted to the position error; leave --error out, or use --free with --error torque");
    }
    let error = arguments.error.map_or_else(|| identify::default_error(&model, &runs), ErrorKind::from);
    let options =
        Options { substeps: arguments.substeps.max(1), iterations: arguments.iterations.max(1), ..Options::default() };

    let found = progress::shown(|told| match &arguments.method {
        Some(method) => {
            identify::identify_method(&model, &experiment, &runs, method, Weighting::default(), &options, told)
        }
        None => identify::identify(&model, &experiment, &runs, error, &options, told),
    })?;
    let judged = dynid::compare::compare(&found.model, &runs)?;

    let may_write = found.status.may_update_model();
    if may_write {
        write_new(&arguments.out, &found.model.to_toml(), overwrite)?;
    }
    let wall_seconds = started.elapsed().as_secs_f64();
    let json = json!({
        "error": found.error.to_string(),
        "status": found.status.as_str(),
        "cost_before": finite(found.cost_before),
        "cost_after": finite(found.cost_after),
        "rmse_fit": judged.rmse_fit,
        "rmse_validate": judged.rmse_validate,
        "torque_percent_fit": judged.torque_percent_fit,
        "torque_percent_validate": judged.torque_percent_validate,
        "iterations": found.iterations,
        "wall_seconds": wall_seconds,
        "parameters": found.parameters.iter().map(parameter).collect::<Vec<Value>>(),
        "open": found.open.iter().map(|parts| parts.iter().map(|(name, part)| json!({ "name": name, "part": part })).collect()).collect::<Vec<Value>>(),
        "out": may_write.then(|| arguments.out.display().to_string()),
    });
    let mut text = told(&found, wall_seconds);
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

/// JSON knows no infinity.
fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn parameter(found: &Found) -> Value {
    json!({
        "name": found.name,
        "start": found.start,
        "value": found.value,
        "std_error": found.std_error.and_then(finite),
        "identifiable": found.identifiable,
        "at_bound": found.held,
    })
}

fn told(found: &Identified, wall_seconds: f64) -> String {
    let mut text = format!(
        "{} error: {} after {} iterations, {wall_seconds:.1} s; cost {} -> {}\n",
        found.error,
        found.status.as_str(),
        found.iterations,
        number(found.cost_before),
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
