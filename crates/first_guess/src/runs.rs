//! The logs as runs: in SI, which begin in motion, which are held out.

use std::ops::Range;
use std::path::Path;

use dynid_logs::experiment::{Role, Run, Settings};
use dynid_logs::log::{self, LogFormat, Repeated};
use dynid_logs::noise::noise_of_log;
use dynid_logs::part::LEAST_SAMPLES;
use dynid_model::Device;

use crate::guess::{RoleReason, RunGuess, WhyFree};
use crate::names::words;
use crate::table::Table;
use crate::{FirstGuess, FirstGuessError};

/// Reads the logs as an experiment of this guess would.
pub(crate) fn read(
    device: &'static Device,
    tables: &[Table],
    guess: &FirstGuess,
    free: &[Vec<usize>],
) -> Result<Vec<Run>, FirstGuessError> {
    let n_joints = device.joints.len();
    let read = |(table, free): (&Table, &Vec<usize>)| {
        let of = |number: &dyn Fn(&crate::ColumnGuess) -> Option<f64>| {
            let numbers = guess.columns.iter().filter_map(|own| Some((own.logical.clone(), number(own)?)));
            numbers.collect::<Vec<_>>()
        };
        let format = LogFormat {
            transmission: None,
            n_joints,
            free: free.clone(),
            columns: guess.columns.iter().map(|own| (own.logical.clone(), own.name.clone())).collect(),
            scale: of(&|own| Some(own.scale())),
            turn: of(&|own| own.turn),
            repeated: if guess.repeats_times { Repeated::Skip } else { Repeated::Refuse },
            rows: None,
            mask: guess.mask.clone(),
            start: None,
            has_controller: false,
        };
        Ok(Run {
            payload: None,
            file: table.name(),
            role: Role::Fit,
            configuration: device.configuration_of(free).unwrap_or(device.configurations.len() + 1),
            free: free.clone(),
            log: log::read(&table.path, &format)?,
            settings: Settings { min_speed: vec![0.0; n_joints], ..Settings::default() },
        })
    };
    tables.iter().zip(free).map(read).collect()
}

/// What each run is for.
pub(crate) fn guess(tables: &[Table], runs: &[Run], why_free: WhyFree) -> Vec<RunGuess> {
    let whole = |log: usize, role: Role, why: RoleReason| {
        of_part((log, &runs[log]), None, 0..runs[log].log.len(), (role, why), why_free)
    };
    if let [run] = runs {
        let n_rows = tables[0].columns[0].len();
        let from = n_rows - n_rows / 4;
        let sample = run.log.len() * from / n_rows;
        if !is_worth_parting(run, sample) {
            return vec![whole(0, Role::Fit, RoleReason::NothingToHoldOut)];
        }
        let part = |rows, samples, role, why| of_part((0, run), Some(rows), samples, (role, why), why_free);
        return vec![
            part([0, from], 0..sample, Role::Fit, RoleReason::Rest),
            part([from, n_rows], sample..run.log.len(), Role::Validate, RoleReason::LastQuarter),
        ];
    }
    let named: Vec<Option<(Role, String)>> = tables.iter().map(|table| named_role(&table.path)).collect();
    let is_held_out = |role: &Option<(Role, String)>| role.as_ref().is_some_and(|(role, _)| *role == Role::Validate);
    let n_named = named.iter().filter(|role| is_held_out(role)).count();
    let by_name = n_named > 0 && n_named < runs.len();
    let last = if by_name { Vec::new() } else { last_fifth(runs) };
    let role = |log: usize| match &named[log] {
        Some((role, word)) if by_name => (*role, RoleReason::Name { word: word.clone() }),
        _ if last.contains(&log) => (Role::Validate, RoleReason::Last),
        _ if !by_name && last.is_empty() => (Role::Fit, RoleReason::NothingToHoldOut),
        _ => (Role::Fit, RoleReason::Rest),
    };
    (0..runs.len())
        .map(|log| {
            let (role, why) = role(log);
            whole(log, role, why)
        })
        .collect()
}

/// The samples of a log that stand in these rows.
fn of_part(
    (log, run): (usize, &Run),
    rows: Option<[usize; 2]>,
    samples: Range<usize>,
    (role, why): (Role, RoleReason),
    why_free: WhyFree,
) -> RunGuess {
    let t = &run.log.t;
    let moving =
        run.free.iter().any(|&joint| begins_in_motion(&t[samples.clone()], &run.log.q[joint][samples.clone()]));
    let duration_s = t[samples.end - 1] - t[samples.start];
    let rate_hz = 1.0 / run.log.sample_time();
    RunGuess {
        log,
        rows,
        free: run.free.clone(),
        why_free,
        role,
        why,
        moving,
        n_samples: samples.len(),
        duration_s,
        rate_hz,
    }
}

/// What the name of a file says of its use.
fn named_role(path: &Path) -> Option<(Role, String)> {
    const HELD_OUT: [&str; 8] =
        ["test", "val", "valid", "validate", "validation", "verification", "heldout", "holdout"];
    const FOR_FIT: [&str; 5] = ["train", "training", "fit", "ident", "identification"];
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let find = |role, known: &[&str]| {
        let word = words(&stem).into_iter().find(|word| known.contains(&word.as_str()));
        word.map(|word| (role, word))
    };
    find(Role::Validate, &HELD_OUT).or_else(|| find(Role::Fit, &FOR_FIT))
}

/// Of the runs with the same free joints the last ones, about a fifth. Where all have others free, the last one whose joints
/// the rest frees as well.
fn last_fifth(runs: &[Run]) -> Vec<usize> {
    let mut held_out: Vec<usize> = Vec::new();
    for (log, run) in runs.iter().enumerate() {
        let alike: Vec<usize> = (0..runs.len()).filter(|other| runs[*other].free == run.free).collect();
        let wanted = if alike.len() > 1 { (alike.len() / 5).max(1) } else { 0 };
        if alike[alike.len() - wanted..].contains(&log) {
            held_out.push(log);
        }
    }
    if held_out.is_empty() {
        let is_freed_elsewhere =
            |log: usize, joint: &usize| (0..runs.len()).any(|other| other != log && runs[other].free.contains(joint));
        let last =
            (0..runs.len()).rev().find(|log| runs[*log].free.iter().all(|joint| is_freed_elsewhere(*log, joint)));
        held_out.extend(last);
    }
    held_out
}

/// Whether both parts are long enough, and every free joint moves in both by a share of its whole motion.
fn is_worth_parting(run: &Run, at: usize) -> bool {
    const SHARE: f64 = 0.2;
    let range = |q: &[f64]| {
        q.iter().copied().fold(f64::NEG_INFINITY, f64::max) - q.iter().copied().fold(f64::INFINITY, f64::min)
    };
    let moves = |joint: &usize| {
        let q = &run.log.q[*joint];
        range(&q[at..]).min(range(&q[..at])) > SHARE * range(q)
    };
    run.log.len() - at >= LEAST_SAMPLES && at >= LEAST_SAMPLES && run.free.iter().all(moves)
}

/// Whether a position changes from the first sample on: the slope at the beginning of the cubic through the means of four
/// blocks, `(-71 a + 141 b - 93 c + 23 d) / (24 h)` for blocks `h` apart, against its noise and the speed of the whole. A
/// motion from rest, by a torque that begins as a straight line, has none.
fn begins_in_motion(t: &[f64], q: &[f64]) -> bool {
    /// A block's length (s), and in samples at least.
    const BLOCK_S: f64 = 0.01;
    const LEAST: usize = 2;
    const WEIGHTS: [f64; 4] = [-71.0 / 24.0, 141.0 / 24.0, -93.0 / 24.0, 23.0 / 24.0];
    /// The slope must exceed so many of its standard deviations, and this share of the typical speed.
    const SURE: f64 = 6.0;
    const SHARE: f64 = 0.1;
    let step = dynid_signal::median_step(t);
    let block = ((BLOCK_S / step) as usize).max(LEAST);
    if q.len() < 8 * block {
        return false;
    }
    let h = block as f64 * step;
    let mean = |block: &[f64]| block.iter().sum::<f64>() / block.len() as f64;
    let slope = q.chunks(block).zip(WEIGHTS).map(|(block, weight)| weight * mean(block)).sum::<f64>() / h;
    let size = WEIGHTS.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
    let noise = noise_of_log(q) * size / (block as f64).sqrt() / h;
    let speeds: Vec<f64> = (0..q.len() - block).step_by(block).map(|k| (q[k + block] - q[k]) / h).collect();
    let typical = (speeds.iter().map(|speed| speed * speed).sum::<f64>() / speeds.len() as f64).sqrt();
    slope.abs() > SURE * noise && slope.abs() > SHARE * typical
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_a_run_is_for() {
        let role = |name: &str| named_role(Path::new(name)).map(|(role, _)| role);
        assert_eq!(role("logs/arm_fast2_test.csv"), Some(Role::Validate));
        assert_eq!(role("verification.csv"), Some(Role::Validate));
        assert_eq!(role("train-3.csv"), Some(Role::Fit));
        assert_eq!(role("latest.csv"), None, "a part of a word is no word");
    }

    #[test]
    fn a_motion_that_begins_is_told_from_one_that_goes_on() {
        let t: Vec<f64> = (0..1000).map(|k| 0.005 * f64::from(k)).collect();
        let swing = |phase: f64| -> Vec<f64> { t.iter().map(|t| 0.3 * (5.0 * t + phase).sin()).collect() };
        assert!(begins_in_motion(&t, &swing(0.0)), "at full speed");
        assert!(!begins_in_motion(&t, &swing(0.5 * std::f64::consts::PI)), "at a turning point");
        let pushed: Vec<f64> = t.iter().map(|t| 2.0 * t * t + 5.0 * t.powi(3)).collect();
        assert!(!begins_in_motion(&t, &pushed), "from rest, by a torque that rises");
    }
}
