//! What the measured motion tells of the parameters.
//!
//! Unknown are the base parameters of the links (the leading one of each combination) and the effects' parameters. The
//! regressor of both along the measured motion, each row over the standard deviation of what no torque law of its joint
//! explains, promises standard errors. Those above a parameter's size are open. A direction that no motion reveals (a scale
//! that gain, stiffness and inertia share) is taken out first: one of its parameters counts as known.

use dynid_model::Parameter;
use dynid_optimise::identifiability::standing;
use dynid_plan::{
    PlanError,
    base::{base_parameters, factors, independent},
    linear::{LinearParameters, Motion, Regressor},
    unidentifiable::{Circumstances, unidentifiable_directions},
};
use dynid_random::Random;
use dynid_user_model::Model;
use nalgebra::DMatrix;
use serde::Serialize;

use crate::{
    Unanswered, balance::Balance, least_squares::independent as independent_errors, unanswered::OpenParameter,
};

/// What the motion tells of the parameters.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Identifiability {
    /// Each combination of unknowns that the free joints can reveal.
    pub parameters: Vec<ExpectedParameter>,
    /// Largest over smallest singular value of the regressor, columns scaled to one length.
    pub condition: f64,
    /// Directions that no motion of these joints reveals.
    pub unidentifiable: Vec<Direction>,
}

/// What is known of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ExpectedParameter {
    /// The parameter, and whether it is open.
    #[serde(flatten)]
    pub parameter: OpenParameter,
    /// Whether its standard error is above its size, or there is none.
    pub is_open: bool,
}

/// A direction in which no motion tells anything.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Direction {
    /// Whether everything in it grows in one proportion.
    pub is_scale: bool,
    /// Parameters of which any one, once fixed, removes it.
    pub fix_one_of: Vec<String>,
}

impl Identifiability {
    /// What it leaves unanswered.
    pub fn unanswered(&self) -> Vec<Unanswered> {
        let open = self.parameters.iter().filter(|own| own.is_open);
        let open: Vec<OpenParameter> = open.map(|own| own.parameter.clone()).collect();
        let directions = self
            .unidentifiable
            .iter()
            .map(|own| Unanswered::NoMotionReveals { is_scale: own.is_scale, fix_one_of: own.fix_one_of.clone() });
        let left_open =
            (!open.is_empty()).then_some(Unanswered::LeftOpen { parameters: open, of: self.parameters.len() });
        left_open.into_iter().chain(directions).collect()
    }
}

/// One unknown.
struct Unknown {
    name: String,
    value: f64,
    /// Standard errors above it leave the parameter open; `None` where any value is like another, as of a position.
    size: Option<f64>,
    source: Source,
}

/// Where the column of an unknown comes from.
enum Source {
    /// A column of the linear regressor.
    Linear(usize),
    /// An effect's parameter, by its name.
    Effect,
}

/// `None` without a balance or an unknown.
///
/// # Errors
/// Free joints whose directions cannot be analysed.
pub fn of(model: &Model, balances: &[Balance<'_>]) -> Result<Option<Identifiability>, PlanError> {
    if balances.is_empty() {
        return Ok(None);
    }
    let mut free: Vec<Vec<usize>> = balances.iter().map(|own| own.run.free.clone()).collect();
    free.sort_unstable();
    free.dedup();
    let base = base_parameters(model, &free)?;
    let of_run = |own: &Balance<'_>| Circumstances { free: own.run.free.clone(), payload: own.run.payload.clone() };
    let mut circumstances: Vec<Circumstances> = balances.iter().map(of_run).collect();
    circumstances.sort_unstable();
    circumstances.dedup();
    let unidentifiable: Vec<Direction> = unidentifiable_directions(model, &circumstances, &base)?
        .into_iter()
        .map(|own| Direction { is_scale: own.is_scale(), fix_one_of: own.fix_one_of })
        .collect();
    let known: Vec<&String> = unidentifiable.iter().filter_map(known_of).collect();
    let systems: Vec<_> = balances.iter().map(|own| own.system.clone()).collect();
    let linear = LinearParameters::of_model(model, &systems);
    let ideal = Ideal::new(&linear, balances);
    let unknowns = unknowns(model, &linear, &ideal, balances, &known);
    if unknowns.is_empty() {
        return Ok(None);
    }
    let rows = weighted(&linear, balances, &unknowns);
    if rows.nrows() == 0 {
        return Ok(None);
    }
    let factor = rows.clone().qr().r();
    let noise = factor.transpose() * &factor;
    let scale: Vec<f64> = unknowns.iter().map(|own| own.size.unwrap_or(1.0)).collect();
    let standing = standing(&factor, &noise, &scale);
    let parameters = unknowns
        .iter()
        .enumerate()
        .map(|(index, own)| {
            let std_error = standing.std_error[index].filter(|error| error.is_finite());
            let is_open = match (std_error, own.size) {
                (None, _) => true,
                (Some(error), Some(size)) => error > size,
                (Some(_), None) => false,
            };
            let joint = match own.source {
                Source::Linear(column) if column < linear.n_link => ideal.joint_of(column),
                _ => joint_of(&own.name).unwrap_or(0),
            };
            let parameter = OpenParameter { name: own.name.clone(), value: own.value, std_error, joint };
            ExpectedParameter { parameter, is_open }
        })
        .collect();
    Ok(Some(Identifiability { parameters, condition: standing.condition, unidentifiable }))
}

/// The parameter that is taken for known so that a direction vanishes: a gain, which a bench measures, before others.
fn known_of(direction: &Direction) -> Option<&String> {
    let gain = direction.fix_one_of.iter().find(|name| name.contains(".gain."));
    gain.or_else(|| direction.fix_one_of.first())
}

/// What the richest motion of the same joints at the same poses would show.
struct Ideal {
    rows: DMatrix<f64>,
    /// The joint of each row.
    joints: Vec<usize>,
}

impl Ideal {
    fn new(linear: &LinearParameters, balances: &[Balance<'_>]) -> Self {
        let n_columns = linear.names.len();
        let mut random = Random::new(37);
        let mut blocks = Vec::new();
        let mut joints = Vec::new();
        for own in balances {
            let n = own.system.n_free();
            let n_motions = (n_columns + 10).div_ceil(n * balances.len()).max(4);
            let mut regressor = Regressor::of_system(&own.system, linear);
            let mut rows = DMatrix::zeros(n_motions * n, n_columns);
            for motion in 0..n_motions {
                regressor.rows(&Motion::random(n, &mut random), &mut rows, motion * n);
                joints.extend(&own.run.free);
            }
            blocks.push(rows);
        }
        let mut rows = DMatrix::zeros(joints.len(), n_columns);
        let mut first = 0;
        for block in blocks {
            rows.rows_mut(first, block.nrows()).copy_from(&block);
            first += block.nrows();
        }
        Self { rows, joints }
    }

    /// The joint farthest from the base whose torque shows the column: it is the lightest, and shows it most.
    fn joint_of(&self, column: usize) -> usize {
        let shows = |row: &usize| self.rows[(*row, column)] != 0.0;
        (0..self.joints.len()).filter(shows).map(|row| self.joints[row]).max().unwrap_or(0)
    }
}

fn unknowns(
    model: &Model,
    linear: &LinearParameters,
    ideal: &Ideal,
    balances: &[Balance<'_>],
    known: &[&String],
) -> Vec<Unknown> {
    let is_unknown =
        |name: &String| !known.contains(&name) && model.parameter(name).is_some_and(|parameter| !parameter.fixed);
    let link_is_unknown = |column: usize| model.links[column / 10].iter().any(|parameter| !parameter.fixed);
    let columns: Vec<usize> = (0..linear.names.len())
        .filter(|&column| ideal.rows.column(column).amax() > 0.0)
        .filter(|&column| match column < linear.n_link {
            true => link_is_unknown(column),
            false => is_unknown(&linear.names[column]),
        })
        .collect();
    let rows = ideal.rows.select_columns(&columns);
    let leading = independent(&rows);
    let dependent: Vec<usize> = (0..columns.len()).filter(|column| !leading.contains(column)).collect();
    let factors = factors(&rows, &leading, &dependent);
    let values = linear.values(model);
    let mut unknowns: Vec<Unknown> = leading
        .iter()
        .enumerate()
        .map(|(row, &index)| {
            let others: Vec<usize> = (0..dependent.len()).filter(|&other| factors[(row, other)].abs() > 1e-9).collect();
            let sum: f64 = others.iter().map(|&other| factors[(row, other)] * values[columns[dependent[other]]]).sum();
            let own = &linear.names[columns[index]];
            let name = format!("{own}{}", if others.is_empty() { "" } else { " + .." });
            let size = own.starts_with("joint.").then(|| model.parameter(own)).flatten();
            let size = size.and_then(|parameter| size_of(model, own, &parameter));
            Unknown { name, value: values[columns[index]] + sum, size, source: Source::Linear(columns[index]) }
        })
        .collect();
    // A combination that is small beside others of its kind need not be known better than a tenth of those.
    let kind = |name: &str| match name.split('.').nth(2).unwrap_or("") {
        symbol if symbol.starts_with('J') => 2,
        symbol if symbol.starts_with("mx") || symbol.starts_with("my") || symbol.starts_with("mz") => 1,
        _ => 0,
    };
    let largest = |of: u8| {
        let links = unknowns.iter().filter(|own| own.name.starts_with("link.") && kind(&own.name) == of);
        links.fold(0.0_f64, |most, own| most.max(own.value.abs()))
    };
    let largest = [largest(0), largest(1), largest(2)];
    for own in unknowns.iter_mut().filter(|own| own.name.starts_with("link.")) {
        own.size = Some(own.value.abs().max(0.1 * largest[usize::from(kind(&own.name))])).filter(|size| *size > 0.0);
    }
    let mut effects: Vec<&String> = balances.iter().flat_map(|own| own.system.effect_names()).collect();
    effects.sort();
    effects.dedup();
    for name in effects.into_iter().filter(|name| !linear.names.contains(name) && is_unknown(name)) {
        let Some(parameter) = model.parameter(name) else { continue };
        let size = size_of(model, name, &parameter);
        unknowns.push(Unknown { name: name.clone(), value: parameter.value, size, source: Source::Effect });
    }
    unknowns
}

/// Size of an effect's parameter: its value or its file's first guess; `None` where that is 0.
fn size_of(model: &Model, name: &str, parameter: &Parameter) -> Option<f64> {
    let initial = model.effects.iter().find_map(|own| {
        let index = (0..own.parameters.len()).find(|index| own.parameter_name(*index) == name)?;
        Some(own.effect.parameters[index].initial.abs())
    })?;
    (initial > 0.0).then(|| initial.max(parameter.value.abs()))
}

/// Rows along the measured motions, over the standard deviation of an independent error.
fn weighted(linear: &LinearParameters, balances: &[Balance<'_>], unknowns: &[Unknown]) -> DMatrix<f64> {
    /// Rows that are enough to see what a motion tells.
    const MOST_ROWS: usize = 8000;
    /// What no law explains is never taken for less than this share of the torque.
    const LEAST_NOISE: f64 = 1e-6;
    let used = |own: &Balance<'_>, slot: usize| own.errors[slot].n_used();
    let samples: usize =
        balances.iter().map(|own| (0..own.run.free.len()).map(|slot| used(own, slot)).sum::<usize>()).sum();
    let stride = samples.div_ceil(MOST_ROWS).max(1);
    let mut stacked: Vec<f64> = Vec::new();
    for own in balances {
        let n = own.system.n_free();
        let weights: Vec<f64> = (0..n)
            .map(|slot| {
                let left = own.left(slot);
                if left.is_empty() {
                    return 0.0;
                }
                let rms =
                    |values: &[f64]| (values.iter().map(|own| own * own).sum::<f64>() / values.len() as f64).sqrt();
                let torque = rms(&own.errors[slot].torque);
                let noise = rms(&left).max(LEAST_NOISE * torque).max(f64::MIN_POSITIVE) * own.linear[slot].slope.abs();
                // Each row stands for so many that are independent.
                (independent_errors(&left) / left.len() as f64 * stride as f64).sqrt() / noise
            })
            .collect();
        let mut regressor = Regressor::of_system(&own.system, linear);
        let mut rows = DMatrix::zeros(n, linear.names.len());
        for (index, &k) in own.motion.kept.iter().enumerate().step_by(stride) {
            if (0..n).all(|slot| !own.motion.used[slot][index]) {
                continue;
            }
            let at = |signal: &[Vec<f64>]| signal.iter().map(|values| values[k]).collect::<Vec<f64>>();
            let (q, dq, ddq) = (at(&own.motion.q), at(&own.motion.dq), at(&own.motion.ddq));
            regressor.rows(&Motion { t: own.motion.elapsed_s(k), q, dq, ddq }, &mut rows, 0);
            for slot in (0..n).filter(|slot| own.motion.used[*slot][index]) {
                for unknown in unknowns {
                    let value = match unknown.source {
                        Source::Linear(column) => rows[(slot, column)],
                        Source::Effect => {
                            let place = own.system.effect_names().iter().position(|name| *name == unknown.name);
                            let column = place.and_then(|place| own.linear[slot].by_parameter[place].as_ref());
                            column.map_or(0.0, |column| -column[index] * own.linear[slot].slope)
                        }
                    };
                    stacked.push(value * weights[slot]);
                }
            }
        }
    }
    DMatrix::from_row_slice(stacked.len() / unknowns.len(), unknowns.len(), &stacked)
}

/// The joint that an effect's parameter belongs to.
pub fn joint_of(name: &str) -> Option<usize> {
    name.strip_prefix("joint.")?.split('.').next()?.parse().ok()
}
