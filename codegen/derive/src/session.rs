//! One Symbolica process at a time on a machine: a second one without a licence aborts.

use std::fs::File;

use anyhow::Context;

/// Keeps other processes of ours from starting Symbolica until it is dropped.
pub struct Session {
    _lock: File,
}

/// Waits until no other process of ours runs Symbolica. Call it from the one thread that will use Symbolica.
///
/// # Errors
/// A temporary folder in which no file can be locked.
pub fn start() -> anyhow::Result<Session> {
    let path = std::env::temp_dir().join("dynid-symbolica.lock");
    // Another user's file may be read, which is enough to lock it, but not written.
    let lock = File::open(&path)
        .or_else(|_| File::options().create(true).truncate(false).write(true).open(&path))
        .with_context(|| format!("opening the lock {}", path.display()))?;
    lock.lock().with_context(|| format!("locking {}", path.display()))?;
    Ok(Session { _lock: lock })
}
