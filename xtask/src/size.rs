//! How large the diagnosis is: its lines without tests, and the numbers that decide in it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

/// What diagnoses, and what searches for the start of a fit.
const SOURCES: [&str; 4] = [
    "crates/diagnose/src",
    "crates/identify/src/starts.rs",
    "crates/identify/src/position/searches.rs",
    "crates/identify/src/follows_log.rs",
];

/// Prints the size of the diagnosis.
pub fn print() -> anyhow::Result<()> {
    let root = crate::shell::root();
    let mut files = Vec::new();
    for source in SOURCES {
        collect(&root.join(source), &mut files)?;
    }
    let (mut lines, mut settings, mut constants) = (0, 0, 0);
    for file in &files {
        let text = fs::read_to_string(file).with_context(|| file.display().to_string())?;
        let code = without_tests(&text);
        lines += code.lines().count();
        constants += code.lines().filter(|line| is_number(line)).count();
        if file.ends_with("settings.rs") {
            settings +=
                code.lines().filter(|line| line.trim_start().starts_with("pub(super) ") && line.ends_with(',')).count();
        }
    }
    println!(
        "the diagnosis: {lines} lines without tests in {} files; {settings} settings, {constants} constants beside them",
        files.len()
    );
    Ok(())
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    if path.is_file() {
        files.push(path.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(path).with_context(|| path.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() || path.extension().is_some_and(|extension| extension == "rs") {
            collect(&path, files)?;
        }
    }
    Ok(())
}

/// A file up to its tests, which stand at its end.
fn without_tests(text: &str) -> &str {
    text.split("\n#[cfg(test)]").next().unwrap_or(text)
}

/// Whether a line gives a number its name.
fn is_number(line: &str) -> bool {
    let name = line.trim_start().trim_start_matches("pub ").trim_start_matches("pub(super) ").strip_prefix("const ");
    let kind = name.and_then(|name| name.split_once(": ")).map(|(_, kind)| kind);
    kind.is_some_and(|kind| ["f64", "usize", "[f64", "[(f64", "(f64"].iter().any(|number| kind.starts_with(number)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_from_other_constants_and_tests_from_code() {
        for (line, expected) in [
            ("const FAR: f64 = 3.0;", true),
            ("    pub(super) const PARTS: usize = 3;", true),
            ("pub const RATES: [f64; 3] = [1.0, 0.3, 0.1];", true),
            ("const NAME: &str = \"a\";", false),
            ("let far: f64 = 3.0;", false),
        ] {
            assert_eq!(is_number(line), expected, "{line}");
        }
        assert_eq!(without_tests("code\n\n#[cfg(test)]\nmod tests;\n"), "code\n");
    }
}
