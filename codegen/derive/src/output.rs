//! The one writer that touches the disk.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};

/// Whether files are brought up to date or only looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Write what differs.
    Write,
    /// Say what differs.
    Check,
}

/// Brings `path` to `text`, or, in `Check`, says that it is stale. Untouched files keep their mtime. True where the
/// file was written.
///
/// # Errors
/// A file that cannot be read or written, or that is stale in `Check`.
pub fn put(path: &Path, text: &str, mode: Mode) -> anyhow::Result<bool> {
    let current = match fs::read_to_string(path) {
        Ok(current) => Some(current.replace("\r\n", "\n")),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(error).with_context(|| format!("reading {}", path.display())),
    };
    if current.as_deref() == Some(text) {
        return Ok(false);
    }
    if mode == Mode::Check {
        let what = if current.is_some() { "is stale" } else { "is missing" };
        bail!("{} {what}; run `cargo xtask gen` and commit the result", path.display());
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| format!("creating {}", folder.display()))?;
    }
    fs::write(path, text).with_context(|| format!("writing {}", path.display()))?;
    Ok(true)
}

/// Removes, or in `Check` reports, equations in `folder` that no device produces any more.
///
/// # Errors
/// A folder that cannot be read, or a left-over file in `Check`.
pub fn sweep(folder: &Path, kept: &BTreeMap<PathBuf, String>, root: &Path, mode: Mode) -> anyhow::Result<()> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error).with_context(|| format!("reading {}", folder.display())),
    };
    let mut paths = Vec::new();
    for entry in entries {
        paths.push(entry.with_context(|| format!("reading {}", folder.display()))?.path());
    }
    paths.sort();
    for path in paths {
        let ours = path.extension().is_some_and(|extension| extension == "kir");
        if !ours || kept.keys().any(|known| root.join(known) == path) {
            continue;
        }
        if mode == Mode::Check {
            bail!(
                "{} belongs to no configuration any more; run `cargo xtask gen` and commit the result",
                path.display()
            );
        }
        fs::remove_file(&path).with_context(|| format!("removing {}", path.display()))?;
    }
    Ok(())
}
