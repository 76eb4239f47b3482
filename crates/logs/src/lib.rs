//! Experiments and measured data: reading log files, the filtered motion, the measurement noise, and the quality of a log.
//!
//! - [`experiment::Experiment`]: an `experiment.toml` with its [`Run`](experiment::Run)s, each to be fitted to or held out
//!   ([`Role`](experiment::Role));
//! - [`log::Log`]: one file in SI units;
//! - [`Run::given`](experiment::Run::given), [`Experiment::of_runs`](experiment::Experiment::of_runs): the same of tables that no file holds;
//! - [`controller`]: the file of the controller that closed the loop;
//! - [`motion::Motion`]: positions, velocities and accelerations after the zero-phase filter;
//! - [`noise`]: measurement noise, estimated from a log alone;
//! - [`part`]: runs made of parts of others;
//! - [`quality::of_run`]: what a log is worth before any model is compared with it.
//!
//! A run with `start` is only planned: it has no measured positions.
//! [`Experiment::read_planned`](experiment::Experiment::read_planned) (for simulation) accepts it,
//! [`Experiment::read_with`](experiment::Experiment::read_with) rejects it.

pub mod controller;
pub mod experiment;
#[cfg(test)]
mod fixtures;
mod given;
pub mod log;
pub mod motion;
pub mod noise;
pub mod part;
pub mod quality;
pub mod transmission;
