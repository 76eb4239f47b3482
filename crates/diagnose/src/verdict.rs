//! From refits to an answer.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    Candidate, Diagnosis, Discovered, ErrorLeft, Evidence, Moved, Note, Place, Ranked, RejectedCandidate, Screened,
    Statement, Verdict,
    candidate::{is_symmetric, joined_link},
    refit::{JointResidual, Judge, Refit},
};
use crate::DiagnoseError;
use dynid_judge::{compare::Finding, compare::compare, compare::locate};
use dynid_logs::experiment::Run;
use dynid_user_model::Model;

/// Below this multiple of the noise at every joint nothing is missing, whatever pattern is left.
pub(super) const AT_THE_FLOOR: f64 = 1.05;
/// Below this multiple what is left is said to be near the noise.
const NEAR: f64 = 1.5;
/// As many places where the model fails are reported.
const PLACES: usize = 12;

/// One effect's search.
pub(super) struct Step {
    pub(super) verdict: Verdict,
    pub(super) base: Refit,
    pub(super) screening: Vec<Screened>,
    /// All that are worth their parameters, best first.
    pub(super) fitted: Vec<Judged>,
    /// Those that are not.
    pub(super) failed: Vec<RejectedCandidate>,
}

impl Step {
    /// The best.
    pub(super) fn best(&self) -> Option<&Refit> {
        self.fitted.first().map(|judged| &judged.refit)
    }
}

/// What explains the runs where no effect does.
pub(super) enum Otherwise {
    /// Nobody asked: one does, or nothing is left.
    NotAsked,
    /// Parameters that differ between runs which the model explains one by one, or those of a body that is carried in one.
    Moved(Vec<Moved>),
    /// Nothing: only the runs held out leave anything.
    HeldOut,
    /// A formula, if any is worth writing.
    Formula(Option<Discovered>),
}

/// A refit with what it is worth.
#[derive(Debug, Clone)]
pub(super) struct Judged {
    pub(super) refit: Refit,
    /// Those that the logs do not tell it from.
    pub(super) alike: Vec<Candidate>,
    pub(super) delta_bic: f64,
}

/// Whether a refit leaves nothing but noise at any joint that is judged; there must be one.
pub(super) fn reaches_the_floor(refit: &Refit) -> bool {
    /// The noise is estimated from each log, to some per cent: what is white is noise up to this multiple of it.
    const WHITE: f64 = 1.15;
    let is_noise =
        |left: &JointResidual| left.ratio().is_some_and(|ratio| ratio < if left.white { WHITE } else { AT_THE_FLOOR });
    refit.judged().all(is_noise) && refit.judged().next().is_some()
}

/// Squared error of the model without an effect. Where it cannot be simulated to the end of a run, a thousand times the
/// noise: any law that can be is then a gain.
fn without(base: &JointResidual) -> f64 {
    const FAR: f64 = 1e6;
    if base.squares.is_finite() { base.squares } else { FAR * base.noise_squares.unwrap_or(1.0) }
}

/// At the joint that a refit helps most: the joint, by what share its held-out squared error falls, and by what share of
/// what is above the noise.
pub(super) fn share(before: &Refit, after: &Refit) -> Option<(usize, f64, f64)> {
    after
        .judged()
        .filter_map(|own| {
            let base = before.judged().find(|left| left.joint == own.joint)?;
            let noise = base.noise_squares.unwrap_or(0.0);
            let squares = without(base);
            let gain = 1.0 - own.squares / squares.max(f64::MIN_POSITIVE);
            let excess = (squares - own.squares) / (squares - noise).max(f64::MIN_POSITIVE);
            Some((own.joint, gain, if squares > noise { excess } else { 0.0 }))
        })
        .max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Effects that fit as well as `best`.
fn confounded(best: &Judged) -> Vec<Candidate> {
    let own = best.refit.candidate.iter().flat_map(|own| equivalents(own, &best.refit));
    own.chain(best.alike.iter().cloned()).collect()
}

/// The same effect as `own`, told from its other end or by another joint that moves the link which it joins.
fn equivalents(own: &Candidate, refit: &Refit) -> Vec<Candidate> {
    let (Some(law), Some(joint)) = (own.law(), own.joint) else { return Vec::new() };
    match own.from {
        Some(from) if is_symmetric(law) => vec![Candidate { joint: Some(from), from: Some(joint), ..own.clone() }],
        None => {
            let Ok(model) = refit.parsed() else { return Vec::new() };
            let Some(link) = joined_link(&model, law, joint) else { return Vec::new() };
            let joints: BTreeSet<usize> = refit.left.iter().map(|left| left.joint).collect();
            let others = joints.into_iter().filter(|other| *other != joint);
            let same = others.filter(|other| joined_link(&model, law, *other) == Some(link));
            same.map(|other| Candidate { joint: Some(other), ..own.clone() }).collect()
        }
        Some(_) => Vec::new(),
    }
}

/// Puts the steps together.
///
/// # Errors
/// A run that cannot be compared with the model.
pub(super) fn conclude(
    judge: &Judge<'_>,
    runs: &[&Run],
    (first, otherwise): (&Refit, Otherwise),
    steps: Vec<Step>,
    notes: Vec<Note>,
) -> Result<Diagnosis, DiagnoseError> {
    let mut ranking: Vec<Ranked> = Vec::new();
    let mut rejected = Vec::new();
    let mut found: Vec<Ranked> = Vec::new();
    let mut better = None;
    for (index, step) in steps.iter().enumerate() {
        let ranked = step.fitted.iter().filter_map(|judged| ranked(step, judged, index + 1));
        let mut ranked: Vec<Ranked> = ranked.collect();
        if step.verdict == Verdict::MissingEffect && !ranked.is_empty() {
            found.push(ranked.remove(0));
            better = step.best().cloned();
        }
        if index == 0 {
            ranking = ranked;
            rejected.extend(step.failed.iter().cloned());
        }
    }
    let later = |other: &Ranked| found.iter().any(|found| found.candidate == other.candidate);
    ranking.retain(|ranked| !later(ranked));
    let base = first.parsed()?;
    let mut verdict = steps.first().map_or(Verdict::Unexplained, |step| step.verdict);
    let mut statements = statements(verdict, first, &found, &ranking, &steps);
    let (mut moved, mut discovered) = (Vec::new(), None);
    match otherwise {
        Otherwise::NotAsked => {}
        Otherwise::Moved(all) => {
            verdict = Verdict::NothingMissing;
            statements.truncate(1);
            statements.extend(all.first().cloned().map(|most| {
                let is_own = base.parameter(&most.parameter).is_some();
                if is_own { Statement::ValuesMoved { most } } else { Statement::BodyCarried { most } }
            }));
            moved = all;
        }
        Otherwise::HeldOut => {
            statements.truncate(1);
            statements.push(Statement::HeldOutRunsDiffer);
        }
        Otherwise::Formula(found) => {
            statements.push(found.as_ref().map_or(Statement::NoFormulaExplains, super::discover::statement));
            discovered = found;
        }
    }
    let mut models: BTreeMap<(usize, Candidate), Model> = BTreeMap::new();
    for (index, step) in steps.iter().enumerate() {
        for judged in &step.fitted {
            if let (Some(candidate), Ok(model)) = (&judged.refit.candidate, judged.refit.parsed()) {
                models.insert((index + 1, candidate.clone()), model);
            }
        }
    }
    for ranked in found.iter_mut().chain(ranking.iter_mut().take(1)) {
        let fitted = |candidate: &Candidate| models.get(&(ranked.depth, candidate.clone()));
        let others: Vec<(&Candidate, &Model)> =
            ranked.confounded_with.iter().filter_map(|candidate| Some((candidate, fitted(candidate)?))).collect();
        if let Some(own) = fitted(&ranked.candidate) {
            ranked.experiment = super::distinguishing_experiment::experiment(own, &others, judge.runs);
        }
    }
    ranking.splice(0..0, found);
    let comparison = compare(&base, runs)?;
    let places = places(locate(&base, runs, &comparison));
    let better = better.map(|better: Refit| better.parsed()).transpose()?;
    Ok(Diagnosis {
        verdict,
        statements,
        error: judge.shown.to_string(),
        ranking,
        rejected,
        screening: steps.into_iter().next().map(|step| step.screening).unwrap_or_default(),
        places,
        moved,
        notes,
        worst_ratio: first.worst_ratio().or(first.one_step),
        discovered,
        base: Some(base),
        better,
    })
}

/// Findings, the most telling first: what several runs say of a joint is reported once, of the run that says it most.
fn places(findings: Vec<Finding>) -> Vec<Place> {
    let mut reported: Vec<(Finding, Vec<String>)> = Vec::new();
    for finding in findings {
        match reported.iter_mut().find(|(other, _)| other.says_the_same(&finding)) {
            Some((first, also)) if first.run != finding.run && !also.contains(&finding.run) => also.push(finding.run),
            Some(_) => {}
            None => reported.push((finding, Vec::new())),
        }
    }
    reported.into_iter().take(PLACES).map(|(finding, also_in)| Place { finding, also_in }).collect()
}

fn ranked(step: &Step, judged: &Judged, depth: usize) -> Option<Ranked> {
    let (before, after) = (&step.base, &judged.refit);
    let candidate = after.candidate.clone()?;
    let mut evidence = Vec::new();
    if let Some((joint, gain, _)) = share(before, after) {
        evidence.push(Evidence::HeldOutFalls { joint, percent: 100.0 * gain });
    }
    evidence.push(Evidence::BicChanges { delta_bic: judged.delta_bic, unknowns: after.unknowns });
    evidence.extend(after.worst_ratio().map(|times_noise| match times_noise {
        ratio if ratio < NEAR => Evidence::LeavesNoise { times_noise },
        _ => Evidence::LeavesMore { times_noise },
    }));
    for own in after.parameters.iter().filter(|own| !own.identifiable) {
        evidence.push(Evidence::NotDetermined { parameter: own.name.clone() });
    }
    if !after.status.may_update_model() {
        evidence.push(Evidence::NotConverged { status: after.status });
    }
    Some(Ranked {
        rmse_validate_before: before.rmse_validate,
        rmse_validate_after: after.rmse_validate,
        torque_percent_before: before.torque_percent_validate,
        torque_percent_after: after.torque_percent_validate,
        delta_bic: judged.delta_bic,
        confounded_with: confounded(judged),
        parameters: after.parameters.clone(),
        evidence,
        experiment: None,
        depth,
        worst_ratio_after: after.worst_ratio().or(after.one_step),
        candidate,
    })
}

/// What is left at the worst joint, or of the torque where the noise is not known.
fn error_left(worst_ratio: Option<f64>, torque_percent: Option<f64>) -> ErrorLeft {
    match (worst_ratio, torque_percent) {
        (Some(times_noise), _) if times_noise < NEAR => ErrorLeft::NearNoise { times_noise },
        (Some(times_noise), _) => ErrorLeft::AboveNoise { times_noise },
        (None, Some(percent)) => ErrorLeft::OfTorque { percent },
        _ => ErrorLeft::Unknown,
    }
}

fn statements(verdict: Verdict, first: &Refit, found: &[Ranked], others: &[Ranked], steps: &[Step]) -> Vec<Statement> {
    let left = error_left(first.worst_ratio(), first.torque_percent_validate);
    let mut statements = vec![Statement::ModelLeaves { left }];
    match verdict {
        Verdict::NothingMissing if reaches_the_floor(first) || first.is_white() => {
            statements.push(Statement::OnlyNoise);
        }
        Verdict::NothingMissing => statements.push(Statement::NearNoise),
        Verdict::MissingEffect => {
            for ranked in found {
                let is_torque = first.worst_ratio().is_none();
                let ratio = ranked.worst_ratio_after.filter(|_| !is_torque);
                let left = error_left(ratio, ranked.torque_percent_after);
                statements.push(Statement::Missing { candidate: ranked.candidate.clone(), left });
                if !ranked.confounded_with.is_empty() {
                    statements.push(Statement::CouldAsWellBe { candidates: ranked.confounded_with.clone() });
                }
            }
            if let Some(last) = steps.last()
                && last.verdict == Verdict::Unexplained
            {
                statements.push(Statement::MoreIsUnexplained);
            }
        }
        Verdict::Unexplained => {
            statements.push(Statement::NoEffectExplains);
            let nearest = others.first().map(|nearest| nearest.candidate.clone());
            statements.extend(nearest.map(|candidate| Statement::Nearest { candidate }));
        }
    }
    statements
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_that_leaves_more_than_noise_is_said_not_to_be_the_whole_answer() {
        assert_eq!(error_left(Some(1.02), Some(9.0)), ErrorLeft::NearNoise { times_noise: 1.02 });
        assert_eq!(error_left(Some(1.49), None), ErrorLeft::NearNoise { times_noise: 1.49 });
        assert_eq!(error_left(Some(1.5), None), ErrorLeft::AboveNoise { times_noise: 1.5 });
        assert_eq!(error_left(Some(701.63), Some(9.0)), ErrorLeft::AboveNoise { times_noise: 701.63 });
        assert_eq!(error_left(None, Some(10.84)), ErrorLeft::OfTorque { percent: 10.84 }, "its noise is not known");
        assert_eq!(error_left(None, None), ErrorLeft::Unknown);
    }

    #[test]
    fn noise_is_what_is_low_or_low_and_white_at_every_joint() {
        let left = |joint: usize, ratio: f64, white: bool| JointResidual {
            joint,
            held_out: true,
            squares: ratio * ratio,
            samples: 100.0,
            noise_squares: Some(1.0),
            white,
        };
        let unknown = JointResidual { noise_squares: None, ..left(0, 0.5, true) };
        let cases = [
            (vec![left(0, 1.10, true)], true),
            (vec![left(0, 1.10, false)], false),
            (vec![left(0, 1.04, false)], true),
            (vec![left(0, 1.20, true)], false),
            (vec![unknown], false),
            (Vec::new(), false),
            (vec![left(0, 0.9, true), left(1, 1.3, true)], false),
        ];
        for (left, expected) in cases {
            let refit = Refit { left, ..crate::refit::tests::empty() };
            assert_eq!(reaches_the_floor(&refit), expected, "{:?}", refit.left);
        }
    }

    /// Both joints of the arm move its last link, of which a payload is a part.
    #[test]
    fn the_same_effect_may_have_another_name() {
        let left = |joint: usize| JointResidual {
            joint,
            held_out: true,
            squares: 1.0,
            samples: 100.0,
            noise_squares: Some(1.0),
            white: true,
        };
        let model = "device = \"planar2r\"\n".to_owned();
        let refit = Refit { model, left: vec![left(0), left(1)], ..crate::refit::tests::empty() };
        let at = |effect: &str, joint: usize, from: Option<usize>| Candidate {
            effect: effect.to_owned(),
            joint: Some(joint),
            from,
        };
        let others = |own: Candidate| equivalents(&own, &refit);
        assert_eq!(others(at("payload", 1, None)), [at("payload", 0, None)]);
        assert_eq!(others(at("rotor_coupling", 0, Some(1))), [at("rotor_coupling", 1, Some(0))]);
        assert_eq!(others(at("input_coupling", 0, Some(1))), [], "the torque of one is felt by the other");
        assert_eq!(others(at("viscous", 0, None)), []);
    }

    /// Squared errors of 400 and 128 before, where noise alone leaves 100 and 64.
    #[test]
    fn shares_are_of_the_error_and_of_what_of_it_is_above_the_noise() {
        let left = |joint: usize, squares: f64, noise_squares: f64| JointResidual {
            joint,
            held_out: true,
            squares,
            samples: 100.0,
            noise_squares: Some(noise_squares),
            white: false,
        };
        let refit = |left: Vec<JointResidual>| Refit { left, ..crate::refit::tests::empty() };
        let before = refit(vec![left(2, 400.0, 100.0), left(3, 128.0, 64.0)]);
        assert_eq!(share(&before, &refit(vec![left(2, 175.0, 100.0), left(3, 80.0, 64.0)])), Some((2, 0.5625, 0.75)));
        assert_eq!(share(&before, &refit(vec![left(2, 400.0, 100.0), left(3, 80.0, 64.0)])), Some((3, 0.375, 0.75)));
        assert_eq!(share(&before, &refit(vec![left(4, 1.0, 1.0)])), None, "a joint that was not judged before");
        let at_the_noise = refit(vec![left(2, 100.0, 100.0)]);
        assert_eq!(
            share(&at_the_noise, &refit(vec![left(2, 75.0, 100.0)])),
            Some((2, 0.25, 0.0)),
            "nothing is above it"
        );
        // Where the model cannot be simulated to the end, any that can be is a gain.
        let share = share(&refit(vec![left(2, f64::INFINITY, 100.0)]), &before).expect("a share");
        assert!(share.0 == 2 && share.1 > 0.99999 && share.2 > 0.99999, "{share:?}");
    }
}
