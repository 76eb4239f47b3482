//! `dynid job`: the same work on many experiments, models or seeds, in any order, on any number of machines.
//!
//! A job is one file named by its digest ([`file::Job`]), its result one file of the same name, written by renaming. So what is
//! done is done, whoever did it: work may be stopped, parted, repeated and mixed.

pub(super) mod file;
mod make;
mod work;

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use anyhow::{Context, bail};
use serde_json::{Value, json};

use super::interrupt::Interrupt;
use super::{Answer, Outcome, progress};
use file::Job;
pub use file::json_files;
use work::Ended;

/// Do the same with many experiments, models or seeds: jobs are files, and so are their results.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  dynid job jobs --from nights.csv -- fit '{experiment}' --model nominal.toml --out '{out}.toml'
                                                one job a row of the table: '{column}' is what stands there
  dynid job jobs --out results                  do what is not done yet
  dynid job jobs --out results --shard 3/16     the third of 16 shares, as on a cluster of 16
  dynid fleet results                           what has changed on which robot, and since when

A job is a JSON file, named by its digest, with the arguments of `dynid`, digests of the files that they read, and
labels (the columns of the table). Its result is results/DIGEST.json: what the verb prints with --json, its exit status, or
its error. '{out}' in an argument stands for results/DIGEST, '{{' for a brace. Paths are those of the working folder.

Ctrl-C keeps what is done; the same command goes on, also within a fit. Two machines that do the same job come to the same file.")]
pub struct Arguments {
    /// Job files, or folders of them; with --from, the folder for new ones.
    #[arg(required = true, value_name = "JOBS")]
    jobs: Vec<PathBuf>,
    /// Make jobs: one for each row of this table.
    #[arg(long, value_name = "TABLE", requires = "verb")]
    from: Option<PathBuf>,
    /// The folder of the results.
    #[arg(long, value_name = "FOLDER", default_value = "results", conflicts_with = "from")]
    out: PathBuf,
    /// Only this share of the jobs, e.g. 3/16.
    #[arg(long, value_name = "I/N", value_parser = Shard::parse, conflicts_with = "from")]
    shard: Option<Shard>,
    /// So many jobs at once, each in one thread; without it, as many as there are processors.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), conflicts_with = "from")]
    at_once: Option<u16>,
    /// Do again what has failed.
    #[arg(long, conflicts_with = "from")]
    again: bool,
    /// The arguments of the jobs, after `--`.
    #[arg(last = true, requires = "from")]
    verb: Vec<String>,
}

/// One of so many equal shares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Shard {
    /// From 0.
    index: usize,
    of: usize,
}

impl Shard {
    fn parse(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((index, of)) if (1..=of).contains(&index) => Ok(Self { index: index - 1, of }),
            _ => Err("expected I/N with 1 <= I <= N, as 3/16".to_owned()),
        }
    }
}

/// Makes jobs, or does them.
pub fn run(arguments: &Arguments, effects: Option<&Path>) -> anyhow::Result<Outcome> {
    match (&arguments.from, arguments.jobs.as_slice()) {
        (Some(table), [folder]) => make::run(table, folder, &arguments.verb, effects),
        (Some(_), _) => bail!("with --from, name one folder for the jobs"),
        (None, _) => work(arguments),
    }
}

fn work(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let jobs = file::read_all(&arguments.jobs)?;
    let shard = arguments.shard.unwrap_or(Shard { index: 0, of: 1 });
    let mine: Vec<&Job> =
        jobs.iter().enumerate().filter(|(k, _)| k % shard.of == shard.index).map(|(_, job)| job).collect();
    dynid_files::make_folder(&arguments.out)?;
    refuse_own_folder(arguments)?;
    dynid_files::remove_all_leftovers(&arguments.out);
    let (mut left, mut done, mut failed) = (Vec::new(), 0, Vec::new());
    for job in &mine {
        match job.result(&arguments.out) {
            Some(result) if result["error"].is_null() => done += 1,
            Some(_) if !arguments.again => failed.push(job.digest.clone()),
            _ => left.push(*job),
        }
    }
    let before = done + failed.len();
    let at_once = arguments.at_once.map_or_else(|| thread::available_parallelism().map_or(1, usize::from), usize::from);
    let interrupt = Interrupt::listen()?;
    let ended = progress::counted("jobs", &|| interrupt.is_asked(), |tell| {
        all(&left, arguments, at_once.min(left.len().max(1)), &interrupt, &|count| {
            // Whether to stop is asked of the interrupt itself.
            let _ = tell(dynid::Done { done: before + count, of: mine.len() });
        })
    })?;
    for (job, ended) in left.iter().zip(&ended) {
        match ended {
            Some(Ended::Done) => done += 1,
            Some(Ended::Failed) => failed.push(job.digest.clone()),
            Some(Ended::Stopped | Ended::Elsewhere | Ended::Died) | None => {}
        }
    }
    Ok(outcome(arguments, mine.len(), done, &failed, interrupt.is_asked()))
}

/// A result has the name of its job, and would take its place.
fn refuse_own_folder(arguments: &Arguments) -> anyhow::Result<()> {
    let whole = |path: &Path| path.canonicalize().with_context(|| format!("{} cannot be read", path.display()));
    let out = whole(&arguments.out)?;
    for place in &arguments.jobs {
        let place = whole(place)?;
        if place == out || (place.is_file() && place.parent() == Some(&out)) {
            bail!("{} holds the jobs; name another folder for the results with --out", arguments.out.display());
        }
    }
    Ok(())
}

/// How long another's job is left alone before it is looked at again.
const PATIENCE: Duration = Duration::from_millis(100);

/// Does all jobs, so many at once; how each ended, in their order, `None` where none began it.
fn all(
    jobs: &[&Job],
    arguments: &Arguments,
    at_once: usize,
    interrupt: &Interrupt,
    tell: &(dyn Fn(usize) + Sync),
) -> anyhow::Result<Vec<Option<Ended>>> {
    let (out, again) = (&arguments.out, arguments.again);
    let (next, count) = (AtomicUsize::new(0), AtomicUsize::new(0));
    // What another does, what was stopped and what died is not done.
    let told = |ended: Ended| {
        if matches!(ended, Ended::Done | Ended::Failed) {
            tell(1 + count.fetch_add(1, Ordering::Relaxed));
        }
        ended
    };
    let worker = || -> anyhow::Result<Vec<(usize, Ended)>> {
        let mut ended = Vec::new();
        while !interrupt.is_asked() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { break };
            ended.push((index, told(work::work(job, out, again, interrupt)?)));
        }
        Ok(ended)
    };
    let found: Vec<anyhow::Result<Vec<(usize, Ended)>>> = thread::scope(|scope| {
        let workers: Vec<_> = (0..at_once).map(|_| scope.spawn(worker)).collect();
        let joined = workers.into_iter().map(|own| own.join().unwrap_or_else(|_| bail!("a worker panicked")));
        joined.collect()
    });
    let mut ended: Vec<Option<Ended>> = vec![None; jobs.len()];
    for own in found {
        own?.into_iter().for_each(|(index, how)| ended[index] = Some(how));
    }
    // What another does ends some time: with its result, or with its death.
    for (own, job) in ended.iter_mut().zip(jobs) {
        while *own == Some(Ended::Elsewhere) && !interrupt.is_asked() {
            thread::sleep(PATIENCE);
            // Its failure is as good as ours would be.
            *own = Some(told(work::work(job, out, false, interrupt)?));
        }
    }
    Ok(ended)
}

fn outcome(arguments: &Arguments, all: usize, done: usize, failed: &[String], was_stopped: bool) -> Outcome {
    let open = all - done - failed.len();
    let out = arguments.out.display();
    let mut text = format!("{done} of {all} jobs done; results: {out}\n");
    if open > 0 {
        let _ = writeln!(text, "{open} left: the same command goes on");
    }
    for digest in failed {
        let _ = writeln!(text, "failed: {out}/{digest}.json says why; --again tries it again");
    }
    let answer = match (open, failed.is_empty()) {
        (0, true) => Answer::Yes,
        (1.., _) if was_stopped => Answer::Interrupted,
        _ => Answer::No,
    };
    Outcome {
        text,
        json: json!({ "jobs": all, "done": done, "failed": failed, "left": open, "out": out.to_string() }),
        answer,
    }
}

/// A JSON file.
pub fn read_json(path: &Path) -> anyhow::Result<Value> {
    parse_json(&dynid_files::read(path)?, path)
}

fn parse_json(text: &str, path: &Path) -> anyhow::Result<Value> {
    serde_json::from_str(text).with_context(|| format!("{}: this is no JSON", path.display()))
}
