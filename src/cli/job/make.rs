//! One job for each row of a table.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Parser;
use dynid_format::UnknownName;
use dynid_model::{document::read_text, sha256_hex};
use serde_json::json;

use super::super::named::all_named_by;
use super::super::{Answer, Arguments, Outcome, Verb, effects_beside};
use super::file::{Content, Job, OUT};

/// Makes jobs of `arguments`, in which `{column}` stands for what the row has there; all columns are labels.
pub fn run(table: &Path, folder: &Path, arguments: &[String], effects: Option<&Path>) -> anyhow::Result<Outcome> {
    let text = read_text(table).with_context(|| format!("{} cannot be read", table.display()))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let no_table = || format!("{}: this is no table", table.display());
    let header: Vec<String> = reader.headers().with_context(no_table)?.iter().map(str::to_owned).collect();
    if let Some(name) = header.iter().enumerate().find_map(|(k, name)| header[..k].contains(name).then_some(name)) {
        bail!("{}: two columns are called `{name}`; rename one of them", table.display());
    }
    if header.iter().any(|name| name == "out") {
        bail!("{}: a column is called `out`, as the place of the result is; rename it", table.display());
    }
    dynid_files::make_folder(folder)?;
    let (mut all, mut new) = (0, 0);
    for record in reader.records() {
        let record = record.with_context(no_table)?;
        let cells: BTreeMap<&str, &str> = header.iter().map(String::as_str).zip(record.iter()).collect();
        let filled = arguments.iter().map(|argument| filled(argument, &cells)).collect::<Result<Vec<_>, _>>();
        let job = Job::new(content(filled.with_context(|| table.display().to_string())?, &cells, effects)?)?;
        all += 1;
        new += usize::from(job.write(folder)?);
    }
    if all == 0 {
        bail!("{}: the table has no rows; give one for each job", table.display());
    }
    let there = all - new;
    let text = format!(
        "{new} jobs written to {0}{1}\nnext: dynid job {0} --out results\n",
        folder.display(),
        if there > 0 { format!(", {there} are there already") } else { String::new() }
    );
    Ok(Outcome {
        text,
        json: json!({ "jobs": all, "written": new, "folder": folder.display().to_string() }),
        answer: Answer::Yes,
    })
}

/// An argument with what a row has, in one pass: what a cell holds is taken as it is. `{out}` stays, `{{` is a brace.
fn filled(argument: &str, cells: &BTreeMap<&str, &str>) -> Result<String, UnknownName> {
    let (mut text, mut rest) = (String::new(), argument);
    while let Some((before, after)) = rest.split_once('{') {
        text.push_str(before);
        if let Some(after) = after.strip_prefix('{') {
            text.push('{');
            rest = after;
            continue;
        }
        let Some((name, after)) = after.split_once('}') else {
            text.push('{');
            rest = after;
            break;
        };
        match cells.get(name) {
            Some(cell) => text.push_str(cell),
            None if name == "out" => text.push_str(OUT),
            None => return Err(UnknownName::among("column", name, cells.keys().copied())),
        }
        rest = after;
    }
    Ok(text + rest)
}

fn content(arguments: Vec<String>, cells: &BTreeMap<&str, &str>, effects: Option<&Path>) -> anyhow::Result<Content> {
    let effects = effects.iter().flat_map(|folder| ["--effects".to_owned(), folder.display().to_string()]);
    let arguments: Vec<String> = effects.chain(arguments).collect();
    let parsed = Arguments::try_parse_from(["dynid"].into_iter().chain(arguments.iter().map(String::as_str)));
    let parsed =
        parsed.map_err(|error| anyhow::anyhow!("{}", error.to_string().trim_start_matches("error: ").trim_end()))?;
    if matches!(parsed.verb, Verb::Open(_) | Verb::Tour(_) | Verb::Job(_) | Verb::Fleet(_)) {
        bail!("`{}` is no work for a job; give a verb that ends with an answer", arguments.join(" "));
    }
    if arguments.iter().any(|argument| argument.contains(&format!("{OUT}.json"))) {
        bail!("{OUT}.json is the result itself; let the verb write to another name");
    }
    let mut files: Vec<PathBuf> =
        parsed.verb.inputs().into_iter().filter(|path| path.is_file()).map(Path::to_owned).collect();
    // Values of options that are files, too: a wall, a setting.
    files.extend(arguments.iter().map(PathBuf::from).filter(|path| path.is_file()));
    files.extend(files.clone().iter().flat_map(|path| all_named_by(path)));
    if let Some(folder) = effects_beside(&parsed) {
        let entries = fs::read_dir(&folder).with_context(|| format!("{} cannot be read", folder.display()))?;
        files.extend(entries.flatten().map(|entry| entry.path()));
    }
    let mut inputs = BTreeMap::new();
    for path in files.iter().filter(|path| path.is_file()) {
        let bytes = fs::read(path).with_context(|| format!("{} cannot be read", path.display()))?;
        inputs.insert(path.display().to_string(), sha256_hex(&bytes));
    }
    let labels = cells.iter().map(|(name, cell)| ((*name).to_owned(), (*cell).to_owned())).collect();
    Ok(Content { arguments, inputs, labels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stand_where_they_are_asked_for_as_they_are() {
        let cells = BTreeMap::from([("folder", "r{night}"), ("night", "3"), ("robot", "{out}")]);
        let filled = |argument: &str| filled(argument, &cells);
        assert_eq!(filled("{folder}/{night}.toml").unwrap(), "r{night}/3.toml");
        assert_eq!(filled("{out}.toml").unwrap(), "{out}.toml");
        assert_eq!(filled("{{night}{robot}{").unwrap(), "{night}{out}{");
        assert!(filled("{nihgt}").unwrap_err().to_string().contains("did you mean `night`"));
    }
}
