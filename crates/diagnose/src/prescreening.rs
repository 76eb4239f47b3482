//! Which candidates are fitted first: a short search with the firmest observer, for few free joints and the position error.
//!
//! A law that is wrong may take many times as long to fit as the one that is right: what is missing leads its simulations
//! astray. A search whose simulations are held to the logs as firmly as at first takes a small part of a fit's time and
//! distinguishes them already, though it proves nothing. So it decides the order, and which candidates cannot rival one that
//! leaves only noise; fits and held-out runs decide the rest.
//!
//! All candidates but sensors are searched (an observer pulls away what a sensor shows wrongly); the first two alone, if one of
//! them leaves only noise. That is so where the model's own fit strayed or where the first candidate's fit explains nothing;
//! otherwise only candidates with fewer unknowns than the first are searched. Those that leave only noise go ahead, the one
//! with the fewest unknowns first.

use std::collections::BTreeMap;

use dynid_model::Place;
use rayon::prelude::*;

use super::{Candidate, Event, FEW_JOINTS, Refit, RejectedCandidate, Rejection, Score, Work, verdict};
use crate::DiagnoseError;
use dynid_identify::identify::ErrorSignal;
use dynid_user_model::Model;

/// Costs per sample that searches came to with the first observer.
#[derive(Debug, Default)]
pub(super) struct Reached {
    /// The model's own.
    base: Option<f64>,
    /// Whether any candidate's was asked.
    is_asked: bool,
    /// Those of candidates that came to anything. An observer pulls what a sensor shows wrongly away from where it is, so that none
    /// is kept for sensors.
    candidates: BTreeMap<Candidate, f64>,
}

impl Reached {
    /// Whether searches were asked and none came near the logs.
    pub(super) fn all_stay_far(&self) -> bool {
        /// Cost per sample beyond which a search is not near.
        const NEAR: f64 = 10.0;
        self.is_asked
            && !self.base.is_some_and(verdict::is_nearly_noise)
            && self.candidates.values().all(|cost| *cost > NEAR)
    }

    /// Whether searches were asked and none came near what noise costs, though some may have come near the logs.
    pub(super) fn none_is_near_noise(&self) -> bool {
        self.is_asked
            && self.base.is_none_or(is_far_above_noise)
            && self.candidates.values().copied().all(is_far_above_noise)
    }

    /// Whether a candidate's search was of little use: the model alone, if its own search came to anything, is not far above
    /// it. Only where none is near noise ([`none_is_near_noise`](Self::none_is_near_noise)) does that say anything.
    pub(super) fn is_hopeless(&self, candidate: &Candidate) -> bool {
        /// Share of what the model itself leaves.
        const USEFUL: f64 = 0.1;
        let is_useful = |cost: f64| self.base.is_some_and(|base| cost <= USEFUL * base);
        self.candidates.get(candidate).is_some_and(|cost| !is_useful(*cost))
    }

    /// Whether a candidate's search is known.
    pub(super) fn knows(&self, candidate: &Candidate) -> bool {
        self.candidates.contains_key(candidate)
    }

    fn is_noise(&self, score: &Score) -> bool {
        self.candidates.get(&score.candidate).is_some_and(|cost| verdict::is_nearly_noise(*cost))
    }
}

/// Whether a search that is short and right would have come to less.
fn is_far_above_noise(cost: f64) -> bool {
    /// So many times as much as noise costs.
    const FAR: f64 = 5.0;
    cost > FAR * verdict::COST_AT_THE_FLOOR
}

impl Work<'_> {
    /// Whether searches with an observer may decide an order: of the position error, where simulations of few joints are cheap.
    fn may_race(&self) -> bool {
        let free = self.judge.runs.iter().map(|run| run.free.len()).max().unwrap_or(0);
        self.judge.error == ErrorSignal::Position && free <= FEW_JOINTS
    }

    /// What the searches of `waiting` come to that have not been asked: of the first ones, and unless one of those leaves only
    /// noise, or `base` alone does, of all. Says whether there is nothing more to ask; where searches may not decide, there
    /// never is.
    pub(super) fn prescreening(
        &self,
        base: &Model,
        waiting: &[Score],
        reached: &mut Reached,
    ) -> Result<bool, DiagnoseError> {
        /// As many are first.
        const FIRST: usize = 2;
        let cost = |start: &Model| self.judge.with_first_observer(start, self.stop);
        let has_sensor = |score: &Score| score.estimate.effects.iter().any(|own| own.effect.place == Place::Sensor);
        let is_new = |score: &Score| !reached.knows(&score.candidate);
        let asked: Vec<&Score> = waiting.iter().filter(|score| is_new(score) && !has_sensor(score)).collect();
        if asked.is_empty() || !self.may_race() {
            return Ok(true);
        }
        (self.tell)(&Event::Comparing(asked.len()));
        if reached.base.is_none() {
            reached.base = cost(base);
        }
        let is_followed = reached.base.is_some_and(verdict::is_nearly_noise);
        let (first, others) = asked.split_at(FIRST.min(asked.len()));
        for some in [first, others] {
            if is_followed || waiting.iter().any(|score| reached.is_noise(score)) {
                return Ok(is_followed || some.is_empty());
            }
            reached.is_asked |= !some.is_empty();
            let costs: Vec<Option<f64>> = some.par_iter().map(|score| cost(&score.estimate)).collect();
            self.asked_to_stop()?;
            let reported = some.iter().zip(costs).filter_map(|(score, cost)| Some((score.candidate.clone(), cost?)));
            reached.candidates.extend(reported);
        }
        Ok(true)
    }
}

/// `waiting` with those ahead that leave only noise with the observer where the model alone does not, the plainest first. The
/// others keep their order.
pub(super) fn noise_first(waiting: Vec<Score>, reached: &Reached, unknowns: &dyn Fn(&Score) -> f64) -> Vec<Score> {
    if reached.base.is_some_and(verdict::is_nearly_noise) {
        return waiting;
    }
    let (mut ahead, others): (Vec<Score>, Vec<Score>) = waiting.into_iter().partition(|score| reached.is_noise(score));
    ahead.sort_by(|a, b| unknowns(a).total_cmp(&unknowns(b)));
    ahead.extend(others);
    ahead
}

/// `waiting` with those ahead that leave only noise, the plainest first, then those that come near the logs, the nearest
/// first, where the model alone does not. The others, and those that were not asked, keep their order.
pub(super) fn ordered(waiting: Vec<Score>, reached: &Reached, unknowns: &dyn Fn(&Score) -> f64) -> Vec<Score> {
    /// Share of what the model itself leaves that is nearer.
    const NEARER: f64 = 0.5;
    let base = reached.base.unwrap_or(f64::INFINITY);
    let cost = |score: &Score| reached.candidates.get(&score.candidate).copied().filter(|cost| *cost < NEARER * base);
    let (mut near, others): (Vec<Score>, Vec<Score>) = waiting.into_iter().partition(|score| cost(score).is_some());
    near.sort_by(|a, b| cost(a).unwrap_or_default().total_cmp(&cost(b).unwrap_or_default()));
    near.extend(others);
    noise_first(near, reached, unknowns)
}

/// Why a candidate is no rival of `winner`, which leaves only noise; `None` if it may be one, or the winner was not asked beside
/// it.
pub(super) fn no_rival(candidate: &Candidate, winner: &Refit, reached: &Reached) -> Option<RejectedCandidate> {
    /// What costs so many times as much as the winner is none.
    const FAR: f64 = 30.0;
    let cost = |candidate: &Candidate| reached.candidates.get(candidate).copied();
    let own = cost(candidate)?;
    let best = cost(winner.candidate.as_ref()?)?;
    (own > FAR * best.max(verdict::COST_AT_THE_FLOOR))
        .then(|| RejectedCandidate { candidate: candidate.clone(), reason: Rejection::NoRival })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::refit::tests::empty;

    pub(crate) fn score(effect: &str) -> Score {
        Score {
            candidate: Candidate { effect: effect.to_owned(), joint: Some(0), from: None },
            information: 0.0,
            explained: 0.5,
            estimate: Model::of_device(dynid_model::device("planar2r").unwrap()),
            others: Vec::new(),
            is_narrow: false,
        }
    }

    pub(crate) fn reached(base: Option<f64>, candidates: &[(&str, f64)]) -> Reached {
        let candidates = candidates.iter().map(|(effect, cost)| (score(effect).candidate, *cost)).collect();
        Reached { base, is_asked: true, candidates }
    }

    fn names(list: &[Score]) -> Vec<&str> {
        list.iter().map(|score| score.candidate.effect.as_str()).collect()
    }

    fn unknowns(score: &Score) -> f64 {
        if score.candidate.effect == "lugre" { 5.0 } else { 1.0 }
    }

    const WAITING: [&str; 5] = ["lugre", "coulomb", "sensor_offset", "viscous", "stribeck"];

    fn waiting() -> Vec<Score> {
        WAITING.iter().map(|effect| score(effect)).collect()
    }

    #[test]
    fn what_leaves_only_noise_on_the_observer_goes_first_then_what_comes_near() {
        let reported = reached(Some(150.0), &[("lugre", 0.3), ("coulomb", 40.0), ("viscous", 0.5), ("stribeck", 4.0)]);
        let list = ordered(waiting(), &reported, &unknowns);
        assert_eq!(names(&list), ["viscous", "lugre", "stribeck", "coulomb", "sensor_offset"]);
        let list = noise_first(waiting(), &reported, &unknowns);
        assert_eq!(names(&list), ["viscous", "lugre", "coulomb", "sensor_offset", "stribeck"]);
        assert!(!reported.all_stay_far() && reached(None, &[("coulomb", 40.0)]).all_stay_far());
        assert!(!Reached::default().all_stay_far(), "none was asked");
        assert!(!reported.none_is_near_noise() && !Reached::default().none_is_near_noise());
        assert!(reached(Some(13.0), &[("coulomb", 6.0)]).none_is_near_noise());
        assert!(!reached(Some(2.0), &[("coulomb", 6.0)]).none_is_near_noise(), "the model alone is");
        let hopeless =
            |base: Option<f64>, cost: f64| reached(base, &[("coulomb", cost)]).is_hopeless(&score("coulomb").candidate);
        assert!(hopeless(Some(50.0), 6.0) && !hopeless(Some(70.0), 6.0));
        assert!(hopeless(None, 6.0), "it is not known of how little use the search was");
        assert!(!reached(Some(50.0), &[]).is_hopeless(&score("coulomb").candidate), "it was not asked");
        assert!(!reached(Some(0.4), &[]).all_stay_far(), "the model alone is near");
    }

    #[test]
    fn where_the_model_alone_follows_the_logs_on_the_observer_nothing_is_reported() {
        let reported = reached(Some(0.4), &[("lugre", 0.3), ("viscous", 0.2)]);
        assert_eq!(names(&ordered(waiting(), &reported, &unknowns)), WAITING);
        // What comes as near as the model itself is not nearer.
        let reported = reached(Some(40.0), &[("lugre", 39.0), ("viscous", 45.0)]);
        assert_eq!(names(&ordered(waiting(), &reported, &unknowns)), WAITING);
    }

    #[test]
    fn only_what_stays_far_above_the_winner_on_the_observer_is_no_rival() {
        let reported = reached(Some(150.0), &[("lugre", 6.0), ("stribeck", 170.0), ("coulomb", 190.0)]);
        let winner = |effect: &str| Refit { candidate: Some(score(effect).candidate), ..empty() };
        let rejected = |effect: &str, winner: &Refit| no_rival(&score(effect).candidate, winner, &reported).is_some();
        let lugre = winner("lugre");
        assert!(rejected("coulomb", &lugre) && !rejected("stribeck", &lugre) && !rejected("sensor_offset", &lugre));
        assert!(!rejected("coulomb", &winner("sensor_offset")), "the winner was not asked");
    }
}
