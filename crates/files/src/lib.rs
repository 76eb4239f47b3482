//! Reading text files ([`read`]) and writing results ([`write_new`], [`write_together`], [`PartialFile`]): a file is written whole or not
//! at all, and an existing one is replaced only with [`Overwrite`] saying so.
//!
//! Errors name the file: [`FileError`]; [`DocumentError`] also says where in the text.

mod partial;

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use dynid_model::{ModelError, document::read_text};

pub use partial::{PartialFile, PartialFolder, remove_all_leftovers, remove_leftovers};

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
    PartialFile::of(path).map(drop)
}

/// What can be known without writing.
fn check_place(path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
    let unwritable = unwritable(path);
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
    PartialFile::with(path, content.as_ref())?.take_name(overwrite)
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
    let partials = files.iter().map(|(path, text)| PartialFile::with(path, text.as_bytes()));
    let mut partials = partials.collect::<Result<Vec<_>, _>>()?;
    for (named, partial) in partials.iter_mut().enumerate() {
        partial.take_name(overwrite).inspect_err(|_| {
            if overwrite == Overwrite::Refuse {
                // The first error is the one to tell.
                files[..named].iter().for_each(|(path, _)| drop(fs::remove_file(path)));
            }
        })?;
    }
    Ok(())
}

/// Makes a folder to write to, and those it lies in; one that is there stays as it is.
///
/// # Errors
/// [`FileError::Unwritable`].
pub fn make_folder(path: &Path) -> Result<(), FileError> {
    if path == Path::new("") {
        return Ok(());
    }
    fs::create_dir_all(path).map_err(unwritable(path))
}

fn unwritable(path: &Path) -> impl Fn(io::Error) -> FileError + Copy + '_ {
    move |source| FileError::Unwritable { path: path.to_owned(), source }
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
        let count = || fs::read_dir(folder.path()).unwrap().count();
        fs::write(&files[1].0, "mine").unwrap();
        assert!(matches!(write_together(&files, Overwrite::Refuse), Err(FileError::Exists { .. })));
        assert!(!files[0].0.exists(), "the first is not written");
        write_together(&files, Overwrite::Force).unwrap();
        let texts = || files.each_ref().map(|(path, _)| fs::read_to_string(path).unwrap());
        assert_eq!(texts(), ["one.toml", "two.toml"]);
        assert_eq!(count(), 2, "no partial file is left");
        // A name that is longer still beside its place: the second fails after the first is written.
        let others = [files[0].0.clone(), folder.path().join("l".repeat(250))].map(|path| (path, "other".to_owned()));
        assert!(matches!(write_together(&others, Overwrite::Force), Err(FileError::Unwritable { .. })));
        assert_eq!(texts(), ["one.toml", "two.toml"], "none is replaced");
        assert_eq!(count(), 2, "no partial file is left");
        // A link that leads nowhere has the name of the second, which shows only when that is to take it.
        #[cfg(unix)]
        {
            let new = ["three.toml", "four.toml"].map(|name| (folder.path().join(name), name.to_owned()));
            std::os::unix::fs::symlink(folder.path().join("nowhere"), &new[1].0).unwrap();
            assert!(matches!(write_together(&new, Overwrite::Refuse), Err(FileError::Exists { .. })));
            assert!(!new[0].0.exists(), "the first gives its name back");
            assert_eq!(count(), 3, "no partial file is left");
        }
    }

    #[test]
    fn a_folder_that_takes_no_file_is_reported_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.toml");
        check_output(&path, Overwrite::Refuse).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "the trial leaves nothing");
        // Not even root makes a file whose name is longer still beside its place.
        let path = folder.path().join("l".repeat(250));
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
