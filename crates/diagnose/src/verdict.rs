//! From refits to an answer.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    Candidate, Diagnosis, ErrorLeft, Evidence, JointResidual, ModelState, Note, Place, Ranked, Refit,
    RejectedCandidate, Rejection, SearchExtent, Statement, Step, Verdict, Work,
    candidate::{is_symmetric, joined_link},
};
use crate::DiagnoseError;
use dynid_identify::identify::ErrorSignal;
use dynid_judge::{compare::Finding, compare::compare, compare::locate};
use dynid_user_model::Model;

/// Below this multiple of the noise at every joint nothing is missing, whatever pattern is left.
const AT_THE_FLOOR: f64 = 1.05;
/// Cost per sample and joint of a fit that leaves nothing but noise.
pub(super) const COST_AT_THE_FLOOR: f64 = 0.5 * AT_THE_FLOOR * AT_THE_FLOOR;
/// Below this multiple nothing is missing if what is left is white.
pub(super) const NEAR_THE_FLOOR: f64 = 1.5;
/// An effect explains what was left if no joint's error is above this multiple of its noise with it.
const EXPLAINED: f64 = 1.5;
/// Where noise is not reached, an effect is named if it explains this share of the squared error above the noise at the
/// joint that it helps most.
const SHARE_OF_POSITION: f64 = 0.95;
/// The same of the torque error, whose noise is not known.
const SHARE_OF_TORQUE: f64 = 0.3;
/// An effect is worth its parameters below this change of the information criterion.
const WORTH: f64 = -20.0;
/// The held-out error must fall by at least this share.
const LEAST_GAIN: f64 = 0.01;
/// As many places where the model fails are reported.
const PLACES: usize = 12;
/// Held-out log-likelihoods that differ by less are the same.
const SAME: f64 = 8.0;

/// A refit with what it is worth.
#[derive(Debug, Clone)]
pub(super) struct Judged {
    pub(super) refit: Refit,
    /// `sum n_eff ln(after / before)` of the held-out runs.
    pub(super) held_out: f64,
    pub(super) delta_bic: f64,
    /// Why it is given no credit.
    pub(super) reason: Option<Rejection>,
}

impl Judged {
    /// Held-out error and parsimony in one number: lower is better.
    fn rank(&self) -> f64 {
        /// What an unknown must gain on held-out data to be worth having.
        const PER_UNKNOWN: f64 = 3.0;
        self.held_out + PER_UNKNOWN * self.refit.unknowns
    }

    /// Without credit, since others were better by one fold and only those were judged by all blocks.
    pub(super) fn unconfirmed(self) -> Self {
        Self { reason: Some(Rejection::NotConfirmed { confirmed: super::blocks::CONFIRMED }), ..self }
    }
}

/// Whether a search, which was short, came to what noise costs per sample.
pub(super) fn is_nearly_noise(cost: f64) -> bool {
    /// So many times as much.
    const NEARLY: f64 = 1.5;
    cost <= NEARLY * COST_AT_THE_FLOOR
}

/// Whether a refit leaves nothing but noise at any joint that is judged; there must be one.
pub(super) fn reaches_the_floor(refit: &Refit) -> bool {
    /// The noise is estimated from each log, to some per cent: what is white is noise up to this multiple of it.
    const WHITE: f64 = 1.15;
    let is_noise =
        |left: &JointResidual| left.ratio().is_some_and(|ratio| ratio < if left.white { WHITE } else { AT_THE_FLOOR });
    refit.judged().all(is_noise) && refit.judged().next().is_some()
}

/// Whether a refit explains what was left.
pub(super) fn explains(refit: &Refit) -> bool {
    refit.worst_ratio().is_some_and(|ratio| ratio < EXPLAINED)
}

/// The best of those that may be given credit.
pub(super) fn best(judged: &[Judged]) -> Option<&Refit> {
    judged.iter().find(|judged| judged.reason.is_none()).map(|judged| &judged.refit)
}

/// Of those that leave nothing but white noise the one with the fewest unknowns.
pub(super) fn plainest_noise(fitted: &[Refit]) -> Option<&Refit> {
    let noise = fitted.iter().filter(|refit| reaches_the_floor(refit) && refit.is_white());
    noise.min_by(|a, b| a.unknowns.total_cmp(&b.unknowns))
}

/// Sum over the joints of `n_eff ln(after / before)`, and of `n_eff`.
fn gain<'a>(
    before: impl Iterator<Item = &'a JointResidual>,
    after: impl Iterator<Item = &'a JointResidual>,
    correlations: &BTreeMap<usize, f64>,
) -> (f64, f64) {
    let (mut gain, mut independent) = (0.0, 0.0);
    let before: Vec<&JointResidual> = before.collect();
    for own in after {
        let Some(base) = before.iter().find(|left| left.joint == own.joint) else { continue };
        let count = own.samples / correlations.get(&own.joint).copied().unwrap_or(1.0).max(1.0);
        independent += count;
        gain += count * (own.squares.max(f64::MIN_POSITIVE) / without(base).max(f64::MIN_POSITIVE)).ln();
    }
    (gain, independent)
}

/// Judges refits against the model without them, best first; those given no credit last.
pub(super) fn judge(
    before: &Refit,
    fitted: Vec<Refit>,
    helps_elsewhere: &dyn Fn(&Refit) -> Option<Rejection>,
) -> Vec<Judged> {
    // Independent samples are counted once, by what the best leaves.
    let pooled =
        |refit: &Refit| refit.judged().map(|left| left.samples * left.squares.max(f64::MIN_POSITIVE).ln()).sum::<f64>();
    let finite = fitted.iter().filter(|refit| refit.is_finite());
    let best = finite.min_by(|a, b| pooled(a).total_cmp(&pooled(b)));
    let correlations: BTreeMap<usize, f64> =
        best.map(|best| best.judged().map(|left| (left.joint, left.correlation)).collect()).unwrap_or_default();
    let mut judged: Vec<Judged> = fitted
        .into_iter()
        .map(|refit| {
            let (held_out, _) = gain(before.judged(), refit.judged(), &correlations);
            let (fit, independent) = gain(before.side(false), refit.side(false), &correlations);
            let delta_bic = fit + refit.unknowns * independent.max(2.0).ln();
            let reason = rejection(before, &refit, delta_bic).or_else(|| helps_elsewhere(&refit));
            Judged { refit, held_out, delta_bic, reason }
        })
        .collect();
    // Held-out errors of laws that all leave nothing but noise differ by chance.
    let key = |judged: &Judged| {
        let is_noise = reaches_the_floor(&judged.refit);
        (judged.reason.is_some(), !is_noise, if is_noise { judged.delta_bic } else { judged.rank() })
    };
    judged.sort_by(|a, b| {
        let (one, other) = (key(a), key(b));
        (one.0, one.1)
            .cmp(&(other.0, other.1))
            .then(one.2.total_cmp(&other.2))
            .then(a.refit.candidate.cmp(&b.refit.candidate))
    });
    plainest_first(&mut judged);
    judged
}

/// A candidate whose fit came to nothing.
pub(super) fn failed(candidate: &Candidate, error: &DiagnoseError) -> RejectedCandidate {
    let reason = match error.interrupted_after() {
        Some(iterations) => Rejection::GivenUp { iterations },
        None => Rejection::FitFailed { error: error.to_string() },
    };
    RejectedCandidate { candidate: candidate.clone(), reason }
}

/// Where the noise is not known, of laws that are as good as the best at its joint the plainest comes first: the one with the
/// fewest unknowns and signals.
fn plainest_first(judged: &mut [Judged]) {
    let credited = judged.iter().take_while(|judged| judged.reason.is_none()).count();
    let Some(best) = judged.first().filter(|_| credited > 0).cloned() else { return };
    let plainness = |judged: &Judged| {
        let law = judged.refit.candidate.as_ref().and_then(Candidate::law);
        let signals = law.map_or(0, dynid_model::Effect::n_signals);
        judged.refit.unknowns + signals as f64
    };
    let plainest = (0..credited)
        .filter(|index| as_good(&judged[*index], &best))
        .min_by(|a, b| plainness(&judged[*a]).total_cmp(&plainness(&judged[*b])).then(a.cmp(b)));
    if let Some(index) = plainest {
        judged[..=index].rotate_right(1);
    }
}

/// Whether a law leaves about as much as another at the joint of both, on the runs fitted to and on those held out. Models of
/// real machines are wrong in many small ways, which decide smaller differences.
fn as_good(own: &Judged, best: &Judged) -> bool {
    /// Of the root mean square held out, with the change of the criterion that goes with it: the closer the runs fitted to
    /// are, the farther those held out may be.
    const ABOUT: [(f64, f64); 2] = [(1.25, 25.0), (1.5, 10.0)];
    let (Some(one), Some(other)) = (&own.refit.candidate, &best.refit.candidate) else { return false };
    if one == other {
        return true;
    }
    let squares = |judged: &Judged| {
        judged
            .refit
            .judged()
            .find(|left| Some(left.joint) == other.joint && left.noise_squares.is_none())
            .map(|left| left.squares)
    };
    let (Some(left), Some(least)) = (squares(own), squares(best)) else { return false };
    let about = |(share, bic): (f64, f64)| left <= share * share * least && own.delta_bic <= best.delta_bic + bic;
    one.joint == other.joint && ABOUT.into_iter().any(about)
}

/// Why a refit is given no credit.
fn rejection(before: &Refit, refit: &Refit, delta_bic: f64) -> Option<Rejection> {
    let evaluated =
        |held_out: bool| before.side(held_out).all(|left| refit.side(held_out).any(|own| own.joint == left.joint));
    if !refit.is_finite() || !evaluated(false) || !evaluated(true) {
        return Some(Rejection::CannotBeEvaluated);
    }
    if let Some(parameter) = refit.parameters.iter().find(|parameter| parameter.at_bound) {
        return Some(Rejection::AtBound { parameter: parameter.name.clone(), value: parameter.value });
    }
    if delta_bic > WORTH {
        return Some(Rejection::NotWorthItsParameters { delta_bic });
    }
    let best = share(before, refit).map_or(0.0, |(_, gain, _)| gain);
    if best < LEAST_GAIN {
        return Some(Rejection::NoHeldOutGain { percent: 100.0 * best.max(0.0) });
    }
    None
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

/// Whether a refit takes nearly all away at a joint, and what is left is at others: that is another effect's matter, and more
/// than a model's fit that was cut short might still have gained.
fn clears_its_joint(before: &Refit, after: &Refit) -> bool {
    /// Share of the squared error above the noise.
    const NEARLY_ALL: f64 = 0.999;
    /// What is left there, as a share of what is left at the worst joint.
    const LITTLE: f64 = 0.1;
    let Some((joint, _, excess)) = share(before, after) else { return false };
    let own = after.judged().find(|left| left.joint == joint).and_then(JointResidual::ratio);
    let is_little = own.zip(after.worst_ratio()).is_some_and(|(own, worst)| own < LITTLE * worst);
    excess >= NEARLY_ALL && is_little
}

/// The joint that a refit helps most.
pub(super) fn helped_joint(before: &Refit, after: &Refit) -> Option<usize> {
    share(before, after).map(|(joint, ..)| joint)
}

/// The answer of one step.
pub(super) fn of(before: &Refit, fitted: &[Judged]) -> Verdict {
    let near_floor = before.worst_ratio().is_some_and(|ratio| ratio < NEAR_THE_FLOOR);
    let Some(best) = best(fitted) else {
        return if near_floor { Verdict::NothingMissing } else { Verdict::Unexplained };
    };
    let least = if before.worst_ratio().is_some() { SHARE_OF_POSITION } else { SHARE_OF_TORQUE };
    let explains_much = share(before, best).is_some_and(|(.., excess)| excess >= least);
    // Where little is left, little is no news; and what more iterations of the model's own fit might have gained is no
    // effect's merit.
    let explained = match (near_floor, before.is_minimum()) {
        (true, _) => explains_much || reaches_the_floor(best),
        (false, true) => explains_much || explains(best),
        (false, false) => explains(best) || clears_its_joint(before, best),
    };
    match (explained, near_floor) {
        (true, _) => Verdict::MissingEffect,
        (false, true) => Verdict::NothingMissing,
        (false, false) => Verdict::Unexplained,
    }
}

/// Effects that fit as well as `best`.
fn confounded(best: &Judged, all: &[Judged]) -> Vec<Candidate> {
    let mut candidates: Vec<Candidate> = all
        .iter()
        .filter(|other| other.reason.is_none() && other.refit.candidate != best.refit.candidate)
        .filter(|other| {
            let both_noise = reaches_the_floor(&other.refit) && reaches_the_floor(&best.refit);
            let apart = if both_noise { other.delta_bic - best.delta_bic } else { other.held_out - best.held_out };
            apart.abs() < SAME || as_good(other, best)
        })
        .filter_map(|other| other.refit.candidate.clone())
        .collect();
    let mut same: Vec<Candidate> = best.refit.candidate.iter().flat_map(|own| equivalents(own, &best.refit)).collect();
    same.append(&mut candidates);
    same
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
pub(super) fn conclude(
    work: &Work<'_>,
    first: &Refit,
    steps: Vec<Step>,
    notes: Vec<Note>,
) -> Result<Diagnosis, DiagnoseError> {
    let mut ranking: Vec<Ranked> = Vec::new();
    let mut rejected = Vec::new();
    let mut found: Vec<Ranked> = Vec::new();
    let mut better = None;
    for (index, step) in steps.iter().enumerate() {
        let ranked = step
            .fitted
            .iter()
            .filter(|judged| judged.reason.is_none())
            .filter_map(|judged| ranked(step, judged, index + 1));
        let mut ranked: Vec<Ranked> = ranked.collect();
        if step.verdict == Verdict::MissingEffect && !ranked.is_empty() {
            found.push(ranked.remove(0));
            better = step.best().cloned();
        }
        if index == 0 {
            ranking = ranked;
            rejected.extend(step.fitted.iter().filter_map(|judged| {
                Some(RejectedCandidate { candidate: judged.refit.candidate.clone()?, reason: judged.reason.clone()? })
            }));
            rejected.extend(step.failed.iter().cloned());
        }
    }
    let later = |other: &Ranked| found.iter().any(|found| found.candidate == other.candidate);
    ranking.retain(|ranked| !later(ranked));
    let base = first.parsed()?;
    let mut verdict = steps.first().map_or(Verdict::Unexplained, |step| step.verdict);
    let mut moved = Vec::new();
    if verdict == Verdict::Unexplained && work.judge.error == ErrorSignal::Position {
        moved = super::inconsistent_runs::moved(work, &base)?;
        if !moved.is_empty() {
            verdict = Verdict::NothingMissing;
        }
    }
    let mut statements = statements(verdict, first, &found, &ranking, &steps);
    if let Some(most) = moved.first() {
        statements.truncate(1);
        statements.push(Statement::ValuesMoved { most: most.clone() });
    }
    let discovered =
        (verdict == Verdict::Unexplained).then(|| super::discover::discover(&base, work.judge.runs)).flatten();
    if verdict == Verdict::Unexplained {
        statements.push(discovered.as_ref().map_or(Statement::NoFormulaExplains, super::discover::statement));
        let is_open = discovered.is_none() && ranking.is_empty() && first.status.may_update_model();
        if is_open && work.judge.error == ErrorSignal::Torque {
            statements.push(Statement::NoiseIsUnknown);
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
            ranked.experiment = super::distinguishing_experiment::experiment(own, &others, work.judge.runs);
        }
    }
    ranking.splice(0..0, found);
    let comparison = compare(&base, work.runs)?;
    let places = places(locate(&base, work.runs, &comparison));
    let better = better.map(|better: Refit| better.parsed()).transpose()?;
    Ok(Diagnosis {
        verdict,
        statements,
        error: work.judge.error.to_string(),
        ranking,
        rejected,
        screening: steps.into_iter().next().map(|step| step.screening).unwrap_or_default(),
        places,
        moved,
        notes,
        worst_ratio: first.worst_ratio(),
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
        ratio if ratio < EXPLAINED => Evidence::LeavesNoise { times_noise },
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
        confounded_with: confounded(judged, &step.fitted),
        parameters: after.parameters.clone(),
        evidence,
        experiment: None,
        depth,
        worst_ratio_after: after.worst_ratio(),
        candidate,
    })
}

/// What is left at the worst joint, or of the torque where the noise is not known.
fn error_left(worst_ratio: Option<f64>, torque_percent: Option<f64>) -> ErrorLeft {
    match (worst_ratio, torque_percent) {
        (Some(times_noise), _) if times_noise < EXPLAINED => ErrorLeft::NearNoise { times_noise },
        (Some(times_noise), _) => ErrorLeft::AboveNoise { times_noise },
        (None, Some(percent)) => ErrorLeft::OfTorque { percent },
        _ => ErrorLeft::Unknown,
    }
}

fn statements(verdict: Verdict, first: &Refit, found: &[Ranked], others: &[Ranked], steps: &[Step]) -> Vec<Statement> {
    let model = if first.was_given_up() { ModelState::WithoutFit } else { ModelState::Refitted };
    let left = error_left(first.worst_ratio(), first.torque_percent_validate);
    let mut statements = vec![Statement::ModelLeaves { model, left }];
    match verdict {
        Verdict::NothingMissing if reaches_the_floor(first) || first.is_white() => {
            statements.push(Statement::OnlyNoise);
        }
        Verdict::NothingMissing => statements.push(Statement::NearNoise),
        Verdict::MissingEffect => {
            for ranked in found {
                let left = error_left(ranked.worst_ratio_after, ranked.torque_percent_after);
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
            let is_fitted = first.followed != SearchExtent::ToItsEnd || first.status.may_update_model();
            statements.push(match is_fitted {
                true => Statement::NoEffectExplains,
                false => Statement::FitDidNotConverge { status: first.status },
            });
            let nearest = others.first().map(|nearest| nearest.candidate.clone());
            statements.extend(nearest.map(|candidate| Statement::Nearest { candidate }));
        }
    }
    statements
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two effects are missing, each at its joint: the first that is found cannot explain the other joint's error.
    #[test]
    fn an_effect_that_clears_its_joint_is_named_though_another_joint_is_far_off() {
        let left = |joint: usize, ratio: f64| JointResidual {
            joint,
            held_out: true,
            squares: ratio * ratio,
            samples: 1.0,
            correlation: 1.0,
            noise_squares: Some(1.0),
            white: false,
        };
        let refit = |ratios: [f64; 2]| Refit {
            followed: SearchExtent::WhileItFell,
            left: vec![left(4, ratios[0]), left(5, ratios[1])],
            ..crate::refit::tests::empty()
        };
        let before = refit([830.0, 770.0]);
        let judged = |refit: Refit| Judged { refit, held_out: -1.0, delta_bic: -400.0, reason: None };
        let verdict = |after: [f64; 2]| of(&before, &[judged(refit(after))]);
        assert_eq!(verdict([700.0, 5.0]), Verdict::MissingEffect);
        assert_eq!(verdict([700.0, 75.0]), Verdict::Unexplained, "a tenth of what was left is not nearly nothing");
        assert_eq!(verdict([20.0, 5.0]), Verdict::Unexplained, "both joints fell by as much: a better fit may do that");
    }

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
            correlation: 1.0,
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
}
