//! `structure.toml` as a table of the library.

use std::error::Error;
use std::fmt::Write;

use dynid_model::Device;
use toml_edit::{DocumentMut, Item, Table, Value};

/// The device's entry, as an expression of type `Structure`.
pub fn entry(device: &Device, text: &str) -> Result<String, Box<dyn Error>> {
    let id = &device.id;
    let table: DocumentMut =
        text.parse().map_err(|error: toml_edit::TomlError| format!("generated/{id}/structure.toml: {error}"))?;
    read(id, &table).ok_or_else(|| {
        format!("generated/{id}/structure.toml is incomplete; run `cargo xtask gen --device {id}`").into()
    })
}

fn read(id: &str, table: &Table) -> Option<String> {
    let mut entry = format!("Structure {{ device: {id:?}, inertia: &[");
    let mut inertia = Vec::new();
    for (key, parameters) in table.get("D")?.as_table()? {
        let (i, j) = key.split_once('_')?;
        let pair: (usize, usize) = (i.parse().ok()?, j.parse().ok()?);
        inertia.push((pair, names(parameters)?));
    }
    inertia.sort();
    let mut gravity = Vec::new();
    for (key, parameters) in table.get("phi")?.as_table()? {
        let joint: usize = key.parse().ok()?;
        gravity.push((joint, names(parameters)?));
    }
    gravity.sort();
    for (pair, parameters) in inertia {
        write!(entry, "({pair:?}, &{parameters:?}), ").ok()?;
    }
    entry.push_str("], gravity: &[");
    for (joint, parameters) in gravity {
        write!(entry, "({joint}, &{parameters:?}), ").ok()?;
    }
    entry.push_str("] }");
    Some(entry)
}

fn names(value: &Item) -> Option<Vec<&str>> {
    value.as_array()?.iter().map(Value::as_str).collect()
}
