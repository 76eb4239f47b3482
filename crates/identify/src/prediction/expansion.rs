//! The likelihood near a point: what a step of Gauss and Newton from there would gain (score test).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{PredictionProblem, evaluate::Evaluator, plan::Plan};

/// Predictions near the point where a problem starts, to first order: what its unknowns may make up for of any other predictions.
pub struct Tangent {
    /// Of every run and free joint, one row an error.
    slopes: Vec<Vec<DMatrix<f64>>>,
    /// The errors there, and the variance below which those of a joint are rounding.
    errors: Vec<Vec<Vec<f64>>>,
    floors: Vec<f64>,
    /// `slopes' slopes` of all runs, by joint and all unknowns.
    grams: Vec<DMatrix<f64>>,
    /// Index among the joints of every run's free ones, and of its unknowns among all.
    places: Vec<(Vec<usize>, Vec<usize>)>,
    /// Cost of the prior, and its information and slope.
    prior_cost: f64,
    prior: Vec<(f64, f64)>,
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
        let errors = evaluator.errors(&x, plan)?;
        let floors = evaluator.floors.clone();
        Some(Self { slopes, errors, floors, grams, places, prior_cost: evaluator.prior_cost(&x), prior })
    }

    /// Cost once the unknowns have taken their step.
    pub fn own_cost(&self) -> Option<f64> {
        self.near(&self.errors)?.cost_after_step()
    }

    /// Cost of a problem of the same runs, with other equations, once the unknowns of this one have taken the step that is best
    /// for it.
    pub fn cost(&self, problem: &PredictionProblem, plan: &Plan) -> Option<f64> {
        let evaluator = Evaluator::new(problem);
        let x = evaluator.start().ok()?;
        self.near(&evaluator.errors(&x, plan)?)?.cost_after_step()
    }

    /// What is left for the unknowns of a problem of the same runs, with other equations, when those of this one have taken the step that
    /// is best for it.
    pub fn reduced(&self, problem: &PredictionProblem, plan: &Plan) -> Option<Reduced> {
        let evaluator = Evaluator::new(problem);
        let x = evaluator.start().ok()?;
        let own_slopes = evaluator.slopes(&x, plan)?;
        let errors = evaluator.errors(&x, plan)?;
        let near = self.near(&errors)?;
        let n = problem.unknowns.len();
        let mut gradient = DVector::zeros(n);
        let mut hessian = DMatrix::<f64>::zeros(n, n);
        let mut mixed = DMatrix::<f64>::zeros(near.scale.len(), n);
        for (run, own_slopes) in own_slopes.iter().enumerate() {
            let (joints, places) = &self.places[run];
            let (_, own_places) = evaluator.places(run);
            // Parameters come first.
            let own_places: Vec<usize> = own_places.into_iter().take_while(|place| *place < n).collect();
            for (slot, own) in own_slopes.iter().enumerate() {
                let information = near.variances[joints[slot]].recip();
                let own = own.columns(0, own_places.len()).transpose();
                let square = information * &own * own.transpose();
                let across = information * &own * &self.slopes[run][slot];
                let slope = -information * &own * DVector::from_column_slice(&errors[run][slot]);
                for (k, column) in own_places.iter().enumerate() {
                    gradient[*column] += slope[k];
                    own_places.iter().enumerate().for_each(|(l, row)| hessian[(*row, *column)] += square[(l, k)]);
                    places.iter().enumerate().for_each(|(l, row)| mixed[(*row, *column)] += across[(k, l)]);
                }
            }
        }
        let scale = DVector::from_fn(n, |k, _| hessian[(k, k)].max(f64::MIN_POSITIVE).sqrt().recip());
        let mixed = DMatrix::from_fn(mixed.nrows(), n, |k, l| mixed[(k, l)] * near.scale[k] * scale[l]);
        let outer = DMatrix::from_fn(n, n, |k, l| hessian[(k, l)] * scale[k] * scale[l]);
        let step = near.factor.solve(&near.slope);
        Some(Reduced {
            cost: near.cost,
            samples: near.samples,
            gain: 0.5 * near.slope.dot(&step),
            gradient: gradient.component_mul(&scale) - mixed.transpose() * &step,
            hessian: outer - mixed.transpose() * near.factor.solve(&mixed),
            scale: scale.iter().copied().collect(),
        })
    }

    /// The likelihood of these errors, which all unknowns change as they change those of the tangent.
    fn near(&self, errors: &[Vec<Vec<f64>>]) -> Option<Near> {
        let mut sums = vec![(0.0, 0.0); self.grams.len()];
        for ((joints, _), errors) in self.places.iter().zip(errors) {
            for (joint, errors) in joints.iter().zip(errors) {
                sums[*joint].0 += errors.len() as f64;
                sums[*joint].1 += errors.iter().map(|error| error * error).sum::<f64>();
            }
        }
        let variances: Vec<f64> =
            sums.iter().zip(&self.floors).map(|((n, squares), floor)| squares / n + floor).collect();
        let cost = self.prior_cost
            + sums.iter().zip(&variances).map(|((n, _), variance)| 0.5 * n * variance.ln()).sum::<f64>();
        let mut gradient = DVector::from_iterator(self.prior.len(), self.prior.iter().map(|(_, slope)| *slope));
        let mut hessian = DMatrix::from_diagonal(&DVector::from_iterator(
            self.prior.len(),
            self.prior.iter().map(|(information, _)| *information),
        ));
        for (gram, variance) in self.grams.iter().zip(&variances) {
            hessian += gram / *variance;
        }
        for ((slopes, errors), (joints, places)) in self.slopes.iter().zip(errors).zip(&self.places) {
            for (joint, (slopes, errors)) in joints.iter().zip(slopes.iter().zip(errors)) {
                let own = slopes.tr_mul(&DVector::from_column_slice(errors)) / variances[*joint];
                places.iter().zip(own.iter()).for_each(|(place, value)| gradient[*place] -= value);
            }
        }
        let scale = hessian.diagonal().map(|entry| entry.max(f64::MIN_POSITIVE).sqrt().recip());
        let mut scaled = DMatrix::from_fn(scale.len(), scale.len(), |k, l| hessian[(k, l)] * scale[k] * scale[l]);
        // What moves nothing has no step.
        (0..scale.len()).for_each(|k| scaled[(k, k)] += 1e-10);
        let samples: f64 = sums.iter().map(|(n, _)| n).sum();
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

    /// The best step of some of the unknowns, by their place among these, that stays within `bounds` (lowest and highest step of
    /// each): coordinate descent, which for so few unknowns is quick.
    pub fn promise(&self, places: &[usize], bounds: &[(f64, f64)]) -> Promise {
        /// For a few unknowns, strongly coupled at worst.
        const SWEEPS: usize = 200;
        let mut step = vec![0.0; places.len()];
        for _ in 0..SWEEPS {
            for (own, place) in places.iter().enumerate() {
                let curvature = self.hessian[(*place, *place)];
                // What the others can do as well is no unknown of its own: the diagonal was one before they had their step.
                if curvature < 1e-9 {
                    continue;
                }
                let others = places.iter().zip(&step).enumerate().filter(|(other, _)| *other != own);
                let slope: f64 = self.gradient[*place]
                    + others.map(|(_, (other, step))| self.hessian[(*place, *other)] * step).sum::<f64>();
                let (low, high) = bounds[own];
                let scale = self.scale[*place];
                step[own] = (-slope / curvature).clamp((low / scale).min(0.0), (high / scale).max(0.0));
            }
        }
        let linear: f64 = places.iter().zip(&step).map(|(place, step)| self.gradient[*place] * step).sum();
        let pairs = places.iter().zip(&step).flat_map(|one| places.iter().zip(&step).map(move |other| (one, other)));
        let square: f64 = pairs.map(|((row, a), (column, b))| self.hessian[(*row, *column)] * a * b).sum();
        let step = places.iter().zip(step).map(|(place, step)| step * self.scale[*place]).collect();
        Promise { cost: self.after(self.gain - linear - 0.5 * square), step }
    }
}
