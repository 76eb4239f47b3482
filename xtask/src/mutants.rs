//! `cargo xtask mutants`: do the tests notice when the code that judges is wrong?
//!
//! `cargo mutants` lists what could be wrong: a `+` that is a `-`, a function that returns 0, an arm that is not there. It would
//! compile everything for each of them, minutes at a time. Here those that are drawn are compiled in together, each
//! behind a switch of its own (`mutants/switches.rs`); then one run of all tests notes which switches each test comes by, and each
//! mutant is given to those tests that come by it, the quickest first, until one fails (`mutants/trial.rs`).
//!
//! A field that is left out of a struct's expression has no switch, nor has a function's value of type `impl Trait`, nor what a
//! constant is computed by, nor what lies within another mutant that was drawn: others are drawn for those.

mod switches;
mod tree;
mod trial;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Context;
use dynid_random::Random;
use serde_json::Value;

use crate::shell;
use trial::Verdict;

/// Crates whose mutants are listed: what judges, and what lowers symbols to kernels.
const JUDGED: [&str; 4] = ["dynid-diagnose", "dynid-identify", "dynid-judge", "dynid-lower"];

/// Changes the code, one place at a time, and counts what the tests notice.
#[derive(clap::Args)]
pub struct Arguments {
    /// Mutants of each crate.
    #[arg(long, default_value_t = 100)]
    each: usize,
    /// What they are drawn from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only mutants of these crates.
    #[arg(long = "package", value_name = "NAME", default_values = JUDGED)]
    packages: Vec<String>,
    /// Seconds of tests that a mutant is given; one that has not been caught by then counts as missed.
    #[arg(long, value_name = "SECONDS", default_value_t = 120.0)]
    patience: f64,
    /// Tests at a time.
    #[arg(long, value_name = "N", default_value_t = 2)]
    jobs: usize,
}

/// A change of one place, as `cargo mutants` lists it.
#[derive(Debug, Clone)]
pub struct Mutant {
    /// The number of its switch.
    pub number: usize,
    pub package: String,
    /// As the workspace's root sees it.
    pub file: PathBuf,
    /// `BinaryOperator`, `FnValue`, ..: what kind of change it is.
    pub genre: String,
    /// In words, with its place.
    pub name: String,
    pub replacement: String,
    /// The change with the lines around it.
    pub diff: String,
    /// Line and column of its first character, both from 1.
    pub start: (usize, usize),
}

/// Draws, plants, builds, listens, tries, and prints what was missed.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut drawn = Vec::new();
    let mut n_listed = 0;
    for package in &arguments.packages {
        let mut listed = listed(package, n_listed)?;
        n_listed += listed.len();
        println!("{package}: {} mutants", listed.len());
        shuffle(&mut listed, arguments.seed);
        drawn.push(listed);
    }
    let tree = tree::Tree::new(&shell::root().join("target/mutants"), &arguments.packages)?;
    let planted = tree.plant(&drawn, arguments.each)?;
    let tests = trial::tests(&tree.programs()?)?;
    let scene = trial::Scene::listen(tests, arguments.jobs, &tree.listeners()?)?;
    let verdicts = scene.verdicts(&planted, arguments.patience, arguments.jobs, &tree.verdicts())?;
    print!("{}", table(&arguments.packages, &planted, &verdicts));
    Ok(())
}

/// All mutants of a package; their numbers begin with `first`.
fn listed(package: &str, first: usize) -> anyhow::Result<Vec<Mutant>> {
    let mut command = shell::cargo(&["mutants", "--list", "--json", "--package", package]);
    let text =
        shell::stdout_of(&mut command).context("`cargo install --locked cargo-mutants` installs what lists them")?;
    let list: Vec<Value> = serde_json::from_str(&text).context("reading what `cargo mutants --list` printed")?;
    (first..).zip(&list).map(|(number, value)| mutant(number, value)).collect()
}

fn mutant(number: usize, value: &Value) -> anyhow::Result<Mutant> {
    let text = |key: &str| value[key].as_str().with_context(|| format!("a mutant without `{key}`")).map(str::to_owned);
    let place = |key: &str| value["span"]["start"][key].as_u64().with_context(|| format!("a mutant without `{key}`"));
    Ok(Mutant {
        number,
        package: text("package")?,
        file: text("file")?.into(),
        genre: text("genre")?,
        name: text("name")?,
        replacement: text("replacement")?,
        diff: text("diff")?,
        start: (usize::try_from(place("line")?)?, usize::try_from(place("column")?)?),
    })
}

/// Another order of the same (Fisher & Yates).
fn shuffle<T>(items: &mut [T], seed: u64) {
    let mut random = Random::new(seed);
    for last in (1..items.len()).rev() {
        items.swap(last, (random.unit() * (last + 1) as f64) as usize);
    }
}

/// What became of the mutants of each package, then those that were missed.
fn table(packages: &[String], mutants: &[Mutant], verdicts: &[Verdict]) -> String {
    let mut counts: BTreeMap<&str, [usize; 5]> = BTreeMap::new();
    let mut missed = String::new();
    for (mutant, verdict) in mutants.iter().zip(verdicts) {
        let column = match verdict {
            Verdict::Caught { hangs: false, .. } => 0,
            Verdict::Caught { hangs: true, .. } => 1,
            Verdict::Missed { .. } => 2,
            Verdict::OutOfPatience { .. } => 3,
            Verdict::Unreached => 4,
        };
        counts.entry(&mutant.package).or_default()[column] += 1;
        if column > 1 {
            let _ = writeln!(missed, "- {}: {}", mutant.name, verdict.in_words());
        }
    }
    let mut text =
        "\n| crate | tried | a test fails | a test hangs | all tests pass | out of patience | no test comes by | caught |\n\
                    | --- | --- | --- | --- | --- | --- | --- | --- |\n"
            .to_owned();
    let mut row = |name: &str, own: [usize; 5]| {
        let (all, [failed, hung, passed, patience, unreached]) = (own.iter().sum::<usize>(), own);
        let share = 100.0 * (failed + hung) as f64 / all.max(1) as f64;
        let _ = writeln!(
            text,
            "| {name} | {all} | {failed} | {hung} | {passed} | {patience} | {unreached} | {share:.0} % |"
        );
    };
    let mut sum = [0; 5];
    for package in packages {
        let own = counts.get(package.as_str()).copied().unwrap_or_default();
        row(package, own);
        sum = std::array::from_fn(|column| sum[column] + own[column]);
    }
    row("all", sum);
    format!("{text}\n{missed}")
}
