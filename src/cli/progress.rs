//! How far a work is, on stderr: bars where that is a terminal, silence where it is none, or with `--progress json` one JSON object a line.

use std::io::Write;
use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use dynid::{DiagnoseProgress, Done, ErrorSignal, FitProgress};
use dynid_diagnose::Event;
use dynid_format::number;
use dynid_identify::identify::Progress;
use indicatif::ProgressBar;
use serde_json::{Value, json};

/// How progress is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Form {
    /// Bars for people; nothing where stderr is no terminal.
    Bars,
    /// One JSON object a line, for programs.
    Json,
}

static FORM: OnceLock<Form> = OnceLock::new();

/// Chooses how all progress of this process is told.
pub fn choose(form: Form) {
    // It is chosen once, by the arguments.
    let _ = FORM.set(form);
}

/// Tells how far a work is.
struct Teller(Option<ProgressBar>);

impl Teller {
    fn new() -> Self {
        let bar = FORM.get() != Some(&Form::Json);
        Self(bar.then(|| {
            let bar = ProgressBar::new_spinner();
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        }))
    }

    fn tell(&self, words: impl FnOnce() -> String, line: impl FnOnce() -> Value) {
        match &self.0 {
            Some(bar) => bar.set_message(words()),
            None => write_line(&line()),
        }
    }

    fn note(&self, note: &str) {
        match &self.0 {
            Some(bar) => bar.suspend(|| say!("note: {note}")),
            None => write_line(&json!({ "progress": "note", "note": note })),
        }
    }

    fn done(&self) {
        if let Some(bar) = &self.0 {
            bar.finish_and_clear();
        }
    }
}

fn write_line(line: &Value) {
    let mut stderr = std::io::stderr().lock();
    // Whoever does not listen any more misses nothing.
    let _ = writeln!(stderr, "{line}").and_then(|()| stderr.flush());
}

/// Runs `work`, which tells how many of its parts are done; `stop` is asked after each.
pub fn counted<T>(
    what: &str,
    stop: &(dyn Fn() -> bool + Sync),
    work: impl FnOnce(&(dyn Fn(Done) -> ControlFlow<()> + Sync)) -> T,
) -> T {
    let teller = Teller::new();
    let result = work(&|Done { done, of }| {
        teller.tell(|| format!("{done} of {of} {what}"), || Done { done, of }.json(what));
        go_on_unless(stop())
    });
    teller.done();
    result
}

/// Runs a fit; `stop` is told which error a search makes small when it begins, and asked after each iteration.
pub fn of_fit<T>(
    stop: &mut dyn FnMut(Option<ErrorSignal>) -> bool,
    work: impl FnOnce(&mut dyn FnMut(FitProgress<'_>) -> ControlFlow<()>) -> T,
) -> T {
    let teller = Teller::new();
    let mut started = Instant::now();
    let result = work(&mut |reported| {
        let mut begun = None;
        match reported {
            FitProgress::FirstEstimate(label) => {
                teller.note(&format!("{label} stands where it vanishes; it starts from a first estimate by the logs"));
            }
            FitProgress::Search(error) => {
                started = Instant::now();
                begun = Some(error);
                // A bar shows the search by its first iteration.
                if teller.0.is_none() {
                    write_line(&FitProgress::Search(error).json());
                }
            }
            FitProgress::Iteration(reported) => {
                teller.tell(|| iteration(reported, started.elapsed()), || FitProgress::Iteration(reported).json());
            }
        }
        go_on_unless(stop(begun))
    });
    teller.done();
    result
}

/// Runs a diagnosis; `hear` is told of its events besides, and `stop` is asked often.
pub fn of_diagnosis<T>(
    hear: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
    work: impl FnOnce(&(dyn Fn(DiagnoseProgress<'_>) -> ControlFlow<()> + Sync)) -> T,
) -> T {
    let teller = Teller::new();
    let started = Instant::now();
    let result = work(&|reported| {
        if let DiagnoseProgress::Event(event) = &reported {
            teller.tell(|| diagnosis(event, started.elapsed()), || reported.json().unwrap_or_default());
            hear(event);
        }
        go_on_unless(stop())
    });
    teller.done();
    result
}

fn go_on_unless(stop: bool) -> ControlFlow<()> {
    if stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

fn iteration(reported: &Progress, elapsed: Duration) -> String {
    let start = if reported.start > 0 { format!("start {}: ", reported.start + 1) } else { String::new() };
    let configuration = reported.configuration.map_or(String::new(), |number| format!("configuration {number}: "));
    let step = reported.step.map_or(String::new(), |step| format!(", step {}", number(step)));
    let observer = if reported.observer > 0.0 {
        format!(", pulled to the logs at {:.0}/s", reported.observer)
    } else {
        String::new()
    };
    format!(
        "{start}{configuration}iteration {}, cost {}{step}{observer}, {:.0} s",
        reported.iteration,
        number(reported.cost),
        elapsed.as_secs_f64()
    )
}

fn diagnosis(event: &Event<'_>, elapsed: Duration) -> String {
    let what = match event {
        Event::FittingModel => "fitting the model itself".to_owned(),
        Event::Asking(count) => format!("asking what each of {count} candidates would add"),
        Event::Screened(screened) => format!("asked what each of {} candidates would add", screened.len()),
        Event::Comparing(count) => format!("fitting the {count} candidates that promise most"),
        Event::Searched(key, _) => format!("searched {key}"),
    };
    format!("{what}, {:.0} s", elapsed.as_secs_f64())
}
