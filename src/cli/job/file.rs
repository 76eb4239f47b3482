//! The files of jobs and of their results.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use dynid_files::{Overwrite, write_new};
use dynid_model::sha256_hex;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{parse_json, read_json};

/// What stands in an argument for the place of the result, without an ending.
pub const OUT: &str = "{out}";

/// What a job file holds. It is named by the SHA-256 of itself as JSON with sorted keys and no blanks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Content {
    /// Those of `dynid`, without `--json`.
    pub arguments: Vec<String>,
    /// SHA-256 of each file that is read, by its path in the working folder: other data are another job.
    pub inputs: BTreeMap<String, String>,
    /// What it is about, for whoever reads the results: `robot`, `night`, ..
    pub labels: BTreeMap<String, String>,
}

/// A job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// What it is named by.
    pub digest: String,
    pub content: Content,
}

impl Content {
    /// Reads the text of a job file; `path` is for messages.
    pub fn parse(text: &str, path: &Path) -> anyhow::Result<Self> {
        serde_json::from_value(parse_json(text, path)?)
            .with_context(|| format!("{}: this is no job file; `dynid job --from` makes them", path.display()))
    }
}

impl Job {
    pub fn new(content: Content) -> anyhow::Result<Self> {
        // A `Value` sorts its keys.
        let text = serde_json::to_value(&content)?.to_string();
        Ok(Self { digest: sha256_hex(text.as_bytes()), content })
    }

    fn read(path: &Path) -> anyhow::Result<Self> {
        let job = Self::new(Content::parse(&dynid_files::read(path)?, path)?)?;
        if path.file_stem().is_none_or(|stem| stem != job.digest.as_str()) {
            bail!("{}: the content is not the one it is named by ({}); make the job anew", path.display(), job.digest);
        }
        Ok(job)
    }

    /// Writes it into a folder; false where it is there already.
    pub fn write(&self, folder: &Path) -> anyhow::Result<bool> {
        let path = folder.join(format!("{}.json", self.digest));
        if path.is_file() {
            return Ok(false);
        }
        write_new(&path, &format!("{}\n", serde_json::to_value(&self.content)?), Overwrite::Refuse)?;
        Ok(true)
    }

    /// Where its result lies.
    pub fn result_path(&self, out: &Path) -> PathBuf {
        self.path(out, "json")
    }

    /// Where its file of this ending lies.
    pub fn path(&self, out: &Path, ending: &str) -> PathBuf {
        out.join(format!("{}.{ending}", self.digest))
    }

    /// Its result, if it is there and whole.
    pub fn result(&self, out: &Path) -> Option<Value> {
        read_json(&self.result_path(out)).ok().filter(|result| result["job"] == self.digest.as_str())
    }

    /// The first file that is no longer the one that the job was made for.
    pub fn changed_input(&self) -> Option<&str> {
        let is_same =
            |(path, digest): &(&String, &String)| fs::read(path).is_ok_and(|bytes| sha256_hex(&bytes) == **digest);
        self.content.inputs.iter().find(|own| !is_same(own)).map(|(path, _)| path.as_str())
    }
}

/// All jobs of these files and folders, by their digests; each once.
pub fn read_all(places: &[PathBuf]) -> anyhow::Result<Vec<Job>> {
    let mut jobs = BTreeMap::new();
    for place in places {
        let files = if place.is_dir() { json_files(place)? } else { vec![place.clone()] };
        for file in files {
            let job = Job::read(&file)?;
            jobs.insert(job.digest.clone(), job);
        }
    }
    Ok(jobs.into_values().collect())
}

/// JSON files of a folder, by name.
pub fn json_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>();
    let mut paths = paths.with_context(|| format!("{} cannot be read", folder.display()))?;
    paths.retain(|path| path.extension().is_some_and(|ending| ending == "json") && path.is_file());
    paths.sort();
    Ok(paths)
}
