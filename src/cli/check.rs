//! `dynid check`: what can these logs not answer, and what looks wrong in them?

use std::fmt::Write;
use std::path::PathBuf;

use dynid::CheckSettings;
use dynid_check::{Checked, Verdict};
use dynid_sentences::check as sentences;

use super::{Answer, Outcome, inputs};

/// Say what logs cannot answer, how to excite what is missing, and what looks wrong in them, before any fit.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid check experiment.toml                        against the device's default model
  dynid check experiment.toml --model believed.toml
  dynid check experiment.toml --free 4,5             only runs with just joints 4 and 5 free

Three questions are answered. Which parameters, joints and directions do the runs leave open? What should be played to
change that? What looks wrong in the logs: units, signs, delays, the hold between samples, cut commands, time stamps,
encoders that wrap, coarse digits, torques that are missing, runs that contradict each other? The values of the model need
only be of the right size. Exit status 0: checked, whatever it says; 1: these logs answer nothing at all.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
}

/// Checks.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let experiment = inputs::experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let checked = dynid::check(&model, &experiment, &CheckSettings { free: arguments.free.clone() })?;
    let file = arguments.model.as_ref().map(|path| path.display().to_string());
    Ok(Outcome {
        text: text(&checked, file.as_deref()),
        json: sentences::json(&checked, file.as_deref())?,
        answer: if checked.verdict == Verdict::NothingToLearn { Answer::No } else { Answer::Yes },
    })
}

fn text(checked: &Checked, model: Option<&str>) -> String {
    let mut text = format!("{}\n", sentences::verdict(checked));
    let mut section = |title: &str, lines: Vec<String>| {
        if !lines.is_empty() {
            let _ = writeln!(text, "\n{title}:");
            lines.iter().for_each(|line| {
                let _ = writeln!(text, "  {line}");
            });
        }
    };
    section("What looks wrong", sentences::findings(&checked.findings));
    // What means that nothing is answered is the first sentence.
    let open = checked.unanswered.iter().filter(|own| !own.is_everything());
    section("What these logs cannot answer", open.map(sentences::unanswered).collect());
    let play = checked
        .suggestions
        .iter()
        .flat_map(|own| [sentences::suggestion(own), format!("$ {}", sentences::command(own, model))]);
    section("What to play", play.collect());
    text
}
