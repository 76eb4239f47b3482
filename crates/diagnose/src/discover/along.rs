//! Errors of the one-step predictions of some runs, and how they answer to torques.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::select::{Normal, OWN, regular};
use super::term::Term;
use super::{KEPT, Left, PIECE_S, PIECES, TERMS};
use crate::missing::{Fitted, Logs, noise_at};
use dynid_identify::prediction::{NearRun, Signals, Tangent};
use dynid_logs::experiment::Run;

/// Runs along the predictions of a model, at one choice of its rates. What is summed is weighed: each joint counts by the size of its
/// errors in the runs that the model was fitted to.
pub(super) struct Along {
    tangent: Tangent,
    signals: Vec<Signals>,
    /// Time between samples of each run (s).
    sample_s: Vec<f64>,
    /// Of each joint of the device, one over the standard deviation of its errors; 0 where it is not free.
    weights: Vec<f64>,
    /// Noise of each joint's logs in these units, squared.
    noises: Vec<f64>,
    /// Weighed errors of each run: one column a free joint.
    errors: Vec<DMatrix<f64>>,
    /// The parameters among the unknowns, which come first.
    parameters: Vec<String>,
}

/// How the weighed predictions answer to something: run by run, one row an error, one column a free joint.
pub(super) type Answer = Vec<DMatrix<f64>>;

impl Along {
    /// Along `runs`, the fitted ones or their beginnings, as `base` predicts them at this multiple of its rates.
    pub(super) fn fitted(work: &Logs<'_>, base: &Fitted, runs: &[Run], rate: f64) -> Option<Self> {
        let mut own = Self::new(work, (base, rate), runs, true)?;
        let joints = own.weights.len();
        for joint in 0..joints {
            let errors =
                || own.slots().filter(|(.., device)| *device == joint).flat_map(|(run, slot, _)| &run.errors()[slot]);
            let (samples, squares) = errors().fold((0.0, 0.0), |(n, sum), error| (n + 1.0, sum + error * error));
            if squares > 0.0 {
                own.weights[joint] = f64::sqrt(samples / squares);
            }
        }
        own.weigh(runs);
        Some(own)
    }

    /// The same along the runs held out, with the weights of those fitted to.
    pub(super) fn held_out(&self, work: &Logs<'_>, base: &Fitted, rate: f64) -> Option<Self> {
        let mut own = Self::new(work, (base, rate), &work.held_out, false)?;
        own.weights.clone_from(&self.weights);
        own.weigh(&work.held_out);
        Some(own)
    }

    fn new(work: &Logs<'_>, (base, rate): (&Fitted, f64), runs: &[Run], is_fitted: bool) -> Option<Self> {
        let (tangent, parameters) = work.tangent(base, runs, rate, is_fitted)?;
        let n_joints = base.model.device.joints.len();
        Some(Self {
            signals: tangent.runs().iter().map(NearRun::signals).collect(),
            tangent,
            sample_s: runs.iter().map(|run| run.log.sample_time()).collect(),
            weights: vec![0.0; n_joints],
            noises: vec![0.0; n_joints],
            errors: Vec::new(),
            parameters,
        })
    }

    /// Errors and noises in units of the weights.
    fn weigh(&mut self, runs: &[Run]) {
        let of_run = |run: &NearRun| {
            let (errors, free) = (run.errors(), run.free());
            DMatrix::from_fn(errors[0].len(), free.len(), |row, slot| self.weights[free[slot]] * errors[slot][row])
        };
        self.errors = self.tangent.runs().iter().map(of_run).collect();
        for (joint, weight) in self.weights.iter().enumerate() {
            self.noises[joint] = (noise_at(runs.iter(), joint) * weight).powi(2);
        }
    }

    /// Every free joint of every run: the run, the slot, the device's joint index.
    fn slots(&self) -> impl Iterator<Item = (&NearRun, usize, usize)> {
        let of_run = |run| NearRun::free(run).iter().enumerate().map(move |(slot, joint)| (run, slot, *joint));
        self.tangent.runs().iter().flat_map(of_run)
    }

    /// The unknowns of a run but the rates, which are held: its own index of each, and that among all.
    fn held(&self, run: &NearRun) -> impl Iterator<Item = (usize, usize)> {
        let n = self.tangent.prior().count();
        run.places().iter().copied().enumerate().filter(move |(_, place)| *place < n)
    }

    /// How many errors there are.
    pub(super) fn samples(&self) -> f64 {
        self.errors.iter().map(|errors| errors.len() as f64).sum()
    }

    /// What is known of the unknowns before the logs.
    pub(super) fn prior(&self) -> Vec<f64> {
        self.tangent.prior().collect()
    }

    /// Log likelihood of errors whose weighed squares are these, the variance being `unit` times that of the model's errors in the runs
    /// fitted to.
    pub(super) fn log_likelihood(&self, squares: f64, unit: f64) -> f64 {
        let weights: f64 =
            self.slots().map(|(run, slot, joint)| run.errors()[slot].len() as f64 * self.weights[joint].ln()).sum();
        weights - 0.5 * self.samples() * unit.ln() - 0.5 * squares / unit
    }

    /// How much of the drive's own torque at `joint` is in each term. Where the model's own parameters may all become smaller together, so
    /// does the torque that the motion needs: the drive's own torque would then explain any error there is, by undoing the drive.
    pub(super) fn shares(&self, joint: usize, terms: &[Term]) -> Vec<f64> {
        let load = self.values(joint, &Term::load());
        let squares: f64 = load.iter().flatten().map(|load| load * load).sum();
        let share = |term: &Term| {
            let values = self.values(joint, term);
            let product: f64 =
                values.iter().flatten().zip(load.iter().flatten()).map(|(value, load)| value * load).sum();
            if squares > 0.0 { product / squares } else { 0.0 }
        };
        terms.par_iter().map(|term| if term.has_load() { share(term) } else { 0.0 }).collect()
    }

    /// A term at a joint, run by run; zeros where a joint that it needs is held: what it would do then is not known to such a run.
    fn values(&self, joint: usize, term: &Term) -> Vec<Vec<f64>> {
        let of_run = |(run, signals): (&NearRun, &Signals)| {
            let free = run.free();
            let knows = |other: &usize| term.is_command() || free.contains(other);
            if free.contains(&joint) && term.others(joint).iter().all(knows) {
                term.values(signals, free, joint)
            } else {
                vec![0.0; signals.time.len()]
            }
        };
        self.tangent.runs().iter().zip(&self.signals).map(of_run).collect()
    }

    /// How the predictions answer to a unit of each term at `joint`, the drive's own torque being taken out; a term that is no number
    /// moves nothing.
    pub(super) fn answers(&self, joint: usize, terms: &[Term], shares: &[f64]) -> Vec<Answer> {
        let load = self.values(joint, &Term::load());
        let answer = |(term, share): (&Term, &f64)| -> Answer {
            let values = self.values(joint, term);
            let of_run = |(index, run): (usize, &NearRun)| {
                let free = run.free();
                let none = || DMatrix::zeros(self.errors[index].nrows(), free.len());
                let Some(slot) = free.iter().position(|own| *own == joint) else { return none() };
                // A torque that resists takes from the drive's, a part of the command adds to it.
                let scale = if term.is_command() { self.signals[index].per_command[slot] } else { -1.0 };
                let values = values[index].iter().zip(&load[index]);
                let torque: Vec<f64> = values.map(|(value, load)| scale * (value - share * load)).collect();
                let mut answer = run.to_torque(slot, &torque).unwrap_or_else(none);
                free.iter().enumerate().for_each(|(slot, own)| answer.column_mut(slot).scale_mut(self.weights[*own]));
                answer
            };
            self.tangent.runs().iter().enumerate().map(of_run).collect()
        };
        terms.par_iter().zip(shares).map(answer).collect()
    }

    /// Sums of products over some rows of a run.
    fn normal(&self, index: usize, rows: std::ops::Range<usize>, answers: &[Answer]) -> Normal {
        let run = &self.tangent.runs()[index];
        let (n_own, n_terms) = (self.tangent.prior().count(), answers.len());
        let errors = self.errors[index].rows(rows.start, rows.len());
        let mut sum = Normal::zero(n_own, n_terms);
        for (slot, joint) in run.free().iter().enumerate() {
            let own = run.slopes()[slot].rows(rows.start, rows.len()) * self.weights[*joint];
            let here =
                DMatrix::from_fn(rows.len(), n_terms, |row, term| answers[term][index][(rows.start + row, slot)]);
            let error = errors.column(slot);
            let places = || self.held(run);
            let (square, mixed, signal) = (own.tr_mul(&own), own.tr_mul(&here), own.tr_mul(&error));
            for (row, place) in places() {
                places().for_each(|(column, other)| sum.own[(place, other)] += square[(row, column)]);
                (0..n_terms).for_each(|term| sum.mixed[(place, term)] += mixed[(row, term)]);
                sum.own_signal[place] += signal[row];
            }
            sum.candidates += here.tr_mul(&here);
            sum.signal += here.tr_mul(&error);
            sum.squares += error.norm_squared();
        }
        sum
    }

    /// Sums of products over pieces of the runs.
    pub(super) fn pieces(&self, answers: &[Answer]) -> Vec<Normal> {
        let spans = self.errors.iter().zip(&self.sample_s).map(|(errors, step)| errors.nrows() as f64 * step);
        let piece_s = PIECE_S.min(spans.sum::<f64>() / PIECES);
        let mut pieces = Vec::new();
        for (run, (errors, step)) in self.errors.iter().zip(&self.sample_s).enumerate() {
            let (rows, each) = (errors.nrows(), ((piece_s / step) as usize).max(1));
            pieces.extend((0..rows).step_by(each).map(|from| (run, from..(from + each).min(rows))));
        }
        pieces.par_iter().map(|(run, rows)| self.normal(*run, rows.clone(), answers)).collect()
    }

    /// The terms at `joint` that a pass of plain forward selection finds telling, and the log likelihood with the best of them.
    pub(super) fn telling(&self, joint: usize, terms: &[Term], shares: &[f64]) -> Option<(Vec<usize>, f64)> {
        let answers = self.answers(joint, terms, shares);
        let mut prior = self.prior();
        let mut basis = Normal::zero(prior.len(), 0);
        self.errors.iter().enumerate().for_each(|(run, errors)| basis.add(&self.normal(run, 0..errors.nrows(), &[])));
        let information = regular(&basis.own, &prior)?;
        let before = basis.squares - basis.own_signal.dot(&information.solve(&basis.own_signal));
        // How each answer goes along with the own unknowns and the errors, and how large it is.
        let (mut mixed, alone): (Vec<DVector<f64>>, Vec<(f64, f64)>) =
            answers.par_iter().map(|answer| self.alone(answer)).unzip();
        let (mut own, mut own_signal) = (basis.own, basis.own_signal);
        let mut kept: Vec<usize> = Vec::new();
        let mut best: Option<f64> = None;
        for _ in 0..TERMS {
            let information = regular(&own, &prior)?;
            let steps = information.solve(&own_signal);
            let gain = |term: usize| {
                let (signal, size) = alone[term];
                let left = size - mixed[term].dot(&information.solve(&mixed[term]));
                let along = signal - mixed[term].dot(&steps);
                let gain = along * along / left;
                (left > OWN * size && gain.is_finite()).then_some((gain, term))
            };
            let mut gains: Vec<(f64, usize)> = (0..answers.len()).into_par_iter().filter_map(gain).collect();
            gains.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            kept.extend(gains.iter().take(KEPT).map(|(_, index)| *index));
            let Some((gain, first)) = gains.first().copied() else { break };
            best.get_or_insert(gain);
            // The best joins the own unknowns.
            let others: Vec<f64> = (0..answers.len())
                .into_par_iter()
                .map(|term| answers[term].iter().zip(&answers[first]).map(|(one, other)| one.dot(other)).sum())
                .collect();
            let ((signal, size), width) = (alone[first], own.nrows());
            own = own.resize(width + 1, width + 1, 0.0);
            for row in 0..width {
                own[(row, width)] = mixed[first][row];
                own[(width, row)] = mixed[first][row];
            }
            own[(width, width)] = size;
            own_signal = own_signal.push(signal);
            prior.push(0.0);
            mixed = mixed.into_iter().zip(others).map(|(mixed, other)| mixed.push(other)).collect();
        }
        kept.sort_unstable();
        kept.dedup();
        let left = (before - best?).max(LEAST * before);
        Some((kept, self.log_likelihood(left, left / self.samples())))
    }

    /// How an answer goes along with the own unknowns, and with the errors; and its squares.
    fn alone(&self, answer: &Answer) -> (DVector<f64>, (f64, f64)) {
        let (mut mixed, mut signal, mut squares) = (DVector::zeros(self.tangent.prior().count()), 0.0, 0.0);
        for ((run, answer), errors) in self.tangent.runs().iter().zip(answer).zip(&self.errors) {
            for (slot, joint) in run.free().iter().enumerate() {
                let here = answer.column(slot);
                let by_slopes = run.slopes()[slot].tr_mul(&here) * self.weights[*joint];
                self.held(run).for_each(|(own, place)| mixed[place] += by_slopes[own]);
            }
            signal += answer.dot(errors);
            squares += answer.norm_squared();
        }
        (mixed, (signal, squares))
    }

    /// What is left of each run without and with a formula whose terms answer like this, `steps` being those of the fitted runs'
    /// parameters without and with it; where a run starts takes its best.
    pub(super) fn left(
        &self,
        answers: &[Answer],
        coefficients: &[f64],
        steps: (&BTreeMap<&str, f64>, &BTreeMap<&str, f64>),
    ) -> Vec<Left> {
        let of_run = |(index, run): (usize, &NearRun)| {
            let errors = &self.errors[index];
            let rows = errors.nrows();
            let mut said = DMatrix::zeros(rows, run.free().len());
            answers.iter().zip(coefficients).for_each(|(answer, coefficient)| said += &answer[index] * *coefficient);
            let mut without = errors.clone();
            let mut with = errors - &said;
            let is_parameter = |place: usize| place < self.parameters.len();
            let others = self.held(run).filter(|(_, place)| !is_parameter(*place));
            let others: Vec<usize> = others.map(|(own, _)| own).collect();
            let mut nuisance = DMatrix::zeros(rows * run.free().len(), others.len());
            for (slot, joint) in run.free().iter().enumerate() {
                let slopes = &run.slopes()[slot] * self.weights[*joint];
                for (own, place) in self.held(run).filter(|(_, place)| is_parameter(*place)) {
                    let name = self.parameters[place].as_str();
                    for (errors, steps) in [(&mut without, steps.0), (&mut with, steps.1)] {
                        let step = steps.get(name).copied().unwrap_or(0.0);
                        errors.column_mut(slot).axpy(-step, &slopes.column(own), 1.0);
                    }
                }
                for (column, own) in others.iter().enumerate() {
                    nuisance.view_mut((slot * rows, column), (rows, 1)).copy_from(&slopes.column(*own));
                }
            }
            let left = |errors: DMatrix<f64>| {
                // Column after column, as the nuisance has it.
                let errors = DVector::from_column_slice(errors.as_slice());
                let signal = nuisance.tr_mul(&errors);
                let gram = regular(&nuisance.tr_mul(&nuisance), &vec![0.0; others.len()]);
                errors.norm_squared() - gram.map_or(0.0, |gram| signal.dot(&gram.solve(&signal)))
            };
            Left {
                before: left(without),
                after: left(with),
                said: said.norm_squared(),
                noise: run.free().iter().map(|joint| rows as f64 * self.noises[*joint]).sum(),
            }
        };
        self.tangent.runs().iter().enumerate().map(of_run).collect()
    }

    /// Steps of the parameters among those of all unknowns.
    pub(super) fn steps<'s>(&'s self, all: &DVector<f64>) -> BTreeMap<&'s str, f64> {
        self.parameters.iter().map(String::as_str).zip(all.iter().copied()).collect()
    }
}

/// No formula is believed to leave less than this share of the squares.
const LEAST: f64 = 1e-3;
