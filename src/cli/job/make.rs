//! One job for each row of a table.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, bail};
use dynid_format::UnknownName;
use dynid_model::sha256_hex;
use serde_json::json;

use super::super::named::all_named_by;
use super::super::{Answer, Outcome};
use super::file::{Content, Job, OUT};

/// Makes jobs of `arguments`, in which `{column}` stands for what the row has there; columns that no argument asks for are labels.
pub fn run(table: &Path, folder: &Path, arguments: &[String]) -> anyhow::Result<Outcome> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(table)
        .with_context(|| format!("{} cannot be read", table.display()))?;
    let header: Vec<String> = reader.headers().context(shown(table))?.iter().map(str::to_owned).collect();
    for asked in arguments.iter().flat_map(|argument| placeholders(argument)) {
        if format!("{{{asked}}}") != OUT && !header.contains(&asked) {
            let unknown = UnknownName::among("column", &asked, header.iter().map(String::as_str));
            bail!("{}: {unknown}", table.display());
        }
    }
    dynid_files::make_folder(folder)?;
    let (mut all, mut new) = (0, 0);
    for record in reader.records() {
        let record = record.context(shown(table))?;
        let cells: BTreeMap<&str, &str> = header.iter().map(String::as_str).zip(record.iter()).collect();
        let job = Job::new(content(arguments, &cells)?)?;
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

fn shown(table: &Path) -> String {
    format!("{}: this is no table", table.display())
}

/// Names in braces.
fn placeholders(argument: &str) -> Vec<String> {
    argument.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name.to_owned()).collect()
}

fn content(arguments: &[String], cells: &BTreeMap<&str, &str>) -> anyhow::Result<Content> {
    let filled = |argument: &String| {
        let names = placeholders(argument);
        names.iter().fold(argument.clone(), |argument, name| match cells.get(name.as_str()) {
            Some(cell) => argument.replace(&format!("{{{name}}}"), cell),
            None => argument,
        })
    };
    let asked: Vec<String> = arguments.iter().flat_map(|argument| placeholders(argument)).collect();
    let filled: Vec<String> = arguments.iter().map(filled).collect();
    let mut inputs = BTreeMap::new();
    for path in filled.iter().map(Path::new).filter(|path| path.is_file()) {
        for path in
            all_named_by(path).iter().map(std::path::PathBuf::as_path).chain([path]).filter(|path| path.is_file())
        {
            let bytes = std::fs::read(path).with_context(|| format!("{} cannot be read", path.display()))?;
            inputs.insert(path.display().to_string(), sha256_hex(&bytes));
        }
    }
    let labels = cells.iter().filter(|(name, _)| !asked.iter().any(|own| own == *name));
    let labels = labels.map(|(name, cell)| ((*name).to_owned(), (*cell).to_owned())).collect();
    Ok(Content { arguments: filled, inputs, labels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_stand_where_they_are_asked_for_and_the_others_are_labels() {
        let arguments = ["fit", "{folder}/e.toml", "--out", "{out}.toml"].map(str::to_owned);
        let cells = BTreeMap::from([("folder", "r07"), ("night", "3"), ("robot", "7")]);
        let content = content(&arguments, &cells).unwrap();
        assert_eq!(content.arguments, ["fit", "r07/e.toml", "--out", "{out}.toml"]);
        let labels: Vec<(&str, &str)> = content.labels.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect();
        assert_eq!(labels, [("night", "3"), ("robot", "7")]);
    }
}
