//! Which candidates are worth a simulation, which are worth a fit, and in which order.
//!
//! What is high in both screenings comes first; ahead of it, candidates at the same joint with fewer unknowns that explain nearly
//! as much. Where one fit leaves only noise, only those candidates are still fitted that a screening finds nearly as
//! significant (if that screening saw the first one at all) or that it finds to explain nearly everything, and those that the
//! first one contains: of nested laws the smallest that explains is wanted.

use super::{Candidate, Probe, Refit, Score, Screened, candidate::distinct, screen::Scored};
use dynid_user_model::Model;

/// A candidate that promises less than this share of the best is not fitted.
const LEAST_PROMISE: f64 = 0.05;
/// As many are fitted in any case.
const FEWEST: usize = 5;
/// What would explain less than this share of the squared error, of torque or with an observer, is not fitted, but for a few: of
/// what the cases of `cargo xtask hidden-effects` hide each explains a sixth at least.
const LEAST_SHARE: f64 = 0.05;
const FEWEST_OF_LITTLE: usize = 3;

/// Two screenings' scores of every candidate in one order: who is high in both comes first.
pub(super) fn of(scored: &[Scored]) -> Vec<Score> {
    // Each screening in units of its best, so that neither drowns the other.
    let best = |of: &dyn Fn(&Scored) -> Option<f64>| scored.iter().filter_map(of).fold(-f64::MIN_POSITIVE, f64::min);
    let by_torque = best(&|pair| Some(pair.0.as_ref()?.information));
    let by_position = best(&|pair| Some(pair.1.as_ref()?.information));
    let promise = |index: usize| {
        let (torque, position) = &scored[index];
        torque.as_ref().map_or(0.0, |score| (score.information / by_torque).max(0.0))
            + position.as_ref().map_or(0.0, |score| (score.information / by_position).max(0.0))
    };
    let mut order: Vec<usize> = (0..scored.len())
        .filter(|index| {
            let helps = |score: &Option<Score>| score.as_ref().is_some_and(|score| score.information < 0.0);
            helps(&scored[*index].0) || helps(&scored[*index].1)
        })
        .collect();
    order.sort_by(|a, b| promise(*b).total_cmp(&promise(*a)).then(a.cmp(b)));
    // What promises a small part of the best is not fitted, but for a few.
    let most = order.first().map_or(0.0, |index| promise(*index));
    let enough = order.iter().filter(|index| promise(**index) >= LEAST_PROMISE * most).count();
    order.truncate(enough.max(FEWEST));
    // Nor is what a screening, whose errors do not pile up, sees explain little.
    let explained = |index: usize| {
        let of = |score: &Option<Score>| score.as_ref().map_or(0.0, |score| score.explained);
        of(&scored[index].0).max(of(&scored[index].1))
    };
    let mut place = 0;
    order.retain(|index| {
        place += 1;
        place <= FEWEST_OF_LITTLE || explained(*index) >= LEAST_SHARE
    });
    let mut list: Vec<Score> = order.into_iter().filter_map(|index| joined(&scored[index])).collect();
    bring_alternatives(&mut list);
    bring_contained(&mut list, scored);
    list
}

/// Both screenings' scores of a candidate in one.
fn joined((torque, position): &Scored) -> Option<Score> {
    // The estimate on simulations is the nearer to what a refit will find; the other is another start.
    match (torque.clone(), position.clone()) {
        (Some(torque), Some(position)) => {
            let mut others = position.others;
            if !torque.others.is_empty() {
                others.insert(others.len().min(1), torque.estimate);
            }
            Some(Score { others, ..position })
        }
        (torque, position) => position.or(torque),
    }
}

/// The list with those ahead that have fewer unknowns than the most promising, at the same joint, and that a screening finds
/// nearly as telling: where one of them leaves nothing but white noise, nothing larger need be fitted.
pub(super) fn plain_ones_first(
    mut list: Vec<Score>,
    scored: &[Scored],
    unknowns: &dyn Fn(&Score) -> f64,
) -> Vec<Score> {
    /// Share of what the most promising explains.
    const NEARLY: f64 = 0.95;
    let Some(first) = list.first() else { return list };
    let (place, most) = (first.candidate.joint, unknowns(first));
    let explained = |candidate: &Candidate| {
        let of = |score: &Option<Score>| score.as_ref().map_or(0.0, |score| score.explained);
        scores_of(candidate, scored).map_or((0.0, 0.0), |own| (of(&own.0), of(&own.1)))
    };
    let (torque, position) = explained(&first.candidate);
    // A screening that sees little of the first tells nothing.
    let is_near = |own: f64, first: f64| first >= LEAST_SHARE && own >= NEARLY * first;
    let is_plain = |score: &Score| {
        let own = explained(&score.candidate);
        score.candidate.joint == place && unknowns(score) < most && (is_near(own.0, torque) || is_near(own.1, position))
    };
    let (mut plain, others): (Vec<Score>, Vec<Score>) = list.drain(..).partition(is_plain);
    plain.sort_by(|a, b| unknowns(a).total_cmp(&unknowns(b)));
    plain.extend(others);
    plain
}

/// What the screening says of every candidate, most promising first.
pub(super) fn screened(scored: &[Scored]) -> Vec<Screened> {
    let mut list: Vec<Screened> = scored
        .iter()
        .filter_map(|(torque, position)| {
            let candidate = torque.as_ref().or(position.as_ref())?.candidate.clone();
            Some(Screened {
                candidate,
                torque: torque.as_ref().map(|score| score.information),
                torque_explained: torque.as_ref().map(|score| score.explained),
                position: position.as_ref().map(|score| score.information),
                position_explained: position.as_ref().map(|score| score.explained),
            })
        })
        .collect();
    let key = |screened: &Screened| screened.position.or(screened.torque).unwrap_or(f64::INFINITY);
    list.sort_by(|a, b| key(a).total_cmp(&key(b)).then(a.candidate.cmp(&b.candidate)));
    list
}

fn scores_of<'s>(candidate: &Candidate, scored: &'s [Scored]) -> Option<&'s Scored> {
    scored
        .iter()
        .find(|(torque, position)| torque.as_ref().or(position.as_ref()).is_some_and(|any| any.candidate == *candidate))
}

/// Of laws that are alternatives at a joint, all are fitted if one is among the first: only a fit tells them apart.
fn bring_alternatives(list: &mut Vec<Score>) {
    /// How far down the list a law brings its alternatives along.
    const FIRST: usize = 4;
    let family = |score: &Score| {
        let word = score.candidate.law()?.alternatives.clone()?;
        Some((word, score.candidate.joint))
    };
    let wanted: Vec<_> = list.iter().take(FIRST).filter_map(family).collect();
    let mut place = 0;
    let (early, late): (Vec<Score>, Vec<Score>) = list.drain(..).partition(|score| {
        place += 1;
        place <= FIRST || family(score).is_some_and(|family| wanted.contains(&family))
    });
    list.extend(early);
    list.extend(late);
}

/// What one of the first laws contains goes last, however little a screening finds in it: of nested laws the smallest that
/// explains is wanted.
pub(super) fn bring_contained(list: &mut Vec<Score>, scored: &[Scored]) {
    let is_listed = |candidate: &Candidate| list.iter().any(|score| score.candidate == *candidate);
    let is_contained =
        |candidate: &Candidate| list.iter().take(FEWEST).any(|score| score.candidate.contains(candidate));
    let left_out = scored.iter().filter_map(joined);
    let mut contained: Vec<Score> =
        left_out.filter(|score| is_contained(&score.candidate) && !is_listed(&score.candidate)).collect();
    contained.sort_by(|a, b| a.information.total_cmp(&b.information).then(a.candidate.cmp(&b.candidate)));
    list.extend(contained);
}

/// Whether a candidate may explain as much as `best` does, which leaves nothing: one that it contains, that the screening finds
/// nearly as telling, or that would leave next to nothing.
pub(super) fn may_rival(score: &Score, best: &Refit, scored: &[Scored]) -> bool {
    /// Shares of the best's score.
    const NEARLY: f64 = 0.6;
    const USELESS: f64 = 0.1;
    /// Share of a screening's best score below which it did not see what it looked at.
    const SEEN: f64 = 0.1;
    /// Share of the squared error; beyond it a screening, which is linear, tells no more.
    const NEARLY_ALL: f64 = 0.98;
    let Some(winner) = &best.candidate else { return true };
    // Of nested laws the smallest that explains is wanted.
    if winner.contains(&score.candidate) {
        return true;
    }
    let (Some(own), Some(best)) = (scores_of(&score.candidate, scored), scores_of(winner, scored)) else { return true };
    let information = |score: &Option<Score>| score.as_ref().map_or(0.0, |score| score.information);
    // A screening that did not see the winner tells nothing of its rivals.
    let least = |of: fn(&Scored) -> &Option<Score>| scored.iter().map(|own| information(of(own))).fold(0.0, f64::min);
    let seen = [information(&best.0) < SEEN * least(|own| &own.0), information(&best.1) < SEEN * least(|own| &own.1)];
    let is_near = |own: &Option<Score>, best: &Option<Score>, is_seen: bool| {
        let is_telling = is_seen || seen == [false, false];
        own.as_ref().is_some_and(|own| own.explained > NEARLY_ALL)
            || (is_telling && information(own) < NEARLY * information(best))
    };
    // What simulations find next to useless, and that elsewhere, is no rival.
    let is_elsewhere = score.candidate.joint != winner.joint;
    let is_useless = is_elsewhere && own.1.is_some() && information(&own.1) > USELESS * information(&best.1);
    (is_near(&own.0, &best.0, seen[0]) && !is_useless) || is_near(&own.1, &best.1, seen[1])
}

/// Of many probes those that are worth a simulation: all of a few, else some about the torque error's estimate. The more
/// candidates there are, the fewer are few.
pub(super) fn worth_simulating(probes: &[Probe], by_torque: Option<&Score>, candidates: usize) -> Vec<Probe> {
    /// As many simulations of all candidates are cheap.
    const AFFORDED: usize = 1500;
    /// As many of one candidate are few, at least and at most.
    const FEW: (usize, usize) = (4, 32);
    let few = (AFFORDED / candidates.max(1)).clamp(FEW.0, FEW.1);
    if probes.len() <= few {
        return probes.to_vec();
    }
    let Some(score) = by_torque else { return probes.iter().step_by(probes.len().div_ceil(few)).cloned().collect() };
    // The estimate, with its amplitudes to be found anew about it.
    let near = |estimate: &Model| {
        probes.iter().min_by(|a, b| distance(a, estimate).total_cmp(&distance(b, estimate))).cloned()
    };
    let near = [&score.estimate].into_iter().chain(&score.others).filter_map(near).collect();
    distinct(near, |probe: &Probe| &probe.model)
}

/// How far a probe's tried values are from those of a model; of values that a factor multiplies, how far their ratios are.
fn distance(probe: &Probe, model: &Model) -> f64 {
    let stepped =
        |name: &str| probe.steps.iter().any(|step| step.name == name) || probe.scaled.iter().any(|own| own == name);
    let apart = |own: f64, other: f64| (own - other).abs() / (own.abs() + other.abs()).max(f64::MIN_POSITIVE);
    let ratio = |of: &Model, name: &str| Some(of.parameter(name)?.value / of.parameter(probe.scaled.first()?)?.value);
    let ratios = probe.scaled.iter().skip(1).filter_map(|name| {
        let apart = apart(ratio(&probe.model, name)?, ratio(model, name)?);
        apart.is_finite().then_some(apart)
    });
    let differences =
        probe.model.parameters().into_iter().filter(|(name, _)| !stepped(name)).filter_map(|(name, own)| {
            let other = model.parameter(&name)?;
            Some(apart(own.value, other.value))
        });
    differences.sum::<f64>() + ratios.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::refit::tests::empty;

    fn candidate(effect: &str, joint: usize) -> Candidate {
        Candidate { effect: effect.to_owned(), joint: Some(joint), from: None }
    }

    /// Shares of the squared error that the torque error and simulations find explained; the better, the lower the criterion.
    fn scored(effect: &str, joint: usize, torque: f64, position: f64) -> Scored {
        let score = |explained: f64| Score {
            candidate: candidate(effect, joint),
            information: 1e3 * (1.0 - explained).ln(),
            explained,
            estimate: Model::of_device(dynid_model::device("planar2r").unwrap()),
            others: Vec::new(),
            is_narrow: false,
        };
        (Some(score(torque)), Some(score(position)))
    }

    /// Viscous friction is missing; without it simulations are so far off that they do not see it.
    fn all() -> Vec<Scored> {
        vec![
            scored("turner", 0, 0.977, 0.50),
            scored("viscous", 1, 0.970, 0.01),
            scored("backlash", 0, 0.0, 0.43),
            scored("sensor_scale", 0, 0.10, 0.45),
            scored("viscous", 0, 0.973, 0.0),
        ]
    }

    #[test]
    fn a_plain_law_that_tells_nearly_as_much_at_the_same_joint_goes_first() {
        let scored = all();
        let list: Vec<Score> = scored.iter().filter_map(|own| own.1.clone()).collect();
        let unknowns = |score: &Score| match score.candidate.effect.as_str() {
            "turner" => 4.0,
            "backlash" => 2.0,
            _ => 1.0,
        };
        let ordered = plain_ones_first(list, &scored, &unknowns);
        let reported: Vec<String> = ordered.iter().map(|score| score.candidate.to_string()).collect();
        let expected = [("viscous", 0), ("turner", 0), ("viscous", 1), ("backlash", 0), ("sensor_scale", 0)];
        assert_eq!(reported, expected.map(|(effect, joint)| candidate(effect, joint).to_string()));
        assert!(plain_ones_first(Vec::new(), &scored, &unknowns).is_empty());
    }

    #[test]
    fn what_one_of_the_first_contains_is_listed_however_little_is_seen_of_it() {
        let own = [
            scored("spring_polynomial", 0, 0.9, 0.9),
            scored("cogging", 0, 0.5, 0.5),
            scored("backlash", 0, 0.5, 0.5),
            scored("spring_cubic", 0, 0.001, 0.001),
            scored("spring_cubic", 1, 0.001, 0.001),
        ];
        let reported: Vec<String> = of(&own).iter().map(|score| score.candidate.to_string()).collect();
        let expected = [("spring_polynomial", 0), ("cogging", 0), ("backlash", 0), ("spring_cubic", 0)];
        assert_eq!(reported, expected.map(|(effect, joint)| candidate(effect, joint).to_string()));
    }

    #[test]
    fn a_screening_that_did_not_see_the_winner_names_no_rival() {
        let scored = all();
        let rivals = |scored: &[Scored]| -> Vec<String> {
            let best = Refit { candidate: Some(candidate("viscous", 0)), ..empty() };
            let others = scored
                .iter()
                .filter_map(|own| own.1.as_ref())
                .filter(|own| Some(&own.candidate) != best.candidate.as_ref());
            others.filter(|own| may_rival(own, &best, scored)).map(|own| own.candidate.to_string()).collect()
        };
        // Elsewhere simulations have to find some use for it; the one they see more of than of the winner has some.
        assert_eq!(rivals(&scored), [candidate("turner", 0).to_string(), candidate("viscous", 1).to_string()]);
        // What the winner contains is one whatever the screening says.
        let mut nested = all();
        nested.push(super::tests::scored("spring_cubic", 0, 0.0, 0.0));
        nested.push(super::tests::scored("spring_polynomial", 0, 0.9, 0.9));
        let winner = Refit { candidate: Some(candidate("spring_polynomial", 0)), ..empty() };
        let is_rival = |index: usize| may_rival(nested[index].1.as_ref().unwrap(), &winner, &nested);
        assert!(is_rival(5) && !is_rival(2));
        // Where neither sees the winner, what either finds telling is a rival.
        let mut unseen = all();
        unseen[4] = super::tests::scored("viscous", 0, 0.01, 0.0);
        assert_eq!(rivals(&unseen).len(), 4);
    }
}
