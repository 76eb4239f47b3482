//! Logs of one joint of a wrist with LuGre friction, made by the plant (`recipe.toml`), and what is believed of it.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

/// A folder with the experiment, its logs and the believed model.
pub fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let wrist = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/wrist");
    for name in ["believed.toml", "experiment.toml", "wrist-1.csv", "wrist-2.csv", "wrist-3.csv"] {
        fs::copy(wrist.join(name), folder.path().join(name)).unwrap();
    }
    folder
}
