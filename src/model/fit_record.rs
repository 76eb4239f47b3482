//! The `[fit]` table of a fitted model: how its values were found.

use std::collections::BTreeMap;

use dynid_model::{ModelError, document::Table};
use toml_edit::{Array, Item, Table as OutTable, value};

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
    /// The cost at the start.
    pub cost_before: f64,
    /// The cost at the end.
    pub cost_after: f64,
    /// Names of parameters that the data do not determine.
    pub not_identifiable: Vec<String>,
    /// Standard error of each parameter that has one, in the parameter's unit.
    pub std_error: BTreeMap<String, f64>,
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
        ])?;
        let text = |key: &str| Ok(table.required(key, "\"..\"")?.text()?.to_owned());
        let mut not_identifiable = Vec::new();
        if let Some(entry) = table.optional("not_identifiable") {
            for name in entry.array()? {
                not_identifiable.push(name.text()?.to_owned());
            }
        }
        let mut std_error = BTreeMap::new();
        if let Some(entry) = table.optional("std_error") {
            let errors = entry.table("[fit.std_error]")?;
            for (name, _) in errors.keys() {
                std_error.insert(name.to_owned(), errors.required(name, "0.0")?.number()?);
            }
        }
        Ok(Self {
            error: text("error")?,
            status: text("status")?,
            data_digest: text("data_digest")?,
            parent_digest: text("parent_digest")?,
            cost_before: table.required("cost_before", "0.0")?.number()?,
            cost_after: table.required("cost_after", "0.0")?.number()?,
            not_identifiable,
            std_error,
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
        table.insert("cost_before", value(self.cost_before));
        table.insert("cost_after", value(self.cost_after));
        let mut names = Array::new();
        names.extend(self.not_identifiable.iter().map(String::as_str));
        for name in names.iter_mut() {
            name.decor_mut().set_prefix("\n    ");
        }
        if !names.is_empty() {
            names.set_trailing("\n");
            names.set_trailing_comma(true);
        }
        table.insert("not_identifiable", value(names));
        let mut errors = OutTable::new();
        // TOML has no null: a parameter without a standard error is left out.
        for (name, error) in self.std_error.iter().filter(|(_, error)| error.is_finite()) {
            errors.insert(name, value(*error));
        }
        table.insert("std_error", Item::Table(errors));
        Item::Table(table)
    }
}
