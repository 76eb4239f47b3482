//! `dynid compare`: how far a model is from the logs, per run and joint.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::bail;
use clap::ValueEnum;
use dynid::{CompareSettings, Compared, Comparison, Experiment, Finding, Model, Run};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_judge::compare::JointComparison;
use dynid_judge::predictions::Predictions;
use dynid_report::{self as report, Accuracy, Budget, Figures, Models, Provenance, Section, Verdict};
use dynid_report::{ShownErrors, panels, plot, run_panels};
use dynid_sentences as sentences;

use super::table::{Align, Table};
use super::{Answer, Outcome, inputs, progress};

/// Say how far a model is from the logs, per run and joint, and draw it.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid compare experiment.toml --model fitted.toml
  dynid compare experiment.toml --model fitted.toml --picture overlay.svg
  dynid compare experiment.toml --model fitted.toml --report page.html
  dynid compare experiment.toml --model fitted.toml --free 4        only runs with just joint 4 free
  dynid compare experiment.toml                                     the device's default model

Two errors are reported where they can be computed. Position: measured minus simulated from the commanded torque; `noise`
is the log's own, so an RMS error near it leaves nothing to explain, and `white` says that the rest has no pattern.
Torque: commanded minus what the measured, filtered motion needs, as a share of the torque. Where model and logs differ is
said below the table: shares of the squared error beside what chance would give, and only what differs from chance.
One sample ahead: what a simulation leaves that is corrected at every sample, as far as makes the logs likeliest; a model that
lacks nothing needs no correction and leaves the noise.
Judge a fitted model by the runs whose role is `validate`: it has not seen them.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The model; without it, the device's default.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_delimiter = ',', value_name = "JOINTS")]
    free: Option<Vec<usize>>,
    /// Draw measured, model and residual of every run and joint into this SVG file.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Which error the picture and the table show; both are always in the JSON.
    #[arg(long, value_enum, default_value_t = Shown::Both)]
    error: Shown,
    /// Write a page (HTML) with tables and pictures of every run and joint; it opens with no network.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Overwrite picture and page if they are there.
    #[arg(long)]
    force: bool,
}

/// Which of the two errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Shown {
    Torque,
    Position,
    Both,
}

impl From<Shown> for ShownErrors {
    fn from(shown: Shown) -> Self {
        match shown {
            Shown::Torque => Self::Torque,
            Shown::Position => Self::Position,
            Shown::Both => Self::Both,
        }
    }
}

/// Compares, draws.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    for output in [&arguments.picture, &arguments.report].into_iter().flatten() {
        check_output(output, overwrite)?;
    }
    if let Some(picture) = arguments.picture.as_ref().filter(|picture| arguments.report.as_ref() == Some(*picture)) {
        bail!("--picture and --report are both {}; give each a file of its own", picture.display());
    }
    let experiment = inputs::experiment(&arguments.experiment)?;
    let model = inputs::model(arguments.model.as_deref(), &experiment)?;
    let runs: Vec<&Run> = experiment.runs_with_free(arguments.free.as_deref())?;
    let settings = CompareSettings { free: arguments.free.clone() };
    let Compared { errors: comparison, predictions, findings: found } =
        progress::counted("runs compared", &|| false, |progress| {
            dynid::compare(&model, &experiment, &settings, progress)
        })?;
    let mut text = table(&comparison, arguments.error);
    text.push_str(&summary(&comparison));
    for sentence in sentences::compare::predictions(&predictions) {
        let _ = writeln!(text, "{sentence}");
    }
    text.push_str(&meanings(&comparison));
    text.push_str(&located(&found));
    if let Some(picture) = &arguments.picture {
        let panels = panels(model.device, &runs, &comparison, arguments.error.into());
        write_new(picture, &plot::standalone(&panels), overwrite)?;
        let _ = writeln!(text, "drawn: {}", picture.display());
    }
    if let Some(report) = &arguments.report {
        write_new(report, &page(arguments, &experiment, &model, &runs, &comparison, &predictions), overwrite)?;
        let _ = writeln!(text, "written: {}", report.display());
    }
    let json = sentences::compare::json(&comparison, &predictions, &found)?;
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// Joints of runs of which the text tells what their numbers mean.
const MOST_EXPLAINED: usize = 8;

/// What the numbers mean, a paragraph a joint of a run: all of them, or those farthest off where there are many.
fn meanings(comparison: &Comparison) -> String {
    let mut joints: Vec<(&str, &JointComparison)> = comparison
        .runs
        .iter()
        .flat_map(|run| run.joints.iter().map(move |joint| (run.file.as_str(), joint)))
        .filter(|(_, joint)| !joint.means.is_empty())
        .collect();
    if joints.is_empty() {
        return String::new();
    }
    let n_joints = joints.len();
    if n_joints > MOST_EXPLAINED {
        // Stable: equal ones stay in the order of the runs.
        joints.sort_by(|(_, a), (_, b)| how_far_off(b).total_cmp(&how_far_off(a)));
        joints.truncate(MOST_EXPLAINED);
    }
    let mut text = String::from("\nWhat that means:\n");
    for (file, joint) in joints {
        let _ = writeln!(text, "  {file}, joint {}:", joint.joint);
        for sentence in sentences::compare::meanings(joint) {
            let _ = writeln!(text, "    {sentence}");
        }
    }
    if n_joints > MOST_EXPLAINED {
        let _ = writeln!(text, "  and {} less far off, with --json", n_joints - MOST_EXPLAINED);
    }
    text
}

/// Error over noise, or the share of the torque where there is no noise to compare with.
fn how_far_off(joint: &JointComparison) -> f64 {
    let ratio = joint.times_noise().filter(|ratio| ratio.is_finite());
    ratio.or(joint.torque_percent).unwrap_or(0.0)
}

/// Findings that the text tells.
const MOST_TOLD: usize = 12;

/// Where model and logs part, the most telling first.
fn located(found: &[Finding]) -> String {
    if found.is_empty() {
        return "\nWhere: nothing that differs from chance.\n".to_owned();
    }
    let mut text = String::from("\nWhere, the most telling first:\n");
    for finding in found.iter().take(MOST_TOLD) {
        let what = sentences::finding::sentence(finding);
        let _ = writeln!(text, "  {}, joint {}: {what}", finding.run, finding.joint);
    }
    if found.len() > MOST_TOLD {
        let _ = writeln!(text, "  and {} more, with --json", found.len() - MOST_TOLD);
    }
    text
}

/// Errors of all runs in one line each: fitted to, and held out.
pub fn summary(comparison: &Comparison) -> String {
    let mut text = String::new();
    for (what, rmse, percent) in [
        ("runs to fit to", comparison.rmse_fit, comparison.torque_percent_fit),
        ("held-out runs", comparison.rmse_validate, comparison.torque_percent_validate),
    ] {
        let parts: Vec<String> = [
            rmse.map(|rmse| format!("position {} RMS", number(rmse))),
            percent.map(|percent| format!("torque {percent:.1} %")),
        ]
        .into_iter()
        .flatten()
        .collect();
        if !parts.is_empty() {
            let _ = writeln!(text, "{what}: {}", parts.join(", "));
        }
    }
    text
}

fn table(comparison: &Comparison, shown: Shown) -> String {
    let mut columns = vec![("run", Align::Left), ("role", Align::Left), ("joint", Align::Right)];
    if shown != Shown::Torque {
        columns.extend([
            ("position RMS", Align::Right),
            ("noise", Align::Right),
            ("largest", Align::Right),
            ("fit %", Align::Right),
            ("white", Align::Left),
        ]);
    }
    if shown != Shown::Position {
        columns.extend([("torque RMS", Align::Right), ("torque %", Align::Right)]);
    }
    let mut table = Table::new(&columns);
    let reported = |value: Option<f64>| value.map_or_else(|| "\u{2014}".to_owned(), number);
    let percent = |value: Option<f64>| value.map_or_else(|| "\u{2014}".to_owned(), |value| format!("{value:.1}"));
    for run in &comparison.runs {
        for joint in &run.joints {
            let mut cells = vec![run.file.clone(), run.role.clone(), joint.joint.to_string()];
            if shown != Shown::Torque {
                cells.extend([
                    reported(joint.rmse),
                    number(joint.noise_floor),
                    reported(joint.max_abs),
                    percent(joint.fit_percent),
                    joint.rmse.map_or("\u{2014}", |_| if joint.white { "yes" } else { "no" }).to_owned(),
                ]);
            }
            if shown != Shown::Position {
                cells.extend([reported(joint.torque_rmse), percent(joint.torque_percent)]);
            }
            table.cells(cells);
        }
    }
    let mut text = table.text();
    for run in &comparison.runs {
        for note in sentences::compare::notes(run) {
            let _ = writeln!(text, "note: {}: {note}", run.file);
        }
    }
    text
}

/// Tables and pictures, one row and one picture a joint of every run.
fn page(
    arguments: &Arguments,
    experiment: &Experiment,
    model: &Model,
    runs: &[&Run],
    comparison: &Comparison,
    predictions: &Predictions,
) -> String {
    let name = arguments.model.as_ref().map_or_else(
        || format!("the default model of {}", model.device.id),
        |path| path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned()),
    );
    let mut verdict = Verdict { sentences: summarised(comparison) };
    verdict.sentences.extend(sentences::compare::predictions(predictions));
    let accuracy =
        Accuracy { title: "How far off".to_owned(), comparison, with_torque: arguments.error != Shown::Position };
    let figures: Vec<Figures> = runs
        .iter()
        .zip(&comparison.runs)
        .map(|(run, compared)| Figures {
            title: format!("{}, to {}", compared.file, compared.role),
            panels: run_panels(model.device, run, compared, arguments.error.into()),
            note: "Above: measured and model. Below: what is left; the band is twice the log's noise.".to_owned(),
        })
        .collect();
    let models = Models::new(&[(name.clone(), model.clone())]);
    let shares = model.fit.as_ref().map_or(&[][..], |fit| &fit.budget);
    let budget = Budget { title: "Where what is left comes from".to_owned(), shares };
    let mut entries = vec![
        ("logs".to_owned(), format!("{}, sha256 {}", experiment.path.display(), experiment.digest)),
        ("model".to_owned(), format!("{name}, sha256 {}", model.digest())),
        ("device".to_owned(), model.device.id.clone()),
        ("program".to_owned(), format!("dynid {}", env!("CARGO_PKG_VERSION"))),
    ];
    if let Some(fit) = &model.fit {
        entries.push(("fitted to".to_owned(), format!("logs with sha256 {}", fit.data_digest)));
    }
    let provenance = Provenance { entries, ..Provenance::default() };
    let mut sections: Vec<&dyn Section> = vec![&verdict, &accuracy];
    sections.extend(figures.iter().map(|figures| figures as &dyn Section));
    if !models.rows.is_empty() {
        sections.push(&models);
    }
    if !shares.is_empty() {
        sections.push(&budget);
    }
    sections.push(&provenance);
    report::page(&format!("{name} against its logs"), &sections)
}

/// What the numbers come to, for the runs fitted to and for those held out.
fn summarised(comparison: &Comparison) -> Vec<String> {
    let mut sentences = Vec::new();
    for (role, runs) in [("fit", "the runs to fit to"), ("validate", "the held-out runs")] {
        // A simulation that has lost its log says nothing by its size, and a log without noise compares with nothing.
        let of_role = comparison.runs.iter().filter(|run| run.role == role && !run.lost);
        let ratios = of_role.flat_map(|run| {
            let finite = |joint: &JointComparison| joint.times_noise().filter(|ratio| ratio.is_finite());
            run.joints.iter().filter_map(move |joint| Some((finite(joint)?, &run.file, joint.joint)))
        });
        if let Some((ratio, file, joint)) = ratios.max_by(|a, b| a.0.total_cmp(&b.0)) {
            sentences.push(format!(
                "On {runs} the position error is at most {ratio:.2} times the noise of the log (joint {joint} of {file})."
            ));
        }
    }
    let notes = comparison.runs.iter().filter(|run| !run.notes.is_empty()).count();
    if notes > 0 {
        sentences.push(format!("{notes} of {} runs have notes below the table.", comparison.runs.len()));
    }
    sentences
}
