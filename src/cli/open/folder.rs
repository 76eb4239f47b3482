//! The folder that is open: what lies in it, and that nothing outside of it is reached.

use std::collections::HashMap;
use std::fs::{self, Metadata};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use dynid_model::sha256_hex;
use serde_json::{Value, json};

use super::answer::Refusal;

/// Folders below each other that are listed.
const DEPTH: usize = 3;
/// Files that are listed.
const MOST_FILES: usize = 2000;
/// Larger files are no text to show, and get no digest.
pub const LARGEST_TEXT: u64 = 1 << 20;
/// Keys under which a document names other files.
const NAMES_FILES: [&str; 3] = ["file", "controller", "device"];

/// The folder. It is the working folder of the process, so that paths in requests are those of commands.
pub struct Folder {
    root: PathBuf,
    known: Mutex<HashMap<PathBuf, (Stamp, Known)>>,
}

/// Tells whether a file was written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    modified: SystemTime,
    bytes: u64,
}

/// What a file's content says.
#[derive(Clone)]
struct Known {
    kind: &'static str,
    digest: Option<String>,
}

impl Stamp {
    pub fn of(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|metadata| Self::from(&metadata))
    }

    fn from(metadata: &Metadata) -> Self {
        Self { modified: metadata.modified().unwrap_or(UNIX_EPOCH), bytes: metadata.len() }
    }
}

impl Folder {
    /// `root` without links.
    pub fn new(root: PathBuf) -> Self {
        Self { root, known: Mutex::default() }
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The path of a request, if it lies inside and is not hidden.
    pub fn place(&self, path: &str) -> Result<PathBuf, Refusal> {
        let clean: PathBuf = Path::new(path).components().filter(|part| *part != Component::CurDir).collect();
        if clean.as_os_str().is_empty() {
            return Err(Refusal::bad("name a file of the folder"));
        }
        self.check(&clean)?;
        Ok(clean)
    }

    /// That a path lies inside and is not hidden, whether there is something or not.
    pub fn check(&self, path: &Path) -> Result<(), Refusal> {
        if self.holds(path) {
            if is_hidden(path) {
                return Err(Refusal::forbidden(format!("{}: hidden files are left alone", path.display())));
            }
            return Ok(());
        }
        let path = path.display();
        Err(Refusal::forbidden(format!(
            "{path} lies outside of the open folder; open one that holds it, or copy it in"
        )))
    }

    fn holds(&self, path: &Path) -> bool {
        let stays = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
        if !path.components().all(stays) {
            return false;
        }
        let mut place = self.root.join(path);
        // What is not there yet lies where its folder lies; a link that leads nowhere may lead anywhere tomorrow.
        while place.symlink_metadata().is_err() {
            if !place.pop() {
                return false;
            }
        }
        place.canonicalize().is_ok_and(|place| place.starts_with(&self.root))
    }

    /// That the files that a document (TOML) names, and those that these name, lie inside, too.
    pub fn check_references(&self, path: &Path) -> Result<(), Refusal> {
        all_named_by(path).iter().try_for_each(|place| {
            // A document in a folder may name one beside that folder: `..` counts where it leads.
            let inside = match self.root.join(place).canonicalize() {
                Ok(real) => real.starts_with(&self.root),
                Err(_) => normal(place).is_some_and(|place| self.holds(&place)),
            };
            if inside {
                return Ok(());
            }
            let sentence =
                "lies outside of the open folder; run `dynid open` in a folder that holds both, or copy it in";
            Err(Refusal::forbidden(format!("{}: {} {sentence}", path.display(), place.display())))
        })
    }

    /// That a folder of effects, if there is one, and its files lie inside.
    pub fn check_effects(&self, effects: &Path) -> Result<(), Refusal> {
        self.check(effects)?;
        let mut entries = fs::read_dir(self.root.join(effects)).into_iter().flatten().flatten();
        entries.try_for_each(|entry| self.check(&effects.join(entry.file_name())))
    }

    /// What lies in the folder, by path; and how many files more.
    pub fn files(&self) -> (Vec<Value>, usize) {
        let mut paths = Vec::new();
        walk(&self.root, DEPTH, &mut paths);
        paths.sort();
        let more = paths.len().saturating_sub(MOST_FILES);
        paths.truncate(MOST_FILES);
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::take(&mut *known);
        let mut files = Vec::with_capacity(paths.len());
        for path in paths {
            let Ok(metadata) = fs::metadata(&path) else { continue };
            let relative = path.strip_prefix(&self.root).unwrap_or(&path).to_owned();
            if !self.holds(&relative) {
                continue;
            }
            let stamp = Stamp::from(&metadata);
            let same = before.get(&relative).filter(|(then, _)| *then == stamp);
            let own = same.map_or_else(|| Known::of(&path, metadata.len()), |(_, own)| own.clone());
            let modified = stamp.modified.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64);
            files.push(json!({
                "path": with_slashes(&relative),
                "kind": own.kind,
                "bytes": metadata.len(),
                "modified": modified,
                "digest": own.digest,
            }));
            known.insert(relative, (stamp, own));
        }
        (files, more)
    }
}

/// A relative path as requests write it.
pub fn with_slashes(path: &Path) -> String {
    path.components().map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// Whether a part of a relative path is hidden.
pub fn is_hidden(path: &Path) -> bool {
    let is_hidden = |part: Component<'_>| match part {
        Component::Normal(name) => name.to_string_lossy().starts_with('.'),
        _ => false,
    };
    path.components().any(is_hidden)
}

/// The path without `.` and `..`; `None` where it leads outside.
fn normal(path: &Path) -> Option<PathBuf> {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                if !normal.pop() {
                    return None;
                }
            }
            Component::Normal(name) => normal.push(name),
            Component::RootDir | Component::Prefix(_) => return None,
        }
    }
    Some(normal)
}

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

/// Digest of the content of these files; of long ones, such as logs, of when they were written and how long they are.
pub fn digest_of(files: &[PathBuf]) -> String {
    let of_file = |path: &PathBuf| match Stamp::of(path) {
        Some(stamp) if stamp.bytes <= LARGEST_TEXT => {
            fs::read(path).map(|content| sha256_hex(&content)).unwrap_or_default()
        }
        stamp => format!("{stamp:?}"),
    };
    let all: Vec<String> = files.iter().map(of_file).collect();
    sha256_hex(all.join("\n").as_bytes())
}

fn walk(folder: &Path, depth: usize, paths: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| !entry.file_name().to_string_lossy().starts_with('.')) {
        // Folders behind links are not gone into: they may lead round in a circle.
        match entry.file_type() {
            Ok(kind) if kind.is_dir() && depth > 0 => walk(&entry.path(), depth - 1, paths),
            Ok(_) if entry.path().is_file() => paths.push(entry.path()),
            _ => {}
        }
    }
}

impl Known {
    fn of(path: &Path, bytes: u64) -> Self {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let content = if bytes <= LARGEST_TEXT { fs::read(path).ok() } else { None };
        let digest = content.as_deref().map(sha256_hex);
        let text = content.and_then(|content| String::from_utf8(content).ok()).unwrap_or_default();
        let kind = match extension.as_str() {
            // Most texts without cells are called so.
            "txt" => "other",
            _ if dynid_tables::ending(path).is_some() => "log",
            "html" => "page",
            "checkpoint" => "checkpoint",
            "urdf" => "device",
            "xml" if text.contains("<mujoco") || text.contains("<robot") => "device",
            "json" if text.contains("\"verdict\"") && text.contains("\"ranking\"") => "diagnosis",
            "toml" => of_document(&text),
            _ => "other",
        };
        Self { kind, digest }
    }
}

/// The keys of a model.
const OF_MODELS: [&str; 7] = ["device", "link", "length", "base", "effect", "fit", "believed"];

/// Which of the program's documents it is, by the keys that only such have.
fn of_document(text: &str) -> &'static str {
    let Ok(table) = text.parse::<toml::Table>() else { return "other" };
    let has = |key: &str| table.contains_key(key);
    if has("torque_per_unit") {
        "wall"
    } else if has("controller") && has("approach") {
        "setting"
    } else if has("run") && table["run"].as_array().is_some_and(|runs| runs.iter().any(|run| run.get("file").is_some()))
    {
        "experiment"
    } else if has("kinematics") || has("units") && has("joint") {
        "device"
    } else if has("place") && has("scope") {
        "effect"
    } else if has("device") && table.keys().all(|key| OF_MODELS.contains(&key.as_str())) {
        "model"
    } else {
        "other"
    }
}
