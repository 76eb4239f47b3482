//! Which tests come by a mutant, and whether one of them fails.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::Mutant;
use super::tree::Program;
use crate::at_once::each;

/// One test, which a process of its own runs.
#[derive(Debug, Clone)]
pub struct Test {
    program: PathBuf,
    folder: PathBuf,
    name: String,
}

/// How a test ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Passed,
    Failed,
    /// It took many times its time and was stopped.
    Hung,
}

/// What became of a mutant.
#[derive(Debug, Clone)]
pub enum Verdict {
    /// A test fails, or hangs, that passes without it.
    Caught { by: String, hangs: bool },
    /// All tests that come by it pass.
    Missed { tests: usize },
    /// The first of those that come by it pass; the time that it was given is over.
    OutOfPatience { tests: usize, of: usize },
    /// No test comes by it.
    Unreached,
}

impl Verdict {
    pub fn in_words(&self) -> String {
        match self {
            Self::Caught { by, hangs: false } => format!("caught by {by}"),
            Self::Caught { by, hangs: true } => format!("caught by {by}, which hangs"),
            Self::Missed { tests } => format!("{tests} tests come by it and pass"),
            Self::OutOfPatience { tests, of } => format!("{tests} tests of {of} that come by it were tried, and pass"),
            Self::Unreached => "no test comes by it".to_owned(),
        }
    }
}

/// A test that comes by mutants.
struct Listened {
    test: Test,
    seconds: f64,
    reached: BTreeSet<usize>,
}

/// Tests that pass where no mutant is active, the quickest first.
pub struct Scene {
    tests: Vec<Listened>,
}

/// All tests of these programs.
pub fn tests(programs: &[Program]) -> anyhow::Result<Vec<Test>> {
    let mut tests = Vec::new();
    for Program { file, folder } in programs {
        let output = Command::new(file).args(["--list", "--format", "terse"]).current_dir(folder).output();
        let output = output.with_context(|| format!("starting {}", file.display()))?;
        if !output.status.success() {
            bail!("{} does not list its tests", file.display());
        }
        let names = String::from_utf8_lossy(&output.stdout).into_owned();
        tests.extend(names.lines().filter_map(|line| line.strip_suffix(": test")).map(|name| Test {
            program: file.clone(),
            folder: folder.clone(),
            name: name.to_owned(),
        }));
    }
    Ok(tests)
}

impl Test {
    /// With its program: `effects` is the name of a test of several.
    fn shown(&self) -> String {
        let program = self.program.file_stem().unwrap_or_default().to_string_lossy();
        format!("{}: {}", program.rsplit_once('-').map_or(&*program, |(name, _)| name), self.name)
    }

    /// Runs it, at most so long, with one more variable of its environment.
    fn run(&self, variable: (&str, &str), most_seconds: f64) -> anyhow::Result<End> {
        // `timeout` stops what the test has started, too
        let mut command = Command::new("timeout");
        command.args(["--kill-after=2", &format!("{most_seconds:.1}")]).arg(&self.program);
        command.args(["--exact", &self.name]).current_dir(&self.folder).env("CARGO_MANIFEST_DIR", &self.folder);
        command.env("INSTA_UPDATE", "no").env(variable.0, variable.1);
        // Every mutant gets the same cases, and none that another one failed.
        command.env("PROPTEST_RNG_SEED", "1").env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "1");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let status = command.status().context("starting `timeout`")?;
        Ok(match status.code() {
            Some(0) => End::Passed,
            // 137, or its own end by that signal, where the test had to be killed
            Some(124 | 137) | None => End::Hung,
            Some(125..=127) => bail!("`timeout` could not run {}", self.program.display()),
            Some(_) => End::Failed,
        })
    }
}

impl Scene {
    /// Runs all tests once and notes what they come by.
    pub fn listen(tests: Vec<Test>, jobs: usize, folder: &Path) -> anyhow::Result<Self> {
        let n_tests = tests.len();
        let numbered: Vec<(usize, Test)> = tests.into_iter().enumerate().collect();
        let heard = each(&numbered, jobs, &|(number, test)| {
            let file = folder.join(number.to_string());
            let started = Instant::now();
            let end = test.run(("MUTANTS_LISTENER", &file.to_string_lossy()), 1800.0)?;
            let seconds = started.elapsed().as_secs_f64();
            let said = fs::read_to_string(&file).unwrap_or_default();
            if end != End::Passed {
                eprintln!("{} does not pass in the copy and is left out", test.shown());
                return Ok(None);
            }
            let reached = said.lines().filter_map(|line| line.parse().ok()).collect();
            Ok(Some(Listened { test: test.clone(), seconds, reached }))
        })?;
        let mut tests: Vec<Listened> = heard.into_iter().flatten().filter(|test| !test.reached.is_empty()).collect();
        tests.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        eprintln!("{} of {n_tests} tests come by a mutant", tests.len());
        Ok(Self { tests })
    }

    /// The verdict of each mutant. The test that caught it in an earlier run, as `file` has it, is tried first.
    pub fn verdicts(
        &self,
        mutants: &[Mutant],
        patience: f64,
        jobs: usize,
        file: &Path,
    ) -> anyhow::Result<Vec<Verdict>> {
        let earlier = caught(&fs::read_to_string(file).unwrap_or_default());
        let book = fs::OpenOptions::new().create(true).append(true).open(file);
        let book = Mutex::new(book.with_context(|| format!("opening {}", file.display()))?);
        let numbered: Vec<(usize, &Mutant)> = mutants.iter().enumerate().collect();
        each(&numbered, jobs, &|(number, mutant)| {
            let known = earlier.get(&mutant.diff);
            let verdict = self.verdict(mutant, known, patience)?;
            eprintln!("{} of {}: {}: {}", number + 1, mutants.len(), mutant.name, verdict.in_words());
            if let Verdict::Caught { by, .. } = &verdict
                && known != Some(by)
            {
                let line = json!({ "diff": mutant.diff, "by": by });
                let mut book = book.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                writeln!(book, "{line}").with_context(|| format!("writing {}", file.display()))?;
            }
            Ok(verdict)
        })
    }

    fn verdict(&self, mutant: &Mutant, known: Option<&String>, patience: f64) -> anyhow::Result<Verdict> {
        let own = self.tests.iter().filter(|test| test.reached.contains(&mutant.number));
        let mut own: Vec<&Listened> = own.collect();
        own.sort_by_key(|listened| known != Some(&listened.test.shown()));
        let started = Instant::now();
        for (tried, Listened { test, seconds, .. }) in own.iter().enumerate() {
            if tried > 0 && started.elapsed().as_secs_f64() + seconds > patience {
                return Ok(Verdict::OutOfPatience { tests: tried, of: own.len() });
            }
            let most = 10.0 + 5.0 * seconds;
            let end = test.run(("MUTANT", &mutant.number.to_string()), most)?;
            // A test that fails without the mutant, too, tells nothing about it.
            if end != End::Passed && test.run(("MUTANT", "none"), most)? == End::Passed {
                return Ok(Verdict::Caught { by: test.shown(), hangs: end == End::Hung });
            }
        }
        Ok(if own.is_empty() { Verdict::Unreached } else { Verdict::Missed { tests: own.len() } })
    }
}

/// The tests that caught mutants in earlier runs, from the lines of a file.
fn caught(lines: &str) -> BTreeMap<String, String> {
    let entry = |line: &str| {
        let value: Value = serde_json::from_str(line).ok()?;
        Some((value["diff"].as_str()?.to_owned(), value["by"].as_str()?.to_owned()))
    };
    lines.lines().filter_map(entry).collect()
}
