//! What of the logs is fitted to, what is held out, and which samples are looked at.

use dynid_dynamics::simulate::Intersample;
use dynid_logs::experiment::{Role, Run};
use dynid_logs::part::part;

/// Where no run is held out, the last of so many equal parts of every run is.
pub(super) const PARTS: usize = 3;

/// The runs, or their parts where none of them is held out.
pub(super) fn split(runs: &[&Run]) -> Vec<Run> {
    if !is_cut(runs) {
        return runs.iter().map(|run| (*run).clone()).collect();
    }
    let parts = |run: &&Run| {
        let cut = run.log.len() * (PARTS - 1) / PARTS;
        [part(run, 0..cut, Role::Fit), part(run, cut..run.log.len(), Role::Validate)]
    };
    runs.iter().flat_map(parts).collect()
}

/// Whether no run is held out.
pub(super) fn is_cut(runs: &[&Run]) -> bool {
    runs.iter().all(|run| run.role == Role::Fit)
}

/// Those to fit to, and those held out.
pub(super) fn by_role(runs: &[Run]) -> (Vec<Run>, Vec<Run>) {
    runs.iter().cloned().partition(|run| run.role == Role::Fit)
}

/// Whether the command of a run stands still between samples, as far as the experiment says, and need not.
pub(super) fn stands(run: &Run) -> bool {
    run.settings.intersample == Intersample::ZeroOrder && run.settings.controller.is_none()
}

/// The run with a command that runs straight from sample to sample.
pub(super) fn with_line(run: &Run) -> Run {
    let mut run = run.clone();
    run.settings.intersample = Intersample::FirstOrder;
    run
}
