//! `dynid report`: all that is known of a model and its logs on one page.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use dynid::ReportSettings;
use dynid_files::{Overwrite, check_output, write_new};
use dynid_sentences as sentences;
use serde_json::{Value, json};

use super::{Answer, Outcome, inputs, ladder, progress};

/// Write one page with all that is known of a model and its logs; it opens with no network.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid report experiment.toml fitted.toml --out report.html
  dynid diagnose experiment.toml --model fitted.toml --json > diagnosis.json
  dynid report experiment.toml believed.toml fitted.toml better.toml --diagnosis diagnosis.json --out report.html

The last model is the subject; the ones before it stand on the ladder. The page shows the verdict, the ladder, where model
and logs part, measured against simulated (zoom and pan), the torque by physical term, the diagnosis, parameters, the
quality of the logs, and where everything came from.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The models of a lineage, first to last; the page is about the last.
    #[arg(required = true)]
    pub models: Vec<PathBuf>,
    /// The page to write (HTML).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// What `dynid diagnose --json` printed.
    #[arg(long, value_name = "FILE")]
    diagnosis: Option<PathBuf>,
    /// Overwrite the page if it is there.
    #[arg(long)]
    force: bool,
}

/// Gathers, writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    check_output(&arguments.out, overwrite)?;
    let experiment = inputs::experiment(&arguments.experiment)?;
    let models = ladder::models(&arguments.models, &experiment)?;
    let diagnosis = arguments.diagnosis.as_deref().map(read_diagnosis).transpose()?;
    let settings = ReportSettings { diagnosis, commands: commands(arguments) };
    let report = progress::counted("models compared", &|| false, |progress| {
        dynid::report(&models, &experiment, &settings, progress)
    })?;
    write_new(&arguments.out, &report.page(), overwrite)?;
    let verdict = report.sentences();
    let mut text = verdict.join("\n");
    text.push_str(&format!("\nwritten: {}\n", arguments.out.display()));
    let quality = report.quality().runs.iter().map(sentences::quality::json).collect::<serde_json::Result<Value>>()?;
    let json = json!({
        "page": arguments.out.display().to_string(),
        "sentences": verdict,
        "sections": report.titles(),
        "where": sentences::compare::findings_json(report.findings())?,
        "quality": quality,
    });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

fn read_diagnosis(path: &Path) -> anyhow::Result<Value> {
    let help = "give a file with what `dynid diagnose --json` printed";
    let text =
        dynid_model::document::read_text(path).with_context(|| format!("cannot read {}; {help}", path.display()))?;
    let diagnosis: Value = serde_json::from_str(&text)
        .map_err(|error| anyhow::anyhow!("{}: not JSON: {error}; {help}", path.display()))?;
    if !diagnosis["verdict"].is_string() {
        bail!("{}: no `verdict` in it; {help}", path.display());
    }
    Ok(diagnosis)
}

/// The way here, as far as the arguments tell it.
fn commands(arguments: &Arguments) -> Vec<String> {
    let experiment = arguments.experiment.display();
    let models: Vec<String> = arguments.models.iter().map(|path| path.display().to_string()).collect();
    let mut commands = Vec::new();
    if let (Some(diagnosis), Some(model)) = (&arguments.diagnosis, models.last()) {
        let diagnosed = models.len().checked_sub(2).map_or(model, |before| &models[before]);
        commands.push(format!("dynid diagnose {experiment} --model {diagnosed} --json > {}", diagnosis.display()));
    }
    if models.len() > 1 {
        commands.push(format!("dynid ladder {experiment} {}", models.join(" ")));
    }
    let mut last = format!("dynid report {experiment} {}", models.join(" "));
    if let Some(diagnosis) = &arguments.diagnosis {
        last.push_str(&format!(" --diagnosis {}", diagnosis.display()));
    }
    commands.push(format!("{last} --out {}", arguments.out.display()));
    commands
}
