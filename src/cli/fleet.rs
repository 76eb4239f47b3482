//! `dynid fleet`: what has changed on which of many robots, and since when.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use dynid_files::{Overwrite, check_output, write_new};
use dynid_fleet::{Analysis, Estimate, Settings, analyse};
use dynid_report::{Section, fleet_sections, page};
use dynid_sentences::fleet as sentences;
use dynid_tables::{Cells, Filled, Values, written};

use super::table_file::format_of;
use super::{Answer, Outcome, job};

/// Say what has changed on which of many robots and since when, and which are unlike the others.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid fleet results --out fleet.html            results of `dynid job` whose jobs fit one night of one robot each
  dynid fleet estimates.parquet                   a table (also .csv, .arrow) with robot, night, quantity, value, std_error

Results of fits are told apart by their labels `robot` and `night`; nights are ordered by their names, with whole numbers by their sizes
(n2 before n10). What is looked at is every parameter that a fit could tell, and the error that it left: `misfit`, the logarithm of its
RMS, or `torque_misfit`, that of the torque error in percent, where no run could be simulated. A law that is no longer the robot's shows
there. What all robots do alike is taken out, from five robots on. Scatter from night to night is estimated from the whole fleet and,
beside that, for each robot; a change is told where a fleet in which nothing happens would show as much anywhere, in any robot, night and
parameter, with a probability below --false-alarms.")]
pub struct Arguments {
    /// Folders of results, result files, or tables (CSV, Parquet, Arrow).
    #[arg(required = true)]
    results: Vec<PathBuf>,
    /// The page to write (HTML).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Also write the estimates that are looked at, as a table: .csv, .parquet or .arrow.
    #[arg(long, value_name = "FILE")]
    estimates: Option<PathBuf>,
    /// Overwrite what is there.
    #[arg(long)]
    force: bool,
    /// Probability of any false statement of a kind.
    #[arg(long, value_name = "P", default_value_t = 0.05, value_parser = probability)]
    false_alarms: f64,
}

fn probability(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 1.0);
    number.ok_or_else(|| "expected a number between 0 and 1".to_owned())
}

/// Quantities that say how much a fit left, by the keys of its results; the first that it has is taken.
const MISFITS: [(&str, &str); 2] = [("rmse_fit", "misfit"), ("torque_percent_fit", "torque_misfit")];

/// Estimates, and the units of their quantities.
#[derive(Default)]
struct Found {
    estimates: Vec<Estimate>,
    units: BTreeMap<String, String>,
    /// Fits that did not end at a minimum: their values are none.
    unended: usize,
    /// Where each estimate stands, by robot, night and quantity.
    places: BTreeMap<(String, String, String), String>,
}

impl Found {
    /// Adds an estimate that stands in `place`; of two of one night nobody knows which is meant.
    fn add(&mut self, estimate: Estimate, place: &str) -> anyhow::Result<()> {
        let Estimate { robot, night, quantity, .. } = &estimate;
        let name = (robot.clone(), night.clone(), quantity.clone());
        if let Some(before) = self.places.get(&name) {
            bail!(
                "{place}: {quantity} of robot {robot} in night {night} stands in {before} already; leave one of them out, or give each a night of its own"
            );
        }
        self.places.insert(name, place.to_owned());
        self.estimates.push(estimate);
        Ok(())
    }
}

/// Reads, looks, writes.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let overwrite = Overwrite::if_forced(arguments.force);
    let format = arguments.estimates.as_deref().map(format_of).transpose()?;
    arguments.out.iter().chain(&arguments.estimates).try_for_each(|out| check_output(out, overwrite))?;
    let mut found = Found::default();
    for place in &arguments.results {
        if place.is_dir() {
            job::json_files(place)?.iter().try_for_each(|file| of_result(file, &mut found))?;
        } else if place.extension().is_some_and(|ending| ending == "json") {
            of_result(place, &mut found)?;
        } else {
            of_table(place, &mut found)?;
        }
    }
    if found.estimates.is_empty() {
        bail!(
            "nothing in these files says what a fit found of a robot in a night; give results of jobs with the labels `robot` and `night`"
        );
    }
    let mut analysis = analyse(&found.estimates, &Settings { false_alarms: arguments.false_alarms });
    // What a fit left is nothing that a model has or lacks.
    analysis.lacking.retain(|own| MISFITS.iter().all(|(_, name)| own.quantity != *name));
    let mut text = text(&analysis);
    if found.unended > 0 {
        text.push_str(&format!("\n{} fits did not end at a minimum and were left out\n", found.unended));
    }
    if let Some(out) = &arguments.out {
        let unit = |quantity: &str| found.units.get(quantity).cloned().unwrap_or_default();
        let sections = fleet_sections(&analysis, &unit);
        let sections: Vec<&dyn Section> = sections.iter().map(Box::as_ref).collect();
        write_new(out, &page("Fleet", &sections), overwrite)?;
        text.push_str(&format!("written: {}\n", out.display()));
    }
    if let (Some(table), Some(format)) = (&arguments.estimates, format) {
        write_new(table, &written(&columns(&found), format), overwrite)?;
        text.push_str(&format!("written: {}\n", table.display()));
    }
    let mut json = sentences::json(&analysis)?;
    json["unended"] = found.unended.into();
    json["estimates"] = arguments.estimates.as_ref().map(|table| table.display().to_string()).into();
    json["page"] = arguments.out.as_ref().map(|out| out.display().to_string()).into();
    // That nothing has changed is an answer, and a good one.
    Ok(Outcome { text, json, answer: Answer::Yes })
}

/// The table of estimates, as [`of_table`] reads it.
fn columns(found: &Found) -> Vec<(String, Values)> {
    Filled::from(&found.estimates)
        .texts("robot", |own| &own.robot)
        .texts("night", |own| &own.night)
        .texts("quantity", |own| &own.quantity)
        .numbers("value", |own| own.value)
        .numbers("std_error", |own| own.std_error)
        .texts("unit", |own| found.units.get(&own.quantity).map_or("", String::as_str))
        .columns()
}

fn text(analysis: &Analysis) -> String {
    let mut text = format!("{}\n", sentences::verdict(analysis));
    let mut section = |title: &str, lines: Vec<String>| {
        if !lines.is_empty() {
            text.push_str(&format!("\n{title}:\n"));
            lines.iter().for_each(|line| text.push_str(&format!("  {line}\n")));
        }
    };
    section("What has changed", analysis.events().iter().map(sentences::event).collect());
    section("Unlike the others", analysis.unlike.iter().map(sentences::unlike).collect());
    section("Lacking", analysis.lacking.iter().map(sentences::lacking).collect());
    let strays = analysis.changes.iter().filter(|own| own.shape == dynid_fleet::Shape::Stray);
    section("Nights that stand alone", strays.map(sentences::stray).collect());
    text
}

/// What the result of a job that was a fit says; others say nothing here.
fn of_result(path: &Path, found: &mut Found) -> anyhow::Result<()> {
    let result = job::read_json(path)?;
    let label = |name: &str| result["labels"][name].as_str().map(str::to_owned);
    let (Some(robot), Some(night)) = (label("robot"), label("night")) else { return Ok(()) };
    let fit = &result["result"];
    let Some(parameters) = fit["parameters"].as_array() else { return Ok(()) };
    if fit["status"] == "iteration limit" || fit["status"] == "numerical error" {
        found.unended += 1;
        return Ok(());
    }
    let mut add = |quantity: &str, value: f64, std_error: f64| {
        let (robot, night, quantity) = (robot.clone(), night.clone(), quantity.to_owned());
        found.add(Estimate { robot, night, quantity, value, std_error }, &path.display().to_string())
    };
    for own in parameters {
        let Some(name) = own["name"].as_str() else { continue };
        // What the logs of a night could not tell is no estimate; the robot has the parameter all the same.
        let known = own["value"].as_f64().zip(own["std_error"].as_f64());
        let (value, std_error) = known.unwrap_or((f64::NAN, 0.0));
        add(name, value, std_error)?;
    }
    let left = MISFITS.iter().find_map(|(key, name)| Some((name, fit[*key].as_f64()?)));
    if let Some((name, left)) = left.filter(|(_, left)| *left > 0.0) {
        add(name, left.ln(), 0.0)?;
    }
    let units = parameters.iter().filter_map(|own| Some((own["name"].as_str()?, own["unit"].as_str()?)));
    found.units.extend(units.map(|(name, unit)| (name.to_owned(), unit.to_owned())));
    Ok(())
}

fn of_table(path: &Path, found: &mut Found) -> anyhow::Result<()> {
    let read = Cells::open(path).map_err(|error| anyhow!("{}: {error}", path.display()))?;
    let place = |name: &str| {
        let place = read.column(name);
        place.with_context(|| format!("{}: give robot, night, quantity, value and std_error", path.display()))
    };
    let [robot, night, quantity, value] = [place("robot")?, place("night")?, place("quantity")?, place("value")?];
    let std_error = place("std_error").ok();
    let unit = place("unit").ok();
    for row in &read.rows {
        let text = |place: usize| row.cells[place].as_str();
        let number = |place: usize| -> anyhow::Result<f64> {
            let cell = text(place);
            let number = cell.parse().ok();
            number.with_context(|| format!("{}:{}: expected a number, found `{cell}`", path.display(), row.line))
        };
        let [robot, night, quantity] = [text(robot), text(night), text(quantity)];
        // What the logs of a night could not tell has no value; the robot has the parameter all the same.
        let value = if text(value).is_empty() { f64::NAN } else { number(value)? };
        let std_error = std_error.filter(|place| !text(*place).is_empty()).map_or(Ok(0.0), number)?;
        if let Some(unit) = unit.map(text).filter(|unit| !unit.is_empty()) {
            found.units.insert(quantity.to_owned(), unit.to_owned());
        }
        let [robot, night, quantity] = [robot, night, quantity].map(str::to_owned);
        let place = format!("{}:{}", path.display(), row.line);
        found.add(Estimate { robot, night, quantity, value, std_error }, &place)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[test]
    fn a_table_is_read_with_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("estimates.csv");
        std::fs::write(&path, "night,robot,value,quantity\n1,a,2.5,p\n2,a,3,p\n").unwrap();
        let mut found = Found::default();
        of_table(&path, &mut found).unwrap();
        assert_eq!((found.estimates.len(), found.estimates[1].value), (2, 3.0));
        let error = of_table(&path, &mut found).unwrap_err().to_string();
        assert!(error.contains("in night 1 stands in") && error.contains("estimates.csv:2 already"), "{error}");
        std::fs::write(&path, "night,robot,value,quantity\n1,a,much,p\n").unwrap();
        let error = of_table(&path, &mut found).unwrap_err().to_string();
        assert!(error.contains("estimates.csv:2") && error.contains("`much`"), "{error}");
        std::fs::write(&path, "night,robot,value,quantity\n1,a,2,p\n1,a,3,p\n").unwrap();
        let error = of_table(&path, &mut Found::default()).unwrap_err().to_string();
        assert!(error.contains("estimates.csv:3: p of robot a in night 1 stands in"), "{error}");
    }

    /// One is a length, the other a share: the fleet must not take the change of the measure for one of the robot.
    #[test]
    fn errors_of_position_and_torque_are_two_quantities() {
        let folder = tempfile::tempdir().unwrap();
        let mut found = Found::default();
        for (night, rmse) in [("1", Value::from(0.01)), ("2", Value::Null)] {
            let path = folder.path().join(format!("{night}.json"));
            let result = json!({
                "labels": { "robot": "a", "night": night },
                "result": { "status": "converged", "parameters": [], "rmse_fit": rmse, "torque_percent_fit": 5.0 },
            });
            std::fs::write(&path, result.to_string()).unwrap();
            of_result(&path, &mut found).unwrap();
        }
        let quantities: Vec<&str> = found.estimates.iter().map(|own| own.quantity.as_str()).collect();
        assert_eq!(quantities, ["misfit", "torque_misfit"]);
    }

    #[test]
    fn what_is_written_is_read_as_the_same_estimates() {
        let folder = tempfile::tempdir().unwrap();
        let own = |night: &str, value| Estimate {
            robot: "a".to_owned(),
            night: night.to_owned(),
            quantity: "p".to_owned(),
            value,
            std_error: 0.1,
        };
        let estimates = vec![own("1", 2.5), own("2", f64::NAN)];
        let units = BTreeMap::from([("p".to_owned(), "N m".to_owned())]);
        let written_of = Found { estimates, units, ..Found::default() };
        for name in ["estimates.csv", "estimates.parquet", "estimates.arrow"] {
            let path = folder.path().join(name);
            std::fs::write(&path, written(&columns(&written_of), format_of(&path).unwrap())).unwrap();
            let mut found = Found::default();
            of_table(&path, &mut found).unwrap();
            assert_eq!(found.units, written_of.units, "{name}");
            assert_eq!(found.estimates[0], written_of.estimates[0], "{name}");
            assert!(found.estimates[1].value.is_nan() && found.estimates[1].night == "2", "{name}");
        }
    }
}
