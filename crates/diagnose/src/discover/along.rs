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
                parameters: left(&with + &said),
                said: left(said),
                before: left(without),
                after: left(with),
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

#[cfg(test)]
mod tests {
    use dynid_logs::experiment::Role;

    use super::*;
    use crate::discover::term::Factor;
    use crate::fixtures::{self, Oscillator};
    use dynid_user_model::Model;

    fn runs() -> [Run; 2] {
        let plant = Oscillator { stiffness: 1.1, cubic: 400.0 };
        let sines = [(0.02, 1.0), (0.01, 3.7)];
        [plant.run(&sines, 6.0, (Role::Fit, 5)), plant.run(&[(0.03, 0.7)], 4.0, (Role::Validate, 6))]
    }

    fn cube() -> Term {
        Term::new(vec![Factor::Position(0); 3])
    }

    /// The errors of a model that has a little of a law differ by what its term answers.
    #[test]
    fn a_term_moves_the_predictions_as_its_law_does() {
        let model = fixtures::model(1.0, "");
        let [fit, held_out] = runs();
        let work = Logs::new(&model, vec![fit], vec![held_out]);
        let base = work.base(&model, "base").expect("a fit");
        let along = |model: &Model| {
            let base = Fitted { model: model.clone(), ..base.clone() };
            Along::fitted(&work, &base, &work.fit, 1.0).expect("the errors")
        };
        let here = along(&base.model);
        let raw = |along: &Along| &along.errors[0] / along.weights[0];
        let mut changed = base.model.clone();
        changed.add_effect("spring_cubic", Some(0), None).expect("it may be there");
        let small = 0.1;
        let changed = changed.with_values(&|name| (name == "joint.0.spring_cubic.K3").then_some(small));
        let moved = (raw(&here) - raw(&along(&changed))) / small;
        let shares = here.shares(0, &[cube()]);
        assert_eq!(shares, [0.0], "no torque of the drive is in it");
        let answer = &here.answers(0, &[cube()], &shares)[0][0] / here.weights[0];
        assert!((&moved - &answer).norm() < 1e-3 * answer.norm(), "{} {}", moved.norm(), answer.norm());

        // The drive's torque is its own share once and for all.
        assert_eq!(here.shares(0, &[Term::load()]), [1.0]);
        let twice = Term::new(vec![Factor::Load, Factor::Load]);
        let load = here.values(0, &Term::load());
        let [third, second] = [3, 2].map(|power| load[0].iter().map(|load| load.powi(power)).sum::<f64>());
        let share = here.shares(0, std::slice::from_ref(&twice))[0];
        assert!((share - third / second).abs() < 1e-12, "{share} {}", third / second);
        let without = here.answers(0, &[Term::load()], &[1.0]);
        assert_eq!(without[0][0].norm(), 0.0, "its own share taken out, nothing is left");
    }

    /// Weights make each joint's squares as many as its samples, and the likelihood of the fit comes out; pieces sum to the whole; each of
    /// its products is made here anew.
    #[test]
    fn normal_equations_are_sums_over_pieces() {
        let model = fixtures::model(1.0, "");
        let [fit, held_out] = runs();
        let work = Logs::new(&model, vec![fit.clone(), held_out.clone()], vec![held_out]);
        let base = work.base(&model, "base").expect("a fit");
        let along = Along::fitted(&work, &base, &work.fit, 1.0).expect("the errors");
        let squares: f64 = along.errors.iter().map(DMatrix::norm_squared).sum();
        assert_eq!(along.samples(), 1000.0);
        assert!((squares / along.samples() - 1.0).abs() < 1e-9, "{squares}");
        let found = along.log_likelihood(squares, 1.0);
        assert!((found / base.fit.log_likelihood - 1.0).abs() < 1e-6, "{found} {}", base.fit.log_likelihood);
        // Twice the variance costs half of ln 2 a sample and halves the squares.
        let wider = along.log_likelihood(squares, 2.0);
        assert!((wider - (found - 500.0 * 2.0_f64.ln() + 0.25 * squares)).abs() < 1e-6);
        let noise = (noise_at(work.fit.iter(), 0) * along.weights[0]).powi(2);
        assert!((along.noises[0] / noise - 1.0).abs() < 1e-12);

        let terms = [cube(), Term::new(vec![Factor::Speed(0)]), Term::new(vec![Factor::Sign(0)])];
        let shares = along.shares(0, &terms);
        let answers = along.answers(0, &terms, &shares);
        let pieces = along.pieces(&answers);
        // 10 s in pieces of 10/16 s: 10 of the one run, 7 of the other.
        assert_eq!(pieces.len(), 17);
        let mut sum = Normal::zero(along.prior().len(), terms.len());
        pieces.iter().for_each(|piece| sum.add(piece));
        assert!((sum.squares / squares - 1.0).abs() < 1e-9);
        // What is nearly at right angles to the errors is so by cancellation: how near, the sizes tell.
        let size = |of: &Answer| of.iter().map(DMatrix::norm_squared).sum::<f64>().sqrt();
        let close = |found: f64, expected: f64, size: f64| {
            assert!((found - expected).abs() < 1e-9 * size, "{found} {expected}")
        };
        for (a, one) in answers.iter().enumerate() {
            let signal: f64 = one.iter().zip(&along.errors).map(|(answer, errors)| answer.dot(errors)).sum();
            let (mixed, (same, own)) = along.alone(one);
            close(sum.signal[a], signal, size(one) * squares.sqrt());
            close(same, signal, size(one) * squares.sqrt());
            close(own, size(one).powi(2), size(one).powi(2));
            assert!((&mixed - sum.mixed.column(a)).norm() < 1e-9 * mixed.norm(), "{mixed} {}", sum.mixed);
            for (b, other) in answers.iter().enumerate() {
                let product: f64 = one.iter().zip(other).map(|(one, other)| one.dot(other)).sum();
                close(sum.candidates[(a, b)], product, size(one) * size(other));
            }
        }

        // The first pass finds the cube, and what it promises is what its regression with the own unknowns leaves.
        let (kept, log_likelihood) = along.telling(0, &terms, &shares).expect("it finds something");
        assert_eq!(kept, [0, 2], "the model has friction of that kind itself");
        let reduced = sum.reduced(&along.prior()).expect("they are determined");
        let left = (0..terms.len()).filter_map(|term| Some(reduced.solve(&[term])?.2));
        let least = left.fold(f64::INFINITY, f64::min);
        let expected = along.log_likelihood(least, least / along.samples());
        assert!((log_likelihood / expected - 1.0).abs() < 1e-6, "{log_likelihood} {expected}");
        assert!((reduced.solve(&[0]).expect("a coefficient").2 / least - 1.0).abs() < 1e-9, "it is the cube");

        // What is left of the runs fitted to is what the regression leaves, but that nothing is known beforehand of where they start.
        let (coefficients, ..) = reduced.solve(&[0]).expect("a coefficient");
        let (without, with) =
            (sum.own_steps(&along.prior(), &[], &[]), sum.own_steps(&along.prior(), &[0], &coefficients));
        let (without, with) = (without.expect("steps"), with.expect("steps"));
        let runs = along.left(&answers[..1], &coefficients, (&along.steps(&without), &along.steps(&with)));
        let [before, after] =
            [|run: &Left| run.before, |run: &Left| run.after].map(|of| runs.iter().map(of).sum::<f64>());
        assert!((before / reduced.squares - 1.0).abs() < 0.02, "{before} {}", reduced.squares);
        assert!((after / least - 1.0).abs() < 0.02, "{after} {least}");
        // It stands at right angles to what it leaves, and its parameters' steps are no part of it.
        let [said, parameters] =
            [|run: &Left| run.said, |run: &Left| run.parameters].map(|of| runs.iter().map(of).sum::<f64>());
        assert!((said / (parameters - after) - 1.0).abs() < 0.02 && parameters > before, "{said} {parameters} {after}");
        assert!((runs[0].noise - 600.0 * along.noises[0]).abs() < 1e-9 * runs[0].noise);
    }
}
