//! How finely the runs of a fit are integrated.

use rayon::prelude::*;

use super::evaluate::{Evaluator, Ready, Resolution};
use crate::plan::{Plan, WORTH_STEPS};
use dynid_dynamics::simulate::{Grid, Planned, Scheme, Steps};

/// What an interval may err by on the way, in units of the noise: corrected at each sample, and free.
const OBSERVED: f64 = 0.3;
const ROUGHLY: f64 = 0.05;
/// What integration may move a position by in the end, in units of the noise.
const FINALLY: f64 = 0.01;
/// Share of that which an interval may err by at first: errors add up.
const OF_INTERVAL: f64 = 0.2;
/// A joint reverses a little earlier or later as a search goes on: so many intervals on either side are ready for it.
const REACH: usize = 2;
/// A plan holds as long as no position has moved by more than this, in units of the noise, from where it was made.
const HOLDS: f64 = 1.0;
/// To these shares it is cut what an interval may err by.
const LEAST_CUT: f64 = 0.03;
const MOST_CUT: f64 = 0.5;
/// Plans that are tried at most.
const TRIES: usize = 6;
/// Steps of a sample that are tried where no plan is exact: the thesis's.
const EVERYWHERE: usize = 60;

impl Evaluator<'_> {
    /// A plan for searches on the way.
    pub(super) fn rough_plan(&self, x: &[f64], observer: f64) -> Plan {
        let off = if observer > 0.0 { OBSERVED } else { ROUGHLY };
        self.planned(x, observer, |ready| ready.tolerance(off)).map(|(plan, _)| plan).unwrap_or_default()
    }

    /// The plan that decides: as stated, or the cheapest found that moves no position by more than a hundredth of the noise. Where motions
    /// part whatever the steps, that which moves them least.
    pub(super) fn final_plan(&self, x: &[f64], stated: Option<Steps>) -> Plan {
        match stated {
            Some(Steps::PerSample(steps)) => self.uniform(steps),
            Some(Steps::Within(share)) => {
                let planned = self.planned(x, 0.0, |ready| ready.share_of_motion(share));
                planned.map(|(plan, _)| plan).unwrap_or_default()
            }
            None => self.exact_plan(x),
        }
    }

    fn exact_plan(&self, x: &[f64]) -> Plan {
        let (mut least, mut best) = (f64::INFINITY, Plan::default());
        let mut is_better = |off: f64, plan: Plan| {
            let is_better = off <= FINALLY || off < WORTH_STEPS * least;
            if is_better {
                (least, best) = (off, plan);
            }
            is_better
        };
        let mut cut = 1.0;
        let mut is_exact = false;
        for _ in 0..TRIES {
            let planned = self.planned(x, 0.0, |ready| ready.tolerance(cut * OF_INTERVAL * FINALLY));
            let Some((plan, simulated)) = planned else { break };
            let off = self.moved_by_halving(x, &plan, &simulated);
            is_exact = off <= FINALLY;
            if !is_better(off, plan) || is_exact {
                break;
            }
            cut *= (FINALLY / off).clamp(LEAST_CUT, MOST_CUT);
        }
        if !is_exact {
            // Where friction holds and lets go, many explicit steps find their way that implicit ones do not.
            let resolution = Resolution { plan: self.uniform(EVERYWHERE), observer: 0.0 };
            let simulated = self.simulated(x, &resolution);
            let off =
                simulated.map_or(f64::INFINITY, |simulated| self.moved_by_halving(x, &resolution.plan, &simulated));
            is_better(off, resolution.plan);
        }
        best
    }

    /// So many explicit steps in a sample time.
    fn uniform(&self, steps: usize) -> Plan {
        let of_run = |ready: &Ready<'_>| Grid::new(&ready.run.time, steps).schemes(&ready.run.time);
        Plan::new(self.ready.iter().map(of_run).collect())
    }

    /// Whether a plan that was made at `anchor` does at `x`, too. One that is the same everywhere is made for no motion.
    pub(super) fn holds(&self, resolution: &Resolution, anchor: &[f64], x: &[f64]) -> bool {
        if resolution.plan == self.uniform(EVERYWHERE) {
            return true;
        }
        let (before, after) = (self.simulated(anchor, resolution), self.simulated(x, resolution));
        before.zip(after).is_some_and(|(before, after)| self.apart(&before, &after) <= HOLDS)
    }

    /// By how much, in units of the noise, steps of half the length move a position at most.
    fn moved_by_halving(&self, x: &[f64], plan: &Plan, simulated: &[Vec<f64>]) -> f64 {
        let halved = Resolution { plan: plan.halved(), observer: 0.0 };
        self.simulated(x, &halved).map_or(f64::INFINITY, |fine| self.apart(simulated, &fine))
    }

    /// How far two simulations of all runs are apart at most, in units of the noise.
    fn apart(&self, one: &[Vec<f64>], other: &[Vec<f64>]) -> f64 {
        let of_run = |(ready, (one, other)): (&Ready<'_>, (&Vec<f64>, &Vec<f64>))| {
            let n_free = ready.weights.len();
            let pairs = one.iter().zip(other).enumerate();
            pairs.map(|(index, (one, other))| (one - other).abs() * ready.weights[index % n_free]).fold(0.0, f64::max)
        };
        self.ready.iter().zip(one.iter().zip(other)).map(of_run).fold(0.0, f64::max)
    }

    /// A plan of which each interval errs by no more than a tolerance of each free joint, and what is simulated before intervals are made
    /// ready for what moves: it errs by no less.
    fn planned(
        &self,
        x: &[f64],
        observer: f64,
        tolerance: impl Fn(&Ready<'_>) -> Vec<f64> + Sync,
    ) -> Option<(Plan, Vec<Vec<f64>>)> {
        let of_run = |ready: &Ready<'_>| ready.plan(x, observer, &tolerance(ready)).ok();
        let found: Option<Vec<Planned>> = self.ready.par_iter().map(of_run).collect();
        let (schemes, simulated): (Vec<Vec<Scheme>>, _) =
            found?.into_iter().map(|Planned { schemes, predicted }| (schemes, predicted)).unzip();
        let plan = Plan::new(schemes).spread(REACH);
        Some((plan, simulated))
    }
}

impl Ready<'_> {
    /// So much of each free joint's noise, over its weight [rad or m].
    pub(super) fn tolerance(&self, off: f64) -> Vec<f64> {
        self.weights.iter().map(|weight| off / weight.max(f64::MIN_POSITIVE)).collect()
    }

    /// So much of the largest position of each free joint [rad or m].
    fn share_of_motion(&self, share: f64) -> Vec<f64> {
        let largest = |slot: usize| self.run.measured(slot).into_iter().fold(0.0_f64, |most, q| most.max(q.abs()));
        (0..self.weights.len()).map(|slot| share * largest(slot)).collect()
    }
}
