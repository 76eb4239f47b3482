//! The book (`docs/book`): its chapters' commands run and say what is printed there, its logs are what their recipes make, and
//! no link of the documentation leads nowhere.
//!
//! `DYNID_BOOK=write cargo test --release --test book` writes what the program says, its pictures and the logs into the book.

#[path = "book/chapter.rs"]
mod chapter;
#[path = "book/links.rs"]
mod links;
#[path = "book/logs.rs"]
mod logs;
#[path = "book/matching.rs"]
mod matching;
#[path = "book/words.rs"]
mod words;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The book, below the repository.
fn book() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/book")
}

/// Whether the book is written anew, instead of compared.
fn is_written() -> bool {
    std::env::var("DYNID_BOOK").is_ok_and(|value| value == "write")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).replace("\r\n", "\n")
}

/// One test a chapter, so that they run side by side.
macro_rules! chapters {
    ($($name:ident),* $(,)?) => {
        $(#[test]
        fn $name() {
            chapter::play(stringify!($name));
        })*

        const CHAPTERS: &[&str] = &[$(stringify!($name)),*];
    };
}

chapters![hour, friction, errors, experiment, wall, effects, python, fleet, introduction];

#[test]
fn every_chapter_is_played() {
    let files = fs::read_dir(book().join("src")).unwrap().map(|entry| entry.unwrap().path());
    let chapters: BTreeSet<String> = files
        .filter(|path| path.extension().is_some_and(|own| own == "md"))
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .filter(|name| name != "SUMMARY")
        .collect();
    assert_eq!(chapters, CHAPTERS.iter().map(|name| (*name).to_owned()).collect(), "the list in tests/book.rs");
}
