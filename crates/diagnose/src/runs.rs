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

#[cfg(test)]
mod tests {
    use dynid_logs::experiment::Settings;
    use dynid_logs::log::Log;

    use super::*;

    fn run(role: Role, n: usize) -> Run {
        let log = Log {
            t: (0..n).map(|k| 0.01 * k as f64).collect(),
            q: vec![(0..n).map(|k| k as f64).collect()],
            tau: vec![vec![0.0; n]],
            reference: None,
            mask: None,
            left_out: Vec::new(),
        };
        let settings = Settings::default();
        Run { file: "made.csv".to_owned(), role, free: vec![0], payload: None, configuration: 1, log, settings }
    }

    #[test]
    fn the_last_third_is_held_out_where_no_run_is() {
        let (one, two, held_out) = (run(Role::Fit, 90), run(Role::Fit, 31), run(Role::Validate, 30));
        let lengths = |runs: &[Run]| runs.iter().map(|run| (run.role, run.log.len())).collect::<Vec<_>>();
        let parts = split(&[&one, &two]);
        let expected = [(Role::Fit, 60), (Role::Validate, 30), (Role::Fit, 20), (Role::Validate, 11)];
        assert_eq!(lengths(&parts), expected);
        assert_eq!(parts[1].log.q[0][0], 60.0, "the parts follow each other");
        assert!(is_cut(&[&one, &two]) && !is_cut(&[&one, &held_out]));
        let whole = split(&[&one, &held_out]);
        assert_eq!(lengths(&whole), [(Role::Fit, 90), (Role::Validate, 30)]);
        let (fit, judged) = by_role(&parts);
        assert_eq!((lengths(&fit), lengths(&judged)), (vec![expected[0], expected[2]], vec![expected[1], expected[3]]));
    }

    #[test]
    fn a_command_that_stands_between_samples_may_run_straight() {
        let standing = run(Role::Fit, 90);
        assert!(stands(&standing));
        assert!(!stands(&with_line(&standing)), "it runs straight already");
        assert_eq!(with_line(&standing).settings.intersample, Intersample::FirstOrder);
    }
}
