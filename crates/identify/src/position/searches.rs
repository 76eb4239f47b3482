//! The searches that a fit consists of, each starting where the one before ended.

use super::{
    End, Options,
    evaluate::{At, Evaluator, Resolution},
};
use dynid_dynamics::simulate::Steps;
use dynid_optimise::sqp::Limits;

/// One search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Search {
    /// Roughly integrated, the simulation corrected at each sample at this rate [1/s].
    Observed(f64),
    /// Roughly integrated.
    Rough,
    /// Integrated as stated, or as finely as the noise asks.
    Final,
}

/// In this order.
pub(super) const SEARCHES: [Search; 8] = [
    Search::Observed(100.0),
    Search::Observed(30.0),
    Search::Observed(10.0),
    Search::Observed(3.0),
    Search::Rough,
    // Again where the plan of the one before does not hold at its end.
    Search::Final,
    Search::Final,
    Search::Final,
];
/// The first search without an observer.
pub(super) const FIRST_FREE: usize = 4;
/// The last.
pub(super) const LAST: usize = SEARCHES.len() - 1;

impl Search {
    /// Rate of the observer [1/s]; 0 without one.
    pub(super) fn observer(self) -> f64 {
        match self {
            Self::Observed(rate) => rate,
            Self::Rough | Self::Final => 0.0,
        }
    }

    /// What this search, begun at `anchor`, makes small. It follows from `anchor` alone, so that an interrupted search goes on with it.
    pub(super) fn at<'e, 'a>(self, evaluator: &'e Evaluator<'a>, anchor: &[f64], stated: Option<Steps>) -> At<'e, 'a> {
        let observer = self.observer();
        let plan = match self {
            Self::Observed(_) | Self::Rough => evaluator.rough_plan(anchor, observer),
            Self::Final => evaluator.final_plan(anchor, stated),
        };
        evaluator.at(Resolution { plan, observer })
    }

    /// When this search ends, after so many `iterations` of those before.
    pub(super) fn limits(self, options: &Options, iterations: usize) -> Limits {
        /// With an observer the minimum is another one anyway: so many iterations, to this share of the cost.
        const OBSERVED: (usize, f64) = (20, 1e-2);
        /// The final search goes on from there.
        const ROUGHLY: f64 = 100.0;
        let left = options.iterations.saturating_sub(iterations).max(1);
        match self {
            Self::Observed(_) => Limits::of_squares(OBSERVED.0.min(left), OBSERVED.1),
            Self::Rough if options.end == End::Exact => Limits::of_squares(left, ROUGHLY * options.tolerance),
            Self::Rough | Self::Final => Limits::of_squares(left, options.tolerance),
        }
    }
}
