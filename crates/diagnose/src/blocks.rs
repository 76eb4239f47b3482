//! Blocked cross-validation, where no run is held out.
//!
//! Every run is cut in time into [`BLOCKS`] blocks. A *fold* holds out one block of every run and fits to the others; blocks
//! rather than samples, since neighbours in time share their error. The diagnosis goes as always with the last blocks held
//! out: screening, fits, a first order. The model itself and the best [`CONFIRMED`] candidates are fitted to the other folds as
//! well, each from where its first fit ended, and what is left of all blocks together decides. That is
//! `(BLOCKS - 1) (CONFIRMED + 1)` more fits, and more only where the best lose their credit, so that the next are asked.
//! The values that are reported are those of the first fold.

use super::Note;
use super::refit::{CostLimits, FOR_A_CANDIDATE, Judge, Refit, left};
use crate::DiagnoseError;
use dynid_check::excitation::LEAST_SAMPLES;
use dynid_identify::identify::ErrorSignal;
use dynid_judge::{compare::Comparison, compare::RunComparison, compare::compare};
use dynid_logs::{experiment::Role, experiment::Run, part::part};

/// Blocks that a run is cut into: with three, a fit sees two thirds of every run.
pub(super) const BLOCKS: usize = 3;
/// As many candidates are judged by all blocks.
pub(super) const CONFIRMED: usize = 3;

/// How runs are held out.
#[derive(Debug)]
pub(super) struct Split {
    /// Of the fold that holds out the last blocks; none where whole runs are held out.
    last: Option<Vec<Run>>,
    /// The other folds.
    pub(super) others: Vec<Vec<Run>>,
}

impl Split {
    /// Blocks, unless one of the runs is held out.
    pub(super) fn of(runs: &[&Run], error: ErrorSignal) -> Self {
        let is_held_out = runs.iter().any(|run| run.role == Role::Validate);
        let mut others: Vec<Vec<Run>> =
            if is_held_out { Vec::new() } else { (0..BLOCKS).map(|block| fold(runs, block, error)).collect() };
        Self { last: others.pop(), others }
    }

    /// Whether runs are cut into blocks.
    pub(super) fn is_cut(&self) -> bool {
        self.last.is_some()
    }

    /// All folds; none where whole runs are held out.
    pub(super) fn folds(&self) -> Vec<&[Run]> {
        self.others.iter().chain(&self.last).map(Vec::as_slice).collect()
    }

    /// `runs`, which it is of, to fit to and held out: the fold that holds out the last blocks, or themselves.
    pub(super) fn judged<'a>(&'a self, runs: &[&'a Run]) -> Vec<&'a Run> {
        self.last.as_ref().map_or_else(|| runs.to_vec(), |fold| fold.iter().collect())
    }
}

/// What to know of it.
pub(super) fn note() -> Note {
    Note::BlockedCrossValidation { blocks: BLOCKS, confirmed: CONFIRMED }
}

/// The runs of the fold that holds out that block, from 0: of every run up to two parts to fit to and one held out.
fn fold(runs: &[&Run], held_out: usize, error: ErrorSignal) -> Vec<Run> {
    let parts = |run: &&Run| {
        let cut = |block: usize| run.log.len() * block / BLOCKS;
        let (from, to) = (cut(held_out), cut(held_out + 1));
        [(0..from, Role::Fit), (from..to, Role::Validate), (to..run.log.len(), Role::Fit)]
            .into_iter()
            .filter(|(rows, _)| !rows.is_empty())
            .map(|(rows, role)| part(run, rows, role))
            // What is left of a part whose beginning is cut may be too little to fit to.
            .filter(|part| part.role == Role::Validate || error == ErrorSignal::Torque || is_left(part))
            .collect::<Vec<Run>>()
    };
    runs.iter().flat_map(parts).collect()
}

/// Whether a fit of positions sees enough of a part, or all.
fn is_left(part: &Run) -> bool {
    part.n_cut() == 0 || part.log.len() >= part.n_cut() + LEAST_SAMPLES
}

/// `last`, a fit with the last blocks of the runs held out, with what is left of all blocks in place of what it leaves of those:
/// each held out from a fit of its own, to one of `others`, the other folds.
///
/// # Errors
/// A fold that the model cannot be fitted to; `stop` says so.
pub(super) fn over_all(
    judge: &Judge<'_>,
    others: &[Vec<Run>],
    last: &Refit,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Refit, DiagnoseError> {
    let start = last.parsed()?;
    let mut compared: Vec<RunComparison> = Vec::new();
    let mut blocks: Vec<&Run> = Vec::new();
    for fold in others {
        let runs: Vec<&Run> = fold.iter().collect();
        let judge = Judge { runs: &runs, ..*judge };
        let model = match &last.candidate {
            // What could not be fitted to one fold is not fitted to another either.
            _ if last.was_given_up() => start.clone(),
            None => {
                let fit = judge.refit(None, &start, &start, CostLimits::default(), stop)?;
                if fit.was_given_up() { start.clone() } else { fit.parsed()? }
            }
            Some(_) => {
                let fitted = judge.fit(&start, Some(FOR_A_CANDIDATE), CostLimits::default(), stop)?;
                fitted.map_or_else(|| start.clone(), |(found, _)| found.model)
            }
        };
        let held_out = held_out(&runs);
        compared.extend(compare(&model, &held_out)?.runs);
        blocks.extend(held_out);
    }
    let held_out = held_out(judge.runs);
    compared.extend(compare(&start, &held_out)?.runs);
    blocks.extend(held_out);
    let comparison = Comparison::of(compared, &blocks);
    Ok(Refit {
        rmse_validate: comparison.rmse_validate,
        torque_percent_validate: comparison.torque_percent_validate,
        blocks: left(&comparison, &blocks, judge.error),
        ..last.clone()
    })
}

fn held_out<'a>(runs: &[&'a Run]) -> Vec<&'a Run> {
    runs.iter().copied().filter(|run| run.role == Role::Validate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_identify::position;
    use dynid_logs::{experiment::Experiment, experiment::Settings, log::Log};
    use dynid_user_model::Model;

    fn run(samples: usize) -> Run {
        let t: Vec<f64> = (0..samples).map(|k| 0.01 * k as f64).collect();
        let q: Vec<f64> = t.iter().map(|t| t.sin()).collect();
        let log = Log {
            tau: vec![q.clone()],
            q: vec![q],
            reference: None,
            mask: Some((0..samples).map(|k| k % 7 == 0).collect()),
            t,
        };
        let settings = Settings { from_s: Some(0.1), first_half: 0.5, ..Settings::default() };
        Run { file: "made.csv".to_owned(), role: Role::Fit, free: vec![0], configuration: 1, log, settings }
    }

    /// Every sample is held out by one fold and fitted to by the others, in order and with its own torque and mask.
    #[test]
    fn every_sample_is_held_out_once() {
        for samples in [400, 401, 402] {
            let (one, other) = (run(samples), run(samples - 100));
            let whole = [&one, &other];
            let mut held_out = vec![Vec::new(); 2];
            for block in 0..BLOCKS {
                let parts = fold(&whole, block, ErrorSignal::Position);
                let mut parts = parts.iter().peekable();
                for (of, run) in whole.iter().enumerate() {
                    let mut seen = 0;
                    while let Some(part) =
                        parts.next_if(|part| seen < run.log.len() && part.log.t[0] == run.log.t[seen])
                    {
                        let rows = seen..seen + part.log.len();
                        assert_eq!(part.log.t, run.log.t[rows.clone()]);
                        assert_eq!(part.log.tau[0], run.log.tau[0][rows.clone()]);
                        assert_eq!(part.log.mask.as_deref(), run.log.mask.as_ref().map(|mask| &mask[rows.clone()]));
                        assert_eq!(part.began_s(), run.log.t[0], "effects keep the run's time");
                        assert_eq!(part.label() == run.file, part.log.t[0] == run.log.t[0], "{}", part.label());
                        let is_first = seen == 0;
                        assert_eq!((part.settings.moving, part.settings.from_s.is_some()), (!is_first, is_first));
                        if part.role == Role::Validate {
                            held_out[of].extend_from_slice(&part.log.t);
                        }
                        seen = rows.end;
                    }
                    assert_eq!(seen, run.log.len(), "fold {block}");
                }
                assert!(parts.next().is_none(), "no part is left over");
            }
            assert_eq!(held_out, [one.log.t.clone(), other.log.t.clone()]);
        }
    }

    /// The cut at a run's beginning may reach into later blocks, and take one away whole.
    #[test]
    fn the_beginning_that_is_cut_is_cut_of_every_part() {
        let mut run = run(300);
        run.settings.from_s = Some(1.2);
        let reported = |block: usize| -> Vec<(f64, Role, usize)> {
            let parts = fold(&[&run], block, ErrorSignal::Position);
            parts.iter().map(|part| (part.log.t[0], part.role, part.n_cut())).collect()
        };
        assert_eq!(reported(0), [(0.0, Role::Validate, 100), (1.0, Role::Fit, 20)]);
        assert_eq!(reported(1), [(1.0, Role::Validate, 20), (2.0, Role::Fit, 0)]);
        assert_eq!(reported(2), [(0.0, Role::Fit, 120), (2.0, Role::Validate, 0)]);
    }

    /// What a model leaves whose fit was given up is counted over as many samples as what a fitted one leaves.
    #[test]
    fn a_model_as_it_is_is_judged_by_all_blocks() {
        let mut run = run(600);
        run.settings.min_speed = vec![0.0];
        let split = Split::of(&[&run], ErrorSignal::Position);
        let judged = split.judged(&[&run]);
        let device = dynid_model::device("servo_pendulum").unwrap();
        let experiment =
            Experiment { path: "made.toml".into(), device, runs: vec![run.clone()], digest: String::new() };
        let judge = Judge {
            error: ErrorSignal::Position,
            experiment: &experiment,
            runs: &judged,
            options: position::Options::default(),
        };
        let last = judge.as_it_is(&Model::of_device(device)).unwrap();
        assert!(last.was_given_up());
        let whole = over_all(&judge, &split.others, &last, &|| false).unwrap();
        let samples: f64 = whole.side(true).map(|left| left.samples).sum();
        assert_eq!(samples, 600.0 - run.n_cut() as f64);
        assert!(whole.was_given_up() && last.side(true).map(|left| left.samples).sum::<f64>() == 200.0);
    }
}
