//! A chapter as its reader follows it: the files that it shows are written, its commands run, in order, in a folder of their own.
//!
//! | block | what is done |
//! | --- | --- |
//! | `console` | the lines after `$ ` run; what follows is what they print, the last line `[exit status 1]` if they end so |
//! | any language, first line (after one of `#!`) a comment `file: NAME` | is written to that file |
//! | any language, first line a comment `from: NAME` | stands so in that file, which a command made |
//! | `csv` | likewise, without that line: a table has no comments |
//! | `python`, and `text` directly after it | `python/tests/test_book.py` |
//!
//! [`crate::matching`] says what `...` stands for. A picture is what a command wrote under the same name.

use std::fmt::Write;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use crate::{book, is_written, matching, read, words};

/// A fenced block.
struct Block<'a> {
    language: &'a str,
    /// Its lines, by index in the chapter.
    lines: Range<usize>,
}

/// Runs a chapter; panics where it is not true.
pub fn play(name: &str) {
    let path = book().join("src").join(format!("{name}.md"));
    let text = read(&path);
    let lines: Vec<&str> = text.lines().collect();
    let folder = TempDir::new().unwrap();
    logs(&text, folder.path());
    let mut wrong = String::new();
    let mut written: Vec<String> = Vec::new();
    let mut copied_to = 0;
    let mut after_python = false;
    for block in blocks(&lines) {
        let at = format!("{}:{}", path.display(), block.lines.start + 1);
        let shown = &lines[block.lines.clone()];
        let is_output_of_python = after_python && block.language == "text";
        after_python = block.language == "python";
        let first = shown.iter().find(|line| !line.starts_with("#!"));
        match (block.language, first.and_then(|line| named(line))) {
            ("console", _) => {
                let said = console(shown, folder.path(), &at, &mut wrong);
                written.extend(lines[copied_to..block.lines.start].iter().map(|line| (*line).to_owned()));
                written.extend(said);
                copied_to = block.lines.end;
            }
            ("python", _) => {}
            ("text", _) if is_output_of_python => {}
            (_, Some(("file", file))) => {
                let file = folder.path().join(file);
                fs::create_dir_all(file.parent().unwrap()).unwrap();
                let content = if block.language == "csv" { &shown[1..] } else { shown };
                fs::write(file, content.join("\n") + "\n").unwrap();
            }
            (_, Some((_, file))) => {
                let content = read(&folder.path().join(file));
                let content: Vec<&str> = content.lines().collect();
                if !matching::is_part(&shown[1..], &content) {
                    let _ = writeln!(wrong, "{at}: {file} has no such lines; it is\n{}", content.join("\n"));
                }
            }
            (language, None) => panic!("{at}: a block of `{language}` that says neither `file: NAME` nor `from: NAME`"),
        }
    }
    if is_written() {
        written.extend(lines[copied_to..].iter().map(|line| (*line).to_owned()));
        fs::write(&path, written.join("\n") + "\n").unwrap();
    }
    pictures(&text, folder.path(), &mut wrong);
    assert!(wrong.is_empty(), "\n{wrong}\n`DYNID_BOOK=write` writes what the program says into the book");
}

/// Copies the logs that a chapter begins with: the first folder of logs that it names.
fn logs(text: &str, folder: &Path) {
    let Some((_, rest)) = text.split_once("`docs/book/logs/") else { return };
    let name = rest.split('`').next().unwrap();
    copy(&book().join("logs").join(name), folder);
}

fn copy(from: &Path, to: &Path) {
    for entry in fs::read_dir(from).unwrap_or_else(|error| panic!("{}: {error}", from.display())) {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            fs::create_dir_all(&target).unwrap();
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

fn blocks<'a>(lines: &[&'a str]) -> Vec<Block<'a>> {
    let mut blocks = Vec::new();
    let mut open: Option<(&str, usize)> = None;
    for (index, line) in lines.iter().enumerate() {
        match (open, line.strip_prefix("```")) {
            (None, Some(language)) => open = Some((language, index + 1)),
            (Some((language, start)), Some("")) => {
                blocks.push(Block { language, lines: start..index });
                open = None;
            }
            _ => {}
        }
    }
    assert!(open.is_none(), "a block is not closed");
    blocks
}

/// `file` or `from`, and the name, of a comment that says so.
fn named(line: &str) -> Option<(&str, &str)> {
    let line = line.trim_start_matches(['#', '/', '*', '<', '!', '-', ' ']);
    let line = line.trim_end_matches("-->").trim();
    let (kind, name) = line.split_once(": ")?;
    (["file", "from"].contains(&kind) && !name.contains(' ')).then_some((kind, name))
}

/// Runs the commands of a block, tells what differs, and returns the block with what they said.
fn console(shown: &[&str], folder: &Path, at: &str, wrong: &mut String) -> Vec<String> {
    let mut made = Vec::new();
    let mut rest = shown;
    assert!(rest.first().is_some_and(|line| line.starts_with("$ ")), "{at}: a block of `console` begins with `$ `");
    while !rest.is_empty() {
        let ends = rest.iter().position(|line| !line.ends_with('\\')).expect("the last line of a command");
        let (command, after) = rest.split_at(ends + 1);
        let until = after.iter().position(|line| line.starts_with("$ ")).unwrap_or(after.len());
        let (expected, next) = after.split_at(until);
        let line: Vec<&str> = command.iter().map(|line| line.trim_end_matches('\\').trim()).collect();
        let said = run(line.join(" ").trim_start_matches("$ "), folder, at);
        let said: Vec<&str> = said.lines().collect();
        made.extend(command.iter().map(|line| (*line).to_owned()));
        if matching::is_all(expected, &said) {
            made.extend(expected.iter().map(|line| (*line).to_owned()));
        } else {
            made.extend(said.iter().map(|line| without_times(line)));
            if !is_written() {
                let _ = writeln!(wrong, "{at}: {}\nsays\n{}", line.join(" "), said.join("\n"));
            }
        }
        rest = next;
    }
    made
}

/// A line with `[..]` for how long something took.
fn without_times(line: &str) -> String {
    let parts: Vec<&str> = line.split(' ').collect();
    let is_time = |at: usize| {
        let before = at.checked_sub(1).map_or("", |before| parts[before]);
        let unit = parts.get(at + 1).copied().unwrap_or_default();
        ["error,", "iterations,"].contains(&before) && ["s)", "s;"].contains(&unit)
    };
    let kept = |at: usize| if is_time(at) { "[..]" } else { parts[at] };
    (0..parts.len()).map(kept).collect::<Vec<&str>>().join(" ")
}

/// What a command prints, errors last; `mkdir` and `cp` need no program.
fn run(line: &str, folder: &Path, at: &str) -> String {
    let mut words = words::split(line).unwrap_or_else(|error| panic!("{at}: {error}"));
    let mut variables = Vec::new();
    while let Some((name, value)) = words.first().and_then(|word| word.split_once('=')) {
        variables.push((name.to_owned(), value.to_owned()));
        words.remove(0);
    }
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let program = Path::new(env!("CARGO_BIN_EXE_dynid"));
    let mut command = match words[..] {
        ["mkdir", name] => {
            fs::create_dir(folder.join(name)).unwrap_or_else(|error| panic!("{at}: mkdir {name}: {error}"));
            return String::new();
        }
        ["cp", from, to] => {
            fs::copy(folder.join(from), folder.join(to)).unwrap_or_else(|error| panic!("{at}: cp {from}: {error}"));
            return String::new();
        }
        ["dynid", ..] => Command::new(program),
        ["sh", _] => Command::new("sh"),
        _ => panic!("{at}: only `dynid`, `sh FILE`, `mkdir` and `cp` may be run: {line}"),
    };
    let beside: Vec<PathBuf> = vec![program.parent().unwrap().to_owned()];
    let path = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).collect::<Vec<_>>();
    let path = std::env::join_paths(beside.into_iter().chain(path)).unwrap();
    command.args(&words[1..]).current_dir(folder).env("PATH", path).env_remove("DYNID_EFFECTS").envs(variables);
    let output = command.output().unwrap_or_else(|error| panic!("{at}: {line}: {error}"));
    let mut said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    if let Some(status) = output.status.code().filter(|status| *status != 0) {
        let _ = writeln!(said, "[exit status {status}]");
    }
    // What is set off by an empty line at the end is not shown.
    said.trim_end().to_owned()
}

/// Pictures of the chapter that a command wrote are the book's; those that Python draws (PNG) are there, for its versions draw otherwise.
fn pictures(text: &str, folder: &Path, wrong: &mut String) {
    for picture in text.split("](pictures/").skip(1).map(|rest| rest.split(')').next().unwrap()) {
        let kept = book().join("src/pictures").join(picture);
        let made = folder.join(kept.file_name().unwrap());
        if picture.ends_with(".png") {
            assert!(kept.is_file(), "{} is missing", kept.display());
            continue;
        }
        let made = fs::read(&made).unwrap_or_else(|error| panic!("no command made {picture}: {error}"));
        if is_written() {
            fs::create_dir_all(kept.parent().unwrap()).unwrap();
            fs::write(&kept, made).unwrap();
        } else if fs::read(&kept).ok().is_none_or(|kept| kept != made) {
            let _ = writeln!(wrong, "{picture} is not what the chapter's command draws");
        }
    }
}
