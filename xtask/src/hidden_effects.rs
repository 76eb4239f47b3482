//! `cargo xtask hidden-effects`: hides one effect after another from the program and prints what it finds.
//!
//! Without `--draw` that is a fixed table, whose cases are fitted before they are diagnosed. With it, machine, instrument and
//! what is hidden are drawn at random, and the program gets one call of `diagnose` (`hidden_effects/drawn.rs`).

mod drawn;
mod scores;

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::ValueEnum;
use dynid_plant::hidden::trial::{self, Outcome};
use dynid_plant::hidden::{Case, Kind, Spot, draw, table};

use crate::at_once::each;
use crate::{BadInput, shell};

/// Hides one effect after another from the program and prints what it finds.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cargo xtask hidden-effects                                   the fixed table
  cargo xtask hidden-effects --draw 7 --jobs 2                 300 cases drawn from seed 7; a stopped run goes on
  cargo xtask hidden-effects --draw 10,11,12 --write-docs      and writes docs/hidden-effects.md
  cargo xtask hidden-effects --draw 7 --write FOLDER --case 42 only writes the files of one case
  cargo xtask hidden-effects --ci                              twelve quick drawn cases, of which most must be right")]
pub struct Arguments {
    /// Only these cases, by number or by a part of their name.
    #[arg(long = "case", value_name = "CASE", value_delimiter = ',')]
    words: Vec<String>,
    /// Only cases of this kind.
    #[arg(long, value_enum)]
    only: Option<Only>,
    /// Cases that are drawn from these seeds, instead of the table.
    #[arg(long, value_name = "N", value_delimiter = ',')]
    draw: Vec<u32>,
    /// Only the first so many cases of each draw.
    #[arg(long, value_name = "COUNT", requires = "draw", default_value_t = draw::N_CASES)]
    cases: usize,
    /// The table with other machines, runs and sizes of the hidden effects than those that the program was written by.
    #[arg(long, value_name = "N", default_value_t = 0, conflicts_with = "draw")]
    vary: u32,
    /// Cases at a time.
    #[arg(long, value_name = "N", default_value_t = 1)]
    jobs: usize,
    /// A drawn case without an answer after so many seconds counts as wrong.
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0)]
    timeout: f64,
    /// Write the scores of the draws to `docs/hidden-effects.md`.
    #[arg(long, requires = "draw")]
    write_docs: bool,
    /// Twelve fixed cases of draws; fails when fewer than a stated number of answers is right.
    #[arg(long, conflicts_with_all = ["draw", "vary", "words", "only", "write", "truth"])]
    ci: bool,
    /// Only write the cases' files, each into a folder of its own in this one, and of the fixed table's a list (cases.csv).
    #[arg(long, value_name = "FOLDER")]
    write: Option<PathBuf>,
    /// Only fit the machines' own models: do plant and program agree about every effect?
    #[arg(long, conflicts_with = "write")]
    truth: bool,
    /// The program to put to the test, instead of the one that is built from here.
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Only {
    Hidden,
    Nothing,
    Outside,
    TwoAtOnce,
    PayloadInOneRun,
}

impl Only {
    fn kind(self) -> Kind {
        match self {
            Self::Hidden => Kind::Hidden,
            Self::Nothing => Kind::Nothing,
            Self::Outside => Kind::Outside,
            Self::TwoAtOnce => Kind::TwoAtOnce,
            Self::PayloadInOneRun => Kind::PayloadInOneRun,
        }
    }
}

/// Runs or writes the cases asked for.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.ci {
        return drawn::ci(arguments);
    }
    if !arguments.draw.is_empty() {
        return drawn::run(arguments);
    }
    let cases = chosen(arguments)?;
    if let Some(folder) = &arguments.write {
        each(&cases, arguments.jobs, &|case| {
            let folder = folder.join(&case.name);
            trial::write(case, &folder).map_err(|reason| anyhow!("{}: {reason}", case.name))?;
            println!("{}", folder.display());
            Ok(())
        })?;
        return list(&cases, folder);
    }
    let program = arguments.built_program()?;
    let mut folder = shell::root().join("target/hidden-effects");
    if arguments.vary > 0 {
        folder.push(format!("vary-{}", arguments.vary));
    }
    if arguments.truth {
        return fit_the_truths(&cases, arguments.jobs, &folder, &program);
    }
    println!("{HEADER}");
    let outcomes = each(&cases, arguments.jobs, &|case| {
        let folder = folder.join(&case.name);
        trial::write(case, &folder).map_err(|reason| anyhow!("{}: {reason}", case.name))?;
        let outcome = trial::run(case, &folder, &program);
        println!("{}", row(case, &outcome));
        Ok(outcome)
    })?;
    let known: Vec<(&Case, Option<&Outcome>)> =
        cases.iter().zip(&outcomes).map(|(case, outcome)| (case, outcome.as_ref().ok())).collect();
    println!("\n{}", totals(&known));
    Ok(())
}

impl Arguments {
    /// The program that is put to the test.
    fn built_program(&self) -> anyhow::Result<PathBuf> {
        if let Some(program) = &self.program {
            return program.canonicalize().with_context(|| program.display().to_string());
        }
        shell::succeed(&mut shell::cargo(&["build", "--release", "--locked", "--package", "dynid"]))?;
        Ok(shell::root().join("target/release").join(format!("dynid{}", std::env::consts::EXE_SUFFIX)))
    }
}

/// A table of the cases beside their folders, of which `dynid job --from` makes jobs.
fn list(cases: &[Case], folder: &Path) -> anyhow::Result<()> {
    let path = folder.join("cases.csv");
    let rows = cases.iter().map(|case| format!("{},{}\n", case.name, hidden(case)));
    let text = format!("case,hidden\n{}", rows.collect::<String>());
    std::fs::write(&path, text).with_context(|| path.display().to_string())?;
    println!("{}", path.display());
    Ok(())
}

/// What the program is to find.
fn hidden(case: &Case) -> String {
    case.hidden.as_ref().map_or_else(
        || "\u{2014}".to_owned(),
        |hidden| Spot { effect: hidden.id.clone(), joint: hidden.joint, from: hidden.from }.to_string(),
    )
}

const HEADER: &str = "| case | hidden | verdict | first | rank | before | after | s | |\n\
                      | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

/// Errors are held-out ones over the noise floor.
fn row(case: &Case, outcome: &Result<Outcome, String>) -> String {
    let hidden = hidden(case);
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(reason) => return format!("| {} | {hidden} | failed: {reason} | | | | | | WRONG |", case.name),
    };
    let ratio = |value: Option<f64>| value.map_or_else(|| "\u{2014}".to_owned(), |value| format!("{value:.2}"));
    let first = outcome.first.as_ref().map_or_else(|| "\u{2014}".to_owned(), ToString::to_string);
    let rank = outcome.rank.map_or_else(|| "\u{2014}".to_owned(), |rank| rank.to_string());
    let mut judged = if outcome.right { "right" } else { "WRONG" }.to_owned();
    if !outcome.right && outcome.tied {
        judged.push_str(", tied");
    }
    match outcome.discovered {
        Some(true) => judged.push_str(", discovered"),
        Some(false) => judged.push_str(", not discovered"),
        None => {}
    }
    format!(
        "| {} | {hidden} | {} | {first} | {rank} | {} | {} | {:.0} | {judged} |",
        case.name,
        outcome.verdict,
        ratio(outcome.before),
        ratio(outcome.after),
        outcome.seconds
    )
}

/// What the cases come to, beside the bars.
fn totals(outcomes: &[(&Case, Option<&Outcome>)]) -> String {
    let of = |kind: Kind| -> Vec<(&Case, Option<&Outcome>)> {
        outcomes.iter().filter(|(case, _)| case.kind == kind).copied().collect()
    };
    let count = |cases: &[(&Case, Option<&Outcome>)], is: &dyn Fn(&Outcome) -> bool| {
        cases.iter().filter(|(_, outcome)| outcome.is_some_and(is)).count()
    };
    let mut lines = Vec::new();
    let mut line = |what: &str, reached: usize, of: usize, bar: &str| {
        if of > 0 {
            let percent = 100.0 * reached as f64 / of as f64;
            lines.push(format!("{what}: {reached} of {of} ({percent:.0} %; bar: {bar})"));
        }
    };
    let (hidden, nothing, outside) = (of(Kind::Hidden), of(Kind::Nothing), of(Kind::Outside));
    let is_named = |outcome: &Outcome| outcome.verdict == "missing_effect";
    line("true effect first", count(&hidden, &|o| is_named(o) && o.rank == Some(1)), hidden.len(), "95 % of 60");
    line(
        "true effect in the first three",
        count(&hidden, &|o| o.rank.is_some_and(|rank| rank <= 3)),
        hidden.len(),
        "all",
    );
    let explained = count(&hidden, &|o| o.after.is_some_and(|after| after <= trial::EXPLAINED));
    line("held-out error at the noise floor once added", explained, hidden.len(), "all");
    line("nothing missing, and said so", count(&nothing, &|o| o.right), nothing.len(), "all of 20");
    line("outside of the library, and said so", count(&outside, &|o| o.right), outside.len(), "90 % of 10");
    let asked = outside.iter().filter(|(case, _)| !case.terms.is_empty()).count();
    line("term discovered", count(&outside, &|o| o.discovered == Some(true)), asked, "70 %");
    lines.join("\n")
}

/// Fits the machines' own models: what is left is the noise, or plant and program disagree about an effect.
fn fit_the_truths(cases: &[Case], jobs: usize, folder: &Path, program: &Path) -> anyhow::Result<()> {
    println!("| case | held-out error over the noise floor |\n| --- | --- |");
    let cases: Vec<Case> = cases.iter().filter(|case| case.true_model.is_some()).cloned().collect();
    let agree = each(&cases, jobs, &|case| {
        let folder = folder.join(&case.name);
        trial::write(case, &folder).map_err(|reason| anyhow!("{}: {reason}", case.name))?;
        let ratio = trial::fit_the_truth(&folder, program);
        match &ratio {
            Ok(ratio) => println!("| {} | {ratio:.3} |", case.name),
            Err(reason) => println!("| {} | {reason} |", case.name),
        }
        Ok(ratio.is_ok_and(|ratio| ratio <= AGREED))
    })?;
    let n_agree = agree.iter().filter(|agree| **agree).count();
    println!("\n{n_agree} of {} at most {AGREED} times the noise floor", cases.len());
    if n_agree < cases.len() { Err(anyhow!("plant and program disagree")) } else { Ok(()) }
}

/// A true model, fitted, leaves at most this many noise floors.
const AGREED: f64 = 1.2;

fn chosen(arguments: &Arguments) -> anyhow::Result<Vec<Case>> {
    let kind = arguments.only.map(Only::kind);
    let is_meant = |case: &Case, word: &str| match word.parse::<usize>() {
        Ok(number) => case.number == number,
        Err(_) => case.name.contains(word),
    };
    let all = table::varied(arguments.vary);
    if let Some(word) = arguments.words.iter().find(|word| !all.iter().any(|case| is_meant(case, word))) {
        return Err(BadInput(format!("there is no case `{word}`; the cases are 1..={}", all.len())).into());
    }
    let is_chosen = |case: &Case| {
        kind.is_none_or(|kind| kind == case.kind)
            && (arguments.words.is_empty() || arguments.words.iter().any(|word| is_meant(case, word)))
    };
    Ok(all.into_iter().filter(is_chosen).collect())
}
