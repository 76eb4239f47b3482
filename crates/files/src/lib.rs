//! Reading text files ([`read`]) and writing results ([`write_new`], [`write_together`]): a file is written whole or not at all, and an existing one
//! is replaced only with [`Overwrite`] saying so.
//!
//! Errors name the file: [`FileError`]; [`DocumentError`] also says where in the text.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
};

use dynid_model::{ModelError, document::read_text};

/// A file that cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// A file that cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file that cannot be written.
    #[error("cannot write {}: {source}; nothing was written", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// An output that is there already.
    #[error("{} exists already and is kept; choose another name, or overwrite it with `--force`", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
}

/// A document (TOML) that cannot be read, or does not say what it must.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DocumentError {
    /// Its file.
    #[error(transparent)]
    File(#[from] FileError),
    /// What it says, with the place.
    #[error(transparent)]
    Content(#[from] ModelError),
}

/// The text of a file.
///
/// # Errors
/// [`FileError::Unreadable`].
pub fn read(path: &Path) -> Result<String, FileError> {
    read_text(path).map_err(|source| FileError::Unreadable { path: path.to_owned(), source })
}

/// What to do with an output that exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overwrite {
    /// Keep it and fail.
    Refuse,
    /// Replace it.
    Force,
}

impl Overwrite {
    /// What `--force` says.
    pub fn if_forced(force: bool) -> Self {
        if force { Self::Force } else { Self::Refuse }
    }
}

/// Fails early where [`write_new`] would fail late, so that no work is lost: the output exists, its folder does not, or no
/// file can be made in it (one is, and is removed again).
///
/// # Errors
/// [`FileError::Exists`], [`FileError::Unwritable`].
pub fn check_output(path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
    check_place(path, overwrite)?;
    remove_leftovers(path);
    // Permissions alone do not tell: the folder may be another user's, or on a read-only disk.
    let tried = partial_of(path);
    // Another program may take the trial for a leftover, and remove it first.
    let trial = File::create(&tried).map(|_| drop(fs::remove_file(&tried)));
    trial.map_err(|source| FileError::Unwritable { path: path.to_owned(), source })
}

/// What can be known without writing.
fn check_place(path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
    let unwritable = |source| FileError::Unwritable { path: path.to_owned(), source };
    if path.is_dir() {
        return Err(unwritable(io::Error::other("it is a folder")));
    }
    // A new file would take the place of the pipe or the device, also that of /dev/null.
    if fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        return Err(unwritable(io::Error::other(
            "it is no file but a pipe or a device, which a result does not replace",
        )));
    }
    if overwrite == Overwrite::Refuse && path.try_exists().map_err(unwritable)? {
        return Err(FileError::Exists { path: path.to_owned() });
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(unwritable(io::Error::other(format!("there is no folder {}", folder.display()))));
    }
    if fs::metadata(folder).map_err(unwritable)?.permissions().readonly() {
        return Err(unwritable(io::Error::other(format!("the folder {} is read-only", folder.display()))));
    }
    Ok(())
}

/// Writes a file whole: a reader sees the old content, or all of the new one.
///
/// # Errors
/// [`FileError::Exists`] unless forced; [`FileError::Unwritable`], with nothing left behind.
pub fn write_new(path: &Path, content: &(impl AsRef<[u8]> + ?Sized), overwrite: Overwrite) -> Result<(), FileError> {
    check_place(path, overwrite)?;
    let partial = partial_of(path);
    // Its lock is held until it has its name.
    let written = write_all(&partial, content.as_ref()).and_then(|_lock| take_name(&partial, path, overwrite));
    written.map_err(|source| {
        // The first error is the one to tell; a leftover that cannot be removed changes nothing.
        let _ = fs::remove_file(&partial);
        match source.kind() {
            io::ErrorKind::AlreadyExists => FileError::Exists { path: path.to_owned() },
            _ => FileError::Unwritable { path: path.to_owned(), source },
        }
    })
}

/// Gives a file that is whole its name.
fn take_name(partial: &Path, path: &Path, overwrite: Overwrite) -> io::Result<()> {
    if overwrite == Overwrite::Refuse {
        // Unlike a renaming, a second name for the file never takes the place of another that came meanwhile.
        match fs::hard_link(partial, path) {
            Ok(()) => return fs::remove_file(partial),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => return Err(error),
            // Not every disk has second names.
            Err(_) => {}
        }
    }
    fs::rename(partial, path)
}

/// Removes what programs that were killed while they wrote this file have left beside it. What one that runs is writing is locked, and stays.
///
/// It looks through the file's folder, so it is not done at every writing: [`check_output`] does it.
pub fn remove_leftovers(path: &Path) {
    remove_leftovers_of(folder_of(path), Left::Files, |own| Some(own) == name_of(path).as_deref());
}

/// As [`remove_leftovers`], of all files of a folder: `.NAME.NUMBER.partial` that nobody has locked.
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
        if entry.file_name().to_str().and_then(written_name).is_some_and(&is_wanted)
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
        let partial = partial_of(path);
        make_folder(folder_of(path))?;
        remove_leftovers_of(folder_of(path), Left::Folders, |own| Some(own) == name_of(path).as_deref());
        loop {
            make_folder(&partial)?;
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

/// The name of the file that is written under a name of [`partial_of`].
fn written_name(partial: &str) -> Option<&str> {
    let (name, writer) = partial.strip_prefix('.')?.strip_suffix(".partial")?.rsplit_once('.')?;
    (!writer.is_empty() && writer.bytes().all(|byte| byte.is_ascii_digit())).then_some(name)
}

/// Writes several files that belong together, each with its text: all of them, or none where one of them cannot be written.
///
/// All are written beside their places first, and then take their names. Only where a name is refused after that do files that were
/// replaced stay replaced.
///
/// # Errors
/// As [`write_new`], of the first file that cannot be written.
pub fn write_together(files: &[(PathBuf, String)], overwrite: Overwrite) -> Result<(), FileError> {
    files.iter().try_for_each(|(path, _)| check_place(path, overwrite))?;
    let unwritable = |path: &Path| {
        let path = path.to_owned();
        |source| FileError::Unwritable { path, source }
    };
    let partials: Result<Vec<File>, FileError> = files
        .iter()
        .map(|(path, text)| write_all(&partial_of(path), text.as_bytes()).map_err(unwritable(path)))
        .collect();
    let mut named: Vec<&Path> = Vec::new();
    let all = partials.and_then(|_locks| {
        files.iter().try_for_each(|(path, _)| {
            fs::rename(partial_of(path), path).map_err(unwritable(path))?;
            named.push(path);
            Ok(())
        })
    });
    if all.is_err() {
        let new = if overwrite == Overwrite::Force { &[] } else { named.as_slice() };
        // The first error is the one to tell.
        files.iter().for_each(|(path, _)| drop(fs::remove_file(partial_of(path))));
        new.iter().for_each(|path| drop(fs::remove_file(path)));
    }
    all
}

/// Makes a folder to write to, and those it lies in; one that is there stays as it is.
///
/// # Errors
/// [`FileError::Unwritable`].
pub fn make_folder(path: &Path) -> Result<(), FileError> {
    if path == Path::new("") {
        return Ok(());
    }
    fs::create_dir_all(path).map_err(|source| FileError::Unwritable { path: path.to_owned(), source })
}

/// Writes a file that is locked as long as what is returned lives.
fn write_all(path: &Path, content: &[u8]) -> io::Result<File> {
    let mut file = File::create(path)?;
    // Not every disk knows locks; on one that does not, leftovers are never removed.
    while file.lock().is_ok() && !path.try_exists()? {
        // Another took it for a leftover before it was locked.
        file = File::create(path)?;
    }
    file.write_all(content)?;
    file.sync_all()?;
    Ok(file)
}

/// Where a file is written before it takes its name.
fn partial_of(path: &Path) -> PathBuf {
    let name = name_of(path).unwrap_or_default();
    folder_of(path).join(format!(".{name}.{}.partial", std::process::id()))
}

fn name_of(path: &Path) -> Option<String> {
    path.file_name().map(|name| name.to_string_lossy().into_owned())
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_overwritten_without_force() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        write_new(&path, "one", Overwrite::Refuse).unwrap();
        assert!(matches!(write_new(&path, "two", Overwrite::Refuse), Err(FileError::Exists { .. })));
        assert_eq!(fs::read_to_string(&path).unwrap(), "one");
        write_new(&path, "two", Overwrite::Force).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 1, "no partial file is left");
    }

    #[test]
    fn files_that_belong_together_are_all_written_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let files = ["one.toml", "two.toml"].map(|name| (folder.path().join(name), name.to_owned()));
        fs::write(&files[1].0, "mine").unwrap();
        assert!(matches!(write_together(&files, Overwrite::Refuse), Err(FileError::Exists { .. })));
        assert!(!files[0].0.exists(), "the first is not written");
        write_together(&files, Overwrite::Force).unwrap();
        let texts = || files.each_ref().map(|(path, _)| fs::read_to_string(path).unwrap());
        assert_eq!(texts(), ["one.toml", "two.toml"]);
        // Not even root makes a file where a folder has its name: the second fails after the first is written.
        fs::create_dir(partial_of(&files[1].0)).unwrap();
        let others = files.each_ref().map(|(path, _)| (path.clone(), "other".to_owned()));
        assert!(matches!(write_together(&others, Overwrite::Force), Err(FileError::Unwritable { .. })));
        assert_eq!(texts(), ["one.toml", "two.toml"], "none is replaced");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "no partial file is left but the folder");
    }

    #[test]
    fn what_a_killed_program_left_is_removed_and_what_another_writes_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let [path, left, others, written] =
            ["a.toml", ".a.toml.1.partial", ".a.toml.b.toml.1.partial", ".a.toml.2.partial"]
                .map(|name| folder.path().join(name));
        let lock = write_all(&written, b"by another").unwrap();
        fs::write(&left, "ha").unwrap();
        fs::write(&others, "of another file").unwrap();
        check_output(&path, Overwrite::Refuse).unwrap();
        assert!(!left.exists() && others.exists() && written.exists());
        drop(lock);
        write_new(&path, "one", Overwrite::Refuse).unwrap();
        check_output(&path, Overwrite::Force).unwrap();
        assert!(!written.exists() && path.exists() && others.exists());
        remove_all_leftovers(folder.path());
        assert!(!others.exists() && path.exists());
    }

    #[test]
    fn a_folder_is_filled_beside_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let [place, left] = ["in/tour", "in/.tour.1.partial"].map(|name| folder.path().join(name));
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

    #[test]
    fn a_file_that_came_while_another_was_written_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let [partial, path] = ["partial", "model.toml"].map(|name| folder.path().join(name));
        fs::write(&partial, "mine").unwrap();
        fs::write(&path, "another's").unwrap();
        let error = take_name(&partial, &path, Overwrite::Refuse).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read_to_string(&path).unwrap(), "another's");
        take_name(&partial, &path, Overwrite::Force).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
    }

    #[test]
    fn a_folder_that_takes_no_file_is_reported_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        check_output(&path, Overwrite::Refuse).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "the trial leaves nothing");
        // Not even root makes a file where a folder has its name.
        fs::create_dir(partial_of(&path)).unwrap();
        assert!(matches!(check_output(&path, Overwrite::Refuse), Err(FileError::Unwritable { .. })));
    }

    #[test]
    fn a_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/such/model.toml");
        let error = write_new(&path, "one", Overwrite::Refuse).unwrap_err().to_string();
        assert!(error.contains("no/such/model.toml") && error.contains("there is no folder"), "{error}");
        assert!(write_new(folder.path(), "one", Overwrite::Force).is_err(), "a folder is no file");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
