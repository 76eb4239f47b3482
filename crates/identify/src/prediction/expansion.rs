//! The likelihood near a point: what a step of Gauss and Newton from there would gain (score test).

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{PredictionProblem, evaluate::Evaluator};
use dynid_optimise::{quadratic::Quadratic, sqp::Objective};

/// The negative log likelihood near the point where a problem starts.
#[derive(Debug, Clone)]
pub struct Expansion {
    quadratic: Quadratic,
    samples: f64,
}

impl Expansion {
    /// Of a problem at its start, with so many integration steps per sample; `None` where it cannot be simulated.
    pub fn new(problem: &PredictionProblem, substeps: usize) -> Option<Self> {
        let evaluator = Evaluator::new(problem);
        let x = evaluator.start().ok()?;
        let samples = evaluator.samples();
        Some(Self { quadratic: evaluator.at(substeps).quadratic(&x)?, samples })
    }

    /// What is left when everything but the unknowns `own` has taken its best step.
    pub fn reduced(&self, own: &[usize]) -> Option<Reduced> {
        let Quadratic { cost, gradient, hessian } = &self.quadratic;
        let rest: Vec<usize> = (0..gradient.len()).filter(|index| !own.contains(index)).collect();
        let scale = |index: usize| hessian[(index, index)].max(f64::MIN_POSITIVE).sqrt().recip();
        let entry = |row: usize, column: usize| hessian[(row, column)] * scale(row) * scale(column);
        let mut inner = DMatrix::from_fn(rest.len(), rest.len(), |row, column| entry(rest[row], rest[column]));
        // What moves nothing has no step.
        (0..rest.len()).for_each(|k| inner[(k, k)] += 1e-10);
        let factor: Cholesky<f64, Dyn> = inner.cholesky()?;
        let mixed = DMatrix::from_fn(rest.len(), own.len(), |row, column| entry(rest[row], own[column]));
        let slope = DVector::from_fn(rest.len(), |k, _| gradient[rest[k]] * scale(rest[k]));
        let outer = DMatrix::from_fn(own.len(), own.len(), |row, column| entry(own[row], own[column]));
        let step = factor.solve(&slope);
        let own_slope = DVector::from_fn(own.len(), |k, _| gradient[own[k]] * scale(own[k]));
        Some(Reduced {
            cost: *cost,
            samples: self.samples,
            gain: 0.5 * slope.dot(&step),
            gradient: own_slope - mixed.transpose() * &step,
            hessian: outer - mixed.transpose() * factor.solve(&mixed),
            scale: own.iter().map(|index| scale(*index)).collect(),
        })
    }
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
    /// Negative log likelihood where these unknowns stay as they are and all others take their step.
    pub fn cost(&self) -> f64 {
        self.after(self.gain)
    }

    /// What a step comes to that takes so much off the quadratic: this counts squares in units of the variance as it is, and the variance
    /// shrinks with them.
    fn after(&self, gain: f64) -> f64 {
        /// No step is believed to leave less than this share of the variance.
        const LEAST: f64 = 1e-3;
        self.cost + 0.5 * self.samples * (1.0 - 2.0 * gain / self.samples).max(LEAST).ln()
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
