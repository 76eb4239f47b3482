//! Work without Python's lock, of which Python hears and which it may stop.
//!
//! The work has a thread of its own; the thread that called waits for it, asks a few times a second whether a signal (Ctrl-C) has come, and
//! is the only one that calls the user's function. So that function need not be safe to call from several threads, and what a notebook
//! shows comes from where it is shown.

use std::any::Any;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{Builder, scope};
use std::time::Duration;

use pyo3::prelude::*;
use serde_json::Value;

use crate::errors::raised;

/// How long a signal may go unheard.
const PATIENCE: Duration = Duration::from_millis(50);

/// What a main thread has on most systems (bytes): a number of ours.
const STACK: usize = 8 << 20;

/// Tells Python how far the work is, and hears whether it is to stop.
pub struct Reporter<'a> {
    lines: Option<Sender<String>>,
    stopped: &'a AtomicBool,
    /// Dropped with the rest when the work ends, however it does.
    _end: Sender<String>,
}

impl Reporter<'_> {
    /// Tells, where somebody listens.
    pub fn tell(&self, line: impl FnOnce() -> Option<Value>) -> ControlFlow<()> {
        if let (Some(lines), Some(line)) = (&self.lines, self.lines.as_ref().and_then(|_| line())) {
            // Whoever waits holds the other end until the work is done.
            let _ = lines.send(line.to_string());
        }
        if self.stopped.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Does `work`, lines of JSON of which go to `progress`.
///
/// # Errors
/// Those of the work; what a signal or `progress` raises, once the work has stopped for it.
pub fn done<T: Send, E: Into<dynid::Error>>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Reporter<'_>) -> Result<T, E> + Send,
) -> PyResult<T> {
    let stopped = AtomicBool::new(false);
    let (sender, receiver) = channel();
    let reporter = Reporter { lines: progress.map(|_| sender.clone()), stopped: &stopped, _end: sender };
    scope(|scope| {
        let worker = Builder::new()
            .stack_size(STACK)
            .spawn_scoped(scope, move || work(&reporter).map_err(Into::into))
            .map_err(|error| raised(format!("no thread could be started: {error}; end other programs")))?;
        let heard = listen(py, progress, receiver, &stopped);
        let result: Result<T, dynid::Error> = match py.detach(|| worker.join()) {
            Ok(result) => result,
            Err(panic) => {
                return Err(raised(format!("a mistake of the program, please report it: {}", words(&*panic))));
            }
        };
        heard?;
        result.map_err(raised)
    })
}

/// Hands lines on until the work is done; the first thing that Python raises stops it.
fn listen(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    mut lines: Receiver<String>,
    stopped: &AtomicBool,
) -> PyResult<()> {
    let mut raised = None;
    loop {
        let line;
        (line, lines) = py.detach(move || (lines.recv_timeout(PATIENCE), lines));
        let heard = match (line, progress) {
            (Err(RecvTimeoutError::Disconnected), _) => return raised.map_or(Ok(()), Err),
            (Ok(line), Some(progress)) if raised.is_none() => progress.call1((line,)).map(|_| ()),
            _ => Ok(()),
        };
        if let Err(error) = heard.and_then(|()| py.check_signals()) {
            stopped.store(true, Ordering::Relaxed);
            raised.get_or_insert(error);
        }
    }
}

fn words(panic: &(dyn Any + Send)) -> &str {
    panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied()).unwrap_or("a panic")
}
