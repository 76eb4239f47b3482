//! Every dependency's licence, against what `deny.toml` allows.
//!
//! The same file serves `cargo deny`; reading it here means that the check needs no tool beyond cargo. A crate outside
//! the list is an error; one in `[[licenses.exceptions]]` is allowed by name (Symbolica: its licence asks something of
//! whoever runs it, see README.md).

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use anyhow::{Context, bail};
use serde_json::Value;

use crate::shell;

/// Fails on a dependency that `deny.toml` does not allow.
pub fn check() -> anyhow::Result<()> {
    let path = shell::root().join("deny.toml");
    let text = fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))?;
    let allowed = Allowed::parse(&text).with_context(|| format!("in {}", path.display()))?;
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let version = shell::stdout_of(std::process::Command::new(rustc).arg("-vV"))?;
    let host =
        version.lines().find_map(|line| line.strip_prefix("host: ")).context("`rustc -vV` does not name the host")?;
    let metadata = shell::stdout_of(&mut shell::cargo(&[
        "metadata",
        "--format-version",
        "1",
        "--locked",
        "--filter-platform",
        host,
    ]))?;
    let metadata: Value = serde_json::from_str(&metadata).context("reading `cargo metadata`")?;
    let resolved: BTreeSet<&str> = metadata["resolve"]["nodes"]
        .as_array()
        .context("`cargo metadata` lists no nodes")?
        .iter()
        .filter_map(|node| node["id"].as_str())
        .collect();
    let packages = metadata["packages"].as_array().context("`cargo metadata` lists no packages")?;
    let mut wrong = Vec::new();
    let mut n_checked = 0;
    for package in packages.iter().filter(|package| package["id"].as_str().is_some_and(|id| resolved.contains(id))) {
        let name = package["name"].as_str().unwrap_or_default();
        let licence = allowed.clarified(name).or(package["license"].as_str()).unwrap_or("none stated");
        n_checked += 1;
        if !allowed.allows(name, licence) {
            wrong.push(format!("{name}: licence `{licence}` is not in deny.toml"));
        }
    }
    if !wrong.is_empty() {
        bail!("{}", wrong.join("\n"));
    }
    println!("{n_checked} crates, all under licences that deny.toml allows");
    Ok(())
}

#[derive(Debug)]
struct Allowed {
    everywhere: BTreeSet<String>,
    by_crate: BTreeMap<String, BTreeSet<String>>,
    clarified: BTreeMap<String, String>,
}

impl Allowed {
    fn parse(text: &str) -> anyhow::Result<Self> {
        let table: toml::Table = text.parse()?;
        let licences = table.get("licenses").and_then(toml::Value::as_table).context("`[licenses]` is missing")?;
        let names = |value: Option<&toml::Value>| -> anyhow::Result<BTreeSet<String>> {
            let array = value.and_then(toml::Value::as_array).context("`allow` must be an array of names")?;
            array
                .iter()
                .map(|name| name.as_str().map(str::to_owned).context("`allow` must be an array of names"))
                .collect()
        };
        let mut by_crate = BTreeMap::new();
        for exception in licences.get("exceptions").and_then(toml::Value::as_array).into_iter().flatten() {
            let name = exception.get("crate").and_then(toml::Value::as_str).context("an exception names no crate")?;
            by_crate.insert(name.to_owned(), names(exception.get("allow"))?);
        }
        let mut clarified = BTreeMap::new();
        for entry in licences.get("clarify").and_then(toml::Value::as_array).into_iter().flatten() {
            let word = |key: &str| entry.get(key).and_then(toml::Value::as_str).map(str::to_owned);
            clarified.insert(
                word("crate").context("a clarification names no crate")?,
                word("expression").context("a clarification has no expression")?,
            );
        }
        Ok(Self { everywhere: names(licences.get("allow"))?, by_crate, clarified })
    }

    fn clarified(&self, name: &str) -> Option<&str> {
        self.clarified.get(name).map(String::as_str)
    }

    fn allows(&self, name: &str, licence: &str) -> bool {
        let of_crate = self.by_crate.get(name);
        satisfied(licence, &|id| {
            self.everywhere.contains(id) || of_crate.is_some_and(|exceptions| exceptions.contains(id))
        })
    }
}

/// Whether an SPDX expression holds: `OR` (also written `/`) binds weaker than `AND`; `WITH` stays part of the name.
fn satisfied(expression: &str, allowed: &dyn Fn(&str) -> bool) -> bool {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let (holds, rest) = either(&words, allowed);
    holds && rest.is_empty()
}

fn either<'a>(words: &'a [&'a str], allowed: &dyn Fn(&str) -> bool) -> (bool, &'a [&'a str]) {
    let (mut holds, mut rest) = both(words, allowed);
    while rest.first() == Some(&"OR") {
        let (next, after) = both(&rest[1..], allowed);
        holds |= next;
        rest = after;
    }
    (holds, rest)
}

fn both<'a>(words: &'a [&'a str], allowed: &dyn Fn(&str) -> bool) -> (bool, &'a [&'a str]) {
    let (mut holds, mut rest) = one(words, allowed);
    while rest.first() == Some(&"AND") {
        let (next, after) = one(&rest[1..], allowed);
        holds &= next;
        rest = after;
    }
    (holds, rest)
}

fn one<'a>(words: &'a [&'a str], allowed: &dyn Fn(&str) -> bool) -> (bool, &'a [&'a str]) {
    match words {
        ["(", inner @ ..] => {
            let (holds, rest) = either(inner, allowed);
            match rest {
                [")", after @ ..] => (holds, after),
                _ => (false, rest),
            }
        }
        [id, "WITH", exception, rest @ ..] => (allowed(&format!("{id} WITH {exception}")), rest),
        [id, rest @ ..] => (allowed(id), rest),
        [] => (false, words),
    }
}

#[cfg(test)]
mod tests {
    use super::{Allowed, satisfied};

    #[test]
    fn expressions_are_read_as_spdx_writes_them() {
        let allowed = |id: &str| ["MIT", "Unicode-3.0", "Apache-2.0 WITH LLVM-exception"].contains(&id);
        for (expression, holds) in [
            ("MIT", true),
            ("GPL-3.0", false),
            ("GPL-3.0 OR MIT", true),
            ("GPL-3.0/MIT", true),
            ("MIT AND GPL-3.0", false),
            ("(MIT OR GPL-3.0) AND Unicode-3.0", true),
            ("GPL-3.0 AND MIT OR MIT", true),
            ("GPL-3.0 AND (MIT OR MIT)", false),
            ("Apache-2.0 WITH LLVM-exception", true),
            ("Apache-2.0", false),
            ("(MIT", false),
            ("", false),
        ] {
            assert_eq!(satisfied(expression, &allowed), holds, "{expression}");
        }
    }

    #[test]
    fn every_dependency_is_allowed() {
        super::check().unwrap();
    }

    #[test]
    fn an_exception_holds_for_its_crate_alone() {
        let text = "[licenses]\nallow = [\"MIT\"]\nexceptions = [{ crate = \"algebra\", allow = [\"LicenseRef-A\"] }]";
        let allowed = Allowed::parse(text).unwrap();
        assert!(allowed.allows("algebra", "LicenseRef-A") && !allowed.allows("other", "LicenseRef-A"));
    }
}
