//! Files that documents name.

use std::fs;
use std::path::{Path, PathBuf};

/// What is longer is a log, and no document (bytes).
pub const LARGEST_TEXT: u64 = 1 << 20;
/// Keys of documents whose values are files, be they there or not.
const NAMES_FILES: [&str; 3] = ["file", "controller", "device"];

/// What a document (TOML) names beside itself, and what these name in turn; some of it may be no file.
pub fn all_named_by(path: &Path) -> Vec<PathBuf> {
    let mut named: Vec<PathBuf> = Vec::new();
    let mut read = vec![path.to_owned()];
    while let Some(document) = read.pop() {
        for place in named_by(&document) {
            if !named.contains(&place) {
                read.push(place.clone());
                named.push(place);
            }
        }
    }
    named
}

fn named_by(path: &Path) -> Vec<PathBuf> {
    // What is larger is a log, and no document.
    let is_text = fs::metadata(path).is_ok_and(|found| found.is_file() && found.len() <= LARGEST_TEXT);
    let text = if is_text { fs::read_to_string(path).ok() } else { None };
    let table = text.and_then(|text| text.parse::<toml::Table>().ok());
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut named = Vec::new();
    files_named(&toml::Value::Table(table.unwrap_or_default()), "", folder, &mut named);
    named
}

/// Values of keys that name files, and all others by which there is a file.
fn files_named(value: &toml::Value, key: &str, folder: &Path, named: &mut Vec<PathBuf>) {
    match value {
        toml::Value::Table(table) => table.iter().for_each(|(key, value)| files_named(value, key, folder, named)),
        toml::Value::Array(values) => values.iter().for_each(|value| files_named(value, key, folder, named)),
        toml::Value::String(name) => {
            let place = folder.join(name);
            if NAMES_FILES.contains(&key) || place.is_file() {
                named.push(place);
            }
        }
        _ => {}
    }
}
