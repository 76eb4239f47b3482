//! Which commands a page may run: those of the loop, on files of the folder.

use std::path::Path;

use clap::{ArgMatches, CommandFactory, error::ErrorKind};

use super::super::answer::Refusal;
use super::super::folder::Folder;
use super::TO_PROGRAMS;
use crate::cli::Arguments;

const VERBS: [&str; 16] = [
    "new", "check", "fit", "compare", "diagnose", "add", "ladder", "report", "table", "simulate", "excite", "plan",
    "export", "wall", "device", "devices",
];

/// Reads the arguments as the program will, and looks at every value as if it were a path.
pub fn check(args: &[String], folder: &Folder) -> Result<(), Refusal> {
    let all = ["dynid"].into_iter().chain(TO_PROGRAMS).chain(args.iter().map(String::as_str));
    let matches = Arguments::command().try_get_matches_from(all).map_err(|error| {
        let text = match error.kind() {
            ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => "give a command and its arguments".to_owned(),
            _ => error.to_string(),
        };
        Refusal::bad(text.trim_start_matches("error: ").trim_end().to_owned())
    })?;
    match matches.subcommand_name() {
        Some(verb) if VERBS.contains(&verb) => inside(&matches, folder),
        verb => Err(Refusal::forbidden(format!("`{}` is run on a terminal", verb.unwrap_or_default()))),
    }
}

fn inside(matches: &ArgMatches, folder: &Folder) -> Result<(), Refusal> {
    for id in matches.ids() {
        // Groups of arguments have no values of their own.
        for value in matches.try_get_raw(id.as_str()).ok().flatten().into_iter().flatten() {
            // A number such as .5 is no hidden file.
            if value.to_str().is_some_and(|value| value.parse::<f64>().is_ok()) {
                continue;
            }
            let path = Path::new(value);
            folder.check(path)?;
            // Effects are read from a folder that is named, or lies beside a file.
            folder.check_effects(path)?;
            folder.check_effects(&path.with_file_name("effects"))?;
            folder.check_references(path)?;
        }
    }
    matches.subcommand().map_or(Ok(()), |(_, inner)| inside(inner, folder))
}
