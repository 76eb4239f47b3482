//! One job done by this program as a child: what it does to itself reaches nobody else.

use std::io::Read;
use std::path::Path;
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
    /// Somebody wished so, or it died twice; there is no result.
    Stopped,
}

/// What a child printed, and its exit status; none where it died.
struct Printed {
    status: Option<i32>,
    out: String,
    err: String,
}

/// Does a job and writes its result.
pub fn work(job: &Job, out: &Path, interrupt: &Interrupt) -> anyhow::Result<Ended> {
    if let Some(changed) = job.changed_input() {
        let error = format!("{changed} is not the file that the job was made for: make the job anew");
        return write(job, out, &Printed { status: Some(2), out: String::new(), err: format!("error: {error}") });
    }
    // A worker that dies is replaced: once, for what kills two kills a third.
    for _ in 0..2 {
        let printed = printed(&arguments(job, out), interrupt)?;
        match printed.status {
            Some(status) if status == i32::from(interrupt::STATUS) => return Ok(Ended::Stopped),
            Some(_) => return write(job, out, &printed),
            None if interrupt.is_asked() => return Ok(Ended::Stopped),
            None => {}
        }
    }
    eprintln!("note: job {} died twice and has no result; the same command tries it again", job.digest);
    Ok(Ended::Stopped)
}

/// The arguments, with the result's place, and with `--resume` where one that was stopped has left what it had.
fn arguments(job: &Job, out: &Path) -> Vec<String> {
    let place = out.join(&job.digest).display().to_string();
    let mut arguments: Vec<String> = job.content.arguments.iter().map(|own| own.replace(OUT, &place)).collect();
    let written = arguments.iter().position(|own| own == "--out").and_then(|at| arguments.get(at + 1));
    if written.is_some_and(|path| Path::new(&format!("{path}.checkpoint")).is_file()) && arguments[0] == "fit" {
        arguments.push("--resume".to_owned());
    }
    arguments
}

fn printed(arguments: &[String], interrupt: &Interrupt) -> anyhow::Result<Printed> {
    let mut command = program()?;
    command.args(["--json", "--stop-with-stdin"]).args(arguments);
    // Jobs share the processors, and no result depends on the number of threads.
    command.env("RAYON_NUM_THREADS", "1");
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        // Ctrl-C on the terminal is this program's: it passes it on.
        command.process_group(0);
    }
    let mut child = command.spawn().context("the program cannot be run")?;
    let (mut out, mut err) = (child.stdout.take(), child.stderr.take());
    thread::scope(|scope| {
        let out = scope.spawn(move || text(out.as_mut()));
        let err = scope.spawn(move || text(err.as_mut()));
        let status = ended(&mut child, interrupt)?;
        let text = |read: thread::ScopedJoinHandle<'_, String>| read.join().unwrap_or_default();
        Ok(Printed { status, out: text(out), err: text(err) })
    })
}

fn text(stream: Option<&mut impl Read>) -> String {
    let mut bytes = Vec::new();
    // What could be read is what there is.
    let _ = stream.map(|own| own.read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).into_owned()
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
        let _ = &stdin;
        thread::sleep(Duration::from_millis(5));
    }
}

fn write(job: &Job, out: &Path, printed: &Printed) -> anyhow::Result<Ended> {
    let mut result: Value = serde_json::from_str(&printed.out).unwrap_or(Value::Null);
    without_times(&mut result);
    let words = || printed.err.split_once("error: ").map_or(printed.err.as_str(), |(_, words)| words).trim().to_owned();
    let error = if result.is_null() { Value::from(words()) } else { Value::Null };
    let ended = if error.is_null() { Ended::Done } else { Ended::Failed };
    let content = json!({
        "job": job.digest,
        "labels": job.content.labels,
        "arguments": job.content.arguments,
        "status": printed.status,
        "result": result,
        "error": error,
    });
    write_new(&job.result_path(out), &format!("{content}\n"), Overwrite::Force)?;
    Ok(ended)
}

/// Leaves out how long it took: a result is the same whoever comes to it.
fn without_times(result: &mut Value) {
    if let Some(object) = result.as_object_mut() {
        object.remove("wall_seconds");
    }
}
