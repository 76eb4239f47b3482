//! Can these runs tell anything? Runs that are too short, and joints that do not move, are said before any fit; parameters
//! that the runs leave open are named after it.

use std::collections::BTreeSet;

use super::{Note, refit::Refit, runs};
use crate::{DiagnoseError, error::WhySoMany};
use dynid_check::{
    excitation::{MOVES, moves, parameters_at},
    identifiability::joint_of,
};
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion, motion::MotionError, part::LEAST_SAMPLES};
use dynid_user_model::Model;

/// What should be known of `runs` before the fit.
///
/// # Errors
/// A run is too short; no joint moves in any.
pub(super) fn check(model: &Model, runs: &[&Run]) -> Result<Vec<Note>, DiagnoseError> {
    let is_cut = runs::is_cut(runs);
    let n_parts = if is_cut { runs::PARTS } else { 1 };
    for run in runs {
        long_enough(run, n_parts * LEAST_SAMPLES, n_parts)?;
        enough_is_left(run, n_parts)?;
    }
    let mut notes = Vec::new();
    let whole = runs.iter().filter(|_| !is_cut);
    let mut without_motion: Vec<(&Run, MotionError)> =
        whole.filter_map(|run| Some((*run, Motion::of(run).err()?))).collect();
    without_motion.sort_by_key(|(run, _)| run.role);
    for (run, why) in without_motion {
        notes.push(match run.role {
            Role::Fit => Note::FittedWithoutTorqueError { reason: why },
            Role::Validate => Note::JudgedWithoutTorqueError { reason: why },
        });
    }
    notes.extend(judged_by_what_is_fitted(runs).filter(|_| !is_cut));
    let still: Vec<(&Run, usize)> = runs
        .iter()
        .flat_map(|run| run.free.iter().filter(|joint| !moves(run, **joint)).map(|joint| (*run, *joint)))
        .collect();
    if still.len() == runs.iter().map(|run| run.free.len()).sum::<usize>() {
        let mut joints: Vec<usize> = still.iter().map(|(_, joint)| *joint).collect();
        joints.sort_unstable();
        joints.dedup();
        return Err(DiagnoseError::NothingMoves {
            runs: runs.iter().map(|run| run.file.clone()).collect(),
            open: joints.iter().flat_map(|joint| parameters_at(model, *joint)).collect(),
        });
    }
    // A joint that moves in no run is reported with what is open after the fit.
    let moves_elsewhere = |joint: usize| runs.iter().any(|run| run.free.contains(&joint) && moves(run, joint));
    let still = still.into_iter().filter(|(_, joint)| moves_elsewhere(*joint));
    notes.extend(still.map(|(run, joint)| stands_still(model, run, joint)));
    Ok(notes)
}

/// Names the joints that are free in no held-out run.
fn judged_by_what_is_fitted(runs: &[&Run]) -> Option<Note> {
    let free_in = |role: Role| -> BTreeSet<usize> {
        runs.iter().filter(|run| run.role == role).flat_map(|run| run.free.iter().copied()).collect()
    };
    let joints: Vec<usize> = free_in(Role::Fit).difference(&free_in(Role::Validate)).copied().collect();
    (!joints.is_empty()).then_some(Note::NeverHeldOut { joints })
}

fn long_enough(run: &Run, needed: usize, n_parts: usize) -> Result<(), DiagnoseError> {
    if run.log.len() >= needed {
        return Ok(());
    }
    let because = if n_parts == 1 { WhySoMany::Plain } else { WhySoMany::Parts { parts: n_parts } };
    Err(too_short(run, needed, because))
}

/// `needed` samples are more than the run has.
fn too_short(run: &Run, needed: usize, because: WhySoMany) -> DiagnoseError {
    let (samples, step) = (run.log.len(), run.log.sample_time());
    DiagnoseError::TooShortToTell {
        run: run.file.clone(),
        samples,
        span_s: samples.saturating_sub(1) as f64 * step,
        needed,
        needed_s: needed as f64 * step,
        because,
    }
}

/// A fit must see enough of a run whose beginning is cut.
fn enough_is_left(run: &Run, n_parts: usize) -> Result<(), DiagnoseError> {
    let (samples, cut) = (run.log.len(), run.n_cut());
    let least = cut + LEAST_SAMPLES;
    // The last part is held out where there are some, as `runs::split` has it.
    let needed = if n_parts > 1 { (least * n_parts).div_ceil(n_parts - 1) } else { least };
    if cut == 0 || samples >= needed {
        return Ok(());
    }
    Err(too_short(run, needed, WhySoMany::Cut { samples: cut }))
}

fn stands_still(model: &Model, run: &Run, joint: usize) -> Note {
    let parameters = parameters_at(model, joint);
    Note::StandsStill { run: run.file.clone(), joint, range_in_noises: MOVES, parameters }
}

/// The unknowns that the runs leave open, as the fit `base` of `model` has it; `None` where they leave none.
///
/// An effect's parameter is left open where its joint moves in no run, where the fit does not depend on it by itself, or where
/// its standard error is above its value before and after and above its file's first guess (where that is 0, as of positions,
/// 0 is a value like any other, and none is small beside it). Links are reported by their number only: most of their parameters
/// never act but together.
pub(super) fn left_open(model: &Model, runs: &[&Run], base: &Refit) -> Option<Note> {
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
    let (links, others): (Vec<&super::EffectParameter>, Vec<&super::EffectParameter>) =
        base.parameters.iter().partition(|own| own.name.starts_with("link."));
    let names: Vec<String> = others.into_iter().filter(|own| is_open(own)).map(|own| own.name.clone()).collect();
    let links = links.into_iter().filter(|own| !own.identifiable).count();
    if names.is_empty() {
        return (links > 0).then_some(Note::LinksNotDetermined { links });
    }
    let mut joints: Vec<usize> = names.iter().filter_map(|name| joint_of(name)).collect();
    joints.sort_unstable();
    joints.dedup();
    Some(Note::NotDetermined { parameters: names, links, joints, still, range_in_noises: MOVES })
}

/// Size of what the effect's file begins with.
fn first_guess(model: &Model, name: &str) -> Option<f64> {
    model.effects.iter().find_map(|own| {
        let index = (0..own.parameters.len()).find(|index| own.parameter_name(*index) == name)?;
        Some(own.effect.parameters[index].initial.abs())
    })
}

#[cfg(test)]
mod tests {
    use dynid_logs::part::part;

    use super::*;
    use crate::EffectParameter;
    use crate::fixtures::{self, Oscillator};
    use crate::refit::tests::empty;

    /// So many samples.
    fn run(samples: usize, role: Role) -> Run {
        let run = Oscillator { stiffness: 1.0, cubic: 0.0 }.run(&[(0.02, 1.0)], 10.0, (role, 5));
        part(&run, 0..samples, role)
    }

    /// Samples that are needed, as it says, and why.
    fn too_short(runs: &[&Run]) -> Option<(usize, WhySoMany)> {
        match check(&fixtures::model(1.0, ""), runs) {
            Ok(_) => None,
            Err(DiagnoseError::TooShortToTell { needed, because, samples, span_s, needed_s, .. }) => {
                assert!((span_s - (samples - 1) as f64 * 0.01).abs() < 1e-9 && needed > samples);
                assert!((needed_s - needed as f64 * 0.01).abs() < 1e-9);
                Some((needed, because))
            }
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn a_pattern_needs_so_many_samples_of_each_run() {
        let held_out = run(64, Role::Validate);
        assert_eq!(too_short(&[&run(63, Role::Fit), &held_out]), Some((64, WhySoMany::Plain)));
        assert_eq!(too_short(&[&run(64, Role::Fit), &held_out]), None);
        // Where the last third is held out, three times as many.
        assert_eq!(too_short(&[&run(191, Role::Fit)]), Some((192, WhySoMany::Parts { parts: 3 })));
        assert_eq!(too_short(&[&run(192, Role::Fit)]), None);
    }

    #[test]
    fn what_is_cut_does_not_count() {
        let cut = |samples: usize, role: Role, from_s: f64| {
            let mut run = run(samples, role);
            run.settings.from_s = Some(from_s);
            run
        };
        let (held_out, because) = (run(64, Role::Validate), WhySoMany::Cut { samples: 50 });
        assert_eq!(too_short(&[&cut(113, Role::Fit, 0.495), &held_out]), Some((114, because)));
        assert_eq!(too_short(&[&cut(114, Role::Fit, 0.495), &held_out]), None);
        // Where the last third is held out, a fit sees the first two less what is cut: 204 of 306 less 140 are 64.
        let because = WhySoMany::Cut { samples: 140 };
        assert_eq!(too_short(&[&cut(305, Role::Fit, 1.395)]), Some((306, because)));
        assert_eq!(too_short(&[&cut(306, Role::Fit, 1.395)]), None);
        let parts = runs::split(&[&cut(306, Role::Fit, 1.395)]);
        assert_eq!(parts[0].log.len() - parts[0].n_cut(), 64);
    }

    #[test]
    fn joints_that_stand_still_or_are_never_held_out_are_named() {
        let model = fixtures::model(1.0, "");
        let moving = run(300, Role::Fit);
        let mut still = run(300, Role::Validate);
        still.log.q[0].fill(0.1);
        let notes = check(&model, &[&moving, &still]).expect("one of them moves");
        assert_eq!(notes, [stands_still(&model, &still, 0)]);
        let Note::StandsStill { parameters, .. } = &notes[0] else { panic!("{notes:?}") };
        assert!(parameters.contains(&"joint.0.spring.Ks".to_owned()), "{parameters:?}");
        let nothing = check(&model, &[&still]).expect_err("nothing moves");
        assert!(matches!(nothing, DiagnoseError::NothingMoves { .. }), "{nothing}");
        assert_eq!(judged_by_what_is_fitted(&[&moving, &still]), None);
        let mut other = run(300, Role::Validate);
        other.free = vec![1];
        assert_eq!(judged_by_what_is_fitted(&[&moving, &other]), Some(Note::NeverHeldOut { joints: vec![0] }));
    }

    /// What the fit does not depend on, what it knows no better than its guess, and what never moves; links by their number.
    #[test]
    fn what_is_left_open_is_named_after_the_fit() {
        let model = fixtures::model(1.0, "");
        let moving = run(300, Role::Fit);
        let own = |name: &str, value: f64, std_error: f64, identifiable: bool| EffectParameter {
            name: name.to_owned(),
            value,
            std_error: Some(std_error),
            at_bound: false,
            identifiable,
        };
        let open = |parameters: &[EffectParameter], run: &Run| {
            left_open(&model, &[run], &Refit { parameters: parameters.to_vec(), ..empty() })
        };
        let known = [own("joint.0.spring.Ks", 1.1, 0.9, true), own("joint.0.viscous.Fv", 0.006, 0.001, true)];
        assert_eq!(open(&known, &moving), None);
        let mut still = moving.clone();
        still.log.q[0].fill(0.1);
        let name = |note: Option<Note>| match note {
            Some(Note::NotDetermined { parameters, links, joints, still, .. }) => (parameters, links, joints, still),
            other => panic!("{other:?}"),
        };
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let all = names(&["joint.0.spring.Ks", "joint.0.viscous.Fv"]);
        assert_eq!(name(open(&known, &still)), (all, 0, vec![0], vec![0]));
        let link = own("link.1.m", 8e-4, 1e-5, false);
        assert_eq!(open(&[known[0].clone(), link.clone()], &moving), Some(Note::LinksNotDetermined { links: 1 }));
        let vague = [own("joint.0.spring.Ks", 1.1, 1.3, true), known[1].clone(), link];
        assert_eq!(name(open(&vague, &moving)), (names(&["joint.0.spring.Ks"]), 1, vec![0], vec![]));
        let free = [known[0].clone(), own("joint.0.viscous.Fv", 0.006, 0.001, false)];
        assert_eq!(name(open(&free, &moving)).0, names(&["joint.0.viscous.Fv"]));
        // A position of 0 is a value like any other.
        assert_eq!(open(&[own("joint.0.spring.qeq", 0.0, 10.0, true)], &moving), None);
    }
}
