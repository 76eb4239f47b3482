//! The searches that a fit consists of, each starting where the one before ended.

use super::{
    Options,
    evaluate::{At, Evaluator, Resolution},
};
use dynid_dynamics::simulate::Steps;
use dynid_optimise::sqp::Limits;

/// One search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Search {
    /// With few integration steps, the simulation pulled to the log at this rate [1/s].
    Observed(f64),
    /// With few integration steps.
    Coarse,
    /// With few integration steps, plus what the stated step made of the positions where the search begins.
    Corrected,
    /// With the stated step: nothing is searched any more, only judged.
    Fine,
}

/// In this order.
pub(super) const SEARCHES: [Search; 9] = [
    Search::Observed(100.0),
    Search::Observed(30.0),
    Search::Observed(10.0),
    Search::Observed(3.0),
    Search::Coarse,
    // The correction is that of where a search begins: it is renewed until nothing moves.
    Search::Corrected,
    Search::Corrected,
    Search::Corrected,
    Search::Fine,
];
/// The first search without an observer.
pub(super) const FIRST_FREE: usize = 4;
/// The last, which judges.
pub(super) const LAST: usize = SEARCHES.len() - 1;

impl Search {
    /// Rate of the observer [1/s]; 0 without one.
    pub(super) fn observer(self) -> f64 {
        match self {
            Self::Observed(rate) => rate,
            Self::Coarse | Self::Corrected | Self::Fine => 0.0,
        }
    }

    /// What this search, begun at `anchor`, makes small: with `coarse` integration steps where few do, else
    /// with `fine` ones.
    pub(super) fn at<'e, 'a>(
        self,
        evaluator: &'e Evaluator<'a>,
        anchor: &[f64],
        coarse: Steps,
        fine: Steps,
    ) -> At<'e, 'a> {
        let rough =
            Resolution { horizon_s: f64::INFINITY, steps: coarse, jacobian_steps: coarse, observer: self.observer() };
        match self {
            Self::Observed(_) | Self::Coarse => evaluator.at(rough),
            Self::Corrected => evaluator.corrected(rough, fine, anchor),
            Self::Fine => evaluator.at(Resolution { steps: fine, ..rough }),
        }
    }

    /// When this search ends, after so many `iterations` of those before.
    pub(super) fn limits(self, options: &Options, iterations: usize) -> Limits {
        /// With an observer the minimum is another one anyway.
        const OBSERVED: Limits = Limits { iterations: 20, tolerance: 1e-2 };
        /// The corrected search goes on from there.
        const ROUGHLY: f64 = 100.0;
        let left = options.iterations.saturating_sub(iterations).max(1);
        match self {
            Self::Observed(_) => Limits { iterations: OBSERVED.iterations.min(left), ..OBSERVED },
            Self::Coarse => Limits { iterations: left, tolerance: ROUGHLY * options.tolerance },
            Self::Corrected | Self::Fine => Limits { iterations: left, tolerance: options.tolerance },
        }
    }
}

/// Whether a simulation with `coarse` steps stays so near the logs that it needs no observer.
pub(super) fn is_near(evaluator: &Evaluator<'_>, x: &[f64], coarse: Steps) -> bool {
    /// Root mean square of the error over the noise.
    const NEAR: f64 = 10.0;
    let at = Search::Coarse.at(evaluator, x, coarse, coarse);
    at.data_cost(x).is_some_and(|cost| 2.0 * cost <= NEAR * NEAR * at.samples() as f64)
}
