//! The likelihood near a point: what a step of Gauss and Newton from there would gain (score test).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use dynid_dynamics::system::System;

use super::{PredictionProblem, evaluate::Evaluator, response::Predicted, response::Signals};
use crate::plan::Plan;

/// Predictions near the point where a problem starts, to first order: what its unknowns may make up for of any other predictions.
pub struct Tangent {
    runs: Vec<NearRun>,
    /// Sums over all runs, by joint.
    sums: Vec<Sums>,
    /// The variance below which errors of a joint are rounding.
    floors: Vec<f64>,
    /// `slopes' slopes` of all runs, by joint and all unknowns.
    grams: Vec<DMatrix<f64>>,
    /// Cost of the prior, and its information and slope.
    prior_cost: f64,
    prior: Vec<(f64, f64)>,
}

/// One run of a tangent.
pub struct NearRun {
    predicted: Predicted,
    /// Of every free joint, one row an error, one column an unknown of this run.
    slopes: Vec<DMatrix<f64>>,
    /// The errors of the model as it is.
    errors: Vec<Vec<f64>>,
    /// Index among the joints of every free one, and among all unknowns of the run's own.
    joints: Vec<usize>,
    places: Vec<usize>,
}

impl NearRun {
    /// The device's indices of its free joints.
    pub fn free(&self) -> &'static [usize] {
        self.predicted.free()
    }

    /// Errors of the predictions of each free joint [rad or m].
    pub fn errors(&self) -> &[Vec<f64>] {
        &self.errors
    }

    /// Their derivatives, of each free joint: one row an error, one column an unknown of this run; see [`NearRun::places`].
    pub fn slopes(&self) -> &[DMatrix<f64>] {
        &self.slopes
    }

    /// Where the unknowns of this run stand among those of all; the rates come last.
    pub fn places(&self) -> &[usize] {
        &self.places
    }

    /// What moves and drives the model.
    pub fn signals(&self) -> Signals {
        self.predicted.signals()
    }

    /// How the predictions change with a torque at a free joint, given where [`NearRun::signals`] are: one row an error, one column a
    /// free joint; `None` where that is no number.
    pub fn to_torque(&self, slot: usize, torque: &[f64]) -> Option<DMatrix<f64>> {
        self.predicted.to_torque(slot, torque)
    }
}

/// Errors of one joint.
#[derive(Clone)]
struct Sums {
    samples: f64,
    squares: f64,
    /// `slopes' errors`, by all unknowns.
    by_slopes: DVector<f64>,
}

/// Other equations, of every run: as they are asked, and as each of some parameters goes so far from there.
pub struct Change {
    /// The equations.
    pub systems: Vec<System>,
    /// Those with one parameter changed, and by how much.
    pub further: Vec<(Vec<System>, f64)>,
}

/// Products of the responses to changes, of one joint in all runs.
struct Products {
    /// `slopes' responses`, `errors' responses` and `responses' responses`.
    by_slopes: DMatrix<f64>,
    by_errors: DVector<f64>,
    square: DMatrix<f64>,
}

/// A likelihood near a point, by all unknowns of a tangent, each in units of its own information.
struct Near {
    /// Negative log likelihood at the point.
    cost: f64,
    samples: f64,
    slope: DVector<f64>,
    scale: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Variance of the errors, by joint.
    variances: Vec<f64>,
}

impl Tangent {
    /// Of a problem at its start; `None` where it cannot be simulated.
    pub fn new(problem: &PredictionProblem, plan: &Plan) -> Option<Self> {
        let evaluator = Evaluator::new(problem);
        let x = evaluator.start().ok()?;
        let slopes = evaluator.slopes(&x, plan)?;
        let n = evaluator.n();
        let mut grams = vec![DMatrix::zeros(n, n); evaluator.joints.len()];
        let places: Vec<_> = (0..slopes.len()).map(|run| evaluator.places(run)).collect();
        for (slopes, (joints, places)) in slopes.iter().zip(&places) {
            for (joint, slopes) in joints.iter().zip(slopes) {
                let gram = slopes.transpose() * slopes;
                for (own, row) in places.iter().enumerate() {
                    for (other, column) in places.iter().enumerate() {
                        grams[*joint][(*row, *column)] += gram[(own, other)];
                    }
                }
            }
        }
        let unknowns = problem.unknowns.iter().zip(&problem.spreads).zip(&x);
        let mut prior: Vec<(f64, f64)> = unknowns
            .map(|((unknown, spread), x)| (spread.powi(-2), (x - unknown.expected) / (spread * spread)))
            .collect();
        prior.resize(n, (0.0, 0.0));
        let (predicted, errors) = (evaluator.responses(&x, plan)?, evaluator.errors(&x, plan)?);
        let runs = predicted.into_iter().zip(slopes).zip(errors).zip(places);
        let near =
            |(((predicted, slopes), errors), (joints, places))| NearRun { predicted, slopes, errors, joints, places };
        let runs: Vec<NearRun> = runs.map(near).collect();
        let floors = evaluator.floors.clone();
        let mut own = Self { runs, sums: Vec::new(), floors, grams, prior_cost: evaluator.prior_cost(&x), prior };
        own.sums = own.sums_of(own.runs.iter().map(|run| run.errors.as_slice()));
        Some(own)
    }

    /// Run by run.
    pub fn runs(&self) -> &[NearRun] {
        &self.runs
    }

    /// What is known of each unknown but the rates before the logs: one over the variance. Parameters come first.
    pub fn prior(&self) -> impl Iterator<Item = f64> {
        self.prior.iter().take(self.prior.len() - self.sums.len()).map(|(information, _)| *information)
    }

    /// Cost once the unknowns have taken their step.
    pub fn own_cost(&self) -> Option<f64> {
        self.near(&self.sums)?.cost_after_step()
    }

    /// Cost of a problem of the same runs, with other equations that are simulated as they are, once the unknowns of this one have taken
    /// the step that is best for it.
    pub fn cost(&self, problem: &PredictionProblem, plan: &Plan) -> Option<f64> {
        let evaluator = Evaluator::new(problem);
        let x = evaluator.start().ok()?;
        let errors = evaluator.errors(&x, plan)?;
        self.near(&self.sums_of(errors.iter().map(Vec::as_slice)))?.cost_after_step()
    }

    /// What is left for the parameters of each of these changes when the unknowns have taken the step that is best for it; `None` where
    /// it has no number.
    pub fn reduced(&self, changes: &[&Change]) -> Vec<Option<Reduced>> {
        // Column of a change as it is asked, if it is any, and of its first parameter.
        let mut places: Vec<Option<(Option<usize>, usize)>> = Vec::new();
        let mut columns: Vec<Vec<DMatrix<f64>>> = Vec::new();
        for change in changes {
            let place = self.responses(change).map(|(asked, further)| {
                let own = asked.map(|asked| {
                    columns.push(asked);
                    columns.len() - 1
                });
                columns.extend(further);
                (own, columns.len() - change.further.len())
            });
            places.push(place);
        }
        let products = self.products(&columns);
        let unchanged = self.near(&self.sums);
        let of = |(change, place): (&&Change, &Option<(Option<usize>, usize)>)| {
            let (asked, first) = (*place)?;
            let changed = asked.map(|asked| self.near(&self.sums_less(&products, asked)));
            let near = changed.as_ref().unwrap_or(&unchanged).as_ref()?;
            Some(self.reduced_at(near, &products, asked, first..first + change.further.len()))
        };
        changes.iter().zip(&places).map(of).collect()
    }

    /// Whether other equations differ along the predictions.
    pub fn is_changed(&self, systems: &[System]) -> bool {
        self.runs.iter().zip(systems).any(|(run, system)| run.predicted.is_changed_by(system))
    }

    /// The responses of all runs to a change as it is asked, if it is any, and to a unit of each of its parameters.
    #[expect(clippy::type_complexity, reason = "of all runs, one matrix each")]
    fn responses(&self, change: &Change) -> Option<(Option<Vec<DMatrix<f64>>>, Vec<Vec<DMatrix<f64>>>)> {
        let to = |systems: &[System]| -> Option<Vec<Option<DMatrix<f64>>>> {
            self.runs.iter().zip(systems).map(|(run, system)| run.predicted.to(system)).collect()
        };
        let zeros = |run: &NearRun| DMatrix::zeros(run.errors[0].len(), run.joints.len());
        let asked = to(&change.systems)?;
        let mut further = Vec::new();
        for (systems, unit) in &change.further {
            let with = to(systems)?;
            let difference = with.into_iter().zip(&asked).zip(&self.runs).map(|((with, asked), run)| {
                let with = with.unwrap_or_else(|| zeros(run));
                asked.as_ref().map_or_else(|| with.clone(), |asked| &with - asked) / *unit
            });
            further.push(difference.collect());
        }
        let is_any = asked.iter().any(Option::is_some);
        let all = asked.into_iter().zip(&self.runs).map(|(asked, run)| asked.unwrap_or_else(|| zeros(run)));
        Some((is_any.then(|| all.collect()), further))
    }

    fn products(&self, columns: &[Vec<DMatrix<f64>>]) -> Vec<Products> {
        let n = columns.len();
        let none = || Products {
            by_slopes: DMatrix::zeros(self.prior.len(), n),
            by_errors: DVector::zeros(n),
            square: DMatrix::zeros(n, n),
        };
        let mut products: Vec<Products> = self.sums.iter().map(|_| none()).collect();
        for (index, run) in self.runs.iter().enumerate() {
            for (slot, joint) in run.joints.iter().enumerate() {
                let own: Vec<_> = columns.iter().map(|column| column[index].column(slot).into_owned()).collect();
                if own.is_empty() {
                    continue;
                }
                let (own, products) = (DMatrix::from_columns(&own), &mut products[*joint]);
                let by_slopes = run.slopes[slot].tr_mul(&own);
                for (row, place) in run.places.iter().enumerate() {
                    (0..n).for_each(|column| products.by_slopes[(*place, column)] += by_slopes[(row, column)]);
                }
                products.by_errors += own.tr_mul(&DVector::from_column_slice(&run.errors[slot]));
                products.square += own.tr_mul(&own);
            }
        }
        products
    }

    fn reduced_at(
        &self,
        near: &Near,
        products: &[Products],
        asked: Option<usize>,
        further: std::ops::Range<usize>,
    ) -> Reduced {
        let n = further.len();
        let mut gradient = DVector::zeros(n);
        let mut hessian = DMatrix::<f64>::zeros(n, n);
        let mut mixed = DMatrix::<f64>::zeros(near.scale.len(), n);
        for (products, variance) in products.iter().zip(&near.variances) {
            for (own, column) in further.clone().enumerate() {
                let by_errors =
                    products.by_errors[column] - asked.map_or(0.0, |asked| products.square[(asked, column)]);
                gradient[own] -= by_errors / variance;
                further
                    .clone()
                    .enumerate()
                    .for_each(|(k, row)| hessian[(k, own)] += products.square[(row, column)] / variance);
                (0..near.scale.len()).for_each(|row| mixed[(row, own)] += products.by_slopes[(row, column)] / variance);
            }
        }
        let scale = DVector::from_fn(n, |k, _| hessian[(k, k)].max(f64::MIN_POSITIVE).sqrt().recip());
        let mixed = DMatrix::from_fn(mixed.nrows(), n, |k, l| mixed[(k, l)] * near.scale[k] * scale[l]);
        let outer = DMatrix::from_fn(n, n, |k, l| hessian[(k, l)] * scale[k] * scale[l]);
        let step = near.factor.solve(&near.slope);
        Reduced {
            cost: near.cost,
            samples: near.samples,
            gain: 0.5 * near.slope.dot(&step),
            gradient: gradient.component_mul(&scale) - mixed.transpose() * &step,
            hessian: outer - mixed.transpose() * near.factor.solve(&mixed),
            scale: scale.iter().copied().collect(),
        }
    }

    /// Sums of these errors, of every run and free joint.
    fn sums_of<'e>(&self, errors: impl Iterator<Item = &'e [Vec<f64>]>) -> Vec<Sums> {
        let none = Sums { samples: 0.0, squares: 0.0, by_slopes: DVector::zeros(self.prior.len()) };
        let mut sums = vec![none; self.grams.len()];
        for (run, errors) in self.runs.iter().zip(errors) {
            for (joint, (slopes, errors)) in run.joints.iter().zip(run.slopes.iter().zip(errors)) {
                let own = &mut sums[*joint];
                own.samples += errors.len() as f64;
                own.squares += errors.iter().map(|error| error * error).sum::<f64>();
                let by_slopes = slopes.tr_mul(&DVector::from_column_slice(errors));
                run.places.iter().zip(by_slopes.iter()).for_each(|(place, value)| own.by_slopes[*place] += value);
            }
        }
        sums
    }

    /// Sums of the errors that a response leaves.
    fn sums_less(&self, products: &[Products], column: usize) -> Vec<Sums> {
        let less = |(sums, products): (&Sums, &Products)| Sums {
            samples: sums.samples,
            squares: (sums.squares - 2.0 * products.by_errors[column] + products.square[(column, column)]).max(0.0),
            by_slopes: &sums.by_slopes - products.by_slopes.column(column),
        };
        self.sums.iter().zip(products).map(less).collect()
    }

    /// The likelihood of errors with these sums, which all unknowns change as they change those of the tangent.
    fn near(&self, sums: &[Sums]) -> Option<Near> {
        let variances: Vec<f64> =
            sums.iter().zip(&self.floors).map(|(sums, floor)| sums.squares / sums.samples + floor).collect();
        let cost = self.prior_cost
            + sums.iter().zip(&variances).map(|(sums, variance)| 0.5 * sums.samples * variance.ln()).sum::<f64>();
        let mut gradient = DVector::from_iterator(self.prior.len(), self.prior.iter().map(|(_, slope)| *slope));
        let mut hessian = DMatrix::from_diagonal(&DVector::from_iterator(
            self.prior.len(),
            self.prior.iter().map(|(information, _)| *information),
        ));
        for ((gram, sums), variance) in self.grams.iter().zip(sums).zip(&variances) {
            hessian += gram / *variance;
            gradient -= &sums.by_slopes / *variance;
        }
        let scale = hessian.diagonal().map(|entry| entry.max(f64::MIN_POSITIVE).sqrt().recip());
        let mut scaled = DMatrix::from_fn(scale.len(), scale.len(), |k, l| hessian[(k, l)] * scale[k] * scale[l]);
        // What moves nothing has no step.
        (0..scale.len()).for_each(|k| scaled[(k, k)] += 1e-10);
        let samples: f64 = sums.iter().map(|sums| sums.samples).sum();
        Some(Near {
            cost,
            samples,
            slope: gradient.component_mul(&scale),
            scale,
            factor: scaled.cholesky()?,
            variances,
        })
    }
}

impl Near {
    fn cost_after_step(&self) -> Option<f64> {
        let gain = 0.5 * self.slope.dot(&self.factor.solve(&self.slope));
        Some(after(self.cost, self.samples, gain)).filter(|cost| cost.is_finite())
    }
}

/// What a step comes to that takes so much off the quadratic: this counts squares in units of the variance as it is, and the variance
/// shrinks with them.
fn after(cost: f64, samples: f64, gain: f64) -> f64 {
    /// No step is believed to leave less than this share of the variance.
    const LEAST: f64 = 1e-3;
    cost + 0.5 * samples * (1.0 - 2.0 * gain / samples).max(LEAST).ln()
}

/// A likelihood of a few unknowns, every other at its best.
#[derive(Debug, Clone)]
pub struct Reduced {
    /// Negative log likelihood at the point, its number of samples, and what the step of the others gains.
    cost: f64,
    samples: f64,
    gain: f64,
    gradient: DVector<f64>,
    hessian: DMatrix<f64>,
    scale: Vec<f64>,
}

/// What a step promises.
#[derive(Debug, Clone, PartialEq)]
pub struct Promise {
    /// Negative log likelihood after the step.
    pub cost: f64,
    /// The step of each unknown.
    pub step: Vec<f64>,
}

impl Reduced {
    fn after(&self, gain: f64) -> f64 {
        after(self.cost, self.samples, gain)
    }

    /// The best step that stays within `bounds` (lowest and highest step of each unknown): coordinate descent, which for so few unknowns
    /// is quick.
    pub fn promise(&self, bounds: &[(f64, f64)]) -> Promise {
        /// For a few unknowns, strongly coupled at worst.
        const SWEEPS: usize = 200;
        let n = bounds.len();
        let mut step = vec![0.0; n];
        for _ in 0..SWEEPS {
            for (own, (low, high)) in bounds.iter().enumerate() {
                let curvature = self.hessian[(own, own)];
                // What the others can do as well is no unknown of its own: the diagonal was one before they had their step.
                if curvature < 1e-9 {
                    continue;
                }
                let others = (0..n).filter(|other| *other != own);
                let slope: f64 =
                    self.gradient[own] + others.map(|other| self.hessian[(own, other)] * step[other]).sum::<f64>();
                let scale = self.scale[own];
                step[own] = (-slope / curvature).clamp((low / scale).min(0.0), (high / scale).max(0.0));
            }
        }
        let linear: f64 = (0..n).map(|own| self.gradient[own] * step[own]).sum();
        let pairs = (0..n).flat_map(|one| (0..n).map(move |other| (one, other)));
        let square: f64 = pairs.map(|(one, other)| self.hessian[(one, other)] * step[one] * step[other]).sum();
        let step = step.iter().zip(&self.scale).map(|(step, scale)| step * scale).collect();
        Promise { cost: self.after(self.gain - linear - 0.5 * square), step }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Within their bounds two unknowns have the step that is best for both; one that tells nothing which the others do not has none.
    #[test]
    fn a_promise_is_of_the_best_step_within_its_bounds() {
        let own = |hessian: &[f64], gradient: &[f64], scale: Vec<f64>| Reduced {
            cost: 7.0,
            samples: 1e6,
            gain: 2.0,
            gradient: DVector::from_column_slice(gradient),
            hessian: DMatrix::from_row_slice(scale.len(), scale.len(), hessian),
            scale,
        };
        let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-3, "{found}, not {expected}");
        let free = (f64::NEG_INFINITY, f64::INFINITY);
        // 2 x^2 + x y + y^2 - 2 x + y has its minimum at (5/7, -6/7), of -8/7; the gain is that and what the others have.
        let pair = own(&[4.0, 1.0, 1.0, 2.0], &[-2.0, 1.0], vec![1.0, 10.0]);
        let Promise { cost, step } = pair.promise(&[free, free]);
        close(step[0], 5.0 / 7.0);
        close(step[1], -60.0 / 7.0);
        close(cost, 7.0 - 2.0 - 8.0 / 7.0);
        // Held at y >= -0.2: x = 2.2/4.
        let Promise { step, .. } = pair.promise(&[free, (-2.0, 1.0)]);
        close(step[0], 0.55);
        close(step[1], -2.0);
        let known = own(&[4.0, 0.0, 0.0, 1e-12], &[-2.0, 1.0], vec![1.0, 1.0]);
        assert_eq!(known.promise(&[free, (-5.0, 5.0)]).step, [0.5, 0.0]);
    }
}
