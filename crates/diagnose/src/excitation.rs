//! Can these runs tell anything? Runs that are too short, and joints that do not move, are said before any fit; parameters
//! that the runs leave open are named after it.

use std::collections::BTreeSet;

use super::{blocks, refit::Refit};
use crate::DiagnoseError;
use dynid_identify::identify::ErrorKind;
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion, motion::MotionError, noise::noise_of_log};
use dynid_text::number;
use dynid_user_model::Model;

/// Samples in which a pattern is told from noise: `compare` says nothing of fewer either.
pub(super) const LEAST_SAMPLES: usize = 64;
/// A joint moves if its positions span so many times their noise.
const MOVES: f64 = 10.0;
/// As many parameters are named.
const NAMED: usize = 6;

/// What should be known of `runs`, of which `folds` are all that is fitted to or held out in turn, before the fit.
///
/// # Errors
/// A run is too short, or has no torque error where that is asked for; no joint moves in any.
pub(super) fn check(
    model: &Model,
    runs: &[&Run],
    folds: &[&[Run]],
    error: ErrorKind,
) -> Result<Vec<String>, DiagnoseError> {
    let n_blocks = if folds.is_empty() { 1 } else { blocks::BLOCKS };
    for run in runs {
        long_enough(run, n_blocks * LEAST_SAMPLES, n_blocks, None)?;
        if error != ErrorKind::Torque {
            enough_is_left(run, n_blocks)?;
        }
    }
    if error == ErrorKind::Torque {
        for part in folds.iter().copied().flatten() {
            // A block that is too short for its filter is reported as what the whole run would have to be.
            if let (Err(MotionError::TooShort { needed, cutoff_hz, .. }), Some(run)) =
                (Motion::of(part), runs.iter().find(|run| run.file == part.file))
            {
                long_enough(run, (n_blocks * needed).max(run.log.len() + 1), n_blocks, Some(cutoff_hz))?;
            }
        }
    }
    let mut notes = Vec::new();
    let whole = runs.iter().filter(|_| folds.is_empty());
    let mut without_motion: Vec<(&Run, MotionError)> =
        whole.filter_map(|run| Some((*run, Motion::of(run).err()?))).collect();
    without_motion.sort_by_key(|(run, _)| run.role);
    let held_out = runs.iter().filter(|run| run.role == Role::Validate).count();
    let some_held_out = held_out > without_motion.iter().filter(|(run, _)| run.role == Role::Validate).count();
    for (run, why) in without_motion {
        if error == ErrorKind::Torque && (run.role == Role::Fit || !some_held_out) {
            return Err(why.into());
        }
        let only = if run.role == Role::Fit { "; only simulations tell what a model of it lacks" } else { "" };
        notes.push(format!("no torque error: {why}{only}"));
    }
    notes.extend(judged_by_what_is_fitted(runs).filter(|_| folds.is_empty()));
    let still: Vec<(&Run, usize)> = runs
        .iter()
        .flat_map(|run| run.free.iter().filter(|joint| !moves(run, **joint)).map(|joint| (*run, *joint)))
        .collect();
    if still.len() == runs.iter().map(|run| run.free.len()).sum::<usize>() {
        let mut joints: Vec<usize> = still.iter().map(|(_, joint)| *joint).collect();
        joints.sort_unstable();
        joints.dedup();
        let names: Vec<String> = joints.iter().flat_map(|joint| parameters_at(model, *joint)).collect();
        return Err(DiagnoseError::NothingMoves {
            runs: listed(&runs.iter().map(|run| run.file.clone()).collect::<Vec<_>>()),
            open: if names.is_empty() { String::new() } else { format!(", nor of {}", listed(&names)) },
        });
    }
    // A joint that moves in no run is reported with what is open after the fit.
    let moves_elsewhere = |joint: usize| runs.iter().any(|run| run.free.contains(&joint) && moves(run, joint));
    let still = still.into_iter().filter(|(_, joint)| moves_elsewhere(*joint));
    notes.extend(still.map(|(run, joint)| stands_still(model, run, joint)));
    Ok(notes)
}

/// Names the joints that are free in no held-out run.
fn judged_by_what_is_fitted(runs: &[&Run]) -> Option<String> {
    let free_in = |role: Role| -> BTreeSet<usize> {
        runs.iter().filter(|run| run.role == role).flat_map(|run| run.free.iter().copied()).collect()
    };
    let only_fitted: Vec<String> =
        free_in(Role::Fit).difference(&free_in(Role::Validate)).map(|joint| format!("joint {joint}")).collect();
    let names = only_fitted.join(", ");
    (!only_fitted.is_empty())
        .then(|| format!("{names}: free in no held-out run, so judged by the runs that are fitted to"))
}

fn long_enough(run: &Run, needed: usize, n_blocks: usize, cutoff_hz: Option<f64>) -> Result<(), DiagnoseError> {
    let samples = run.log.len();
    if samples >= needed {
        return Ok(());
    }
    let blocks = format!(", since no run is held out and each is cut into {n_blocks} blocks");
    let because = match (n_blocks, cutoff_hz) {
        (1, _) => String::new(),
        (_, None) => blocks,
        (_, Some(cutoff_hz)) => format!("{blocks} that a filter of {cutoff_hz} Hz must fit into (cutoff_hz)"),
    };
    Err(too_short(run, needed, because))
}

/// `needed` samples are more than the run has.
fn too_short(run: &Run, needed: usize, because: String) -> DiagnoseError {
    let (samples, step) = (run.log.len(), run.log.sample_time());
    DiagnoseError::TooShortToTell {
        run: run.file.clone(),
        samples,
        span_s: number(samples.saturating_sub(1) as f64 * step),
        needed,
        needed_s: number(needed as f64 * step),
        because,
    }
}

/// A fit must see enough of a run whose beginning is cut.
fn enough_is_left(run: &Run, n_blocks: usize) -> Result<(), DiagnoseError> {
    let (samples, cut) = (run.log.len(), run.n_cut());
    // The last block is held out where there are some.
    let seen = if n_blocks > 1 { samples - samples / n_blocks } else { samples };
    if cut == 0 || seen >= cut + LEAST_SAMPLES {
        return Ok(());
    }
    let needed = samples + cut + LEAST_SAMPLES - seen;
    Err(too_short(run, needed, format!(", since from_s cuts {cut} of its samples")))
}

/// Whether a joint moves in a run by more than noise.
pub(super) fn moves(run: &Run, joint: usize) -> bool {
    let q = &run.log.q[joint];
    let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(*q), high.max(*q)));
    // Not `>=`: what never changes has no noise either.
    high - low > MOVES * noise_of_log(q)
}

fn stands_still(model: &Model, run: &Run, joint: usize) -> String {
    let names = parameters_at(model, joint);
    let open = if names.is_empty() { String::new() } else { format!(", so it tells little of {}", listed(&names)) };
    format!("{}: joint {joint} is free but stays within {MOVES:.0} times its noise{open}", run.file)
}

/// The unknown parameters of the effects at a joint.
fn parameters_at(model: &Model, joint: usize) -> Vec<String> {
    let parameters = model.parameters().into_iter();
    let unknown = parameters.filter(|(name, parameter)| !parameter.fixed && joint_of(name) == Some(joint));
    unknown.map(|(name, _)| name).collect()
}

/// The unknowns that the runs leave open, as the fit `base` of `model` has it; `None` where they leave none.
///
/// An effect's parameter is left open where its joint moves in no run, where the fit does not depend on it by itself, or where
/// its standard error is above its value before and after and above its file's first guess (where that is 0, as of positions,
/// 0 is a value like any other, and none is small beside it). Links are reported by their number only: most of their parameters
/// never act but together.
pub(super) fn left_open(model: &Model, runs: &[&Run], base: &Refit) -> Option<String> {
    let stands_still = |joint: &usize| {
        let mut free = runs.iter().filter(|run| run.free.contains(joint)).peekable();
        free.peek().is_some() && free.all(|run| !moves(run, *joint))
    };
    let still: Vec<usize> = (0..model.device.joints.len()).filter(stands_still).collect();
    let is_open = |own: &super::EffectParameter| {
        let started = model.parameter(&own.name).map_or(0.0, |parameter| parameter.value.abs());
        let guess = first_guess(model, &own.name).filter(|guess| *guess > 0.0);
        let size = guess.map(|guess| guess.max(started).max(own.value.abs()));
        joint_of(&own.name).is_some_and(|joint| still.contains(&joint))
            || !own.identifiable
            || own.std_error.zip(size).is_some_and(|(error, size)| error > size)
    };
    let as_given = |(name, parameter): (String, dynid_model::Parameter)| super::EffectParameter {
        name,
        value: parameter.value,
        std_error: None,
        at_bound: false,
        identifiable: true,
    };
    let unfitted: Vec<super::EffectParameter> = match base.was_given_up() {
        true => model.parameters().into_iter().filter(|(_, parameter)| !parameter.fixed).map(as_given).collect(),
        false => Vec::new(),
    };
    let (links, others): (Vec<&super::EffectParameter>, Vec<&super::EffectParameter>) =
        base.parameters.iter().chain(&unfitted).partition(|own| own.name.starts_with("link."));
    let names: Vec<String> = others.into_iter().filter(|own| is_open(own)).map(|own| own.name.clone()).collect();
    let links = links.into_iter().filter(|own| !own.identifiable).count();
    let of_links = match links {
        0 => String::new(),
        1 => "one parameter of the links by itself".to_owned(),
        links => format!("{links} parameters of the links by themselves"),
    };
    if names.is_empty() {
        return (links > 0).then(|| {
            format!(
                "these runs do not determine {of_links}, only in combinations: `dynid plan` says which can be identified"
            )
        });
    }
    let and = if links > 0 { format!(", nor {of_links}") } else { String::new() };
    let mut joints: Vec<usize> = names.iter().filter_map(|name| joint_of(name)).collect();
    joints.sort_unstable();
    joints.dedup();
    let numbered = |joints: &[usize]| {
        let numbers: Vec<String> = joints.iter().map(usize::to_string).collect();
        format!("{} {}", if joints.len() == 1 { "joint" } else { "joints" }, numbers.join(", "))
    };
    let why = if still.is_empty() {
        String::new()
    } else {
        let stay = if still.len() == 1 { "stays" } else { "stay" };
        format!("{} {stay} within {MOVES:.0} times the noise in every run; ", numbered(&still))
    };
    let what = if joints.is_empty() { "the joints".to_owned() } else { numbered(&joints) };
    Some(format!(
        "these runs do not determine {}{and}: {why}excite {what} more, both ways, slowly and fast, over more of the range \
         (`dynid excite`)",
        listed(&names)
    ))
}

/// Size of what the effect's file begins with.
fn first_guess(model: &Model, name: &str) -> Option<f64> {
    model.effects.iter().find_map(|own| {
        let index = (0..own.parameters.len()).find(|index| own.parameter_name(*index) == name)?;
        Some(own.effect.parameters[index].initial.abs())
    })
}

/// The joint that an effect's parameter belongs to.
fn joint_of(name: &str) -> Option<usize> {
    name.strip_prefix("joint.")?.split('.').next()?.parse().ok()
}

/// The first few, and how many more.
fn listed(names: &[String]) -> String {
    let shown = names.iter().take(NAMED).cloned().collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(NAMED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
