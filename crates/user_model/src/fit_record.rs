//! The `[fit]` table of a fitted model: how its values were found.

use std::collections::BTreeMap;

use dynid_model::{ModelError, document::Table};
use toml_edit::{Array, ArrayOfTables, InlineTable, Item, Table as OutTable, Value, value};

use serde::{Deserialize, Serialize};

/// One free joint of one configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorShare {
    /// The configuration, from 1.
    pub configuration: usize,
    /// The joint.
    pub joint: usize,
    /// Noise of its logs, root mean square [rad or m].
    pub noise_floor: f64,
    /// Root mean square of measured minus simulated, after the fit of all runs.
    pub rmse: f64,
    /// Root mean square by which its simulated position is off for the parameters' uncertainty, all sources together.
    pub remaining: f64,
    /// The part of it that is due to each configuration's noise; the squares of these and of `range` add up to that of
    /// `remaining`.
    pub from: Vec<Source>,
    /// The part of it that is due to what no data determine, so that only the ranges of the parameters say anything.
    pub range: f64,
    /// What it was, before this configuration's own runs were fitted, for the uncertainty that the parameters known by
    /// then had after each earlier step.
    pub carried: Vec<Source>,
}

/// A part of an error and the configuration that it is due to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// The configuration, from 1.
    pub configuration: usize,
    /// Root mean square [rad or m].
    pub rms: f64,
}

/// How a model's values were found. Costs are those of the error that was fitted.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitRecord {
    /// Which error was made small: `torque`, `position` or `both`.
    pub error: String,
    /// How the fit ended, in words.
    pub status: String,
    /// SHA-256 of the samples that were fitted.
    pub data_digest: String,
    /// [`super::Model::digest`] of the model that the fit started from.
    pub parent_digest: String,
    /// The cost at the start, if it was asked for.
    pub cost_before: Option<f64>,
    /// The cost at the end.
    pub cost_after: f64,
    /// Names of parameters that the data do not determine.
    pub not_identifiable: Vec<String>,
    /// Standard error of each parameter that has one, in the parameter's unit.
    pub std_error: BTreeMap<String, f64>,
    /// Names of parameters that a bound holds.
    pub at_bound: Vec<String>,
    /// The method whose configurations were fitted one after another, if one was.
    pub method: Option<String>,
    /// How much of each joint's remaining error comes from which configuration of the method.
    pub budget: Vec<ErrorShare>,
}

/// A table of numbers by name; empty where there is none.
pub(super) fn numbers(table: &Table, key: &str, label: &str) -> Result<BTreeMap<String, f64>, ModelError> {
    let Some(entry) = table.optional(key) else { return Ok(BTreeMap::new()) };
    let numbers = entry.table(label)?;
    let number = |(name, _): (&str, _)| Ok((name.to_owned(), numbers.required(name, "0.0")?.number()?));
    numbers.keys().into_iter().map(number).collect()
}

/// The table that [`numbers`] reads; what is not finite is left out.
pub(super) fn write_numbers(numbers: &BTreeMap<String, f64>) -> Item {
    let mut entries = OutTable::new();
    for (name, number) in numbers.iter().filter(|(_, number)| number.is_finite()) {
        entries.insert(name, value(*number));
    }
    Item::Table(entries)
}

impl FitRecord {
    pub(super) fn read(table: &Table) -> Result<Self, ModelError> {
        table.only(&[
            "error",
            "status",
            "data_digest",
            "parent_digest",
            "cost_before",
            "cost_after",
            "not_identifiable",
            "std_error",
            "at_bound",
            "method",
            "budget",
        ])?;
        let text = |key: &str| Ok(table.required(key, "\"..\"")?.text()?.to_owned());
        let names = |key: &str| -> Result<Vec<String>, ModelError> {
            let entries = table.optional(key).map_or_else(|| Ok(Vec::new()), |entry| entry.array())?;
            entries.iter().map(|name| Ok(name.text()?.to_owned())).collect()
        };
        Ok(Self {
            error: text("error")?,
            status: text("status")?,
            data_digest: text("data_digest")?,
            parent_digest: text("parent_digest")?,
            cost_before: table.optional("cost_before").map(|entry| entry.number()).transpose()?,
            cost_after: table.required("cost_after", "0.0")?.number()?,
            not_identifiable: names("not_identifiable")?,
            std_error: numbers(table, "std_error", "[fit.std_error]")?,
            at_bound: names("at_bound")?,
            method: table.optional("method").map(|entry| entry.text().map(str::to_owned)).transpose()?,
            budget: table.tables("budget", "[[fit.budget]]", 1)?.iter().map(read_share).collect::<Result<_, _>>()?,
        })
    }

    pub(super) fn write(&self) -> Item {
        let mut table = OutTable::new();
        for (key, text) in [
            ("error", &self.error),
            ("status", &self.status),
            ("data_digest", &self.data_digest),
            ("parent_digest", &self.parent_digest),
        ] {
            table.insert(key, value(text));
        }
        if let Some(cost_before) = self.cost_before {
            table.insert("cost_before", value(cost_before));
        }
        table.insert("cost_after", value(self.cost_after));
        if let Some(method) = &self.method {
            table.insert("method", value(method));
        }
        table.insert("not_identifiable", value(lines(&self.not_identifiable)));
        if !self.at_bound.is_empty() {
            table.insert("at_bound", value(lines(&self.at_bound)));
        }
        // TOML has no null: a parameter without a standard error is left out.
        table.insert("std_error", write_numbers(&self.std_error));
        let mut shares = ArrayOfTables::new();
        self.budget.iter().for_each(|share| shares.push(write_share(share)));
        if !shares.is_empty() {
            table.insert("budget", Item::ArrayOfTables(shares));
        }
        Item::Table(table)
    }
}

/// Names, one a line.
fn lines(names: &[String]) -> Array {
    let mut array = Array::new();
    array.extend(names.iter().map(String::as_str));
    for name in array.iter_mut() {
        name.decor_mut().set_prefix("\n    ");
    }
    if !array.is_empty() {
        array.set_trailing("\n");
        array.set_trailing_comma(true);
    }
    array
}

fn write_share(share: &ErrorShare) -> OutTable {
    let mut table = OutTable::new();
    table.insert("configuration", value(share.configuration as i64));
    table.insert("joint", value(share.joint as i64));
    for (key, number) in [
        ("noise_floor", share.noise_floor),
        ("rmse", share.rmse),
        ("remaining", share.remaining),
        ("range", share.range),
    ] {
        table.insert(key, value(number));
    }
    for (key, sources) in [("from", &share.from), ("carried", &share.carried)] {
        let mut array = Array::new();
        for source in sources {
            let mut entry = InlineTable::new();
            entry.insert("configuration", Value::from(source.configuration as i64));
            entry.insert("rms", Value::from(source.rms));
            array.push(entry);
        }
        table.insert(key, value(array));
    }
    table
}

fn read_share(table: &Table) -> Result<ErrorShare, ModelError> {
    table.only(&["configuration", "joint", "noise_floor", "rmse", "remaining", "range", "from", "carried"])?;
    let number = |key: &str| table.required(key, "0.0")?.number();
    let sources = |key: &str| -> Result<Vec<Source>, ModelError> {
        let read = |table: &Table| {
            Ok(Source {
                configuration: table.required("configuration", "1")?.index()?,
                rms: table.required("rms", "0.0")?.number()?,
            })
        };
        table.tables(key, key, 1)?.iter().map(read).collect()
    };
    Ok(ErrorShare {
        configuration: table.required("configuration", "1")?.index()?,
        joint: table.required("joint", "0")?.index()?,
        noise_floor: number("noise_floor")?,
        rmse: number("rmse")?,
        remaining: number("remaining")?,
        from: sources("from")?,
        range: number("range")?,
        carried: sources("carried")?,
    })
}
