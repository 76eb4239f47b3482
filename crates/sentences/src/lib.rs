//! What the library finds, as sentences: the one place where text, page and JSON take them from.
//!
//! The library's findings are enums with numbers. Here each becomes a sentence, and each result the JSON that programs read:
//! the typed findings with their sentences beside them.

pub mod check;
pub mod compare;
pub mod diagnosis;
pub mod discovered;
pub mod finding;
pub mod first_guess;
pub mod fit;
pub mod fleet;
pub mod ladder;
pub mod quality;

use serde_json::Value;

/// Sentences of all of them, in their order.
fn all<T>(findings: &[T], sentence: impl Fn(&T) -> String) -> Vec<String> {
    findings.iter().map(sentence).collect()
}

/// Puts what is said of each of `items` into the entry of the same place in the array `json[key]`.
fn each<T>(
    json: &mut Value,
    key: &str,
    items: &[T],
    mut put: impl FnMut(&T, &mut Value) -> serde_json::Result<()>,
) -> serde_json::Result<()> {
    let entries = json.get_mut(key).and_then(Value::as_array_mut);
    items.iter().zip(entries.into_iter().flatten()).try_for_each(|(item, entry)| put(item, entry))
}
