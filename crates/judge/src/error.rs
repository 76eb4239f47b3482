//! Why a model cannot be compared with logs.

use dynid_dynamics::system::SystemError;
use dynid_files::DocumentError;

/// A comparison that cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// A model that makes no equations for a run.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The controller's file of a closed-loop run.
    #[error(transparent)]
    Controller(#[from] DocumentError),
}
