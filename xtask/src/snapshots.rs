//! Snapshots that no test looks at any more, and new ones that nobody has looked at yet.
//!
//! insta appends the path of every snapshot that a test refers to, to the file named by
//! `INSTA_SNAPSHOT_REFERENCES_FILE`; what is in the tree and not in there has been left behind.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// Fails on unreferenced `*.snap` and on pending `*.snap.new` below `root`.
pub fn check(root: &Path, references: &Path) -> anyhow::Result<()> {
    let text = fs::read_to_string(references).unwrap_or_default();
    let referenced: BTreeSet<PathBuf> =
        text.lines().filter_map(|line| fs::canonicalize(root.join(line.trim())).ok()).collect();
    let mut found = Vec::new();
    collect(root, &mut found)?;
    let pending = found.iter().filter(|path| path.extension().is_some_and(|extension| extension == "new"));
    let unreferenced = found.iter().filter(|path| {
        path.extension().is_some_and(|extension| extension == "snap")
            && fs::canonicalize(path).is_ok_and(|path| !referenced.contains(&path))
    });
    let reported: Vec<String> = pending
        .map(|path| format!("{}: a new snapshot waits for review", path.display()))
        .chain(unreferenced.map(|path| format!("{}: no test refers to this snapshot; remove it", path.display())))
        .collect();
    if !reported.is_empty() {
        bail!("{}", reported.join("\n"));
    }
    Ok(())
}

fn collect(folder: &Path, found: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    let entries = fs::read_dir(folder).with_context(|| format!("reading {}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            if name != "target" && !name.starts_with('.') {
                collect(&path, found)?;
            }
        } else if name.ends_with(".snap") || name.ends_with(".snap.new") {
            found.push(path);
        }
    }
    Ok(())
}
