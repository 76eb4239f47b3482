//! Does an effect help where it acts?

use super::{Block, Refit, Rejection, TorqueView, View};

/// Why an effect that lowers the error is not believed: most of the gain lies where it hardly acts. `None` where it is
/// believed, or where the torque error does not tell.
///
/// Where an effect acts is reported by what the torque error changes when it alone is taken out of the fitted model. If it is
/// the cause, the squared error falls there, in those samples in which it acts more than in half of all. `before` is what the
/// view shows of the model without it.
pub(super) fn helps_elsewhere(view: &TorqueView, before: &[Block], after: &Refit) -> Option<Rejection> {
    /// At least so much of the gain lies in the half of the samples in which the effect acts most.
    const LEAST: f64 = 0.35;
    /// A gain of less than this share of the squared torque error says nothing of where it lies.
    const CLEAR: f64 = 0.1;
    let candidate = after.candidate.as_ref()?;
    let joint = candidate.joint?;
    let with = after.parsed().ok()?;
    let mut without = with.clone();
    without.remove_effect(&candidate.effect, candidate.joint, candidate.from).ok()?;
    let (with, without) = (view.errors(&with)?, view.errors(&without)?);
    let mut samples: Vec<(f64, f64)> = Vec::new();
    let mut before_squares = 0.0;
    for ((base, with), without) in before.iter().zip(&with).zip(&without).filter(|((base, _), _)| base.joint == joint) {
        if base.values.len() != with.values.len() || base.values.len() != without.values.len() {
            return None;
        }
        for ((base, with), without) in base.values.iter().zip(&with.values).zip(&without.values) {
            samples.push(((with - without).abs(), base * base - with * with));
            before_squares += base * base;
        }
    }
    let gain: f64 = samples.iter().map(|(_, gain)| gain).sum();
    if gain < CLEAR * before_squares || samples.len() < 8 {
        return None;
    }
    samples.sort_by(|a, b| b.0.total_cmp(&a.0));
    let near: f64 = samples[..samples.len() / 2].iter().map(|(_, gain)| gain).sum();
    let share = near / gain;
    (share < LEAST).then(|| Rejection::HelpsElsewhere { percent: 100.0 * share.max(0.0) })
}
