//! `dynid table`: the parameters of several models side by side, like the thesis's Appendix D.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::bail;
use dynid_files::{Overwrite, check_output, write_new};
use dynid_format::number;
use dynid_report::{self as report, Budget, Models, Provenance, Section};
use dynid_tables::{Filled, Format, Values, written};
use dynid_user_model::Model;
use serde_json::{Value, json};

use super::table::{Align, Table};
use super::{Answer, Outcome, fit, ladder::label};

/// Show models' parameters side by side: values, standard errors, and how each stands.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid table believed.toml fitted.toml
  dynid table start.toml isolated.toml coupling.toml --out parameters.html
  dynid table nights/*.toml --out parameters.parquet

Shown is what a fit of any of the models moved, and what differs between them. Flags: `not alone`, the logs determine it
only together with others; `at its bound`, the bound holds it. Error budgets that the fits recorded follow.")]
pub struct Arguments {
    /// Models of one device, in the order of the columns.
    #[arg(required = true)]
    pub models: Vec<PathBuf>,
    /// Write a page (HTML) that opens with no network; or, for other programs, a table whose rows are one parameter of one
    /// model each, if the name ends in .csv, .parquet or .arrow.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite the page if it is there.
    #[arg(long)]
    force: bool,
}

/// Reads, tabulates.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    if let Some(out) = &arguments.out {
        check_output(out, overwrite)?;
    }
    let models: Vec<(String, Model)> = arguments
        .models
        .iter()
        .map(|path| Ok((label(path, &arguments.models), Model::load(path)?)))
        .collect::<anyhow::Result<_>>()?;
    let device = models[0].1.device;
    if let Some((place, (_, other))) =
        models.iter().enumerate().find(|(_, (_, model))| !model.device.is_same_as(device))
    {
        bail!(
            "{}: the model is of device `{}`, {} of `{}`; tabulate models of one device",
            arguments.models[place].display(),
            other.device.id,
            arguments.models[0].display(),
            device.id
        );
    }
    let table = Models::new(&models);
    let mut text = as_text(&table);
    for (name, model) in &models {
        if let Some(fit) = &model.fit {
            let method = fit.method.as_ref().map_or(String::new(), |method| format!(", method {method}"));
            let _ = writeln!(
                text,
                "{name}: {} error{method}, {}, cost {} -> {}",
                fit.error,
                fit.status,
                fit.cost_before.map_or_else(|| "\u{2014}".to_owned(), number),
                number(fit.cost_after)
            );
            if !fit.budget.is_empty() {
                let _ = write!(text, "{name}, {}", fit::budget(&fit.budget));
            }
        }
    }
    if let Some(out) = &arguments.out {
        match Format::of(out) {
            Some(format) => write_new(out, &written(&columns(&table), format), overwrite)?,
            None => write_new(out, &page(&models, &table, &arguments.models), overwrite)?,
        }
        let _ = writeln!(text, "written: {}", out.display());
    }
    Ok(Outcome { text, json: json(&models, &table, &arguments.models), answer: Answer::Yes })
}

/// One parameter of one model a row.
fn columns(table: &Models) -> Vec<(String, Values)> {
    let cells: Vec<_> = (table.rows.iter())
        .flat_map(|row| table.names.iter().zip(&row.cells).map(move |(model, cell)| (row, model, cell)))
        .filter_map(|(row, model, cell)| cell.map(|cell| (row, model, cell)))
        .collect();
    Filled::from(&cells)
        .texts("model", |(_, model, _)| model)
        .texts("quantity", |(row, ..)| &row.name)
        .numbers("value", |(.., cell)| cell.value)
        .numbers("std_error", |(.., cell)| cell.std_error.unwrap_or(f64::NAN))
        .texts("unit", |(row, ..)| &row.unit)
        .texts("standing", |(.., cell)| cell.standing.as_str())
        .columns()
}

fn as_text(models: &Models) -> String {
    let mut columns = vec![("parameter", Align::Left), ("unit", Align::Left)];
    for (name, fitted) in models.names.iter().zip(&models.fitted) {
        columns.push((name, Align::Right));
        if *fitted {
            columns.extend([("\u{b1}", Align::Right), ("", Align::Left)]);
        }
    }
    let mut table = Table::new(&columns);
    let none = || "\u{2014}".to_owned();
    for row in &models.rows {
        let mut cells = vec![row.name.clone(), row.unit.clone()];
        for (cell, fitted) in row.cells.iter().zip(&models.fitted) {
            cells.push(cell.map_or_else(none, |cell| number(cell.value)));
            if *fitted {
                cells.push(cell.and_then(|cell| cell.std_error).map_or_else(none, number));
                cells.push(cell.map_or("", |cell| cell.standing.flag()).to_owned());
            }
        }
        table.cells(cells);
    }
    table.text()
}

fn json(models: &[(String, Model)], table: &Models, paths: &[PathBuf]) -> Value {
    let reported: Vec<Value> = models
        .iter()
        .zip(paths)
        .map(|((name, model), path)| {
            let fit = model.fit.as_ref();
            json!({
                "name": name,
                "file": path.display().to_string(),
                "status": fit.map(|fit| &fit.status),
                "error": fit.map(|fit| &fit.error),
                "method": fit.and_then(|fit| fit.method.as_ref()),
                "cost_before": fit.and_then(|fit| fit.cost_before).filter(|cost| cost.is_finite()),
                "cost_after": fit.map(|fit| fit.cost_after).filter(|cost| cost.is_finite()),
                "budget": fit.map(|fit| &fit.budget),
            })
        })
        .collect();
    let rows: Vec<Value> = table
        .rows
        .iter()
        .map(|row| {
            let values: Vec<Value> = row
                .cells
                .iter()
                .map(|cell| match cell {
                    Some(cell) => json!({
                        "value": cell.value,
                        "std_error": cell.std_error,
                        "standing": cell.standing.as_str(),
                    }),
                    None => Value::Null,
                })
                .collect();
            json!({ "name": row.name, "unit": row.unit, "models": values })
        })
        .collect();
    json!({ "models": reported, "parameters": rows })
}

fn page(models: &[(String, Model)], table: &Models, paths: &[PathBuf]) -> String {
    let mut entries = vec![("device".to_owned(), models[0].1.device.id.clone())];
    for ((name, model), path) in models.iter().zip(paths) {
        entries.push((name.clone(), format!("{}, sha256 {}", path.display(), model.digest())));
        if let Some(fit) = &model.fit {
            entries.push((format!("{name}, fitted"), format!("{} error, {}", fit.error, fit.status)));
            entries.push((format!("{name}, data"), format!("sha256 {}", fit.data_digest)));
        }
    }
    entries.push(("program".to_owned(), format!("dynid {}", env!("CARGO_PKG_VERSION"))));
    let provenance = Provenance { entries, ..Provenance::default() };
    let budgets: Vec<Budget> = models
        .iter()
        .filter_map(|(name, model)| {
            let shares = model.fit.as_ref().map(|fit| fit.budget.as_slice()).filter(|shares| !shares.is_empty())?;
            Some(Budget { title: format!("Error budget of {name}"), shares })
        })
        .collect();
    let mut sections: Vec<&dyn Section> = vec![table];
    sections.extend(budgets.iter().map(|budget| budget as &dyn Section));
    sections.push(&provenance);
    report::page(&format!("Parameters of {}", models[0].1.device.title), &sections)
}
