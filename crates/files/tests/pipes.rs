//! What is no file: a pipe that nobody writes to would keep the program for ever, and no result takes its place.
#![cfg(unix)]

use std::{fs, path::Path, process::Command};

use dynid_files::{FileError, Overwrite, check_output, read, write_new};

#[test]
fn a_pipe_is_neither_read_nor_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe.toml");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    assert!(read(&pipe).unwrap_err().to_string().contains("a pipe or a device"));
    for overwrite in [Overwrite::Refuse, Overwrite::Force] {
        assert!(matches!(check_output(&pipe, overwrite), Err(FileError::Unwritable { .. })));
        assert!(matches!(write_new(&pipe, "mine", overwrite), Err(FileError::Unwritable { .. })));
    }
    assert!(!fs::metadata(&pipe).unwrap().is_file(), "it is there still");
    assert!(read(Path::new("/dev/null")).unwrap_err().to_string().contains("a pipe or a device"));
    let empty = folder.path().join("empty.toml");
    fs::write(&empty, "").unwrap();
    assert_eq!(read(&empty).unwrap(), "");
}
