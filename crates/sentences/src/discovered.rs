//! A formula for what no effect of the library explains.

use dynid_diagnose::ActsOn;

/// Where one was found.
pub(crate) fn found(joint: usize, acts_on: ActsOn, formula: &str, percent: f64) -> String {
    let what = match acts_on {
        ActsOn::Command => "adds to its command",
        ActsOn::Motion => "resists its motion",
    };
    format!(
        "A formula does, of what {what} at joint {joint}: {formula}. It takes away {percent:.0} % of what is \
         above the noise of one-step predictions of the held-out runs."
    )
}

/// Where none was found.
pub(crate) fn nothing() -> String {
    "Nor does any product of the measured signals that holds on the held-out runs: there is nothing worth writing."
        .to_owned()
}
