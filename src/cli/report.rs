//! `dynid report`: all that is known of a model and its logs on one page.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_identify::position::FitRun;
use dynid_judge::{compare::Finding, compare::locate::locate};
use dynid_judge::{ladder::Ladder, ladder::Rung};
use dynid_logs::quality;
use dynid_logs::{experiment::Experiment, experiment::Role, experiment::Run};
use dynid_report::{
    self as report, DataQuality, Figures, LadderSection, Provenance, Ranking, Section, Sheet, TorqueTerms, Verdict,
    Where,
};
use dynid_sentences as sentences;
use dynid_text::number;
use dynid_torque as torque;
use dynid_user_model::Model;
use serde_json::{Value, json};

use super::compare::{Shown, run_panels};
use super::{Answer, Outcome, inputs, ladder};

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
    experiment: PathBuf,
    /// The models of a lineage, first to last; the page is about the last.
    #[arg(required = true)]
    models: Vec<PathBuf>,
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
    let report = Report::new(&experiment, &models, diagnosis, commands(arguments))?;
    write_new(&arguments.out, &report.page(), overwrite)?;
    let verdict = report.sentences();
    let mut text = verdict.join("\n");
    text.push_str(&format!("\nwritten: {}\n", arguments.out.display()));
    let quality = report.quality.runs.iter().map(sentences::quality::json).collect::<serde_json::Result<Value>>()?;
    let json = json!({
        "page": arguments.out.display().to_string(),
        "sentences": verdict,
        "sections": report.titles(),
        "where": sentences::compare::findings_json(&report.findings)?,
        "quality": quality,
    });
    Ok(Outcome { text, json, answer: Answer::Yes })
}

fn read_diagnosis(path: &Path) -> anyhow::Result<Value> {
    let help = "give a file with what `dynid diagnose --json` printed";
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}; {help}", path.display()))?;
    let diagnosis: Value = serde_json::from_str(&text)
        .map_err(|error| anyhow::anyhow!("{}: not JSON: {error}; {help}", path.display()))?;
    if !diagnosis["verdict"].is_string() {
        bail!("{}: no `verdict` in it; {help}", path.display());
    }
    Ok(diagnosis)
}

/// The way here, as far as the arguments tell it.
/// What a diagnosis comes to: all that it says after its first sentence, which tells how far off the model was.
fn answer(diagnosis: &Value) -> Option<String> {
    let sentences = report::sentences(diagnosis);
    let answer = if sentences.len() > 1 { &sentences[1..] } else { &sentences[..] };
    (!answer.is_empty()).then(|| answer.join(" "))
}

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

/// Everything on the page.
pub struct Report<'a> {
    experiment: &'a Experiment,
    models: &'a [(String, Model)],
    runs: Vec<&'a Run>,
    ladder: Ladder,
    /// Of the subject.
    findings: Vec<Finding>,
    /// Of the model before it.
    findings_before: Vec<Finding>,
    diagnosis: Option<Value>,
    terms: TorqueTerms,
    occurs: Vec<bool>,
    quality: DataQuality,
    commands: Vec<String>,
}

impl<'a> Report<'a> {
    /// Compares and takes apart; the last of `models` is the subject.
    pub fn new(
        experiment: &'a Experiment,
        models: &'a [(String, Model)],
        diagnosis: Option<Value>,
        commands: Vec<String>,
    ) -> anyhow::Result<Self> {
        let runs: Vec<&Run> = experiment.runs.iter().collect();
        let ladder = dynid_judge::ladder::ladder(models, &runs)?;
        let Some(((_, subject), rung)) = models.last().zip(ladder.rungs.last()) else { bail!("no model") };
        let findings = locate(subject, &runs, &rung.comparison);
        let before = models.len().checked_sub(2).map(|before| (&models[before].1, &ladder.rungs[before].comparison));
        let findings_before = before.map_or_else(Vec::new, |(model, comparison)| locate(model, &runs, comparison));
        let mut terms = TorqueTerms::default();
        for run in &runs {
            // A run without torque error is said among the notes of the comparison.
            if let Ok(joints) = torque::terms(subject, run) {
                let unit = |joint: usize| subject.device.joints[joint].command_unit.clone();
                terms
                    .runs
                    .push((run.file.clone(), joints.into_iter().map(|own| (own.clone(), unit(own.joint))).collect()));
            }
        }
        let systems =
            runs.iter().map(|run| Ok(FitRun::of_run(subject, run)?)).collect::<anyhow::Result<Vec<FitRun>>>()?;
        let occurs = subject.names().iter().map(|name| systems.iter().any(|run| run.occurs(name))).collect();
        let quality = DataQuality { runs: runs.iter().map(|run| quality::of_run(run)).collect() };
        Ok(Self {
            experiment,
            models,
            runs,
            ladder,
            findings,
            findings_before,
            diagnosis,
            terms,
            occurs,
            quality,
            commands,
        })
    }

    fn subject(&self) -> (&str, &Model) {
        let (name, model) = &self.models[self.models.len() - 1];
        (name, model)
    }

    /// The verdict, in three sentences: how far off, whether the lineage paid, and what is missing or where it shows.
    pub fn sentences(&self) -> Vec<String> {
        let (name, _) = self.subject();
        let rung = &self.ladder.rungs[self.ladder.rungs.len() - 1];
        let held_out = self.experiment.runs.iter().any(|run| run.role == Role::Validate);
        let on = if held_out { "the held-out runs" } else { "the runs it was fitted to (none is held out)" };
        let (rmse, percent) = if held_out {
            (rung.rmse_validate, rung.torque_percent_validate)
        } else {
            (rung.rmse_fit, rung.torque_percent_fit)
        };
        // A simulation that has lost a log says nothing by its size.
        let role = if held_out { Role::Validate } else { Role::Fit };
        let is_lost = |rung: &Rung| {
            self.runs.iter().zip(&rung.comparison.runs).any(|(run, compared)| run.role == role && compared.lost)
        };
        let rmse = rmse.filter(|_| !is_lost(rung));
        let mut parts = Vec::new();
        if let Some(rmse) = rmse {
            let times = match self.ladder.noise_floor.filter(|floor| *floor > 0.0) {
                Some(floor) => format!(" ({:.2} times the noise of the logs)", rmse / floor),
                None => String::new(),
            };
            parts.push(format!("a position error of {} RMS{times}", number(rmse)));
        }
        if let Some(percent) = percent {
            parts.push(format!("a torque error of {percent:.1} %"));
        }
        let mut sentences = vec![if parts.is_empty() {
            format!("{name} has no error that can be computed on {on}.")
        } else {
            format!("On {on}, {name} has {}.", parts.join(" and "))
        }];
        let first = &self.ladder.rungs[0];
        let fell = |before: Option<f64>, after: Option<f64>| before.zip(after).filter(|(_, after)| *after > 0.0);
        let rmse_first = if held_out { first.rmse_validate } else { first.rmse_fit };
        let position = fell(rmse_first.filter(|_| !is_lost(first)), rmse);
        let torque = if held_out {
            fell(first.torque_percent_validate, percent)
        } else {
            fell(first.torque_percent_fit, percent)
        };
        if self.models.len() > 1 {
            let added: Vec<&str> =
                self.ladder.rungs.iter().flat_map(|rung| rung.added.iter().map(String::as_str)).collect();
            let with = if added.is_empty() { String::new() } else { format!(" with {}", added.join(", ")) };
            sentences.push(match (position, torque) {
                (Some((before, after)), _) => format!(
                    "Since {} the position error went from {} to {}{with}.",
                    first.model,
                    number(before),
                    number(after)
                ),
                (None, Some((before, after))) => {
                    format!("Since {} the torque error went from {before:.1} to {after:.1} %{with}.", first.model)
                }
                (None, None) => format!("It has {} models before it.", self.models.len() - 1),
            });
        }
        let reported = self.diagnosis.as_ref().and_then(answer);
        sentences.push(match (reported, self.findings.first()) {
            (Some(reported), _) => reported,
            (None, Some(finding)) => {
                let what = sentences::finding::sentence(finding);
                format!("Most telling of what is left: {}, joint {}: {what}.", finding.run, finding.joint)
            }
            (None, None) => "Nothing of what is left differs from chance.".to_owned(),
        });
        sentences
    }

    fn sections<T>(&self, with: impl FnOnce(&[&dyn Section]) -> T) -> T {
        let (_, subject) = self.subject();
        let rung = &self.ladder.rungs[self.ladder.rungs.len() - 1];
        let verdict = Verdict { sentences: self.sentences() };
        let ladder = LadderSection { ladder: &self.ladder };
        let name_before = self.models.len().checked_sub(2).map(|before| self.models[before].0.as_str());
        let place =
            Where { findings: &self.findings, before: name_before.map(|name| (name, self.findings_before.as_slice())) };
        // Held-out runs first: they are what a model is judged by.
        let mut order: Vec<usize> = (0..self.runs.len()).collect();
        order.sort_by_key(|index| self.runs[*index].role != Role::Validate);
        let mut panels = Vec::new();
        let mut means = Vec::new();
        for index in order {
            let compared = &rung.comparison.runs[index];
            panels.extend(run_panels(subject.device, self.runs[index], compared, Shown::Both));
            for joint in compared.joints.iter().filter(|joint| !joint.means.is_empty()) {
                let meanings = sentences::compare::meanings(joint).join(" ");
                means.push(format!("{}, joint {}: {meanings}", compared.file, joint.joint));
            }
            let notes = sentences::compare::notes(compared);
            means.extend(notes.iter().map(|note| format!("{}: {note}", compared.file)));
        }
        let overlays = Figures {
            title: "Measured against the model".to_owned(),
            panels,
            note: "Above: measured (wide and pale) and model (thin). Below: what is left; the band is twice the log's noise. \
                   Buttons, arrow keys, + and \u{2212} zoom; so does the wheel after a click; drag to move; double-click for all."
                .to_owned(),
        };
        let means = report::Sentences { title: "What is left, in words".to_owned(), sentences: means };
        let sheet = Sheet { model: subject, occurs: self.occurs.clone() };
        let mut provenance = Provenance::of_models(self.experiment, self.models);
        provenance.commands.clone_from(&self.commands);
        let ranking = self.diagnosis.as_ref().map(|diagnosis| Ranking { diagnosis });
        let mut sections: Vec<&dyn Section> = vec![&verdict, &ladder, &place];
        if let Some(ranking) = &ranking {
            sections.push(ranking);
        }
        sections.extend([&overlays as &dyn Section, &means]);
        if !self.terms.runs.is_empty() {
            sections.push(&self.terms);
        }
        sections.extend([&sheet as &dyn Section, &self.quality, &provenance]);
        with(&sections)
    }

    fn titles(&self) -> Vec<String> {
        self.sections(|sections| sections.iter().map(|section| section.title().to_owned()).collect())
    }

    /// The page.
    pub fn page(&self) -> String {
        let (name, model) = self.subject();
        self.sections(|sections| report::page(&format!("{name}: {}", model.device.title), sections))
    }
}
