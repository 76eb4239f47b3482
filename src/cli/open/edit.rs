//! A TOML text changed in place: comments and order stay.

use serde::{Deserialize, Deserializer};
use serde_json::Value as Json;
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value};

use super::answer::Refusal;

/// One change.
#[derive(Deserialize)]
pub struct Change {
    keys: Vec<Key>,
    /// What stands there afterwards; null takes the key out.
    #[serde(default, deserialize_with = "present")]
    value: Option<Json>,
    /// A table that joins the array of tables.
    insert: Option<Json>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Key {
    Index(usize),
    Name(String),
}

/// Tells a null from nothing.
fn present<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Json>, D::Error> {
    Json::deserialize(deserializer).map(Some)
}

/// The text with all changes, or why one of them cannot be made.
pub fn edited(text: &str, changes: &[Change]) -> Result<String, Refusal> {
    let mut document: DocumentMut = text.parse()?;
    for change in changes {
        made(document.as_item_mut(), change)?;
    }
    Ok(document.to_string())
}

fn made(root: &mut Item, change: &Change) -> Result<(), Refusal> {
    let nowhere = || Refusal::bad("a change names a place that the file does not have");
    let (last, path) = change.keys.split_last().ok_or_else(nowhere)?;
    let mut item = root;
    for key in path {
        let inner = match key {
            Key::Name(name) => item.get_mut(name.as_str()),
            Key::Index(index) => item.get_mut(*index),
        };
        item = inner.ok_or_else(nowhere)?;
    }
    match (&change.value, &change.insert, last) {
        (Some(Json::Null), None, Key::Name(name)) => {
            item.as_table_like_mut().ok_or_else(nowhere)?.remove(name);
        }
        (Some(Json::Null), None, Key::Index(index)) => {
            if let Some(tables) = item.as_array_of_tables_mut().filter(|tables| *index < tables.len()) {
                tables.remove(*index);
            } else {
                let array = item.as_array_mut().filter(|array| *index < array.len()).ok_or_else(nowhere)?;
                array.remove(*index);
            }
        }
        (Some(json), None, Key::Name(name)) => {
            let table = item.as_table_like_mut().ok_or_else(nowhere)?;
            match table.get_mut(name).and_then(Item::as_value_mut) {
                Some(old) => replace(old, json)?,
                None => {
                    table.insert(name, Item::Value(value(json)?));
                }
            }
        }
        (Some(json), None, Key::Index(index)) => {
            let array = item.as_array_mut().ok_or_else(nowhere)?;
            replace(array.get_mut(*index).ok_or_else(nowhere)?, json)?;
        }
        (None, Some(Json::Object(entries)), last) => {
            let mut table = Table::new();
            for (key, json) in entries {
                table.insert(key, Item::Value(value(json)?));
            }
            let tables = match last {
                Key::Name(name) => {
                    let own = item.as_table_like_mut().ok_or_else(nowhere)?;
                    own.entry(name).or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()))
                }
                Key::Index(_) => item,
            };
            let tables = tables.as_array_of_tables_mut().ok_or_else(nowhere)?;
            let at = if let Key::Index(index) = last { (*index).min(tables.len()) } else { tables.len() };
            let mut all: Vec<Table> = tables.iter().cloned().collect();
            all.insert(at, table);
            // New places: tables are written in the order of their places.
            all.iter_mut().for_each(|table| table.set_position(None));
            *tables = all.into_iter().collect();
        }
        _ => return Err(Refusal::bad("a change has either `value`, or `insert` with a table")),
    }
    Ok(())
}

/// A value in the place of another, with its comments; a float stays one.
fn replace(old: &mut Value, json: &Json) -> Result<(), Refusal> {
    let mut new = match json.as_f64().filter(|_| old.is_float()) {
        Some(number) => Value::from(number),
        None => value(json)?,
    };
    *new.decor_mut() = old.decor().clone();
    *old = new;
    Ok(())
}

fn value(json: &Json) -> Result<Value, Refusal> {
    Ok(match json {
        Json::Bool(flag) => (*flag).into(),
        Json::String(text) => text.as_str().into(),
        Json::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(integer), _) => integer.into(),
            (None, Some(float)) => float.into(),
            (None, None) => return Err(Refusal::bad(format!("{number} is no number that TOML has"))),
        },
        Json::Array(values) => Value::Array(values.iter().map(value).collect::<Result<Array, Refusal>>()?),
        Json::Object(entries) => {
            let entries = entries.iter().map(|(key, json)| Ok((key.as_str(), value(json)?)));
            Value::InlineTable(entries.collect::<Result<InlineTable, Refusal>>()?)
        }
        Json::Null => return Err(Refusal::bad("TOML has no null; take the key out instead")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(text: &str, changes: serde_json::Value) -> String {
        let changes: Vec<Change> = serde_json::from_value(changes).unwrap();
        edited(text, &changes).unwrap()
    }

    #[test]
    fn comments_and_order_stay() {
        let text = "# logs\ndevice = \"planar2r\"\n\n[[run]] # first\nfile = \"a.csv\"\nrole = \"fit\" # seen\n\n# second\n[[run]]\nfile = \"b.csv\"\nrole = \"fit\"\n\n[scale]\ntau0 = 1.0 # drive\nq0 = 2\n";
        let after = changed(
            text,
            serde_json::json!([
                { "keys": ["run", 1, "role"], "value": "validate" },
                { "keys": ["scale", "tau0"], "value": 3 },
                { "keys": ["scale", "q0"], "value": null },
                { "keys": ["cutoff_hz"], "value": 20.5 },
            ]),
        );
        let expected = text.replacen("b.csv\"\nrole = \"fit\"", "b.csv\"\nrole = \"validate\"", 1);
        let expected = expected.replace("1.0 # drive\nq0 = 2\n", "3.0 # drive\n");
        assert_eq!(after, expected.replace("\"planar2r\"\n", "\"planar2r\"\ncutoff_hz = 20.5\n"));
    }

    #[test]
    fn runs_are_added_and_taken_out() {
        let text = "device = \"planar2r\"\n\n[[run]]\nfile = \"a.csv\"\n\n# the other\n[[run]]\nfile = \"b.csv\"\n";
        let after = changed(
            text,
            serde_json::json!([
                { "keys": ["run", 1], "insert": { "file": "new.csv", "rows": [0, 100], "free": [0] } },
                { "keys": ["run", 0], "value": null },
            ]),
        );
        assert!(after.contains("# the other\n[[run]]\nfile = \"b.csv\""), "{after}");
        let runs = after.parse::<toml::Table>().unwrap();
        let files: Vec<&str> =
            runs["run"].as_array().unwrap().iter().map(|run| run["file"].as_str().unwrap()).collect();
        assert_eq!(files, ["new.csv", "b.csv"]);
        let nowhere: Vec<Change> =
            serde_json::from_value(serde_json::json!([{ "keys": ["run", 9, "role"], "value": "fit" }])).unwrap();
        assert!(edited(text, &nowhere).is_err());
    }
}
