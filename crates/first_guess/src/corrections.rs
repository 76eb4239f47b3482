//! What the device's own values say of units, signs and timing, as `dynid_check` finds it, put into the guess.
//!
//! One kind of correction is made at a time, and the rest is asked anew: what is in a wrong unit has no sign, and what has a
//! wrong sign has no timing.

use dynid_check::{Finding, FindingKind, balance, balance::Balance, columns, finding::DegreesBecause};
use dynid_dynamics::{simulate::Intersample, system::SystemError};
use dynid_logs::{experiment::Run, quality};
use dynid_model::{Device, JointKind};
use dynid_user_model::Model;

use crate::guess::{Factor, FactorReason, Remark};
use crate::{ColumnGuess, FirstGuess, Quantity};

/// Corrects `runs` and `guess` alike; `not_commands` says what the torque column of each joint holds where that is not the joint's command.
pub(crate) fn apply(
    device: &'static Device,
    runs: &mut [Run],
    guess: &mut FirstGuess,
    not_commands: &[Option<Quantity>],
) -> Result<(), SystemError> {
    let model = Model::of_device(device);
    let mut is_torque_known = not_commands.iter().all(Option::is_none);
    loop {
        let balances = balances(&model, runs)?;
        let findings = findings(&model, runs, &balances);
        let factors = degrees(device, guess, &findings, is_torque_known)
            .or_else(|| if is_torque_known { None } else { Some(needed(guess, runs, &balances, not_commands)) })
            .or_else(|| thousand(guess, runs, &findings))
            .or_else(|| signs(guess, runs, &findings));
        drop(balances);
        if let Some(Correction { factors, is_of_torque }) = factors {
            is_torque_known |= is_of_torque;
            factors.into_iter().for_each(|(logical, factor)| put(guess, runs, &logical, factor));
        } else if !guess.is_straight && looks_straight(runs, &findings) {
            guess.is_straight = true;
            runs.iter_mut().for_each(|run| run.settings.intersample = Intersample::FirstOrder);
        } else {
            guess.findings = findings.into_iter().filter(|own| is_open(guess, own)).collect();
            return Ok(());
        }
    }
}

/// Whether a finding still asks something: a position whose unit was found is not in degrees once more.
fn is_open(guess: &FirstGuess, finding: &Finding) -> bool {
    let is_decided =
        |column: &ColumnGuess| column.kind() == "q" && column.joint() == finding.joint && !column.factors.is_empty();
    !(matches!(finding.kind, FindingKind::Degrees { .. }) && guess.columns.iter().any(is_decided))
}

/// Factors on columns of the project's names.
struct Correction {
    factors: Vec<(String, Factor)>,
    /// Whether they make torques of what were none.
    is_of_torque: bool,
}

impl Correction {
    fn of(factors: Vec<(String, Factor)>) -> Option<Self> {
        (!factors.is_empty()).then_some(Self { factors, is_of_torque: false })
    }
}

fn balances<'a>(model: &Model, runs: &'a [Run]) -> Result<Vec<Balance<'a>>, SystemError> {
    let of = |run: &'a Run| Balance::of(model, run).map(Result::ok).transpose();
    runs.iter().filter_map(of).collect()
}

fn findings(model: &Model, runs: &[Run], balances: &[Balance<'_>]) -> Vec<Finding> {
    let of_columns = runs.iter().flat_map(|run| columns::findings(model.device, run, &quality::of_run(run)));
    let mut findings: Vec<Finding> = of_columns.collect();
    findings.extend(balance::findings(model, balances));
    findings
}

/// Positions in degrees: who logs one angle so logs all so.
fn degrees(device: &Device, guess: &FirstGuess, findings: &[Finding], is_torque_known: bool) -> Option<Correction> {
    let finding = findings.iter().map(|own| &own.kind).find(|kind| match kind {
        FindingKind::Degrees { because: DegreesBecause::Torque { .. }, .. } => is_torque_known,
        FindingKind::Degrees { .. } => true,
        _ => false,
    })?;
    let is_angle = |column: &&ColumnGuess| {
        let joint = column.joint().filter(|joint| device.joints[*joint].kind == JointKind::Revolute);
        joint.is_some() && matches!(column.kind(), "q" | "ref") && column.factors.is_empty() && column.turn.is_none()
    };
    let reason = FactorReason::Finding { finding: finding.clone() };
    let factor = Factor { factor: std::f64::consts::PI / 180.0, reason };
    let columns = guess.columns.iter().filter(is_angle);
    Correction::of(columns.map(|column| (column.logical.clone(), factor.clone())).collect())
}

/// Currents or voltages: the torque that their unit makes, as far as the device's values tell.
/// A joint that moves in no run needs none.
fn needed(
    guess: &mut FirstGuess,
    runs: &[Run],
    balances: &[Balance<'_>],
    not_commands: &[Option<Quantity>],
) -> Correction {
    /// The torque must be the motion's to be judged by.
    const SURE: f64 = 0.7;
    let mut factors = Vec::new();
    for column in guess.columns.iter().filter(|column| column.kind() == "tau") {
        let Some(joint) = column.joint().filter(|joint| is_ever_free(runs, *joint)) else { continue };
        let Some(quantity) = not_commands[joint] else { continue };
        let of_run = |own: &Balance<'_>| {
            let slot = own.run.free.iter().position(|free| *free == joint)?;
            balance::ratio(own, slot)
        };
        let told: Vec<(f64, f64)> = balances.iter().filter_map(of_run).collect();
        let surest = told.into_iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        match surest {
            Some((ratio, correlation)) if correlation.abs() > SURE => {
                let reason = FactorReason::Needed { quantity, correlation };
                factors.push((column.logical.clone(), Factor { factor: three_digits(1.0 / ratio), reason }));
            }
            _ => guess.remarks.push(Remark::UnknownFactor { column: column.name.clone(), quantity, joint }),
        }
    }
    Correction { factors, is_of_torque: true }
}

/// Torques in thousandths, where most joints that move say so.
fn thousand(guess: &FirstGuess, runs: &[Run], findings: &[Finding]) -> Option<Correction> {
    const MILLI: f64 = 1e-3;
    let of = |joint: usize| {
        findings.iter().find(|own| {
            own.joint == Some(joint) && matches!(own.kind, FindingKind::Thousand { factor } if factor > 1.0)
        })
    };
    let free: Vec<usize> = (0..runs[0].log.q.len()).filter(|joint| is_ever_free(runs, *joint)).collect();
    let found: Vec<&Finding> = free.iter().filter_map(|joint| of(*joint)).collect();
    let finding = found.first().filter(|_| 2 * found.len() > free.len())?;
    let factor = Factor { factor: MILLI, reason: FactorReason::Finding { finding: finding.kind.clone() } };
    let columns = guess.columns.iter().filter(|column| column.kind() == "tau" && column.scale().abs() == 1.0);
    Correction::of(columns.map(|column| (column.logical.clone(), factor.clone())).collect())
}

/// Torques against the motion, in more than half of the runs in which the joint is free.
fn signs(guess: &FirstGuess, runs: &[Run], findings: &[Finding]) -> Option<Correction> {
    let wrong = |column: &ColumnGuess| {
        let joint = column.joint().filter(|_| column.kind() == "tau" && column.scale() > 0.0)?;
        let own =
            findings.iter().filter(|own| own.joint == Some(joint) && matches!(own.kind, FindingKind::WrongSign { .. }));
        let own: Vec<&Finding> = own.collect();
        let n_free = runs.iter().filter(|run| run.free.contains(&joint)).count();
        let finding = own.first().filter(|_| 2 * own.len() > n_free)?;
        let reason = FactorReason::Finding { finding: finding.kind.clone() };
        Some((column.logical.clone(), Factor { factor: -1.0, reason }))
    };
    Correction::of(guess.columns.iter().filter_map(wrong).collect())
}

/// Whether most torques run straight from row to row.
fn looks_straight(runs: &[Run], findings: &[Finding]) -> bool {
    let straight = findings
        .iter()
        .filter(|own| matches!(own.kind, FindingKind::Hold { looks: Intersample::FirstOrder, .. }))
        .count();
    2 * straight > runs.iter().map(|run| run.free.len()).sum()
}

fn is_ever_free(runs: &[Run], joint: usize) -> bool {
    runs.iter().any(|run| run.free.contains(&joint))
}

fn put(guess: &mut FirstGuess, runs: &mut [Run], logical: &str, factor: Factor) {
    for column in guess.columns.iter_mut().filter(|column| column.logical == logical) {
        let (Some(joint), kind) = (column.joint(), column.kind().to_owned()) else { continue };
        for run in runs.iter_mut() {
            let values = match (kind.as_str(), &mut run.log.reference) {
                ("q", _) => Some(&mut run.log.q[joint]),
                ("tau", _) => Some(&mut run.log.tau[joint]),
                (_, reference) => reference.as_mut().map(|reference| &mut reference[joint]),
            };
            values.into_iter().flatten().for_each(|value| *value *= factor.factor);
        }
        column.factors.push(factor.clone());
    }
}

fn three_digits(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}
