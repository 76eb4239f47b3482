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

mod follow;
mod region;
mod spectrum;
#[cfg(test)]
mod tests;
mod trace;

use dynid_model::Device;
use rayon::prelude::*;
use serde::Serialize;

use trace::Trace;

use super::Comparison;
use dynid_logs::experiment::Run;
use dynid_signal::statistics::correlation_time;
use dynid_text::number;
use dynid_user_model::Model;

/// Findings of one joint in one run that are reported, the most telling first.
const MOST: usize = 6;

/// Smaller shares of the squared error are not worth a sentence.
const LEAST_SHARE: f64 = 0.03;

/// One thing that is known of where an error lies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The run, as the experiment names it.
    pub run: String,
    /// The device's joint index.
    pub joint: usize,
    /// One sentence with numbers.
    pub what: String,
    /// What it is about.
    pub kind: FindingKind,
    /// Share of the squared error, 0 to 1: what lies there, or what a regression on it explains.
    pub share: f64,
    /// What that share would be by chance.
    pub expected: f64,
    /// Which error it is about.
    pub error: Signal,
    /// The other joint, where one has to do with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub other: Option<usize>,
    /// What `kind` leaves open: which signal it follows, on which side or in which part it lies.
    #[serde(skip)]
    about: String,
    /// From and to which frequency it lies (Hz), where it is about frequencies.
    #[serde(skip)]
    band_hz: Option<[f64; 2]>,
    /// Index of the run, for two may have one log.
    #[serde(skip)]
    run_index: usize,
    /// By which findings are ordered.
    #[serde(skip)]
    rank: f64,
}

impl Finding {
    /// Whether it says of its joint what `other` says, of whichever error and run.
    pub fn says_the_same(&self, other: &Self) -> bool {
        let overlap = match (self.band_hz, other.band_hz) {
            (Some([low, high]), Some([other_low, other_high])) => low <= other_high && other_low <= high,
            _ => true,
        };
        (self.joint, self.kind, self.other, &self.about) == (other.joint, other.kind, other.other, &other.about)
            && overlap
    }

    /// Share beyond chance, of what chance leaves.
    pub fn surplus(&self) -> f64 {
        (self.share - self.expected) / (1.0 - self.expected).max(1e-3)
    }

    /// What an error follows says more than where it lies, and that more than its frequency.
    fn ranked(mut self) -> Self {
        let telling = match self.kind {
            FindingKind::Band | FindingKind::PartOfRun => 0.25,
            FindingKind::Beat
            | FindingKind::Reversal
            | FindingKind::LowSpeed
            | FindingKind::HighSpeed
            | FindingKind::HighLoad
            | FindingKind::OneSide
            | FindingKind::EndOfRange => 0.7,
            _ => 1.0,
        };
        self.rank = telling * self.surplus();
        self
    }
}

/// Which error is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Commanded torque minus what the measured motion needs.
    Torque,
    /// Measured minus simulated position.
    Position,
}

impl Signal {
    fn name(self) -> &'static str {
        match self {
            Self::Torque => "torque error",
            Self::Position => "position error",
        }
    }
}

/// What a finding is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FindingKind {
    /// A constant.
    Offset,
    /// It has the sign of the speed, as friction has.
    Direction,
    /// It is proportional to the speed.
    Speed,
    /// It is proportional to the speed squared, against it.
    SpeedSquared,
    /// It is proportional to the acceleration, as inertia is.
    Acceleration,
    /// It is proportional to the commanded torque.
    Load,
    /// It has the sign of the commanded torque, as a dead zone has.
    LoadSign,
    /// It is proportional to the size of the load and has the sign of the speed.
    LoadFriction,
    /// It follows the rate of the commanded torque: a lag or delay.
    LoadRate,
    /// It is a smooth function of the position.
    Position,
    /// It repeats with the position.
    PeriodicPosition,
    /// What has the sign of the speed differs between the sides of the rest position.
    SidedFriction,
    /// It follows another joint's position, speed or acceleration.
    OtherMotion,
    /// It follows another joint's commanded torque.
    OtherTorque,
    /// It has the sign of the sum of two joints' speeds.
    CommonDirection,
    /// It drifts during the run.
    Drift,
    /// Its mean differs between runs.
    BetweenRuns,
    /// It lies near reversals of the speed.
    Reversal,
    /// It lies at low speed.
    LowSpeed,
    /// It lies at high speed.
    HighSpeed,
    /// It lies at large commanded torque.
    HighLoad,
    /// It lies on one side of the rest position.
    OneSide,
    /// It lies at the ends of the range of positions.
    EndOfRange,
    /// It lies in one part of the run.
    PartOfRun,
    /// It lies in one band of frequencies.
    Band,
    /// Two near frequencies that beat.
    Beat,
}

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
        more.what.push_str(&format!(
            "; the {} says the same ({:.0} % of its square)",
            less.error.name(),
            100.0 * less.share
        ));
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
            let what = format!(
                "the mean {} differs between runs: {} {} here, {} over all ({:.0} % of the squared error, {:.1} % by chance)",
                farthest.error.name(),
                number(*mean),
                farthest.unit,
                number(overall),
                100.0 * share,
                100.0 * expected
            );
            findings.push(farthest.finding(FindingKind::BetweenRuns, what, share, expected));
        }
    }
    findings
}

/// The unit of positions, and that of commands, at a joint.
fn units(device: &Device, joint: usize) -> (&'static str, &str) {
    let own = &device.joints[joint];
    (if own.kind == dynid_model::JointKind::Prismatic { "m" } else { "rad" }, &own.command_unit)
}
