//! How far a fit is, on stderr; silent where stderr is no terminal.

use std::time::Duration;

use dynid::identify::Progress;
use dynid::report::number;
use indicatif::ProgressBar;

/// Runs `work` with somebody to tell its progress to.
pub fn shown<T>(work: impl FnOnce(&mut dyn FnMut(&Progress)) -> T) -> T {
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(200));
    let result = work(&mut |told| {
        let tether =
            if told.tether > 0.0 { format!(", pulled to the logs at {:.0}/s", told.tether) } else { String::new() };
        let step = told.configuration.map_or(String::new(), |number| format!("configuration {number}: "));
        bar.set_message(format!("{step}iteration {}, cost {}{tether}", told.iteration, number(told.cost)));
    });
    bar.finish_and_clear();
    result
}
