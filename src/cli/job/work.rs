//! One job done by this program as a child: what it does to itself reaches nobody else.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::Context;
use dynid_files::{Overwrite, write_new};
use serde_json::{Value, json};

use super::super::interrupt::{self, Interrupt};
use super::super::program;
use super::file::{Job, OUT};

/// How a job ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// Its result says what it found.
    Done,
    /// Its result says why it found nothing.
    Failed,
    /// Somebody wished so; there is no result.
    Stopped,
    /// Another is doing it.
    Elsewhere,
    /// It died twice; there is no result.
    Died,
}

/// What a child printed, and its exit status; none where it died.
struct Printed {
    status: Option<i32>,
    out: String,
    err: String,
}

/// The ending of the file that is locked, to which a child also writes what is wrong.
const LOCK: &str = "lock";

/// Does a job and writes its result, last of all that it writes; one that has failed is done `again`, or stays.
///
/// All its files but the checkpoint of a diagnosis lie in the folder of the results, since they name others by where they lie, and begin
/// with its digest. Who has the lock of `DIGEST.lock` does the job; a child has it, too, so that one whose parent was killed comes to its
/// end before another begins, which goes on from the checkpoint that was left.
pub fn work(job: &Job, out: &Path, again: bool, interrupt: &Interrupt) -> anyhow::Result<Ended> {
    let Some(work) = Work::begun(job, out)? else { return Ok(Ended::Elsewhere) };
    let ended = work.done(again, interrupt)?;
    if matches!(ended, Ended::Done | Ended::Failed) {
        // A fit that comes to its end removes its own.
        if work.was_begun || ended == Ended::Failed {
            for left in work.files()?.iter().filter(|path| is_checkpoint(path)) {
                fs::remove_file(left).with_context(|| format!("{} cannot be removed", left.display()))?;
            }
        }
        // Another that looks for the lock now finds the result.
        let _ = fs::remove_file(job.path(out, LOCK));
    }
    Ok(ended)
}

/// A job that nobody else does meanwhile, where the disk has locks.
struct Work<'a> {
    job: &'a Job,
    /// The folder of the results.
    out: &'a Path,
    /// Held, and what a child writes to that is wrong.
    lock: File,
    /// Whether somebody has left something: folders of thousands of results are looked through only then.
    was_begun: bool,
}

impl<'a> Work<'a> {
    /// Takes the lock; none where another has it.
    fn begun(job: &'a Job, out: &'a Path) -> anyhow::Result<Option<Self>> {
        let path = job.path(out, LOCK);
        let was_written = |(own, place): (&String, String)| own.contains(OUT) && Path::new(&place).exists();
        let was_begun = path.exists()
            || job.result_path(out).exists()
            || job.content.arguments.iter().zip(with_places(job, out)).any(was_written);
        let lock = File::options().create(true).truncate(false).read(true).write(true).open(&path);
        let lock = lock.with_context(|| format!("{} cannot be written", path.display()))?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => return Ok(None),
            Err(TryLockError::Error(error)) => say!(
                "note: {} cannot be locked ({error}): see to it that no two processes do the same jobs, e.g. by --shard",
                path.display()
            ),
            Ok(()) => {}
        }
        Ok(Some(Self { job, out, lock, was_begun }))
    }

    /// Does it, unless its result is there.
    fn done(&self, again: bool, interrupt: &Interrupt) -> anyhow::Result<Ended> {
        let job = self.job;
        // Somebody else may have done it since it was looked for.
        match job.result(self.out) {
            Some(result) if result["error"].is_null() => return Ok(Ended::Done),
            Some(_) if !again => return Ok(Ended::Failed),
            _ => {}
        }
        if let Some(changed) = job.changed_input() {
            let error = format!("error: {changed} is not the file that the job was made for: make the job anew");
            return self.write(&Printed { status: Some(2), out: String::new(), err: error });
        }
        // A worker that dies is replaced: once, for what kills two kills a third.
        for attempt in 0..2 {
            let left = if self.was_begun || attempt > 0 { self.files()? } else { Vec::new() };
            let printed = self.printed(&self.arguments(&left)?, interrupt)?;
            match printed.status {
                Some(status) if status == i32::from(interrupt::STATUS) => return Ok(Ended::Stopped),
                Some(_) => return self.write(&printed),
                None if interrupt.is_asked() => return Ok(Ended::Stopped),
                None => {}
            }
        }
        say!("note: job {} died twice and has no result; the same command tries it again", job.digest);
        Ok(Ended::Died)
    }

    /// What a verb has written for the job: all but its lock and its result.
    fn files(&self) -> anyhow::Result<Vec<PathBuf>> {
        let own = [self.job.path(self.out, LOCK), self.job.result_path(self.out)];
        let entries = fs::read_dir(self.out).with_context(|| format!("{} cannot be read", self.out.display()))?;
        let begins = |path: &PathBuf| {
            path.file_name().and_then(OsStr::to_str).is_some_and(|name| name.starts_with(&self.job.digest))
        };
        Ok(entries.flatten().map(|entry| entry.path()).filter(|path| begins(path) && !own.contains(path)).collect())
    }

    /// The arguments, with the result's place, and with `--resume` where one that was stopped has `left` what it had.
    fn arguments(&self, left: &[PathBuf]) -> anyhow::Result<Vec<String>> {
        // What was written whole before a death is written again.
        for path in left.iter().filter(|path| !is_checkpoint(path)) {
            let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
            removed.with_context(|| format!("{} cannot be removed", path.display()))?;
        }
        let mut arguments = with_places(self.job, self.out);
        if left.iter().any(|path| is_checkpoint(path)) && arguments.iter().any(|own| own == "fit") {
            arguments.push("--resume".to_owned());
        }
        Ok(arguments)
    }

    /// Runs the program.
    fn printed(&self, arguments: &[String], interrupt: &Interrupt) -> anyhow::Result<Printed> {
        let mut lock = &self.lock;
        lock.set_len(0)?;
        lock.rewind()?;
        let mut command = program()?;
        command.args(["--json", "--stop-with-stdin"]).args(arguments);
        // Jobs share the processors, and no result depends on the number of threads.
        command.env("RAYON_NUM_THREADS", "1");
        // With its stderr it holds the lock.
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(lock.try_clone()?);
        #[cfg(unix)]
        {
            use std::os::unix::process::CommandExt;
            // Ctrl-C on the terminal is this program's: it passes it on.
            command.process_group(0);
        }
        let mut child = command.spawn().context("the program cannot be run")?;
        let stdout = child.stdout.take();
        let (status, out) = thread::scope(|scope| {
            let out = scope.spawn(|| stdout.map_or_else(|| Ok(String::new()), io::read_to_string));
            let status = ended(&mut child, interrupt);
            (status, out.join())
        });
        lock.rewind()?;
        let mut err = Vec::new();
        lock.read_to_end(&mut err)?;
        // What is no text is no answer.
        let out = out.ok().and_then(Result::ok).unwrap_or_default();
        Ok(Printed { status: status?, out, err: String::from_utf8_lossy(&err).into_owned() })
    }

    fn write(&self, printed: &Printed) -> anyhow::Result<Ended> {
        let mut result: Value = serde_json::from_str(&printed.out).unwrap_or(Value::Null);
        without_times(&mut result);
        let error = if result.is_null() { Value::from(why(&printed.err, printed.status)) } else { Value::Null };
        let ended = if error.is_null() { Ended::Done } else { Ended::Failed };
        let content = json!({
            "job": self.job.digest,
            "labels": self.job.content.labels,
            "arguments": self.job.content.arguments,
            "program": concat!("dynid ", env!("CARGO_PKG_VERSION")),
            "status": printed.status,
            "result": result,
            "error": error,
        });
        write_new(&self.job.result_path(self.out), &format!("{content}\n"), Overwrite::Force)?;
        Ok(ended)
    }
}

/// Whether a file is what a stopped fit has left.
fn is_checkpoint(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "checkpoint")
}

/// The arguments, with the place of what the verb writes.
fn with_places(job: &Job, out: &Path) -> Vec<String> {
    let name = out.join(&job.digest).display().to_string();
    job.content.arguments.iter().map(|own| own.replace(OUT, &name)).collect()
}

/// Waits for the end of a child, and passes on that somebody wishes it: stdin ends.
fn ended(child: &mut Child, interrupt: &Interrupt) -> anyhow::Result<Option<i32>> {
    let mut stdin = child.stdin.take();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.code());
        }
        if interrupt.is_asked() {
            stdin = None;
        }
        // It is held until then.
        let _ = &stdin;
        thread::sleep(Duration::from_millis(5));
    }
}

/// The words of an error, as the child printed them.
fn why(printed: &str, status: Option<i32>) -> String {
    let words = printed.split_once("error: ").map_or(printed, |(_, words)| words).trim();
    if words.is_empty() {
        format!("it printed no answer (exit status {})", status.unwrap_or(-1))
    } else {
        words.to_owned()
    }
}

/// Leaves out how long it took: a result is the same whoever comes to it.
fn without_times(result: &mut Value) {
    if let Some(object) = result.as_object_mut() {
        object.remove("wall_seconds");
    }
}
