//! `cargo xtask hidden-effects`: hides one effect after another from the program and prints what it finds.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, anyhow};
use clap::ValueEnum;
use dynid_plant::hidden::{Case, Kind, table};

use crate::BadInput;

/// Hides one effect after another from the program and prints what it finds.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only these cases, by number or by a part of their name.
    #[arg(long = "case", value_name = "CASE", value_delimiter = ',')]
    cases: Vec<String>,
    /// Only cases of this kind.
    #[arg(long, value_enum)]
    only: Option<Only>,
    /// Cases at a time.
    #[arg(long, value_name = "N", default_value_t = 1)]
    jobs: usize,
    /// Only write the cases' files, each into a folder of its own in this one.
    #[arg(long, value_name = "FOLDER")]
    write: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Only {
    Hidden,
    Nothing,
    Outside,
}

/// Runs or writes the cases asked for.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let cases = chosen(arguments)?;
    if let Some(folder) = &arguments.write {
        return each(&cases, arguments.jobs, &|case| {
            let folder = write(case, folder)?;
            println!("{}", folder.display());
            Ok(())
        });
    }
    Ok(())
}

fn chosen(arguments: &Arguments) -> anyhow::Result<Vec<Case>> {
    let kind = arguments.only.map(|only| match only {
        Only::Hidden => Kind::Hidden,
        Only::Nothing => Kind::Nothing,
        Only::Outside => Kind::Outside,
    });
    let is_meant = |case: &Case, word: &str| match word.parse::<usize>() {
        Ok(number) => case.number == number,
        Err(_) => case.name.contains(word),
    };
    let all = table::cases();
    if let Some(word) = arguments.cases.iter().find(|word| !all.iter().any(|case| is_meant(case, word))) {
        return Err(BadInput(format!("there is no case `{word}`; the cases are 1..={}", all.len())).into());
    }
    let is_chosen = |case: &Case| {
        kind.is_none_or(|kind| kind == case.kind)
            && (arguments.cases.is_empty() || arguments.cases.iter().any(|word| is_meant(case, word)))
    };
    Ok(all.into_iter().filter(is_chosen).collect())
}

/// Does `work` for all cases, some at a time.
fn each(cases: &[Case], jobs: usize, work: &(dyn Fn(&Case) -> anyhow::Result<()> + Sync)) -> anyhow::Result<()> {
    let next = Mutex::new(cases.iter());
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1))
            .map(|_| {
                scope.spawn(|| -> anyhow::Result<()> {
                    loop {
                        let case = next.lock().map_err(|_| anyhow!("another case failed"))?.next();
                        let Some(case) = case else { return Ok(()) };
                        work(case).with_context(|| case.name.clone())?;
                    }
                })
            })
            .collect();
        workers.into_iter().try_for_each(|worker| worker.join().map_err(|_| anyhow!("a case failed"))?)
    })
}

/// Writes a case into a folder of its own, over what is there.
fn write(case: &Case, folder: &Path) -> anyhow::Result<PathBuf> {
    let folder = folder.join(&case.name);
    fs::create_dir_all(&folder).with_context(|| format!("making {}", folder.display()))?;
    for (name, text) in case.files().map_err(|reason| anyhow!(reason))? {
        let path = folder.join(name);
        fs::write(&path, text).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(folder)
}
