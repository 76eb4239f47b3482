//! An experiment and a model to begin with, from nothing but logs and a device.

mod experiment_file;
mod model_file;

use std::path::PathBuf;

use dynid_first_guess::{FirstGuess, Known};
use dynid_model::Device;

use crate::Error;

pub use experiment_file::experiment_file;
pub use model_file::model_file;

/// Says what logs of `device` hold, from their header and their numbers: columns, units, signs, free joints, runs to hold out;
/// each with its reason. [`experiment_file()`] and [`model_file()`] write it down.
///
/// # Errors
/// A log that cannot be read; a column that is needed and cannot be guessed.
///
/// ```
/// use std::path::{Path, PathBuf};
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/src/tour");
/// let device = dynid::device("freedom6s").expect("a shipped device");
/// let logs: Vec<PathBuf> = (1..=3).map(|k| format!("{folder}/wrist-{k}.csv").into()).collect();
/// let guess = dynid::first_guess(device, &logs, &Default::default())?;
/// assert!(guess.runs.iter().all(|run| run.free == [4, 5]));
/// let experiment = dynid::experiment_file(device, &logs, &guess, Path::new(folder));
/// assert!(experiment.contains("file = \"wrist-3.csv\""));
/// # Ok::<(), dynid::Error>(())
/// ```
pub fn first_guess(device: &'static Device, logs: &[PathBuf], known: &Known) -> Result<FirstGuess, Error> {
    Ok(dynid_first_guess::first_guess(device, logs, known)?)
}
