//! `dynid tour`: the whole loop on logs that the program carries, in which an effect is hidden.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{anyhow, bail};
use dynid::{
    Addition, Candidate, CompareSettings, Compared, Comparison, DiagnoseSettings, Diagnosis, Experiment, Finding,
    FitResult, FitSettings, Ladder, LadderSettings, Model, Ranked, ReportSettings, Role, Verdict,
};
use dynid::{tour::FILES, tour::truth};
use dynid_files::{Overwrite, PartialFolder, check_output, write_new};
use dynid_format::number;
use dynid_report as report;
use dynid_report::plot::steps;
use dynid_sentences as sentences;
use serde_json::{Value, json};

use super::interrupt::Interrupt;
use super::table::{Align, Table};
use super::{Answer, Outcome, inputs, ladder as ladder_verb, open, progress};

/// See the whole loop on logs that the program carries: find the effect that a model lacks, add it, watch the error fall.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid tour                     into dynid-tour, or dynid-tour-2 if that is there
  dynid tour --out-dir here      into a folder of your choice
  dynid tour --open              then the same on a live page, as `dynid open` of that folder

The logs were made with an effect that the believed model does not have. The tour fits the model, says where it fails, finds
out which effect is missing, adds it, fits again and shows the error fall. The folder then holds all that the loop needs,
to go on by hand, and report.html, which opens with no network.")]
pub struct Arguments {
    /// Where to; without it the first of dynid-tour, dynid-tour-2, .. that is not there.
    #[arg(long, value_name = "FOLDER")]
    out_dir: Option<PathBuf>,
    /// Overwrite the tour's files where they are there.
    #[arg(long)]
    force: bool,
    /// Go on as `dynid open` of what was made, until Ctrl-C.
    #[arg(long)]
    pub open: bool,
    /// Print the page's address, and open no browser.
    #[arg(long, requires = "open")]
    no_browser: bool,
}

const FITTED: &str = "fitted.toml";
const DIAGNOSIS: &str = "diagnosis.json";
const BETTER: &str = "better.toml";
const BETTER_FITTED: &str = "better-fitted.toml";
const LADDER: &str = "ladder.svg";
const REPORT: &str = "report.html";
/// What the tour makes.
const MADE: [&str; 6] = [FITTED, DIAGNOSIS, BETTER, BETTER_FITTED, LADDER, REPORT];

/// Walks through the loop beside the folder that it is for; a tour that fails leaves nothing behind. Answers also how to open what it made.
pub fn run(arguments: &Arguments) -> anyhow::Result<(Outcome, open::Arguments)> {
    let overwrite = Overwrite::if_forced(arguments.force);
    let (folder, taken) = folder(arguments, overwrite)?;
    let partial = PartialFolder::of(&folder)?;
    let interrupt = Interrupt::listen()?;
    let stop = || interrupt.is_asked();
    let outcome = walk(partial.path(), &folder, taken.as_deref(), &stop).and_then(|outcome| {
        settle(partial.path(), &folder)?;
        Ok(outcome)
    });
    let made = open::Arguments {
        experiment: Some(folder.join("experiment.toml")),
        model: Some(folder.join(BETTER_FITTED)),
        port: 0,
        no_browser: arguments.no_browser,
    };
    if outcome.is_err() && interrupt.is_asked() {
        let text = "stopped; nothing is left of it\n".to_owned();
        let json = json!({ "status": "interrupted" });
        return Ok((Outcome { text, json, answer: Answer::Interrupted }, made));
    }
    Ok((outcome?, made))
}

/// Does everything in `partial`; what is reported is about `folder`.
fn walk(
    partial: &Path,
    folder: &Path,
    taken: Option<&Path>,
    stop: &(dyn Fn() -> bool + Sync),
) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let put = |name: &str, text: &str| write_new(&partial.join(name), text, Overwrite::Refuse);
    for (name, text) in FILES {
        put(name, text)?;
    }
    let experiment = inputs::experiment(&partial.join("experiment.toml"))?;
    let start = inputs::model(Some(&partial.join("believed.toml")), &experiment)?;

    let fitted = fit(&start, &experiment, stop)?;
    put(FITTED, &fitted.model.to_toml())?;
    let fitted_model = Model::load(partial.join(FITTED))?;

    let Compared { errors: comparison, findings, .. } = progress::counted("runs compared", stop, |progress| {
        dynid::compare(&fitted_model, &experiment, &CompareSettings::default(), progress)
    })?;

    let settings = DiagnoseSettings::default();
    let diagnosis = progress::of_diagnosis(&|_| (), stop, |progress| {
        dynid::diagnose(&fitted_model, &experiment, &settings, progress)
    })?;
    let diagnosis_json = sentences::diagnosis::json(&diagnosis)?;
    put(DIAGNOSIS, &format!("{}\n", serde_json::to_string_pretty(&diagnosis_json)?))?;
    let Some(best) = diagnosis.ranking.first().filter(|_| diagnosis.verdict == Verdict::MissingEffect) else {
        bail!("the tour's diagnosis did not find what is hidden in its logs; this is a mistake of the program");
    };

    let Candidate { effect, joint, from } = best.candidate.clone();
    let (better, _) = dynid::add(&fitted_model, &Addition { effect, joint, from, values: Vec::new() })?;
    put(BETTER, &better.to_toml())?;
    let better = Model::load(partial.join(BETTER))?;
    let better_fitted = fit(&better, &experiment, stop)?;
    put(BETTER_FITTED, &better_fitted.model.to_toml())?;

    let paths = ["believed.toml", FITTED, BETTER_FITTED].map(|name| partial.join(name));
    let models = ladder_verb::models(&paths, &experiment)?;
    let ladder = progress::counted("models compared", stop, |progress| {
        dynid::ladder(&models, &experiment, &LadderSettings::default(), progress)
    })?;
    put(LADDER, &steps::standalone(&report::ladder_pictures(&ladder)))?;
    let commands = commands(best).map(|(_, command)| command).into();
    let settings = ReportSettings { diagnosis: Some(diagnosis_json), commands };
    // As the command that stands on the page names it, in the folder that this one becomes.
    let experiment = Experiment { path: "experiment.toml".into(), ..experiment };
    let report = progress::counted("models compared", stop, |progress| {
        dynid::report(&models, &experiment, &settings, progress)
    })?;
    put(REPORT, &report.page())?;

    let seconds = started.elapsed().as_secs_f64();
    let tour = Tour {
        experiment: &experiment,
        start: &start,
        fitted,
        comparison,
        findings,
        best,
        diagnosis: &diagnosis,
        better_fitted,
        ladder,
        seconds,
    };
    Ok(Outcome { text: tour.story(folder, taken), json: tour.json(folder)?, answer: Answer::Yes })
}

/// Only a fit that ends at a minimum goes on.
fn fit(model: &Model, experiment: &Experiment, stop: &(dyn Fn() -> bool + Sync)) -> anyhow::Result<FitResult> {
    let settings = FitSettings::default();
    let found = progress::of_fit(&mut |_| stop(), |progress| dynid::fit(model, experiment, &settings, progress))?;
    if !found.status.may_update_model() {
        bail!(
            "a fit of the tour ended before its minimum ({}); this is a mistake of the program",
            found.status.as_str()
        );
    }
    Ok(found)
}

/// The steps of the loop as commands, in the tour's folder.
fn commands(best: &Ranked) -> [(&'static str, String); 7] {
    let joint = best.candidate.joint.map_or(String::new(), |joint| format!(" --joint {joint}"));
    let from = best.candidate.from.map_or(String::new(), |from| format!(" --from {from}"));
    let effect = &best.candidate.effect;
    [
        ("fit", format!("dynid fit experiment.toml --model believed.toml --out {FITTED}")),
        ("compare", format!("dynid compare experiment.toml --model {FITTED}")),
        ("diagnose", format!("dynid diagnose experiment.toml --model {FITTED} --save {DIAGNOSIS}")),
        ("add", format!("dynid add {effect}{joint}{from} --model {FITTED} --out {BETTER}")),
        ("fit again", format!("dynid fit experiment.toml --model {BETTER} --out {BETTER_FITTED}")),
        ("ladder", format!("dynid ladder experiment.toml believed.toml {FITTED} {BETTER_FITTED} --out {LADDER}")),
        (
            "report",
            format!(
                "dynid report experiment.toml believed.toml {FITTED} {BETTER_FITTED} --diagnosis {DIAGNOSIS} --out {REPORT}"
            ),
        ),
    ]
}

/// Moves what was made to where it belongs.
fn settle(partial: &Path, folder: &Path) -> anyhow::Result<()> {
    let unwritable = |error: std::io::Error| anyhow!("cannot write {}: {error}", folder.display());
    if !folder.exists() {
        return fs::rename(partial, folder).map_err(unwritable);
    }
    for entry in fs::read_dir(partial).map_err(unwritable)? {
        let entry = entry.map_err(unwritable)?;
        fs::rename(entry.path(), folder.join(entry.file_name())).map_err(unwritable)?;
    }
    Ok(())
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
        for name in FILES.map(|(name, _)| name).into_iter().chain(MADE) {
            check_output(&chosen.join(name), overwrite)?;
        }
    }
    Ok((chosen, None))
}

struct Tour<'a> {
    experiment: &'a Experiment,
    start: &'a Model,
    fitted: FitResult,
    comparison: Comparison,
    findings: Vec<Finding>,
    best: &'a Ranked,
    diagnosis: &'a Diagnosis,
    better_fitted: FitResult,
    ladder: Ladder,
    seconds: f64,
}

impl Tour<'_> {
    fn story(&self, folder: &Path, taken: Option<&Path>) -> String {
        let mut text = String::from("dynid tour: which physical effect does a model lack?\n\n");
        self.setting(&mut text);
        let [fit, compare, diagnose, add, fit_again, ladder, report] = commands(self.best);
        let step = |text: &mut String, number: usize, (name, command): (&str, String), why: &str| {
            let _ = writeln!(text, "\n{number}. {name}: {why}\n   $ {command}");
        };

        step(&mut text, 1, fit, "first the believed model's own values, so that they are not to blame");
        let held_out = |comparison: &Comparison| as_text(comparison.rmse_validate);
        let _ = writeln!(
            text,
            "   {} values moved. On the run that no fit sees, the position error is now {} rad RMS; the log's own noise is {}.",
            self.fitted.parameters.len(),
            held_out(&self.comparison),
            as_text(self.ladder.noise_floor)
        );

        step(&mut text, 2, compare, "where do model and logs part?");
        for finding in self.findings.iter().take(2) {
            let what = sentences::finding::sentence(finding);
            let _ = writeln!(text, "   {}, joint {}: {what}.", finding.run, finding.joint);
        }
        for (joint, ratio) in self.ratios(0..self.experiment.runs.len()) {
            let _ = writeln!(text, "   Joint {joint}: the position error is {ratio:.1} times the noise.");
        }

        step(&mut text, 3, diagnose, "which effect would explain it, and what else could?");
        for sentence in sentences::diagnosis::sentences(self.diagnosis) {
            let _ = writeln!(text, "   {sentence}");
        }
        text.push_str(&indented(&self.ranking()));

        step(&mut text, 4, add, "into the model, where it does nothing yet");
        step(&mut text, 5, fit_again, "and let the logs say how much of it there is");
        text.push_str(&indented(&self.parameters()));

        step(&mut text, 6, ladder, "did it pay?");
        text.push_str(&indented(&ladder_verb::as_text(&self.ladder)));

        step(&mut text, 7, report, "all of it on one page");
        let _ = writeln!(text, "   {}/{REPORT} opens with no network.", folder.display());
        if let Some(taken) = taken {
            let _ = writeln!(text, "\n{} was there already and is kept.", taken.display());
        }
        let _ = writeln!(
            text,
            "\nThe whole loop took {:.0} s. Go on by hand in {}: these commands work there.",
            self.seconds,
            folder.display()
        );
        text
    }

    /// Robot, logs, what is believed.
    fn setting(&self, text: &mut String) {
        let device = self.start.device;
        let free: Vec<String> = self
            .experiment
            .runs
            .first()
            .map(|run| run.free.iter().map(|&joint| format!("{joint} ({})", device.joints[joint].title)).collect())
            .unwrap_or_default();
        let _ = writeln!(
            text,
            "robot     {}: {} joints; free are {}, the others are locked",
            device.title,
            device.joints.len(),
            free.join(" and ")
        );
        for run in &self.experiment.runs {
            let seconds = run.log.t.last().copied().unwrap_or_default();
            let _ = writeln!(
                text,
                "log       {}: {} samples, {seconds:.0} s, {}",
                run.file,
                run.log.len(),
                match run.role {
                    Role::Fit => "to fit to",
                    Role::Validate => "to be judged by",
                }
            );
        }
        let effects: Vec<String> = self.start.effects.iter().map(|effect| effect.label()).collect();
        let _ = writeln!(text, "believed  {}", effects.join(", "));
        text.push_str(
            "          The logs were made by an independent simulator (tests/plant), with one effect more.\n",
        );
    }

    /// The largest position error of each joint over the noise, among these runs.
    fn ratios(&self, runs: std::ops::Range<usize>) -> Vec<(usize, f64)> {
        let mut found: Vec<(usize, f64)> = Vec::new();
        for joint in self.comparison.runs[runs].iter().flat_map(|run| &run.joints) {
            let Some(rmse) = joint.rmse else { continue };
            let ratio = rmse / joint.noise_floor;
            match found.iter_mut().find(|(own, _)| *own == joint.joint) {
                Some((_, largest)) => *largest = largest.max(ratio),
                None => found.push((joint.joint, ratio)),
            }
        }
        found
    }

    fn ranking(&self) -> String {
        let mut table = Table::new(&[
            ("effect", Align::Left),
            ("held-out RMS before", Align::Right),
            ("after", Align::Right),
            ("\u{394} BIC", Align::Right),
            ("cannot be told from", Align::Left),
        ]);
        for ranked in self.diagnosis.ranking.iter().take(3) {
            let others: Vec<String> = ranked.confounded_with.iter().map(ToString::to_string).collect();
            table.row([
                ranked.candidate.to_string(),
                as_text(ranked.rmse_validate_before),
                as_text(ranked.rmse_validate_after),
                format!("{:.0}", ranked.delta_bic).replace('-', "\u{2212}"),
                if others.is_empty() { "\u{2014}".to_owned() } else { others.join(", ") },
            ]);
        }
        table.text()
    }

    fn parameters(&self) -> String {
        let truth = truth();
        let mut table = Table::new(&[
            ("parameter", Align::Left),
            ("believed", Align::Right),
            ("fitted", Align::Right),
            ("with the effect", Align::Right),
            ("\u{b1}", Align::Right),
            ("truth", Align::Right),
        ]);
        for parameter in &self.better_fitted.parameters {
            let name = &parameter.name;
            let value = |model: &Model| as_text(model.parameter(name).map(|own| own.value));
            table.row([
                name.clone(),
                value(self.start),
                value(&self.fitted.model),
                number(parameter.value),
                as_text(parameter.std_error),
                as_text(truth.get(name).copied()),
            ]);
        }
        table.text()
    }

    fn json(&self, folder: &Path) -> anyhow::Result<Value> {
        let found = &self.best.candidate;
        let steps: Vec<String> = commands(self.best).map(|(_, command)| command).into();
        Ok(json!({
            "folder": folder.display().to_string(),
            "report": folder.join(REPORT).display().to_string(),
            "found": found,
            "where": self.findings.first().map(sentences::finding::json).transpose()?,
            "verdict": self.diagnosis.verdict,
            "ladder": sentences::ladder::json(&self.ladder)?,
            "commands": steps,
            "wall_seconds": self.seconds,
        }))
    }
}

fn as_text(value: Option<f64>) -> String {
    value.map_or_else(|| "\u{2014}".to_owned(), number)
}

/// Each line a little to the right.
fn indented(text: &str) -> String {
    text.lines().fold(String::new(), |mut indented, line| {
        let _ = writeln!(indented, "{}", format!(" {line}").trim_end());
        indented
    })
}
