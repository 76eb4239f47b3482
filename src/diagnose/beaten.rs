//! Where a formula that was found without the library leaves far less than its effects do, those are not what is missing.

use std::collections::BTreeSet;

use super::{Refit, Refused, Score, Scored, Work, discover, race, verdict};
use crate::{error::Error, model::Model};

impl Work<'_> {
    /// Whether a formula of one term leaves far less than the best effect of the library, which does not leave mere noise:
    /// then that effect is only the nearest to what is missing.
    pub(super) fn is_beaten(&self, base: &Model, refit: &Refit, fitted: &[verdict::Judged]) -> Result<bool, Error> {
        /// Of the squared torque error of the held-out runs.
        const FAR_LESS: f64 = 0.5;
        let Some(best) = verdict::best(fitted).filter(|best| !verdict::explains(best)) else { return Ok(false) };
        let Some(joint) = verdict::helped_joint(refit, best) else { return Ok(false) };
        Ok(discover::better_than(base, &best.parsed()?, self.judge.runs, joint, FAR_LESS).is_some())
    }

    /// Whether a formula of one term leaves far less of a joint's torque error than the screening finds that any suspect would.
    pub(super) fn is_formula_ahead(&self, base: &Model, scored: &[Scored]) -> bool {
        let joints: BTreeSet<usize> = self.judge.runs.iter().flat_map(|run| run.free.iter().copied()).collect();
        let explained = scored.iter().filter_map(|(torque, _)| Some(torque.as_ref()?.explained)).fold(0.0, f64::max);
        let formula = discover::explained_by_one_term(base, self.judge.runs);
        formula.is_some_and(|formula| is_far_ahead(formula, explained, joints.len()))
    }
}

/// Whether a formula that explains a share `formula` of one joint's squared torque error is far ahead of a suspect that explains
/// `suspect` of that of all `joints`, which count alike: all of that may be at the formula's joint.
fn is_far_ahead(formula: f64, suspect: f64, joints: usize) -> bool {
    /// Share of what the suspect leaves. The screening, which is linear, may see less in a law than there is.
    const FAR_LESS: f64 = 0.25;
    let left = (1.0 - suspect * joints as f64).max(0.0);
    1.0 - formula < FAR_LESS * left
}

/// `waiting` without those that stay far above the noise on a tether, but for the first, from one start, where
/// `is_first_kept`: a fit says more of it than a tether.
pub(super) fn without_hopeless(
    waiting: Vec<Score>,
    is_first_kept: bool,
    reached: &race::Reached,
    failed: &mut Vec<Refused>,
) -> Vec<Score> {
    let mut left = Vec::new();
    for mut score in waiting {
        if !reached.knows(&score.suspect) {
            left.push(score);
        } else if is_first_kept && left.is_empty() {
            score.others.clear();
            left.push(score);
        } else {
            failed.push(Refused {
                suspect: score.suspect,
                reason: "even with simulations that are held to the logs it stays far above the noise, and a formula \
                         leaves far less of the torque error than any effect of the library would"
                    .to_owned(),
            });
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::race::tests::{reached, score};

    #[test]
    fn what_stays_far_on_a_tether_is_left_out_but_for_the_first_and_for_what_was_not_asked() {
        let told = reached(Some(13.0), &[("lugre", 9.0), ("coulomb", 8.0), ("viscous", 7.0)]);
        let waiting = ["lugre", "coulomb", "sensor_offset", "viscous"].map(score).to_vec();
        let names = |list: &[Score]| -> Vec<String> { list.iter().map(|score| score.suspect.effect.clone()).collect() };
        let mut refused = Vec::new();
        assert_eq!(names(&without_hopeless(waiting.clone(), true, &told, &mut refused)), ["lugre", "sensor_offset"]);
        assert_eq!(refused.len(), 2);
        assert_eq!(names(&without_hopeless(waiting, false, &told, &mut refused)), ["sensor_offset"]);
        assert_eq!(refused.len(), 5);
    }

    #[test]
    fn a_formula_is_ahead_where_it_leaves_a_small_part_of_what_any_suspect_leaves_at_its_joint() {
        assert!(is_far_ahead(0.93, 0.25, 1) && !is_far_ahead(0.93, 0.75, 1));
        // Of two joints, a quarter of both may be half of one.
        assert!(is_far_ahead(0.89, 0.25, 2) && !is_far_ahead(0.87, 0.25, 2));
        // What explains half of two joints may explain all of one.
        assert!(!is_far_ahead(0.999, 0.5, 2) && !is_far_ahead(1.0, 0.6, 2));
    }
}
