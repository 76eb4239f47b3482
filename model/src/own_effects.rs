//! Effects of users: files in a folder of theirs, which join the library when a program starts.

use std::{
    fmt, fs, io,
    path::{Path, PathBuf},
};

use crate::{ModelError, document::read_text};

/// Why a folder's effects cannot join the library.
#[derive(Debug)]
pub enum NoEffects {
    /// A folder or a file that cannot be read.
    Unreadable {
        /// Which.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
    /// A file that is wrong.
    Wrong(ModelError),
    /// A file with the name of one of the library's.
    Taken {
        /// Which.
        path: PathBuf,
    },
    /// The library is in use already: it is the same for all that a process does.
    TooLate {
        /// Whose effects were to join it.
        folder: PathBuf,
    },
}

impl fmt::Display for NoEffects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoEffects::Unreadable { path, error } => {
                write!(f, "{}: cannot be read: {error}; name a folder of effect files", path.display())
            }
            NoEffects::Wrong(error) => error.fmt(f),
            NoEffects::Taken { path } => {
                write!(f, "{}: the library has an effect of this name; rename the file", path.display())
            }
            NoEffects::TooLate { folder } => {
                write!(f, "{}: its effects come too late; read them before anything else", folder.display())
            }
        }
    }
}

impl std::error::Error for NoEffects {}

/// Path and text of every effect file in a folder, by name, but for those that are copies of `shipped` ones.
pub(crate) fn effect_files(folder: &Path, shipped: &[(&str, &str)]) -> Result<Vec<(String, String)>, NoEffects> {
    let unreadable = |path: &Path| {
        let path = path.to_owned();
        move |error| NoEffects::Unreadable { path, error }
    };
    let entries = fs::read_dir(folder).and_then(|entries| entries.collect::<io::Result<Vec<_>>>());
    let paths = entries.map_err(unreadable(folder))?.into_iter().map(|entry| entry.path());
    let mut paths: Vec<PathBuf> = paths.filter(|path| path.extension().is_some_and(|own| own == "toml")).collect();
    paths.sort();
    let mut files = Vec::new();
    for path in paths {
        let text = read_text(&path).map_err(unreadable(&path))?;
        match shipped.iter().find(|(known, _)| Path::new(known).file_name() == path.file_name()) {
            Some((_, known)) if *known == text => {}
            Some(_) => return Err(NoEffects::Taken { path }),
            None => files.push((path.to_string_lossy().into_owned(), text)),
        }
    }
    Ok(files)
}
