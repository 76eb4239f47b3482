//! How far a work is, on stderr; silent where stderr is no terminal.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use dynid::{DiagnoseProgress, Done, ErrorSignal, FitProgress};
use dynid_diagnose::Event;
use dynid_format::number;
use dynid_identify::identify::Progress;
use indicatif::ProgressBar;

fn spinner() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Runs `work`, which tells how many of its parts are done; `stop` is asked after each.
pub fn counted<T>(
    what: &str,
    stop: &(dyn Fn() -> bool + Sync),
    work: impl FnOnce(&(dyn Fn(Done) -> ControlFlow<()> + Sync)) -> T,
) -> T {
    let bar = spinner();
    let result = work(&|Done { done, of }| {
        bar.set_message(format!("{done} of {of} {what}"));
        go_on_unless(stop())
    });
    bar.finish_and_clear();
    result
}

/// Runs a fit; `stop` is told which error a search makes small when it begins, and asked after each iteration.
pub fn of_fit<T>(
    stop: &mut dyn FnMut(Option<ErrorSignal>) -> bool,
    work: impl FnOnce(&mut dyn FnMut(FitProgress<'_>) -> ControlFlow<()>) -> T,
) -> T {
    let bar = spinner();
    let mut started = Instant::now();
    let result = work(&mut |reported| {
        let mut begun = None;
        match reported {
            FitProgress::FirstEstimate(label) => bar.suspend(|| {
                eprintln!("note: {label} stands where it vanishes; it starts from a first estimate by the logs");
            }),
            FitProgress::Search(error) => {
                started = Instant::now();
                begun = Some(error);
            }
            FitProgress::Iteration(reported) => bar.set_message(iteration(reported, started.elapsed())),
        }
        go_on_unless(stop(begun))
    });
    bar.finish_and_clear();
    result
}

/// Runs a diagnosis; `hear` is told of its events besides, and `stop` is asked often.
pub fn of_diagnosis<T>(
    hear: &(dyn Fn(&Event<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
    work: impl FnOnce(&(dyn Fn(DiagnoseProgress<'_>) -> ControlFlow<()> + Sync)) -> T,
) -> T {
    let bar = spinner();
    let started = Instant::now();
    let result = work(&|reported| {
        if let DiagnoseProgress::Event(event) = reported {
            bar.set_message(diagnosis(event, started.elapsed()));
            hear(event);
        }
        go_on_unless(stop())
    });
    bar.finish_and_clear();
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
        Event::Comparing(count) => format!("fitting the {count} candidates that promise most"),
        Event::Searched(key, _) => format!("searched {key}"),
    };
    format!("{what}, {:.0} s", elapsed.as_secs_f64())
}
