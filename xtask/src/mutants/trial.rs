//! Which tests come by a mutant, and whether one of them fails.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::Context;
use serde_json::{Value, json};

use super::Mutant;
use super::tree::Program;

/// One test, which a process of its own runs.
#[derive(Debug, Clone)]
pub struct Test {
    program: PathBuf,
    folder: PathBuf,
    pub name: String,
}

/// How a test ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Passed,
    Failed,
    /// Or was stopped: it took many times its time.
    Hung,
}

/// What became of a mutant.
#[derive(Debug, Clone)]
pub enum Verdict {
    Caught {
        by: String,
    },
    /// So many tests come by it, and all pass.
    Missed {
        tests: usize,
    },
    /// So many of those that come by it passed in the time that it was given.
    OutOfPatience {
        tests: usize,
        of: usize,
    },
    Unreached,
}

impl Verdict {
    pub fn in_words(&self) -> String {
        match self {
            Self::Caught { by } => format!("caught by {by}"),
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
    /// Runs it, at most so long, with one more variable of its environment.
    fn run(&self, variable: (&str, &str), most_seconds: f64) -> anyhow::Result<End> {
        // `timeout` stops what the test has started, too
        let mut command = Command::new("timeout");
        command.args(["--kill-after=2", &format!("{most_seconds:.1}")]).arg(&self.program);
        command.args(["--exact", &self.name]).current_dir(&self.folder).env("CARGO_MANIFEST_DIR", &self.folder);
        command.env("INSTA_UPDATE", "no").env(variable.0, variable.1);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let status = command.status().context("starting `timeout`")?;
        Ok(match status.code() {
            Some(0) => End::Passed,
            Some(124 | 137) => End::Hung,
            _ => End::Failed,
        })
    }
}

impl Scene {
    /// Runs all tests once and notes what they come by.
    pub fn listen(tests: Vec<Test>, jobs: usize, folder: &Path) -> anyhow::Result<Self> {
        let n_tests = tests.len();
        let heard = in_parallel(jobs, &tests, |number, test| {
            let file = folder.join(number.to_string());
            let started = Instant::now();
            let end = test.run(("MUTANTS_LISTENER", &file.to_string_lossy()), 1800.0)?;
            let seconds = started.elapsed().as_secs_f64();
            let said = fs::read_to_string(&file).unwrap_or_default();
            if end != End::Passed {
                eprintln!("{} does not pass in the copy and is left out", test.name);
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

    /// The verdict of each mutant. What was caught in an earlier run, and is the same, is not tried again.
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
        in_parallel(jobs, mutants, |number, mutant| {
            if let Some(by) = earlier.get(&mutant.diff) {
                return Ok(Verdict::Caught { by: by.clone() });
            }
            let verdict = self.verdict(mutant, patience)?;
            eprintln!("{} of {}: {}: {}", number + 1, mutants.len(), mutant.name, verdict.in_words());
            if let Verdict::Caught { by } = &verdict {
                let line = json!({ "diff": mutant.diff, "by": by });
                let mut book = book.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                writeln!(book, "{line}").with_context(|| format!("writing {}", file.display()))?;
            }
            Ok(verdict)
        })
    }

    fn verdict(&self, mutant: &Mutant, patience: f64) -> anyhow::Result<Verdict> {
        let own: Vec<&Listened> = self.tests.iter().filter(|test| test.reached.contains(&mutant.number)).collect();
        let started = Instant::now();
        for (tried, listened) in own.iter().enumerate() {
            if started.elapsed().as_secs_f64() + listened.seconds > patience {
                return Ok(Verdict::OutOfPatience { tests: tried, of: own.len() });
            }
            let most = 10.0 + 5.0 * listened.seconds;
            if listened.test.run(("MUTANT", &mutant.number.to_string()), most)? != End::Passed {
                return Ok(Verdict::Caught { by: listened.test.name.clone() });
            }
        }
        Ok(if own.is_empty() { Verdict::Unreached } else { Verdict::Missed { tests: own.len() } })
    }
}

/// Mutants that earlier runs caught, and the tests that did, from the lines of a file.
fn caught(lines: &str) -> BTreeMap<String, String> {
    let entry = |line: &str| {
        let value: Value = serde_json::from_str(line).ok()?;
        Some((value["diff"].as_str()?.to_owned(), value["by"].as_str()?.to_owned()))
    };
    lines.lines().filter_map(entry).collect()
}

/// What a function makes of each item, so many at a time; ends with the first error.
fn in_parallel<T: Sync, R: Send>(
    jobs: usize,
    items: &[T],
    work: impl Fn(usize, &T) -> anyhow::Result<R> + Sync,
) -> anyhow::Result<Vec<R>> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(number) else { break };
                    let result = work(number, item);
                    if result.is_err() {
                        next.store(items.len(), Ordering::Relaxed);
                    }
                    done.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((number, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, result)| result).collect()
}
