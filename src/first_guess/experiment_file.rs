//! The text of an experiment, each guess with its reason as a comment beside it.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use dynid_first_guess::{ColumnGuess, FirstGuess, RunGuess, WhyColumn};
use dynid_model::{Device, path_from};
use dynid_sentences::{check, first_guess as sentences};

/// The experiment that `guess` describes, to lie in `folder`: as TOML, with the reason of each guess beside it.
pub fn experiment_file(device: &Device, logs: &[PathBuf], guess: &FirstGuess, folder: &Path) -> String {
    let mut text = "# Written by `dynid new` from the logs alone: what stands here is a guess, and says why. Mend what is wrong.\n".to_owned();
    for remark in &guess.remarks {
        comment(&mut text, &sentences::remark(remark));
    }
    for finding in check::findings(&guess.findings) {
        comment(&mut text, &format!("Looks wrong: {finding}"));
    }
    let mut settings = vec![(format!("device = {}", quoted(&device.name_from(folder))), String::new())];
    if guess.is_straight {
        let why =
            "torques run straight from row to row: so they explain the motion; \"zero\": each holds until the next row";
        settings.push(("hold = \"linear\"".to_owned(), why.to_owned()));
    }
    if guess.repeats_times {
        settings.push((
            "repeated_times = \"skip\"".to_owned(),
            "rows with the time of the row before are left out".to_owned(),
        ));
    }
    if let Some(mask) = &guess.mask {
        let why = "by its name: where it is 0 a row leaves the torque error";
        settings.push((format!("mask = {}", quoted(mask)), why.to_owned()));
    }
    lines(&mut text, &settings);
    write_columns(&mut text, guess);
    write_scale(&mut text, guess);
    guess.runs.iter().for_each(|run| write_run(&mut text, logs, run, folder));
    text
}

fn write_columns(text: &mut String, guess: &FirstGuess) {
    let (own, foreign): (Vec<&ColumnGuess>, Vec<&ColumnGuess>) =
        guess.columns.iter().partition(|column| column.why == WhyColumn::OwnName);
    text.push('\n');
    if !own.is_empty() {
        let names: Vec<&str> = own.iter().map(|column| column.name.as_str()).collect();
        comment(text, &format!("Columns with dynid's own names: {}.", names.join(", ")));
    }
    if !guess.unused.is_empty() {
        comment(text, &format!("Not used: {}.", guess.unused.join(", ")));
    }
    if foreign.is_empty() {
        return;
    }
    comment(
        text,
        "Which column of the logs is the time, and of which joint the position (q), the torque (tau), the reference (ref).",
    );
    text.push_str("[columns]\n");
    let line =
        |column: &&ColumnGuess| (format!("{} = {}", column.logical, quoted(&column.name)), sentences::column(column));
    lines(text, &foreign.iter().map(line).collect::<Vec<_>>());
}

fn write_scale(text: &mut String, guess: &FirstGuess) {
    comment(
        text,
        "\nWhat brings a column to SI (s, rad, m, N*m, N); those without a factor are taken to be in it. -1 turns a sign.",
    );
    text.push_str("[scale]\n");
    let line = |column: &ColumnGuess| {
        let why: Vec<String> = column.factors.iter().map(|factor| sentences::factor(column, factor)).collect();
        (!why.is_empty()).then(|| (format!("{} = {:?}", column.logical, column.scale()), why.join("; ")))
    };
    lines(text, &guess.columns.iter().filter_map(line).collect::<Vec<_>>());
    let turn = |column: &ColumnGuess| {
        column
            .turn
            .map(|turn| (format!("{} = {turn:?}", column.logical), "its jumps by so much are taken back".to_owned()))
    };
    let turns: Vec<(String, String)> = guess.columns.iter().filter_map(turn).collect();
    if !turns.is_empty() {
        comment(text, "\nHow much a turn is, in the log's own unit, of an encoder that begins anew after each.");
        text.push_str("[turn]\n");
        lines(text, &turns);
    }
}

fn write_run(text: &mut String, logs: &[PathBuf], run: &RunGuess, folder: &Path) {
    text.push_str("\n[[run]]\n");
    let free: Vec<String> = run.free.iter().map(usize::to_string).collect();
    let mut entries = vec![
        (format!("file = {}", quoted(&path_from(&logs[run.log], folder))), String::new()),
        (format!("free = [{}]", free.join(", ")), sentences::free(run.why_free).to_owned()),
        (format!("role = \"{}\"", run.role), sentences::role(&run.why)),
    ];
    if let Some([from, to]) = run.rows {
        entries.push((format!("rows = [{from}, {to}]"), "of the log, to excluded".to_owned()));
    }
    if run.moving {
        entries.push(("moving = true".to_owned(), "the positions change from its first row on".to_owned()));
    }
    lines(text, &entries);
}

/// A line each, with its comment beside it, the comments one below the other where lines are short.
fn lines(text: &mut String, entries: &[(String, String)]) {
    const LONG: usize = 60;
    let widths = entries.iter().filter(|(_, why)| !why.is_empty()).map(|(line, _)| line.chars().count());
    let width = widths.filter(|width| *width <= LONG).max().unwrap_or(0);
    for (line, why) in entries {
        // Writing to a string cannot fail.
        let _ = match why.as_str() {
            "" => writeln!(text, "{line}"),
            why => writeln!(text, "{line:width$}  # {}", one_line(why)),
        };
    }
}

fn comment(text: &mut String, what: &str) {
    if what.starts_with('\n') {
        text.push('\n');
    }
    let _ = writeln!(text, "# {}", one_line(what));
}

/// Names in logs may hold anything; a comment ends with its line.
fn one_line(text: &str) -> String {
    text.trim().chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

pub(super) fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}
