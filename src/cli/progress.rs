//! How far a fit is, on stderr; silent where stderr is no terminal.

use std::time::{Duration, Instant};

use dynid_identify::identify::Progress;
use dynid_text::number;
use indicatif::ProgressBar;

/// Runs `work` with somebody to tell its progress to.
pub fn shown<T>(work: impl FnOnce(&mut dyn FnMut(&Progress)) -> T) -> T {
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(200));
    let started = Instant::now();
    let result = work(&mut |reported| bar.set_message(message(reported, started.elapsed())));
    bar.finish_and_clear();
    result
}

fn message(reported: &Progress, elapsed: Duration) -> String {
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
