//! Names that become identifiers of the generated Rust.

use std::path::Path;

use crate::{document::Table, error::ModelError};

/// Keywords, those reserved for later included (The Rust Reference, "Keywords").
const KEYWORDS: [&str; 53] = [
    "Self", "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate", "do", "dyn",
    "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop", "macro",
    "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "return", "self", "static", "struct", "super",
    "trait", "true", "try", "type", "typeof", "unsafe", "unsized", "use", "virtual", "where", "while", "yield", "_",
];

/// Crates of Rust, and what stands beside the devices' modules and folders in the crate of the kernels.
const TAKEN: [&str; 18] = [
    "alloc",
    "alone",
    "build",
    "core",
    "dual",
    "effect",
    "effect_library",
    "end_point",
    "gradient",
    "kernel",
    "lanes",
    "library",
    "scalar",
    "src",
    "std",
    "structure",
    "target",
    "tests",
];

/// Whether Rust keeps this word for itself, so that nothing can be called so.
pub fn is_keyword(name: &str) -> bool {
    KEYWORDS.contains(&name)
}

/// The id of a device or an effect: the stem of its file, which names a module of the kernels.
pub fn read_id(root: &Table, path: &Path) -> Result<String, ModelError> {
    let id = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let reason = if !is_lower_case_identifier(&id) {
        "which is no lower-case name"
    } else if is_keyword(&id) {
        "which is a keyword of Rust"
    } else if TAKEN.contains(&id.as_str()) {
        "which is taken: the crate of the kernels has a part of this name"
    } else {
        return Ok(id);
    };
    Err(root.error(format!("the file's name makes the id `{id}`, {reason}")).help(
        "rename the file: lower-case letters, digits and `_` after a letter, e.g. `planar2r.toml`; the id names a Rust module",
    ))
}

fn is_lower_case_identifier(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}
