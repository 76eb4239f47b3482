//! Starts that lie outside their own bounds, brought to the nearest bound.

use std::path::Path;

use toml_edit::{DocumentMut, Item, TableLike, Value};

use super::{Model, read::Bodies};
use dynid_files::DocumentError;

impl Model {
    /// As [`Model::load`], but a value outside the bounds that the file states beside it is put on the nearest one; the
    /// model's notes say which were. Links may be what no body can be: a fit makes them physical (`made_physical` of
    /// `dynid-identify`).
    ///
    /// # Errors
    /// As [`Model::load`].
    pub fn load_clipped(path: &Path) -> Result<Self, DocumentError> {
        let text = dynid_files::read(path)?;
        let (text, clipped) = clipped(&text);
        let mut model = Self::parse_with(&text, path, Bodies::Unchecked, None)?;
        model.notes.extend(clipped);
        Ok(model)
    }
}

/// The text with every `{ value, lower, upper }` within its bounds, and what was changed. A text that is no TOML stays, for
/// the reader to say what is wrong with it.
fn clipped(text: &str) -> (String, Vec<String>) {
    let mut notes = Vec::new();
    let Ok(mut document) = text.parse::<DocumentMut>() else { return (text.to_owned(), notes) };
    walk(document.as_table_mut(), "", &mut notes);
    if notes.is_empty() { (text.to_owned(), notes) } else { (document.to_string(), notes) }
}

fn walk(table: &mut dyn TableLike, place: &str, notes: &mut Vec<String>) {
    for (key, item) in table.iter_mut() {
        let place = if place.is_empty() { key.get().to_owned() } else { format!("{place}.{}", key.get()) };
        match item {
            Item::ArrayOfTables(tables) => {
                for table in tables.iter_mut() {
                    let id = table.get("id").and_then(Item::as_str).unwrap_or_default().to_owned();
                    let joint = table.get("joint").and_then(Item::as_integer);
                    let place = joint.map_or_else(|| id.clone(), |joint| format!("joint.{joint}.{id}"));
                    walk(table, &place, notes);
                }
            }
            item => {
                if let Some(table) = item.as_table_like_mut() {
                    clip(table, &place, notes);
                    walk(table, &place, notes);
                }
            }
        }
    }
}

fn clip(table: &mut dyn TableLike, place: &str, notes: &mut Vec<String>) {
    let number = |key: &str| {
        let item = table.get(key)?;
        item.as_float().or_else(|| item.as_integer().map(|value| value as f64))
    };
    let Some(value) = number("value") else { return };
    let (lower, upper) = (number("lower").unwrap_or(f64::NEG_INFINITY), number("upper").unwrap_or(f64::INFINITY));
    // Bounds that cross are for the reader to refuse.
    if lower > upper || (lower..=upper).contains(&value) || value.is_nan() {
        return;
    }
    let bound = value.clamp(lower, upper);
    notes.push(format!("{place} started at {value}, outside its bounds {lower} .. {upper}; clipped to {bound}"));
    if let Some(old) = table.get_mut("value").and_then(Item::as_value_mut) {
        let decor = old.decor().clone();
        *old = Value::from(bound);
        *old.decor_mut() = decor;
    }
}

#[cfg(test)]
mod tests {
    use super::clipped;

    #[test]
    fn values_outside_their_bounds_are_put_on_them_and_reported() {
        let text = "# mine\n[link.2]\nm = { value = 2.0, lower = 0.5, upper = 1.5 } # kg\nx = 0.1\n\n[[effect]]\n\
                    id = \"viscous\"\njoint = 1\nFv = { value = -1, lower = 0.0, upper = 1.0 }\n";
        let (now, notes) = clipped(text);
        assert_eq!(now, text.replace("value = 2.0", "value = 1.5").replace("value = -1", "value = 0.0"));
        assert_eq!(notes.len(), 2);
        assert!(
            notes[0].starts_with("link.2.m started at 2, outside its bounds 0.5 .. 1.5; clipped to 1.5"),
            "{notes:?}"
        );
        assert!(notes[1].starts_with("joint.1.viscous.Fv started at -1"), "{notes:?}");
        let within = text.replace("2.0", "1.0").replace("-1,", "0.5,");
        assert_eq!(clipped(&within), (within.clone(), Vec::new()));
    }
}
