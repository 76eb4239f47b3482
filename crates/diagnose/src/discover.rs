//! A formula for what no effect of the library explains: sparse regression of the torque error on products of the signals at
//! hand.
//!
//! The model's own parameters are taken out of the torque error and of every candidate column, joint by joint. A few terms are chosen by forward selection with exchanges; what counts is what is chosen
//! again from random halves of the data (stability selection, Meinshausen & Buehlmann 2010), and in the end the runs that
//! were not used decide: there the squared torque error must fall. Where it does not, nothing is written.
//!
//! At most three terms are chosen, must be chosen again from 80 % of random halves, and must take away 30 % of the squared error
//! of the held-out runs. The drive's own torque alone is no candidate and is taken out of every candidate that has it as a
//! factor: it would explain any error by undoing the drive.

mod file;
mod joint_weights;
mod select;
mod term;
mod torque_error;

use std::collections::BTreeMap;

use dynid_model::device::JointKind;
use dynid_model::unit::Unit;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

use self::{
    file::effect_file,
    joint_weights::Weighed,
    select::{Choice, Normal, Reduced, Rules},
    term::{Term, dictionary},
    torque_error::{Block, TorqueView, own_column, regular},
};
use super::statement::{ActsOn, Statement};
use dynid_logs::{experiment::Role, experiment::Run, motion::Motion};
use dynid_random::Random;
use dynid_signal::statistics::correlation_time;
use dynid_torque as torque;
use dynid_user_model::Model;

/// A formula that explains a part of the torque error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Discovered {
    /// The device's joint index.
    pub joint: usize,
    /// The other joint whose signals it needs, where it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<usize>,
    /// What it adds to.
    pub acts_on: ActsOn,
    /// In words and signs, e.g. `0.0078 * sin(6*q5) * dq5`.
    pub formula: String,
    /// Its terms, most telling first.
    pub terms: Vec<DiscoveredTerm>,
    /// Share of the joint's squared torque error that it explains on the runs fitted to, the model's own parameters being
    /// free with and without it.
    pub explained_fit: f64,
    /// The same on the held-out runs, with the values of the runs fitted to.
    pub explained_validate: f64,
    /// The effect file that says it; `None` where an effect cannot.
    pub effect_file: Option<String>,
    /// Formulas for other joints, each found as if nothing were missing elsewhere.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub elsewhere: Vec<Discovered>,
}

/// One term of a formula.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiscoveredTerm {
    /// A product of signals, e.g. `sin(6*q5) * dq5`.
    pub term: String,
    /// Torque that resists, or part of the command, per unit of the product.
    pub coefficient: f64,
    /// One standard deviation.
    pub std_error: f64,
    /// Of the coefficient.
    pub unit: String,
    /// Share of the random halves of the data that choose it, or a term that those data do not tell from it.
    pub chosen_in: f64,
}

/// Random halves of the data.
const HALVES: usize = 30;
/// A term must be chosen in this share of them.
const STABLE: f64 = 0.8;
/// Terms whose squared correlation is above this are one.
const ALIKE: f64 = 0.8;
/// Length of the pieces that halves are made of (s), and into how many pieces the runs are cut at least.
const PIECE_S: f64 = 2.0;
const PIECES: f64 = 16.0;
/// At most so many terms.
const TERMS: usize = 3;
/// The squared torque error of the held-out runs must fall by this share.
const WORTH: f64 = 0.3;
/// Samples of the torque error, taken four a period of the highest frequency that is left, that share one independent error:
/// the same for every choice of terms, as their scores are compared.
const PER_INDEPENDENT: f64 = 4.0;
/// Candidates that are kept for the choice, per step of a first pass.
const KEPT: usize = 40;

/// Looks for a formula for the torque error that `base` leaves of `runs`; `None` where none is worth writing.
pub fn discover(base: &Model, runs: &[&Run]) -> Option<Discovered> {
    let (fit, held_out) = Sampled::of_roles(base, runs)?;
    let joints = fit.joints();
    let mut found: Vec<(f64, Discovered)> =
        joints.into_iter().filter_map(|joint| Search::new(&fit, joint)?.best(&held_out, TERMS)).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found = found.into_iter().map(|(_, found)| found);
    let mut best = found.next()?;
    best.elsewhere = found.collect();
    Some(best)
}

/// A formula of one term for what `base` leaves at `joint` that leaves less than `share` of the squared torque error which
/// any of `explained`, models that an effect was added to, leaves there on the held-out runs.
pub(super) fn better_than(
    base: &Model,
    explained: &[&Model],
    runs: &[&Run],
    joint: usize,
    share: f64,
) -> Option<Discovered> {
    let (fit, held_out) = Sampled::of_roles(base, runs)?;
    let search = Search::new(&fit, joint)?;
    let (_, formula) = search.best(&held_out, 1)?;
    let left = (1.0 - formula.explained_validate) * search.own.left(&held_out, joint)?;
    let is_better = |explained: &&Model| {
        let (fit, held_out) = Sampled::of_roles(explained, runs)?;
        Some(left < share * Own::new(&fit)?.left(&held_out, joint)?)
    };
    explained.par_iter().all(|explained| is_better(explained) == Some(true)).then_some(formula)
}

/// What a diagnosis says where a formula was found.
pub(super) fn statement(found: &Discovered) -> Statement {
    Statement::FormulaExplains {
        joint: found.joint,
        acts_on: found.acts_on,
        formula: found.formula.clone(),
        percent: 100.0 * found.explained_validate,
    }
}

/// The run, to be fitted to, with the torque error held to lower frequencies than the motion: what position noise does to
/// an acceleration grows with the square of the frequency, and would drown the rest.
fn smoother(run: &Run) -> Option<Run> {
    /// Cut-off of the torque error over that of the motion.
    const LOWER: f64 = 0.35;
    let motion = Motion::of(run).ok()?;
    let mut run = Run { role: Role::Fit, ..run.clone() };
    run.settings.cutoff_hz = Some(motion.cutoff_hz);
    // Decimation by `d` asks for a cut-off of a quarter of the new rate.
    let decimate = (0.25 / LOWER / (motion.cutoff_hz * motion.grid.step)).round().max(1.0) as usize;
    run.settings.decimate = decimate.max(run.settings.decimate);
    Some(run)
}

/// One run's signals.
struct RunSignals {
    free: Vec<usize>,
    motion: Motion,
    /// Per slot: what the drive path delivers, and torque per command.
    delivered: Vec<Vec<f64>>,
    slopes: Vec<f64>,
    /// Per slot: the kept samples that count.
    samples: Vec<Vec<usize>>,
}

/// The torque error of some runs, with its derivatives by the model's own parameters.
struct Sampled {
    runs: Vec<RunSignals>,
    /// Run by run, slot by slot.
    blocks: Vec<Block>,
    /// By name: range and column over all blocks.
    own: BTreeMap<String, (f64, Vec<f64>)>,
    kinds: Vec<JointKind>,
    commands: Vec<String>,
}

impl Sampled {
    /// Of the runs to fit to, and of those held out.
    fn of_roles(base: &Model, runs: &[&Run]) -> Option<(Self, Self)> {
        let (fit, held_out): (Vec<&Run>, Vec<&Run>) = runs.iter().partition(|run| run.role == Role::Fit);
        Some((Self::of(base, &fit)?, Self::of(base, &held_out)?))
    }

    fn of(base: &Model, runs: &[&Run]) -> Option<Self> {
        let runs: Vec<Run> = runs.iter().filter_map(|run| smoother(run)).collect();
        let runs: Vec<(&Run, Motion)> = runs.iter().filter_map(|run| Some((run, Motion::of(run).ok()?))).collect();
        let (runs, motions): (Vec<&Run>, Vec<Motion>) = runs.into_iter().unzip();
        let view = TorqueView::new(&runs, &motions);
        let blocks = view.errors(base)?;
        let own: Vec<(String, (f64, Vec<f64>))> = base
            .parameters()
            .par_iter()
            .filter_map(|(name, parameter)| Some((name.clone(), own_column(&view, base, &blocks, name, parameter)?)))
            .collect();
        let signals = |(index, (run, motion)): (usize, (&Run, Motion))| {
            let system = base.system(&run.free, |joint| run.log.mean_position(joint)).ok()?;
            let (delivered, slopes) = torque::delivered(&system, &motion);
            let samples = (0..run.free.len()).map(|slot| view.samples(index, slot)).collect();
            Some(RunSignals { free: run.free.clone(), motion, delivered, slopes, samples })
        };
        let runs = runs.into_iter().zip(motions).enumerate().map(signals).collect::<Option<Vec<RunSignals>>>()?;
        (!blocks.is_empty()).then(|| Self {
            runs,
            blocks,
            own: own.into_iter().collect(),
            kinds: base.device.joints.iter().map(|joint| joint.kind).collect(),
            commands: base.device.joints.iter().map(|joint| joint.command_unit.clone()).collect(),
        })
    }

    fn joints(&self) -> Vec<usize> {
        let mut joints: Vec<usize> = self.blocks.iter().map(|block| block.joint).collect();
        joints.sort_unstable();
        joints.dedup();
        joints
    }

    /// The rows of each block.
    fn rows(&self) -> Vec<std::ops::Range<usize>> {
        let mut end = 0;
        let range = |block: &Block| {
            let start = end;
            end += block.values.len();
            start..end
        };
        self.blocks.iter().map(range).collect()
    }

    /// The rows of a joint.
    fn rows_of(&self, joint: usize) -> impl Iterator<Item = usize> {
        self.blocks.iter().zip(self.rows()).filter(move |(block, _)| block.joint == joint).flat_map(|(_, rows)| rows)
    }

    /// Run and slot of each block.
    fn places(&self) -> Vec<(usize, usize)> {
        let slots = |(index, run): (usize, &RunSignals)| (0..run.free.len()).map(move |slot| (index, slot)).collect();
        self.runs.iter().enumerate().flat_map(|pair| -> Vec<(usize, usize)> { slots(pair) }).collect()
    }

    /// What a term at a joint would leave in the torque error, over the joint's blocks one after the other.
    fn column(&self, term: &Term, joint: usize) -> Vec<f64> {
        let mut column = Vec::new();
        for run in &self.runs {
            let Some(slot) = run.free.iter().position(|other| *other == joint) else { continue };
            // A torque that resists is missing from the load, a part of the command from the drive.
            let scale = if term.is_command() { -1.0 } else { 1.0 / run.slopes[slot] };
            let filtered = if term.others(joint).iter().all(|other| term.is_command() || run.free.contains(other)) {
                run.motion.filtered(&term.values(&run.motion, &run.free, joint, &run.delivered))
            } else {
                // A joint that is held does not move: what it would do then is not known to this run.
                vec![0.0; run.motion.kept.len()]
            };
            column.extend(run.samples[slot].iter().map(|&index| scale * filtered[index]));
        }
        column
    }
}

/// What the model's own parameters may take of the torque error.
struct Own<'a> {
    names: Vec<&'a String>,
    prior: Vec<f64>,
    weights: BTreeMap<usize, f64>,
    /// Weighed: their columns and the error, over all rows.
    columns: DMatrix<f64>,
    error: DVector<f64>,
}

impl<'a> Own<'a> {
    fn new(fit: &'a Sampled) -> Option<Self> {
        let names: Vec<&String> = fit.own.keys().collect();
        let prior: Vec<f64> = fit.own.values().map(|(spread, _)| spread.powi(-2)).collect();
        let rows: usize = fit.blocks.iter().map(|block| block.values.len()).sum();
        let plain = DMatrix::from_fn(rows, names.len(), |row, column| fit.own[names[column]].1[row]);
        let problem = Weighed::new(&fit.blocks, &plain, &prior);
        let is_regular = problem.is_regular();
        let Weighed { weights, own, error, .. } = problem;
        is_regular.then_some(Self { names, prior, weights, columns: own, error })
    }

    /// The torque error of `sampled`, over all rows, after these steps of the parameters.
    fn taken_out(&self, sampled: &Sampled, steps: &DVector<f64>) -> Vec<f64> {
        let columns: Vec<Option<&Vec<f64>>> =
            self.names.iter().map(|name| sampled.own.get(*name).map(|(_, column)| column)).collect();
        let taken = |row: usize| -> f64 {
            columns.iter().zip(steps.iter()).filter_map(|(column, step)| Some((*column)?[row] * step)).sum()
        };
        let errors = sampled.blocks.iter().flat_map(|block| block.values.iter());
        errors.enumerate().map(|(row, error)| error - taken(row)).collect()
    }

    /// Sum of squares of the joint's torque error in `sampled`, the parameters fitted to the runs to fit to.
    fn left(&self, sampled: &Sampled, joint: usize) -> Option<f64> {
        let information = regular(&self.columns.tr_mul(&self.columns), &self.prior)?;
        let errors = self.taken_out(sampled, &information.solve(&self.columns.tr_mul(&self.error)));
        Some(sampled.rows_of(joint).map(|row| errors[row] * errors[row]).sum())
    }
}

/// The search at one joint.
struct Search<'a> {
    fit: &'a Sampled,
    joint: usize,
    own: Own<'a>,
    independent: f64,
    terms: Vec<Term>,
    /// Weighed columns of the terms, over the joint's rows.
    columns: Vec<Vec<f64>>,
    /// Part of the drive's own torque that was taken out of each column.
    shares: Vec<f64>,
    /// The rows of the joint.
    rows: Vec<usize>,
}

impl<'a> Search<'a> {
    fn new(fit: &'a Sampled, joint: usize) -> Option<Self> {
        let own = Own::new(fit)?;
        let free: std::collections::BTreeSet<usize> =
            fit.runs.iter().flat_map(|run| run.free.iter().copied()).collect();
        let free: Vec<usize> = free.into_iter().collect();
        let terms = dictionary(joint, &free, &fit.kinds);
        let weight = *own.weights.get(&joint)?;
        let load = fit.column(&Term::load(), joint);
        let (columns, shares): (Vec<Vec<f64>>, Vec<f64>) = terms
            .par_iter()
            .map(|term| {
                let column = fit.column(term, joint);
                let share = if term.has_load() { share_of(&column, &load) } else { 0.0 };
                (
                    without_share(column, share, &load).into_iter().map(|value| value * weight).collect::<Vec<f64>>(),
                    share,
                )
            })
            .unzip();
        let independent = own.error.len() as f64 / PER_INDEPENDENT;
        let rows = fit.rows_of(joint).collect();
        let mut search = Self { fit, joint, own, independent, terms, columns, shares, rows };
        search.shorten()?;
        Some(search)
    }

    /// Keeps the candidates that a pass of plain forward selection finds telling.
    fn shorten(&mut self) -> Option<()> {
        let n = self.own.error.len();
        let mut basis = self.own.columns.clone();
        let mut prior = self.own.prior.clone();
        let mut kept: Vec<usize> = Vec::new();
        for _ in 0..TERMS {
            let information = regular(&basis.tr_mul(&basis), &prior)?;
            let left = &self.own.error - &basis * information.solve(&basis.tr_mul(&self.own.error));
            let part = DMatrix::from_fn(self.rows.len(), basis.ncols(), |row, column| basis[(self.rows[row], column)]);
            let mut gains: Vec<(f64, usize)> = self
                .columns
                .par_iter()
                .enumerate()
                .filter_map(|(index, column)| {
                    let vector = DVector::from_column_slice(column);
                    let shared = part.tr_mul(&vector);
                    let whole = vector.norm_squared();
                    let size = whole - shared.dot(&information.solve(&shared));
                    // What is left of the error has the basis taken out, nearly.
                    let along: f64 = self.rows.iter().zip(column).map(|(row, value)| left[*row] * value).sum();
                    let gain = along * along / size;
                    (size > 1e-4 * whole && gain.is_finite()).then_some((gain, index))
                })
                .collect();
            gains.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            kept.extend(gains.iter().take(KEPT).map(|(_, index)| *index));
            let Some((_, first)) = gains.first() else { break };
            let mut column = DVector::zeros(n);
            self.rows.iter().zip(&self.columns[*first]).for_each(|(row, value)| column[*row] = *value);
            let width = basis.ncols();
            basis = basis.insert_column(width, 0.0);
            basis.set_column(width, &column);
            prior.resize(width + 1, 0.0);
        }
        kept.sort_unstable();
        kept.dedup();
        self.terms = kept.iter().map(|&index| self.terms[index].clone()).collect();
        self.columns = kept.iter().map(|&index| self.columns[index].clone()).collect();
        self.shares = kept.iter().map(|&index| self.shares[index]).collect();
        (!self.terms.is_empty()).then_some(())
    }

    /// Sums of products over pieces of the runs.
    fn pieces(&self) -> Vec<Normal> {
        let mut rows: BTreeMap<(usize, usize), (Vec<usize>, Vec<usize>)> = BTreeMap::new();
        let mut own_row = 0;
        let span_of = |signals: &RunSignals| {
            signals.motion.grid.step * signals.motion.kept.last().map_or(0.0, |last| *last as f64)
        };
        let piece_s = PIECE_S.min(self.fit.runs.iter().map(span_of).sum::<f64>() / PIECES);
        for ((block, range), (run, slot)) in self.fit.blocks.iter().zip(self.fit.rows()).zip(self.fit.places()) {
            let signals = &self.fit.runs[run];
            for (row, &sample) in range.zip(&signals.samples[slot]) {
                let grid = signals.motion.kept[sample];
                let time = grid as f64 * signals.motion.grid.step;
                let piece = rows.entry((run, (time / piece_s) as usize)).or_default();
                piece.0.push(row);
                if block.joint == self.joint {
                    piece.1.push(own_row);
                    own_row += 1;
                }
            }
        }
        let rows: Vec<(Vec<usize>, Vec<usize>)> = rows.into_values().collect();
        rows.par_iter().map(|(all, joint)| self.normal(all, joint)).collect()
    }

    /// Of several pieces together.
    fn sum<'n>(&self, pieces: impl IntoIterator<Item = &'n Normal>) -> Normal {
        let mut sum = Normal::zero(self.own.names.len(), self.terms.len());
        pieces.into_iter().for_each(|piece| sum.add(piece));
        sum
    }

    /// Sums over some rows; `joint` are those of the joint, counted among its own.
    fn normal(&self, all: &[usize], joint: &[usize]) -> Normal {
        let from = &self.own;
        let width = from.columns.ncols();
        let own = DMatrix::from_fn(all.len(), width, |row, column| from.columns[(all[row], column)]);
        let error = DVector::from_fn(all.len(), |row, _| from.error[all[row]]);
        let here = DMatrix::from_fn(joint.len(), self.columns.len(), |row, column| self.columns[column][joint[row]]);
        let own_here =
            DMatrix::from_fn(joint.len(), width, |row, column| from.columns[(self.rows[joint[row]], column)]);
        let error_here = DVector::from_fn(joint.len(), |row, _| from.error[self.rows[joint[row]]]);
        Normal {
            own: own.tr_mul(&own),
            mixed: own_here.tr_mul(&here),
            candidates: here.tr_mul(&here),
            own_signal: own.tr_mul(&error),
            signal: here.tr_mul(&error_here),
            squares: error.norm_squared(),
        }
    }

    /// Whether terms may stand in one formula: so that one effect can say it, or each is of the same two other joints.
    fn may_join(&self, chosen: &[usize]) -> bool {
        let commands = chosen.iter().filter(|index| self.terms[**index].is_command()).count();
        if commands > 0 && commands < chosen.len() {
            return false;
        }
        let others: Vec<_> = chosen.iter().map(|index| self.terms[*index].others(self.joint)).collect();
        let all: std::collections::BTreeSet<usize> = others.iter().flatten().copied().collect();
        all.len() <= 1 || others.iter().any(|others| others.len() == all.len())
    }

    fn choose(&self, reduced: &Reduced, independent: f64, most: usize) -> Choice {
        let complexity: Vec<f64> = self.terms.iter().map(Term::complexity).collect();
        let may_join = |chosen: &[usize]| self.may_join(chosen);
        reduced.select(&Rules { independent, complexity: &complexity, may_join: &may_join, most })
    }

    /// The formula of at most so many terms with its score (lower is better); `None` where there is nothing worth writing.
    fn best(&self, held_out: &Sampled, most: usize) -> Option<(f64, Discovered)> {
        let pieces = self.pieces();
        let whole = self.sum(&pieces);
        let reduced = whole.reduced(&self.own.prior)?;
        let choice = self.choose(&reduced, self.independent, most);
        let shares = self.stability(&pieces, &reduced, &choice.chosen, most);
        let chosen: Vec<(usize, f64)> =
            choice.chosen.iter().copied().zip(shares).filter(|(_, share)| *share >= STABLE).collect();
        let indices: Vec<usize> = chosen.iter().map(|(index, _)| *index).collect();
        if indices.is_empty() {
            return None;
        }
        let (coefficients, inverse, _) = reduced.solve(&indices)?;
        let without = whole.own_steps(&self.own.prior, &[], &[])?;
        let with = whole.own_steps(&self.own.prior, &indices, &coefficients)?;
        let terms: Vec<(Term, f64)> =
            indices.iter().map(|&index| self.terms[index].clone()).zip(coefficients.iter().copied()).collect();
        let fitted = self.explained(self.fit, &indices, &coefficients, &without, &with);
        let judged = self.explained(held_out, &indices, &coefficients, &without, &with);
        if !(judged.total() >= WORTH && judged.shares.iter().all(Share::is_good)) {
            return None;
        }
        let noise = fitted.deviation * self.own.weights[&self.joint] * fitted.correlation.sqrt();
        let mut reported: Vec<(DiscoveredTerm, &(Term, f64))> = Vec::new();
        for (place, ((own, (_, share)), coefficient)) in terms.iter().zip(&chosen).zip(&coefficients).enumerate() {
            reported.push((
                DiscoveredTerm {
                    term: own.0.label(self.joint),
                    coefficient: *coefficient,
                    std_error: noise * inverse[(place, place)].max(0.0).sqrt(),
                    unit: self.unit(&own.0),
                    chosen_in: *share,
                },
                own,
            ));
        }
        let formula = formula(&reported.iter().map(|(reported, _)| reported).collect::<Vec<_>>());
        let others: std::collections::BTreeSet<usize> =
            terms.iter().flat_map(|(term, _)| term.others(self.joint)).collect();
        Some((
            choice.score,
            Discovered {
                joint: self.joint,
                from: if others.len() == 1 { others.first().copied() } else { None },
                effect_file: effect_file(self.joint, &terms, &formula),
                elsewhere: Vec::new(),
                acts_on: if terms.iter().all(|(term, _)| term.is_command()) { ActsOn::Command } else { ActsOn::Motion },
                formula,
                terms: reported.into_iter().map(|(reported, _)| reported).collect(),
                explained_fit: fitted.total(),
                explained_validate: judged.total(),
            },
        ))
    }

    fn unit(&self, term: &Term) -> String {
        let unit = term.coefficient_unit();
        let command = self.fit.commands.get(self.joint).map_or("command", String::as_str);
        match (Unit::parse(&unit), Unit::parse(command)) {
            (Ok(unit), Ok(command)) => unit.at(self.fit.kinds[self.joint]).with_command(&command).to_string(),
            _ => unit,
        }
    }

    /// In which share of random halves each of `chosen` is chosen, or one that they do not tell from it.
    fn stability(&self, pieces: &[Normal], whole: &Reduced, chosen: &[usize], most: usize) -> Vec<f64> {
        let mut random = Random::new(0x0D15_C0FE);
        let halves: Vec<Vec<usize>> = (0..HALVES)
            .map(|_| {
                let mut order: Vec<(f64, usize)> = (0..pieces.len()).map(|index| (random.unit(), index)).collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut half: Vec<usize> =
                    order.iter().take(pieces.len().div_ceil(2)).map(|(_, index)| *index).collect();
                half.sort_unstable();
                half
            })
            .collect();
        let choices: Vec<Vec<usize>> = halves
            .par_iter()
            .map(|half| {
                self.sum(half.iter().map(|&piece| &pieces[piece]))
                    .reduced(&self.own.prior)
                    .map(|reduced| self.choose(&reduced, 0.5 * self.independent, most).chosen)
                    .unwrap_or_default()
            })
            .collect();
        let share = |index: &usize| {
            let is_in = |choice: &&Vec<usize>| choice.iter().any(|other| whole.likeness(*index, *other) >= ALIKE);
            choices.iter().filter(is_in).count() as f64 / HALVES as f64
        };
        chosen.iter().map(share).collect()
    }

    /// What the formula explains of the joint's torque error in `sampled`, by the values that the runs fitted to gave.
    fn explained(
        &self,
        sampled: &Sampled,
        chosen: &[usize],
        coefficients: &[f64],
        without: &DVector<f64>,
        with: &DVector<f64>,
    ) -> Explained {
        let load = sampled.column(&Term::load(), self.joint);
        let column =
            |index: usize| without_share(sampled.column(&self.terms[index], self.joint), self.shares[index], &load);
        let columns: Vec<(Vec<f64>, f64)> =
            chosen.iter().zip(coefficients).map(|(index, coefficient)| (column(*index), *coefficient)).collect();
        let (before, after) = (self.own.taken_out(sampled, without), self.own.taken_out(sampled, with));
        let mut shares = Vec::new();
        let mut left = Vec::new();
        let mut own_row = 0;
        for (block, range) in sampled.blocks.iter().zip(sampled.rows()) {
            if block.joint != self.joint {
                continue;
            }
            let mut share = Share::default();
            for row in range {
                let said: f64 = columns.iter().map(|(column, coefficient)| column[own_row] * coefficient).sum();
                let after = after[row] - said;
                share.before += before[row] * before[row];
                share.after += after * after;
                share.said += said * said;
                left.push(after);
                own_row += 1;
            }
            shares.push(share);
        }
        let deviation = (left.iter().map(|value| value * value).sum::<f64>() / (left.len() as f64).max(1.0)).sqrt();
        Explained { shares, deviation, correlation: correlation_time(&left, left.len()) }
    }
}

/// How much of `load` is in a column.
fn share_of(column: &[f64], load: &[f64]) -> f64 {
    let squares: f64 = load.iter().map(|load| load * load).sum();
    let product: f64 = column.iter().zip(load).map(|(value, load)| value * load).sum();
    if squares > 0.0 { product / squares } else { 0.0 }
}

/// A column without its part along `load`. Where the model's own parameters may all become smaller together, so does the torque
/// that the motion needs: the drive's own torque would then explain any error there is, by undoing the drive.
fn without_share(mut column: Vec<f64>, share: f64, load: &[f64]) -> Vec<f64> {
    if share != 0.0 {
        column.iter_mut().zip(load).for_each(|(value, load)| *value -= share * load);
    }
    column
}

/// Squared torque error of one run.
#[derive(Debug, Default)]
struct Share {
    before: f64,
    after: f64,
    /// Of the formula itself.
    said: f64,
}

impl Share {
    /// Whether a run in which the formula has something to say agrees with it.
    fn is_good(&self) -> bool {
        self.said < WORTH * self.before || self.after <= (1.0 - WORTH) * self.before
    }
}

/// What a formula explains.
struct Explained {
    shares: Vec<Share>,
    /// Root mean square of what is left.
    deviation: f64,
    /// Successive samples of it that share one independent error.
    correlation: f64,
}

impl Explained {
    fn total(&self) -> f64 {
        let (before, after) =
            self.shares.iter().fold((0.0, 0.0), |sum, share| (sum.0 + share.before, sum.1 + share.after));
        if before > 0.0 { 1.0 - after / before } else { 0.0 }
    }
}

/// `0.0078 * sin(6*q5) * dq5 - 0.2 * t`
fn formula(terms: &[&DiscoveredTerm]) -> String {
    let mut text = String::new();
    for term in terms {
        let sign = match (text.is_empty(), term.coefficient < 0.0) {
            (true, true) => "-",
            (true, false) => "",
            (false, true) => " - ",
            (false, false) => " + ",
        };
        text.push_str(&format!("{sign}{} * {}", digits(term.coefficient.abs()), term.term));
    }
    text
}

/// Four digits, in ASCII.
fn digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    if (1e-4..1e5).contains(&rounded) || rounded == 0.0 { format!("{rounded}") } else { format!("{rounded:e}") }
}
