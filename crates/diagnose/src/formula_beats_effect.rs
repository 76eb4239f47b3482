//! A formula of one term, found without the library, that explains far more than the library's effects: then none of those is
//! what is missing.
//!
//! Asked twice. `Work::is_formula_ahead`, before fits: where no search with an observer comes near the noise and the formula
//! leaves less than a quarter of the torque error, at the worst joint, that the most significant candidates leave by the
//! screening, candidates that are hopeless with the observer are not fitted (a formula takes seconds, a dozen fits minutes). They
//! are fitted after all if another candidate explains the logs. `Work::is_beaten`, after fits: before an effect that does not
//! reach the noise is named, the formula must not leave less than half of what it leaves.

use super::{Refit, RejectedCandidate, Rejection, Score, Scored, Work, discover, prescreening, verdict};
use crate::DiagnoseError;
use dynid_user_model::Model;

impl Work<'_> {
    /// Whether a formula of one term leaves far less than the best effect of the library, which does not leave mere noise:
    /// then that effect is only the nearest to what is missing.
    pub(super) fn is_beaten(
        &self,
        base: &Model,
        refit: &Refit,
        fitted: &[verdict::Judged],
    ) -> Result<bool, DiagnoseError> {
        /// Of the squared torque error of the held-out runs.
        const FAR_LESS: f64 = 0.5;
        let Some(best) = verdict::best(fitted).filter(|best| !verdict::explains(best)) else { return Ok(false) };
        let Some(joint) = verdict::helped_joint(refit, best) else { return Ok(false) };
        Ok(discover::better_than(base, &[&best.parsed()?], self.judge.runs, joint, FAR_LESS).is_some())
    }

    /// Whether a formula of one term leaves far less of the torque error, at the joint where `refit` leaves most, than any of
    /// the candidates that the screening finds most telling, at the values that it finds.
    pub(super) fn is_formula_ahead(&self, base: &Model, refit: &Refit, scored: &[Scored]) -> bool {
        /// Of the squared torque error of the held-out runs. The screening, which is linear, may see less in a law than a fit
        /// would.
        const FAR_LESS: f64 = 0.25;
        /// As many candidates are compared.
        const COMPARED: usize = 6;
        /// Share of the squared position error with an observer; what explains more has its fit.
        const NEARLY_ALL: f64 = 0.95;
        let ratios = refit.judged().filter_map(|left| Some((left.ratio()?, left.joint)));
        let Some((_, joint)) = ratios.max_by(|a, b| a.0.total_cmp(&b.0)) else { return false };
        if scored.iter().filter_map(|(_, position)| position.as_ref()).any(|score| score.explained > NEARLY_ALL) {
            return false;
        }
        let mut telling: Vec<&Score> = scored.iter().filter_map(|(torque, _)| torque.as_ref()).collect();
        telling.sort_by(|a, b| b.explained.total_cmp(&a.explained).then(a.candidate.cmp(&b.candidate)));
        let estimates: Vec<&Model> = telling.iter().take(COMPARED).map(|score| &score.estimate).collect();
        !estimates.is_empty() && discover::better_than(base, &estimates, self.judge.runs, joint, FAR_LESS).is_some()
    }
}

/// `waiting`, and apart from it those that are hopeless with an observer, where none is near noise. The first of them, from one
/// start, is left where nothing was fitted yet: a fit says more of it than an observer.
pub(super) fn without_hopeless(
    waiting: Vec<Score>,
    is_fitted: bool,
    reached: &prescreening::Reached,
) -> (Vec<Score>, Vec<Score>) {
    let mut is_first_left = is_fitted;
    let (mut left, mut hopeless) = (Vec::new(), Vec::new());
    for mut score in waiting {
        if !reached.is_hopeless(&score.candidate) {
            left.push(score);
        } else if is_first_left {
            hopeless.push(score);
        } else {
            is_first_left = true;
            score.others.clear();
            left.push(score);
        }
    }
    (left, hopeless)
}

/// Those that are hopeless and were not fitted, with the reason.
pub(super) fn rejected(hopeless: Vec<Score>, fitted: &[Refit]) -> impl Iterator<Item = RejectedCandidate> {
    let unfitted = hopeless.into_iter().filter(|score| !super::is_fitted(&score.candidate, fitted));
    unfitted.map(|score| RejectedCandidate { candidate: score.candidate, reason: Rejection::BeatenByFormula })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{prescreening::tests::reached, prescreening::tests::score, refit::tests::empty};

    fn names(list: &[Score]) -> Vec<&str> {
        list.iter().map(|score| score.candidate.effect.as_str()).collect()
    }

    /// `viscous` comes far nearer than the model alone, and no observer tells of the sensor.
    #[test]
    fn what_stays_far_with_an_observer_is_set_apart_but_for_the_first_of_all() {
        let reported = reached(Some(130.0), &[("lugre", 90.0), ("coulomb", 80.0), ("viscous", 7.0)]);
        let mut waiting = ["sensor_offset", "lugre", "coulomb", "viscous"].map(score).to_vec();
        waiting.iter_mut().for_each(|score| score.others = vec![score.estimate.clone()]);
        let (left, hopeless) = without_hopeless(waiting.clone(), false, &reported);
        assert_eq!((names(&left), names(&hopeless)), (vec!["sensor_offset", "lugre", "viscous"], vec!["coulomb"]));
        assert_eq!(left.iter().map(|score| score.others.len()).collect::<Vec<_>>(), [1, 0, 1]);
        let (left, hopeless) = without_hopeless(waiting, true, &reported);
        assert_eq!((names(&left), names(&hopeless)), (vec!["sensor_offset", "viscous"], vec!["lugre", "coulomb"]));
        let fitted = Refit { candidate: Some(score("lugre").candidate), ..empty() };
        let reported: Vec<RejectedCandidate> = rejected(hopeless, &[fitted]).collect();
        assert_eq!(reported.iter().map(|rejected| rejected.candidate.effect.as_str()).collect::<Vec<_>>(), ["coulomb"]);
    }
}
