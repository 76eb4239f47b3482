//! Where model and log part: what the error of a joint follows, and where in the run it lies.
//!
//! Each finding is a share of the squared error beside the share that chance would give, and is reported only where chance
//! gives it in less than about one case of 100 000. Two questions are asked of every error:
//!
//! - *what does it follow?* Signals at hand (speed, its sign, position, load, the other joints' motion and torque, time) are
//!   taken into a regression one after another, the one that explains most first, so that what merely goes along with an
//!   earlier one is not told again; what would have explained nearly as much is named beside it (`follow`);
//! - *where does it lie?* Shares near reversals, at low and high speed, at high load, on one side of the rest position, early
//!   and late in the run, in a band of frequencies (`region`, `spectrum`).
//!
//! The torque error is asked where there is one, for it is local in time; the position error, which the mechanism has
//! filtered, is asked besides unless the simulation has lost its log.

mod finding;
mod follow;
mod region;
mod spectrum;
#[cfg(test)]
mod tests;
mod trace;

use dynid_model::Device;
use rayon::prelude::*;

pub use finding::{
    AlsoIn, Finding, FindingKind, OtherSignal, OwnSignal, Region, RegressionStep, Regressor, Side, Signal, Third, Twin,
};
use trace::Trace;

use super::{Comparison, RunComparison};
use dynid_logs::experiment::Run;
use dynid_signal::statistics::correlation_time;
use dynid_user_model::Model;

/// Findings of one joint in one run that are reported, the most telling first.
const MOST: usize = 6;

/// Smaller shares of the squared error are not worth telling.
const LEAST_SHARE: f64 = 0.03;

/// Where the errors of `comparison`, which is of `model` and `runs`, lie: the most telling first.
pub fn locate(model: &Model, runs: &[&Run], comparison: &Comparison) -> Vec<Finding> {
    let traces: Vec<Vec<Trace>> = runs
        .par_iter()
        .zip(&comparison.runs)
        .enumerate()
        .map(|(index, (run, compared))| trace::of_run(model, index, run, compared))
        .collect();
    let traces: Vec<Trace> = traces.into_iter().flatten().collect();
    let mut findings: Vec<Finding> = traces.par_iter().flat_map_iter(of_trace).collect();
    findings.extend(between_runs(&traces));
    let mut findings = twins_together(findings);
    // Stable, so that equal shares keep the order of runs and joints.
    findings.sort_by(|a, b| b.rank.total_cmp(&a.rank));
    findings
}

/// The stretches of time in which the samples of each finding lie, from and to as the log of `run` counts time (s); `None` for a finding
/// that is about all samples. All `findings` are of that run, of which `compared` is the comparison with `model`.
pub fn spans(model: &Model, run: &Run, compared: &RunComparison, findings: &[&Finding]) -> Vec<Option<Vec<[f64; 2]>>> {
    let traces = trace::of_run(model, 0, run, compared);
    let of_finding = |finding: &&Finding| {
        let region = match &finding.kind {
            FindingKind::LiesIn { region, .. } => region.clone(),
            FindingKind::HasSidedFriction { rest, .. } => Region::OneSide { side: Side::Below, rest: *rest },
            _ => return None,
        };
        let is_its = |trace: &&Trace| (trace.joint, trace.error) == (finding.joint, finding.error);
        let trace = traces.iter().find(is_its);
        let inside = trace.and_then(|trace| Some((trace, region::inside(trace, &region)?)));
        Some(inside.map_or(Vec::new(), |(trace, inside)| stretches(&inside, trace.start_s, trace.step)))
    };
    findings.iter().map(of_finding).collect()
}

/// From half a step before the first to half a step after the last of samples that follow each other.
fn stretches(inside: &[bool], start_s: f64, step: f64) -> Vec<[f64; 2]> {
    let time = |edge: usize| start_s + (edge as f64 - 0.5) * step;
    let mut stretches = Vec::new();
    let mut first = 0;
    for alike in inside.chunk_by(|one, next| one == next) {
        if alike[0] {
            stretches.push([time(first), time(first + alike.len())]);
        }
        first += alike.len();
    }
    stretches
}

/// What both errors of a joint in a run say is said once, by the one that says more, with the other's share.
fn twins_together(findings: Vec<Finding>) -> Vec<Finding> {
    let mut reported: Vec<Finding> = Vec::new();
    for finding in findings {
        let twin = reported.iter_mut().find(|other| {
            other.run_index == finding.run_index && other.says_the_same(&finding) && other.error != finding.error
        });
        let Some(twin) = twin else {
            reported.push(finding);
            continue;
        };
        let (mut more, less) =
            if twin.rank >= finding.rank { (twin.clone(), finding) } else { (finding, twin.clone()) };
        more.twin = Some(Twin { error: less.error, share: less.share });
        *twin = more;
    }
    reported
}

/// The same of one error.
fn of_trace(trace: &Trace) -> Vec<Finding> {
    if trace.n_used() < 64 || trace.power() <= 0.0 {
        return Vec::new();
    }
    let mut findings = follow::findings(trace);
    findings.extend(region::findings(trace));
    findings.extend(spectrum::findings(trace));
    findings.retain(|finding| finding.share >= LEAST_SHARE && finding.surplus() > 0.0);
    findings.sort_by(|a, b| b.rank.total_cmp(&a.rank));
    findings.truncate(MOST);
    findings
}

/// Means that differ between runs more than each is uncertain.
fn between_runs(traces: &[Trace]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut seen: Vec<(Signal, usize)> = Vec::new();
    for trace in traces {
        let key = (trace.error, trace.joint);
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        // Run, mean, variance of the mean, samples, squared error.
        let of_runs: Vec<(&Trace, f64, f64, f64)> = traces
            .iter()
            .filter(|other| (other.error, other.joint) == key && other.n_used() >= 64)
            .map(|other| {
                let n_used = other.n_used() as f64;
                let mean = other.mean();
                let variance = (other.power() / n_used - mean * mean).max(0.0);
                (other, mean, variance * correlation_time(&other.centred(), other.n_used()) / n_used, n_used)
            })
            .collect();
        if of_runs.len() < 2 {
            continue;
        }
        let samples: f64 = of_runs.iter().map(|(.., n)| n).sum();
        let power: f64 = of_runs.iter().map(|(trace, ..)| trace.power()).sum();
        let overall = of_runs.iter().map(|(_, mean, _, n)| mean * n).sum::<f64>() / samples;
        let degrees = of_runs.len() - 1;
        // Chi-squared about the mean that makes it smallest: each run's weighed by what it is certain of.
        let certainty = |variance: f64| variance.max(f64::MIN_POSITIVE).recip();
        let certain: f64 = of_runs.iter().map(|(_, _, variance, _)| certainty(*variance)).sum();
        let centre = of_runs.iter().map(|(_, mean, variance, _)| mean * certainty(*variance)).sum::<f64>() / certain;
        let statistic: f64 =
            of_runs.iter().map(|(_, mean, variance, _)| (mean - centre).powi(2) * certainty(*variance)).sum();
        let share = of_runs.iter().map(|(_, mean, _, n)| n * (mean - overall).powi(2)).sum::<f64>() / power;
        let expected = of_runs.iter().map(|(_, _, variance, n)| n * variance).sum::<f64>() / power;
        if statistic < dynid_signal::statistics::critical(degrees, 1) || share < LEAST_SHARE || share < 2.0 * expected {
            continue;
        }
        let farthest = of_runs.iter().max_by(|a, b| (a.1 - overall).abs().total_cmp(&(b.1 - overall).abs()));
        if let Some((farthest, mean, ..)) = farthest {
            let kind = FindingKind::DiffersBetweenRuns { here: *mean, overall };
            findings.push(farthest.finding(kind, share, expected));
        }
    }
    findings
}

/// The unit of positions, and that of commands, at a joint.
fn units(device: &Device, joint: usize) -> (&'static str, &str) {
    let own = &device.joints[joint];
    (if own.kind == dynid_model::JointKind::Prismatic { "m" } else { "rad" }, &own.command_unit)
}
