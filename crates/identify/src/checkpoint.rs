//! What is left of a fit that was stopped: enough to go on and end at the same bits.
//!
//! The file is TOML; numbers stand in it with as many digits as bring back the same bits. It names the data, the model
//! and the options that it belongs to, and is of use for no others.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use dynid_model::{
    Effect,
    document::read_text,
    error::{LONGEST_MESSAGE, shortened},
    sha256_hex,
};
use serde::{Deserialize, Serialize};

use crate::{identify::FitTask, identify::State, position::Options, sequence::Weighting};
use dynid_dynamics::simulate::Steps;
use dynid_files::{FileError, Overwrite, remove_leftovers, write_new};
use dynid_logs::{experiment::Experiment, experiment::Run};
use dynid_user_model::Model;

/// Raised whenever the state or the search that goes on from it changes its meaning.
const FORMAT: u32 = 12;

/// Why a checkpoint is of no use.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// There is none.
    #[error("there is no checkpoint {} to go on from; leave `--resume` out to start from the beginning", path.display())]
    Missing {
        /// Where it would be.
        path: PathBuf,
    },
    /// One is there, and the fit is to start from the beginning.
    #[error(
        "{} is left of a fit that was stopped; go on from it with `--resume`, or start from the beginning and lose it \
         with `--force`",
        path.display()
    )]
    Left {
        /// The checkpoint.
        path: PathBuf,
    },
    /// It belongs to another fit.
    #[error(
        "{} belongs to another fit: {what} was {expected}, now it is {found}; go on with what it was made with, or \
         start from the beginning with `--force` instead of `--resume`",
        path.display()
    )]
    Other {
        /// The checkpoint.
        path: PathBuf,
        /// What differs.
        what: &'static str,
        /// As the checkpoint says.
        expected: String,
        /// As it is now.
        found: String,
    },
    /// It is not what a fit wrote.
    #[error("{} cannot be read: {reason}; start from the beginning with `--force` instead of `--resume`", path.display())]
    Damaged {
        /// The checkpoint.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

/// What a fit is of: two fits of the same are the same.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Of this module and the searches.
    format: u32,
    /// Of the program.
    version: String,
    /// Digest of the samples and how they are processed.
    data: String,
    /// Digest of the start, its bounds, its device's structure and its effects included.
    model: String,
    /// As one would ask for it.
    options: String,
}

impl Identity {
    /// Of the fit of `model` to `runs`.
    pub fn new(model: &Model, experiment: &Experiment, runs: &[&Run], how: &FitTask) -> Self {
        let mut data = experiment.digest.clone();
        for run in runs {
            data.push_str(&format!("\n{} {} {:?} {:?}", run.file, run.role, run.free, run.settings));
        }
        // A user's files may change between a stop and going on.
        let effects: Vec<&Effect> = model.effects.iter().map(|own| own.effect).collect();
        let start = format!("{} {} {:?} {effects:?}", model.device.structure_digest(), model.digest(), model.prior);
        Self {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            data: sha256_hex(data.as_bytes()),
            // A search may start again from the prior values.
            model: sha256_hex(start.as_bytes()),
            options: request(how),
        }
    }
}

/// What is asked for, as one would ask `dynid fit` for it; what only the library can be asked for is named after it.
fn request(how: &FitTask) -> String {
    let FitTask { error, method, weighting, only, starts, options, tell_start } = how;
    let Options { steps, iterations, tolerance, start, end } = *options;
    let steps = match steps {
        Some(Steps::PerSample(steps)) => format!(" --substeps {steps}"),
        Some(Steps::Within(share)) => format!(" (steps within {share:e})"),
        None => String::new(),
    };
    let mut text = format!("--error {error}{steps} --iterations {iterations}");
    if let Some(method) = method {
        text.push_str(&format!(" --method {method}"));
    }
    if *weighting == Weighting::OfMethod {
        text.push_str(" --weights method");
    }
    if !only.is_empty() {
        text.push_str(&format!(" --only '{}'", only.join(",")));
    }
    if starts.count > 1 {
        text.push_str(&format!(" --starts {} --seed {}", starts.count, starts.seed));
    }
    if !starts.prior {
        text.push_str(" (not from the prior values)");
    }
    if !tell_start {
        text.push_str(" (without the cost at the start)");
    }
    let default = Options::default();
    if (tolerance, start, end) != (default.tolerance, default.start, default.end) {
        text.push_str(&format!(" (tolerance {tolerance:e}, start {start:?}, end {end:?})"));
    }
    text
}

#[derive(Serialize)]
struct Written<'a> {
    identity: &'a Identity,
    state: &'a State,
}

#[derive(Deserialize)]
struct WhoseState {
    identity: Identity,
}

#[derive(Deserialize)]
struct ReadState {
    state: State,
}

/// The checkpoint beside an output: `fitted.toml.checkpoint`.
pub fn path_beside(out: &Path) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".checkpoint");
    PathBuf::from(name)
}

/// Writes a state whole: whenever the program dies, the last state or the one before it is there.
///
/// # Errors
/// A file that cannot be written.
pub fn write(path: &Path, identity: &Identity, state: &State) -> Result<(), FileError> {
    let unwritable = |reason: String| FileError::Unwritable {
        path: path.to_owned(),
        source: io::Error::new(io::ErrorKind::InvalidData, reason),
    };
    let text = toml::to_string(&Written { identity, state }).map_err(|error| unwritable(error.to_string()))?;
    let text = format!("# State of a stopped fit; `dynid fit` with `--resume` goes on from it and removes it.\n{text}");
    write_new(path, &text, Overwrite::Force)
}

/// Reads the state of the fit `identity`.
///
/// # Errors
/// No file, one of another fit, one that no fit wrote.
pub fn read(path: &Path, identity: &Identity) -> Result<State, CheckpointError> {
    let text = read_text(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => CheckpointError::Missing { path: path.to_owned() },
        _ => CheckpointError::Damaged { path: path.to_owned(), reason: error.to_string() },
    })?;
    let damaged = |error: toml::de::Error| CheckpointError::Damaged {
        path: path.to_owned(),
        reason: shortened(error.message().to_owned(), LONGEST_MESSAGE),
    };
    // The state of another program may be none of this one.
    let WhoseState { identity: expected } = toml::from_str(&text).map_err(damaged)?;
    let program = |identity: &Identity| format!("{} (format {})", identity.version, identity.format);
    let pairs = [
        ("the program", program(&expected), program(identity)),
        ("the data", short(&expected.data), short(&identity.data)),
        ("the model", short(&expected.model), short(&identity.model)),
        ("the request", format!("`{}`", expected.options), format!("`{}`", identity.options)),
    ];
    for (what, expected, found) in pairs {
        if expected != found {
            let expected = shortened(expected, LONGEST_MESSAGE);
            return Err(CheckpointError::Other { path: path.to_owned(), what, expected, found });
        }
    }
    let ReadState { state } = toml::from_str(&text).map_err(damaged)?;
    Ok(state)
}

/// Removes the checkpoint of a fit that is done, and what is left of one that was being written; one that is not there is as good.
pub fn remove(path: &Path) -> io::Result<()> {
    remove_leftovers(path);
    match fs::remove_file(path) {
        // A read-only disk refuses before it looks whether the file is there.
        Err(_) if fs::symlink_metadata(path).is_err() => Ok(()),
        other => other,
    }
}

/// As much of a digest as tells two apart.
fn short(digest: &str) -> String {
    digest.chars().take(16).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_and_cannot_be_removed_is_an_error() {
        let folder = tempfile::TempDir::new().expect("a folder");
        let path = folder.path().join("out.toml.checkpoint");
        assert!(remove(&path).is_ok(), "it is not there");
        fs::write(&path, "").expect("a file");
        assert!(remove(&path).is_ok() && !path.exists());
        fs::create_dir(&path).expect("a folder");
        assert!(remove(&path).is_err() && path.exists());
    }
}
