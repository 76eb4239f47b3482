//! Runs for tests.

use crate::experiment::{Role, Run, Settings};
use crate::log::Log;

/// A run of one joint.
pub fn run(t: Vec<f64>, q: Vec<f64>, tau: Vec<f64>) -> Run {
    let log = Log { tau: vec![tau], q: vec![q], t, reference: None, mask: None, left_out: Vec::new() };
    let settings = Settings { min_speed: vec![0.0], ..Settings::default() };
    Run { file: "made.csv".to_owned(), role: Role::Fit, free: vec![0], payload: None, configuration: 1, log, settings }
}
