//! What `structure.toml` says of each configuration.

use dynid_model::Device;
use toml_edit::{DocumentMut, Table, Value};

/// Of each configuration, in the device's order: the names of the parameters that appear in its equations.
pub fn appearing(device: &Device, text: &str) -> Result<Vec<Vec<String>>, String> {
    let file = format!("generated/{}/structure.toml", device.id);
    let table: DocumentMut = text.parse().map_err(|error: toml_edit::TomlError| format!("{file}: {error}"))?;
    let read = read(&table).filter(|read| read.len() == device.configurations.len());
    read.ok_or_else(|| format!("{file} is incomplete; run `cargo xtask gen --device {}`", device.id))
}

fn read(table: &Table) -> Option<Vec<Vec<String>>> {
    let configurations = table.get("configuration")?.as_array_of_tables()?;
    let names = |own: &Table| -> Option<Vec<String>> {
        own.get("parameters")?.as_array()?.iter().map(Value::as_str).map(|name| name.map(str::to_owned)).collect()
    };
    configurations.iter().map(names).collect()
}
