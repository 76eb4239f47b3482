//! `dynid ladder`: the models of a lineage on the same runs, so that one sees the error fall.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use anyhow::bail;
use dynid::{Experiment, Ladder, LadderSettings, Model};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_judge::ladder::Lineage;
use dynid_report as report;
use dynid_report::plot::steps;
use dynid_sentences::{self as sentences, ladder::FORMULA};

use super::table::{Align, Table};
use super::{Answer, Outcome, inputs, progress};

/// Put the models of a lineage on the same runs: error, parameters, and what each step added.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid ladder experiment.toml believed.toml fitted.toml better-fitted.toml
  dynid ladder experiment.toml fitted.toml better-fitted.toml --out ladder.svg --report ladder.html
  dynid ladder experiment.toml fitted.toml better-fitted.toml --free 4,5     only runs with just these joints free

Give the models in the order in which they came about. A rung pays for its parameters when the error on the held-out runs
falls and its BIC (smaller is better, differences below -10 are strong) falls too. Each model's [fit] names the model it was
fitted from; a rung that is not the child of the one before it is said.")]
pub struct Arguments {
    /// The experiment: which logs there are and what was free in each.
    pub experiment: PathBuf,
    /// The models, first to last.
    #[arg(required = true)]
    pub models: Vec<PathBuf>,
    /// Only runs in which exactly these joints are free, e.g. `--free 4` or `--free 4,5`.
    #[arg(long, value_name = "JOINTS", value_delimiter = ',')]
    free: Option<Vec<usize>>,
    /// Draw the ladder into this SVG file.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a page (HTML) with table and picture; it opens with no network.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Overwrite picture and page if they are there.
    #[arg(long)]
    force: bool,
}

/// Compares all models, tells.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    for output in [&arguments.out, &arguments.report].into_iter().flatten() {
        check_output(output, overwrite)?;
    }
    if let Some(out) = arguments.out.as_ref().filter(|out| arguments.report.as_ref() == Some(*out)) {
        bail!("--out and --report are both {}; give each a file of its own", out.display());
    }
    let experiment = inputs::experiment(&arguments.experiment)?;
    let models = models(&arguments.models, &experiment)?;
    let settings = LadderSettings { free: arguments.free.clone() };
    let ladder = progress::counted("models compared", &|| false, |progress| {
        dynid::ladder(&models, &experiment, &settings, progress)
    })?;
    let mut text = as_text(&ladder);
    if let Some(out) = &arguments.out {
        write_new(out, &steps::standalone(&report::ladder_pictures(&ladder)), overwrite)?;
        let _ = writeln!(text, "drawn: {}", out.display());
    }
    if let Some(path) = &arguments.report {
        let section = report::LadderSection { ladder: &ladder };
        let provenance = report::Provenance::of_models(&experiment, &models);
        write_new(path, &report::page("Error ladder", &[&section, &provenance]), overwrite)?;
        let _ = writeln!(text, "written: {}", path.display());
    }
    Ok(Outcome { text, json: sentences::ladder::json(&ladder)?, answer: Answer::Yes })
}

/// The models with what they are called: their files' names, or paths where these are alike.
pub fn models(paths: &[PathBuf], experiment: &Experiment) -> anyhow::Result<Vec<(String, Model)>> {
    paths.iter().map(|path| Ok((label(path, paths), inputs::model(Some(path), experiment)?))).collect()
}

/// The file's name without its ending; its whole path where that would not tell it from another.
pub fn label(path: &Path, all: &[PathBuf]) -> String {
    let is_like = |other: &&PathBuf| other.file_stem() == path.file_stem();
    if all.iter().filter(is_like).count() > 1 {
        return path.display().to_string();
    }
    path.file_stem().map_or_else(|| path.display().to_string(), |stem| stem.to_string_lossy().into_owned())
}

/// The ladder as text.
pub fn as_text(ladder: &Ladder) -> String {
    let dash = || "\u{2014}".to_owned();
    let size = |value: Option<f64>| value.map_or_else(dash, number);
    let percent = |value: Option<f64>| value.map_or_else(dash, |value| format!("{value:.1}"));
    let whole = |value: Option<f64>| value.map_or_else(dash, |value| format!("{value:.0}").replace('-', "\u{2212}"));
    let mut table = Table::new(&[
        ("model", Align::Left),
        ("position: fit", Align::Right),
        ("validate", Align::Right),
        ("torque %: fit", Align::Right),
        ("validate", Align::Right),
        ("free", Align::Right),
        ("BIC", Align::Right),
        ("\u{394}", Align::Right),
        ("what changed", Align::Left),
    ]);
    for rung in &ladder.rungs {
        table.row([
            rung.model.clone(),
            size(rung.rmse_fit),
            size(rung.rmse_validate),
            percent(rung.torque_percent_fit),
            percent(rung.torque_percent_validate),
            rung.free_parameters.to_string(),
            whole(rung.bic),
            whole(rung.delta_bic),
            report::changes(rung),
        ]);
    }
    let mut text = table.text();
    if let Some(floor) = ladder.noise_floor {
        let _ = writeln!(text, "  noise of the logs: {}", number(floor));
    }
    if let Some(joints) = ladder.rungs.first().map(|rung| &rung.joints).filter(|joints| joints.len() > 1) {
        text.push_str("\nper joint, on the held-out runs (position RMS, torque %):\n");
        let mut columns = vec![("model".to_owned(), Align::Left)];
        columns.extend(joints.iter().map(|joint| (format!("joint {}", joint.joint), Align::Right)));
        let columns: Vec<(&str, Align)> = columns.iter().map(|(name, align)| (name.as_str(), *align)).collect();
        let mut table = Table::new(&columns);
        for rung in &ladder.rungs {
            let mut cells = vec![rung.model.clone()];
            cells.extend(rung.joints.iter().map(|joint| {
                let (rmse, torque) = (
                    joint.rmse_validate.or(joint.rmse_fit),
                    joint.torque_percent_validate.or(joint.torque_percent_fit),
                );
                format!("{}, {}", size(rmse), percent(torque))
            }));
            table.cells(cells);
        }
        let mut cells = vec!["noise of the logs".to_owned()];
        cells.extend(joints.iter().map(|joint| number(joint.noise_floor)));
        table.cells(cells);
        text.push_str(&table.text());
    }
    if let Some(samples) = ladder.independent_samples {
        let _ = writeln!(text, "{FORMULA}; {samples:.0} samples");
    }
    let n_children = ladder.rungs.iter().filter(|rung| rung.lineage.is_some_and(Lineage::is_child)).count();
    if n_children > 0 && n_children + 1 == ladder.rungs.len() {
        text.push_str("each model is the child of the one before it, as its [fit] says\n");
    }
    for note in sentences::ladder::notes(ladder) {
        let _ = writeln!(text, "note: {note}");
    }
    text
}
