//! The members of the workspace, as `cargo metadata` tells them.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::Value;

use crate::shell;

/// A crate of the workspace.
#[derive(Debug)]
pub struct Member {
    pub name: String,
    pub manifest: PathBuf,
    /// Every one that its `Cargo.toml` names, of other workspaces too.
    pub dependencies: Vec<Dependency>,
    pub targets: Vec<Target>,
}

/// What a member's `Cargo.toml` says that it needs.
#[derive(Debug)]
pub struct Dependency {
    pub package: String,
    /// What sources call it: its key in `Cargo.toml`, with underscores.
    pub identifier: String,
    pub kind: Kind,
    pub features: Vec<String>,
}

/// Which table of `Cargo.toml` names a dependency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Normal,
    Build,
    Development,
}

impl Kind {
    /// Name of the table.
    pub fn table(self) -> &'static str {
        match self {
            Self::Normal => "dependencies",
            Self::Build => "build-dependencies",
            Self::Development => "dev-dependencies",
        }
    }
}

/// What cargo compiles on its own.
#[derive(Debug)]
pub struct Target {
    pub kind: TargetKind,
    /// The file that everything else of it is declared from.
    pub root: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TargetKind {
    Library,
    Program,
    BuildScript,
    /// A test, a benchmark or an example: what dev-dependencies are for.
    Trial,
}

impl Member {
    /// What other crates' sources call it.
    pub fn identifier(&self) -> String {
        identifier(&self.name)
    }

    /// Its library's root file, where it has a library.
    pub fn library(&self) -> Option<&Path> {
        let library = self.targets.iter().find(|target| target.kind == TargetKind::Library);
        library.map(|target| target.root.as_path())
    }
}

/// Every member of the workspace.
pub fn members() -> anyhow::Result<Vec<Member>> {
    let text = shell::stdout_of(&mut shell::cargo(&["metadata", "--no-deps", "--format-version", "1", "--locked"]))?;
    read(&text).context("reading `cargo metadata`")
}

/// Names of all packages that `package` is built from, itself included; `edges` are the kinds that `cargo tree` knows.
pub fn built_from(package: &str, edges: &str) -> anyhow::Result<Vec<String>> {
    let arguments = ["tree", "--edges", edges, "--prefix", "none", "--locked", "--package", package];
    let tree = shell::stdout_of(&mut shell::cargo(&arguments))?;
    Ok(tree.lines().filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect())
}

/// A file's path as the workspace's root sees it.
pub fn shown(file: &Path) -> String {
    file.strip_prefix(shell::root()).unwrap_or(file).display().to_string()
}

fn read(metadata: &str) -> anyhow::Result<Vec<Member>> {
    let metadata: Value = serde_json::from_str(metadata)?;
    metadata["packages"].as_array().context("it lists no packages")?.iter().map(member).collect()
}

fn member(package: &Value) -> anyhow::Result<Member> {
    Ok(Member {
        name: word(package, "name")?.to_owned(),
        manifest: word(package, "manifest_path")?.into(),
        dependencies: list(package, "dependencies")?.iter().map(dependency).collect::<Result<_, _>>()?,
        targets: list(package, "targets")?.iter().map(target).collect::<Result<_, _>>()?,
    })
}

fn dependency(table: &Value) -> anyhow::Result<Dependency> {
    let package = word(table, "name")?;
    let kind = match table["kind"].as_str() {
        None => Kind::Normal,
        Some("build") => Kind::Build,
        Some("dev") => Kind::Development,
        Some(other) => bail!("`{package}` is a dependency of the unknown kind `{other}`"),
    };
    let key = table["rename"].as_str().unwrap_or(package);
    let features = list(table, "features")?.iter().filter_map(Value::as_str).map(str::to_owned).collect();
    Ok(Dependency { package: package.to_owned(), identifier: identifier(key), kind, features })
}

fn target(table: &Value) -> anyhow::Result<Target> {
    let kinds = list(table, "kind")?;
    let is = |kind: &str| kinds.iter().any(|other| other == kind);
    let kind = if is("custom-build") {
        TargetKind::BuildScript
    } else if is("bin") {
        TargetKind::Program
    } else if is("test") || is("bench") || is("example") {
        TargetKind::Trial
    } else {
        TargetKind::Library
    };
    Ok(Target { kind, root: word(table, "src_path")?.into() })
}

fn word<'a>(table: &'a Value, key: &str) -> anyhow::Result<&'a str> {
    table[key].as_str().with_context(|| format!("`{key}` is missing"))
}

fn list<'a>(table: &'a Value, key: &str) -> anyhow::Result<&'a Vec<Value>> {
    table[key].as_array().with_context(|| format!("`{key}` is missing"))
}

fn identifier(package: &str) -> String {
    package.replace('-', "_")
}

#[cfg(test)]
mod tests {
    use super::{Kind, TargetKind, read};

    #[test]
    fn a_member_is_read_with_its_renamed_dependency_and_its_targets() {
        let metadata = r#"{ "packages": [{
            "name": "a-b", "manifest_path": "/w/a/Cargo.toml",
            "dependencies": [
                { "name": "long-name", "rename": "short-name", "kind": null, "features": ["f"] },
                { "name": "other", "rename": null, "kind": "dev", "features": [] }
            ],
            "targets": [
                { "kind": ["lib"], "src_path": "/w/a/src/lib.rs" },
                { "kind": ["bench"], "src_path": "/w/a/benches/b.rs" }
            ]
        }] }"#;
        let members = read(metadata).unwrap();
        let member = &members[0];
        assert_eq!(member.identifier(), "a_b");
        assert_eq!(member.library().unwrap().to_str(), Some("/w/a/src/lib.rs"));
        assert_eq!(member.targets[1].kind, TargetKind::Trial);
        let renamed = &member.dependencies[0];
        assert_eq!((renamed.package.as_str(), renamed.identifier.as_str()), ("long-name", "short_name"));
        assert_eq!((renamed.kind, renamed.features.as_slice()), (Kind::Normal, &["f".to_owned()][..]));
        assert_eq!(member.dependencies[1].kind, Kind::Development);
    }
}
