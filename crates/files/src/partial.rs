//! Files and folders that are filled beside their places, under a name that nobody reads: `.NAME.PROCESS-NUMBER.partial`.
//!
//! Who fills one holds its lock, so that what a killed program has left is told from what another is filling, and removed.

use std::{
    fs::{self, File, TryLockError},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use super::{FileError, Overwrite, folder_of, make_folder, unwritable};

/// A file that is written beside its place, and goes when it is dropped, unless it took its name.
#[derive(Debug)]
pub struct PartialFile {
    path: PathBuf,
    place: PathBuf,
    // Its lock ends with it.
    file: File,
}

impl PartialFile {
    /// Makes an empty file that is to be `path`.
    ///
    /// # Errors
    /// [`FileError::Unwritable`].
    pub fn of(path: &Path) -> Result<Self, FileError> {
        Self::made(path).map_err(unwritable(path))
    }

    /// Makes a file with its content, and brings that to the disk.
    ///
    /// # Errors
    /// [`FileError::Unwritable`].
    pub fn with(path: &Path, content: &[u8]) -> Result<Self, FileError> {
        let filled = |mut own: Self| {
            own.file.write_all(content)?;
            own.file.sync_all()?;
            Ok(own)
        };
        Self::made(path).and_then(filled).map_err(unwritable(path))
    }

    fn made(path: &Path) -> io::Result<Self> {
        loop {
            let partial = partial_of(path);
            let file = match File::create_new(&partial) {
                // That of a process of the same number, which was killed or runs on another machine.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                made => made?,
            };
            let is_locked = match file.try_lock() {
                // Another takes it for a leftover.
                Err(TryLockError::WouldBlock) => continue,
                // Not every disk knows locks; on one that does not, leftovers are never removed.
                Err(TryLockError::Error(_)) => false,
                Ok(()) => true,
            };
            let own = Self { path: partial, place: path.to_owned(), file };
            // Another may have taken it for a leftover before it was locked.
            if !is_locked || own.path.try_exists()? {
                return Ok(own);
            }
        }
    }

    /// What to write to, and to read what was written: elsewhere than on Unix its lock keeps all others from it.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Gives the file, which is whole and on the disk, its name.
    ///
    /// # Errors
    /// [`FileError::Exists`] unless forced; [`FileError::Unwritable`].
    pub fn take_name(&mut self, overwrite: Overwrite) -> Result<(), FileError> {
        let exists = || FileError::Exists { path: self.place.clone() };
        if overwrite == Overwrite::Refuse {
            // Unlike a renaming, a second name for the file never takes the place of another that came meanwhile.
            match fs::hard_link(&self.path, &self.place) {
                Ok(()) => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(exists()),
                // Not every disk has second names.
                Err(_) if self.place.try_exists().map_err(unwritable(&self.place))? => return Err(exists()),
                Err(_) => {}
            }
        }
        fs::rename(&self.path, &self.place).map_err(unwritable(&self.place))?;
        // From now on another's may be there.
        self.path = PathBuf::new();
        Ok(())
    }
}

impl Drop for PartialFile {
    fn drop(&mut self) {
        // One that cannot be removed changes nothing; one that was renamed has no path any more.
        let _ = fs::remove_file(&self.path);
    }
}

/// A folder that is filled beside the place where its content belongs, and goes with what is still in it when it is dropped.
///
/// It is locked where the system locks folders; there, one that a killed program left is removed when the next is made.
#[derive(Debug)]
pub struct PartialFolder {
    path: PathBuf,
    _lock: Option<File>,
}

impl PartialFolder {
    /// Makes the folder whose content belongs to `path`, and those it lies in.
    ///
    /// # Errors
    /// [`FileError::Unwritable`].
    pub fn of(path: &Path) -> Result<Self, FileError> {
        make_folder(folder_of(path))?;
        remove_leftovers_of(folder_of(path), Left::Folders, |own| Some(own) == name_of(path).as_deref());
        loop {
            let partial = partial_of(path);
            match fs::create_dir(&partial) {
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                made => made.map_err(unwritable(path))?,
            }
            let lock = File::open(&partial).ok().filter(|folder| folder.lock().is_ok());
            // Another may have taken it for a leftover before it was locked.
            if partial.is_dir() {
                return Ok(Self { path: partial, _lock: lock });
            }
        }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for PartialFolder {
    fn drop(&mut self) {
        // Nothing is in it any more where all went well.
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Removes what programs that were killed while they wrote this file have left beside it. What one that runs is writing is locked, and stays.
///
/// It looks through the file's folder, so it is not done at every writing: [`check_output`](super::check_output) does it.
pub fn remove_leftovers(path: &Path) {
    remove_leftovers_of(folder_of(path), Left::Files, |own| Some(own) == name_of(path).as_deref());
}

/// As [`remove_leftovers`], of all files of a folder: `.NAME.PROCESS-NUMBER.partial` that nobody has locked.
pub fn remove_all_leftovers(folder: &Path) {
    remove_leftovers_of(folder, Left::Files, |_| true);
}

#[derive(Clone, Copy, PartialEq)]
enum Left {
    Files,
    Folders,
}

fn remove_leftovers_of(folder: &Path, kind: Left, is_wanted: impl Fn(&str) -> bool) {
    // Leftovers are in nobody's way: where they cannot be seen or removed they stay.
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        if entry.file_name().to_str().and_then(final_name).is_some_and(&is_wanted)
            && entry.file_type().is_ok_and(|own| own.is_dir() == (kind == Left::Folders))
            && let Ok(left) = File::options().read(true).write(kind == Left::Files).open(entry.path())
            && left.try_lock().is_ok()
        {
            let _ = match kind {
                Left::Files => fs::remove_file(entry.path()),
                Left::Folders => fs::remove_dir_all(entry.path()),
            };
        }
    }
}

/// A name beside a place that no other writer of this process has.
fn partial_of(path: &Path) -> PathBuf {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let [name, process] = [name_of(path).unwrap_or_default(), std::process::id().to_string()];
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    folder_of(path).join(format!(".{name}.{process}-{number}.partial"))
}

/// The name of the file that is written under a name of [`partial_of`].
fn final_name(partial: &str) -> Option<&str> {
    let (name, writer) = partial.strip_prefix('.')?.strip_suffix(".partial")?.rsplit_once('.')?;
    let is_number = |own: &str| !own.is_empty() && own.bytes().all(|byte| byte.is_ascii_digit());
    writer.split_once('-').is_some_and(|(process, number)| is_number(process) && is_number(number)).then_some(name)
}

fn name_of(path: &Path) -> Option<String> {
    path.file_name().map(|name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::super::{check_output, write_new};
    use super::*;

    #[test]
    fn what_a_killed_program_left_is_removed_and_what_another_writes_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let [path, left, others, users] =
            ["a.toml", ".a.toml.1-0.partial", ".a.toml.b.toml.1-0.partial", ".a.toml.2026-03-01.partial"]
                .map(|name| folder.path().join(name));
        let written = PartialFile::with(&path, b"by another").unwrap();
        fs::write(&left, "ha").unwrap();
        fs::write(&others, "of another file").unwrap();
        fs::write(&users, "of another program").unwrap();
        check_output(&path, Overwrite::Refuse).unwrap();
        assert!(!left.exists() && others.exists() && written.path.exists());
        write_new(&path, "one", Overwrite::Refuse).unwrap();
        assert!(written.path.exists());
        remove_all_leftovers(folder.path());
        assert!(!others.exists() && path.exists() && written.path.exists() && users.exists());
    }

    #[test]
    fn a_file_that_is_dropped_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        let two = [PartialFile::of(&path).unwrap(), PartialFile::of(&path).unwrap()];
        assert_ne!(two[0].path, two[1].path, "two threads write one file");
        assert!(two.iter().all(|own| own.path.exists()) && !path.exists());
        drop(two);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_file_that_came_while_another_was_written_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        let mut partial = PartialFile::with(&path, b"mine").unwrap();
        fs::write(&path, "another's").unwrap();
        assert!(matches!(partial.take_name(Overwrite::Refuse), Err(FileError::Exists { .. })));
        assert_eq!(fs::read_to_string(&path).unwrap(), "another's");
        partial.take_name(Overwrite::Force).unwrap();
        assert_eq!(partial.path, Path::new(""), "another's may be where it was");
        drop(partial);
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
    }

    #[test]
    fn a_folder_is_filled_beside_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let [place, left] = ["in/tour", "in/.tour.1-0.partial"].map(|name| folder.path().join(name));
        fs::create_dir_all(&left).unwrap();
        fs::write(left.join("log.csv"), "ha").unwrap();
        let partial = PartialFolder::of(&place).unwrap();
        let path = partial.path().to_owned();
        // A lock on a folder is Unix's.
        assert_eq!(left.exists(), !cfg!(unix), "what a killed program left");
        fs::write(path.join("log.csv"), "whole").unwrap();
        if cfg!(unix) {
            remove_leftovers_of(&folder.path().join("in"), Left::Folders, |_| true);
            assert!(path.exists(), "nobody else removes what is being filled");
        }
        drop(partial);
        assert!(!path.exists() && !place.exists());
        assert!(PartialFolder::of(&folder.path().join("in/a/b")).is_ok());
    }
}
