//! Effects of the user in this process: the library reads them once, when a program starts.

use std::fs;
use std::path::PathBuf;

use anyhow::anyhow;
use dynid::Model;
use dynid_model::library::is_shipped;

use super::answer::Refusal;
use super::folder::Stamp;

/// The user's effects as they were when the server began.
pub struct OwnEffects {
    folder: PathBuf,
    then: Vec<(PathBuf, Option<Stamp>)>,
}

impl OwnEffects {
    /// Those of a folder, which may not be there.
    pub fn new(folder: PathBuf) -> Self {
        Self { then: stamps(&folder), folder }
    }

    /// A model that was read, unless what it needs may have changed since the library was.
    pub fn known<E: Into<anyhow::Error>>(&self, read: Result<Model, E>) -> Result<Model, Refusal> {
        if stamps(&self.folder) == self.then {
            return Ok(read?);
        }
        let remedy = format!("{} was changed since: start `dynid open` again", self.folder.display());
        match read {
            Ok(model) if model.effects.iter().all(|own| is_shipped(own.effect)) => Ok(model),
            Ok(_) => Err(anyhow!("the model has effects of your own, read when this server began; {remedy}").into()),
            Err(error) => {
                Err(anyhow!("{}; effects of your own were read when this server began, and {remedy}", error.into())
                    .into())
            }
        }
    }
}

fn stamps(folder: &PathBuf) -> Vec<(PathBuf, Option<Stamp>)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|own| own == "toml")).collect();
    files.sort();
    files.into_iter().map(|path| (Stamp::of(&path), path)).map(|(stamp, path)| (path, stamp)).collect()
}
