//! A TOML text changed in place: comments and order stay.

use serde::{Deserialize, Deserializer};
use serde_json::Value as Json;
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value};

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
    /// The table becomes as many, each with what is said of it: parts of a run.
    parts: Option<Vec<serde_json::Map<String, Json>>>,
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
    if let Some(parts) = &change.parts {
        let Key::Index(index) = last else { return Err(nowhere()) };
        return part(item, *index, parts);
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
        (Some(json), None, Key::Name(name)) => set(item.as_table_like_mut().ok_or_else(nowhere)?, name, json)?,
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
            *tables = in_this_order(all);
        }
        _ => return Err(Refusal::bad("a change has either `value`, or `insert` with a table, or `parts`")),
    }
    Ok(())
}

/// A table of an array of tables as several, one for each of `parts`, with what that says.
fn part(item: &mut Item, index: usize, parts: &[serde_json::Map<String, Json>]) -> Result<(), Refusal> {
    let tables = item.as_array_of_tables_mut().filter(|tables| index < tables.len());
    let tables = tables.ok_or_else(|| Refusal::bad("what is parted is no [[table]] of the file; edit it as text"))?;
    let mut all: Vec<Table> = tables.iter().cloned().collect();
    let whole = all.remove(index);
    for (place, changes) in parts.iter().enumerate() {
        let mut own = whole.clone();
        if place > 0 {
            // The words above belong to the first.
            own.decor_mut().set_prefix("\n");
        }
        changes.iter().try_for_each(|(name, json)| set(&mut own, name, json))?;
        all.insert(index + place, own);
    }
    *tables = in_this_order(all);
    Ok(())
}

/// Tables are written in the order of their places in the file they were read from: these have none.
fn in_this_order(mut tables: Vec<Table>) -> ArrayOfTables {
    tables.iter_mut().for_each(|table| table.set_position(None));
    tables.into_iter().collect()
}

/// A value of a table, with the comments of what stood there.
fn set(table: &mut dyn TableLike, name: &str, json: &Json) -> Result<(), Refusal> {
    match table.get_mut(name).and_then(Item::as_value_mut) {
        Some(old) => replace(old, json)?,
        None => {
            table.insert(name, Item::Value(value(json)?));
        }
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

    #[test]
    fn a_run_is_cut_into_parts() {
        let text = "device = \"planar2r\"\n\n# the first\n[[run]]\nfile = \"a.csv\"\nrole = \"fit\" # seen\nrows = [\n  0, # all\n  900,\n]\n\n[run.columns]\ntau0 = \"i0\"\n\n[[run]]\nfile = \"b.csv\"\n\n[scale]\ntau0 = 2.0\n";
        let parts = serde_json::json!([
            { "rows": [0, 300], "role": "fit" },
            { "rows": [300, 500], "role": "validate", "moving": true },
            { "rows": [500, 900], "role": "fit", "moving": true },
        ]);
        let after = changed(text, serde_json::json!([{ "keys": ["run", 0], "parts": parts }]));
        assert_eq!(after.matches("# the first").count(), 1, "{after}");
        let table = after.parse::<toml::Table>().unwrap();
        let part = |rows: [i64; 2], role: &str, moving: Option<bool>| {
            let mut own = toml::toml! { file = "a.csv" };
            own.insert("rows".into(), rows.to_vec().into());
            own.insert("role".into(), role.into());
            own.insert("columns".into(), toml::toml! { tau0 = "i0" }.into());
            own.extend(moving.map(|moving| ("moving".to_owned(), moving.into())));
            toml::Value::Table(own)
        };
        let runs = [
            part([0, 300], "fit", None),
            part([300, 500], "validate", Some(true)),
            part([500, 900], "fit", Some(true)),
            toml::Value::Table(toml::toml! { file = "b.csv" }),
        ];
        assert_eq!(table["run"].as_array().unwrap()[..], runs, "{after}");
        assert_eq!(table["scale"]["tau0"].as_float(), Some(2.0), "{after}");
    }
}
