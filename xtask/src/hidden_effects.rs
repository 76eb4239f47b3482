//! `cargo xtask hidden-effects`: hides one effect after another from the program and prints what it finds.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, anyhow};
use clap::ValueEnum;
use dynid_plant::hidden::trial::{self, Outcome};
use dynid_plant::hidden::{Case, Kind, Spot, table};

use crate::{BadInput, shell};

/// Hides one effect after another from the program and prints what it finds.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only these cases, by number or by a part of their name.
    #[arg(long = "case", value_name = "CASE", value_delimiter = ',')]
    cases: Vec<String>,
    /// Only cases of this kind.
    #[arg(long, value_enum)]
    only: Option<Only>,
    /// Other machines, runs and sizes of the hidden effects than those that the program was written by.
    #[arg(long, value_name = "N", default_value_t = 0)]
    draw: u32,
    /// Cases at a time.
    #[arg(long, value_name = "N", default_value_t = 1)]
    jobs: usize,
    /// Only write the cases' files, each into a folder of its own in this one.
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
}

/// Runs or writes the cases asked for.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let cases = chosen(arguments)?;
    if let Some(folder) = &arguments.write {
        each(&cases, arguments.jobs, &|case| {
            let folder = folder.join(&case.name);
            trial::write(case, &folder).map_err(|reason| anyhow!(reason))?;
            println!("{}", folder.display());
            Ok(())
        })?;
        return Ok(());
    }
    let program = match &arguments.program {
        Some(program) => program.canonicalize().with_context(|| program.display().to_string())?,
        None => {
            shell::succeed(&mut shell::cargo(&["build", "--release", "--locked", "--package", "dynid"]))?;
            shell::root().join("target/release").join(format!("dynid{}", std::env::consts::EXE_SUFFIX))
        }
    };
    let mut folder = shell::root().join("target/hidden-effects");
    if arguments.draw > 0 {
        folder.push(format!("draw-{}", arguments.draw));
    }
    if arguments.truth {
        return fit_the_truths(&cases, arguments.jobs, &folder, &program);
    }
    println!("{HEADER}");
    let outcomes = each(&cases, arguments.jobs, &|case| {
        let folder = folder.join(&case.name);
        trial::write(case, &folder).map_err(|reason| anyhow!(reason))?;
        let outcome = trial::run(case, &folder, &program);
        println!("{}", row(case, &outcome));
        Ok(outcome)
    })?;
    let known: Vec<(&Case, Option<&Outcome>)> =
        cases.iter().zip(&outcomes).map(|(case, outcome)| (case, outcome.as_ref().ok())).collect();
    println!("\n{}", totals(&known));
    Ok(())
}

const HEADER: &str = "| case | hidden | verdict | first | rank | before | after | s | |\n\
                      | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

/// Errors are held-out ones over the noise floor.
fn row(case: &Case, outcome: &Result<Outcome, String>) -> String {
    let hidden = case.hidden.as_ref().map_or_else(
        || "\u{2014}".to_owned(),
        |hidden| Spot { effect: hidden.id.clone(), joint: hidden.joint, from: hidden.from }.to_string(),
    );
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
        trial::write(case, &folder).map_err(|reason| anyhow!(reason))?;
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
    let kind = arguments.only.map(|only| match only {
        Only::Hidden => Kind::Hidden,
        Only::Nothing => Kind::Nothing,
        Only::Outside => Kind::Outside,
    });
    let is_meant = |case: &Case, word: &str| match word.parse::<usize>() {
        Ok(number) => case.number == number,
        Err(_) => case.name.contains(word),
    };
    let all = table::drawn(arguments.draw);
    if let Some(word) = arguments.cases.iter().find(|word| !all.iter().any(|case| is_meant(case, word))) {
        return Err(BadInput(format!("there is no case `{word}`; the cases are 1..={}", all.len())).into());
    }
    let is_chosen = |case: &Case| {
        kind.is_none_or(|kind| kind == case.kind)
            && (arguments.cases.is_empty() || arguments.cases.iter().any(|word| is_meant(case, word)))
    };
    Ok(all.into_iter().filter(is_chosen).collect())
}

/// Does `work` for all cases, some at a time; the answers stand in the order of the cases.
fn each<T: Send>(
    cases: &[Case],
    jobs: usize,
    work: &(dyn Fn(&Case) -> anyhow::Result<T> + Sync),
) -> anyhow::Result<Vec<T>> {
    let next = Mutex::new(cases.iter().enumerate());
    let mut done: Vec<(usize, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs.max(1))
            .map(|_| {
                scope.spawn(|| -> anyhow::Result<Vec<(usize, T)>> {
                    let mut done = Vec::new();
                    loop {
                        let case = next.lock().map_err(|_| anyhow!("another case failed"))?.next();
                        let Some((index, case)) = case else { return Ok(done) };
                        done.push((index, work(case).with_context(|| case.name.clone())?));
                    }
                })
            })
            .collect();
        let mut done = Vec::new();
        for worker in workers {
            done.extend(worker.join().map_err(|_| anyhow!("a case failed"))??);
        }
        anyhow::Ok(done)
    })?;
    done.sort_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, answer)| answer).collect())
}
