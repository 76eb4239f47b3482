//! The night in which a quantity of a robot begins to be another.
//!
//! A series is explained by its mean and, one after the other, by the shape that takes most of what is left: generalised least
//! squares with the covariance of the scatter, of which a shape's deviation is its amount over its standard error. What is taken
//! stays; when no shape is sure any more, the series is explained.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use serde::Serialize;

use crate::scatter::Own;
use crate::{Level, Scatter, Series};

/// How a quantity changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// It is another from this night on.
    Step,
    /// It moves from this night on, each night by the same.
    Drift,
    /// This night stands alone: a bad log rather than another robot.
    Stray,
}

/// A change that is sure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// Which robot.
    pub robot: String,
    /// What has changed.
    pub quantity: String,
    /// How.
    pub shape: Shape,
    /// The first night of the change; a drift is 0 in this one.
    pub night: String,
    /// Its place among the fleet's nights.
    pub index: usize,
    /// Places of the nights of which the likelihood is within a factor of `exp(1.92)` of the most likely one: 95 % of a single unknown.
    pub between: [usize; 2],
    /// By how much; of a drift, each night (unit of the quantity).
    pub by: f64,
    /// Standard error of that.
    pub std_error: f64,
    /// Value before.
    pub from: f64,
    /// Value afterwards; of a drift, in the last night.
    pub to: f64,
    /// Probability that a fleet in which nothing happens shows as much anywhere.
    pub chance: f64,
}

impl Change {
    pub(crate) fn name(&mut self, nights: &[String]) {
        self.night.clone_from(&nights[self.index]);
    }
}

/// A series with what explains it.
pub(crate) struct Explained {
    pub(crate) changes: Vec<Change>,
    /// The series without that: strays are left out, what lasts is taken away.
    pub(crate) rest: Series,
    /// Value in the last night, without what only that has.
    pub(crate) last: f64,
    pub(crate) std_error: f64,
}

/// Nights on either side of a step: one alone is a stray.
const LEAST_NIGHTS: usize = 2;
/// Twice the logarithm of the likelihood's factor that leaves a night possible: 95 % of a chi-squared number of one degree of freedom.
const POSSIBLE: f64 = 3.841_458_820_694_124;

/// What is smaller is nothing: its square is none, and that over which it is divided infinite.
const LEAST: f64 = 1e-100;

/// All shapes that a series of so many nights may have, each with the place where it begins.
fn shapes(n: usize) -> impl Iterator<Item = (Shape, usize)> {
    let steps = (LEAST_NIGHTS..=n.saturating_sub(LEAST_NIGHTS)).map(|at| (Shape::Step, at));
    let drifts = (0..n.saturating_sub(LEAST_NIGHTS)).map(|at| (Shape::Drift, at));
    let strays = (0..n).map(|at| (Shape::Stray, at));
    steps.chain(drifts).chain(strays).filter(move |_| n > 2 * LEAST_NIGHTS - 1)
}

/// How many shapes are tried.
pub(crate) fn looks(n: usize) -> usize {
    shapes(n).count()
}

/// What a shape adds to each night, for an amount of 1.
fn column(series: &Series, shape: Shape, at: usize) -> DVector<f64> {
    let night = |k: usize| series.nights[k] as f64;
    DVector::from_fn(series.len(), |k, _| match shape {
        Shape::Step => f64::from(u8::from(k >= at)),
        Shape::Drift => (night(k) - night(at)).max(0.0),
        Shape::Stray => f64::from(u8::from(k == at)),
    })
}

/// Numbers that are independent and of variance 1 in place of those of a series.
struct Whitened {
    factor: Cholesky<f64, Dyn>,
}

impl Whitened {
    fn new(series: &Series, scatter: &Scatter, own: Own) -> Option<Self> {
        let n = series.len();
        let largest = series.values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        // Estimates that repeat to the last digit leave no scatter at all: that of rounding stays.
        let rounding = (largest * f64::EPSILON).max(LEAST);
        let since = |k: usize| (series.nights[k] - series.nights[0]) as f64;
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let walked = scatter.walk.powi(2) * since(i.min(j));
            if i != j {
                return own.variance * walked;
            }
            own.variance * (walked + series.std_errors[i].powi(2) + scatter.night.powi(2)) + rounding.powi(2)
        });
        covariance.cholesky().map(|factor| Self { factor })
    }

    fn of(&self, values: &DVector<f64>) -> DVector<f64> {
        let mut own = values.clone();
        self.factor.l_dirty().solve_lower_triangular_mut(&mut own);
        own
    }
}

/// What is left of a vector beside others that are orthonormal.
fn beside(mut own: DVector<f64>, basis: &[DVector<f64>]) -> DVector<f64> {
    // Twice: the first leaves what rounding makes of it.
    for _ in 0..2 {
        for direction in basis {
            let share = direction.dot(&own);
            own.axpy(-share, direction, 1.0);
        }
    }
    own
}

/// A shape beside what is known already.
struct Look {
    shape: Shape,
    at: usize,
    /// Amount over its standard error.
    deviation: f64,
}

/// Finds what explains a series.
pub(crate) fn explain(series: &Series, scatter: &Scatter, own: Own, level: Level) -> Explained {
    let n = series.len();
    let values = DVector::from_column_slice(&series.values);
    let Some(white) = Whitened::new(series, scatter, own) else {
        let last = values[n - 1];
        return Explained { changes: Vec::new(), rest: series.clone(), last, std_error: series.std_errors[n - 1] };
    };
    let y = white.of(&values);
    let ones = DVector::from_element(n, 1.0);
    let mut known: Vec<(Shape, usize, f64)> = Vec::new();
    let basis_of = |known: &[(Shape, usize, f64)]| {
        let columns = [ones.clone()].into_iter().chain(known.iter().map(|(shape, at, _)| column(series, *shape, *at)));
        columns.fold(Vec::new(), |mut basis: Vec<DVector<f64>>, own| {
            basis.extend(beside(white.of(&own), &basis).try_normalize(f64::MIN_POSITIVE));
            basis
        })
    };
    let looked = |basis: &[DVector<f64>]| -> Vec<Look> {
        let left = beside(y.clone(), basis);
        let look = |(shape, at)| {
            let whole = white.of(&column(series, shape, at));
            let own = beside(whole.clone(), basis);
            let size = own.norm();
            // What is the same as something known has nothing of its own.
            let is_new = size > 1e-6 * whole.norm();
            is_new.then(|| Look { shape, at, deviation: own.dot(&left) / size })
        };
        shapes(n).filter_map(look).collect()
    };
    while known.len() < n / 3 {
        let looks = looked(&basis_of(&known));
        let Some(best) = looks.into_iter().max_by(|a, b| a.deviation.abs().total_cmp(&b.deviation.abs())) else {
            break;
        };
        let chance = level.chance(best.deviation, own.freedom);
        if !level.is_sure(chance) {
            break;
        }
        known.push((best.shape, best.at, chance));
    }
    told(series, &white, &y, &known, |basis| looked(basis), basis_of)
}

/// All that was found, with amounts that are estimated together.
fn told(
    series: &Series,
    white: &Whitened,
    y: &DVector<f64>,
    known: &[(Shape, usize, f64)],
    looked: impl Fn(&[DVector<f64>]) -> Vec<Look>,
    basis_of: impl Fn(&[(Shape, usize, f64)]) -> Vec<DVector<f64>>,
) -> Explained {
    let n = series.len();
    let columns: Vec<DVector<f64>> = known.iter().map(|(shape, at, _)| column(series, *shape, *at)).collect();
    let all: Vec<DVector<f64>> =
        [DVector::from_element(n, 1.0)].into_iter().chain(columns).map(|own| white.of(&own)).collect();
    let normal = DMatrix::from_fn(all.len(), all.len(), |i, j| all[i].dot(&all[j]));
    let covariance = normal.try_inverse().unwrap_or_else(|| DMatrix::zeros(all.len(), all.len()));
    let amounts = &covariance * DVector::from_fn(all.len(), |i, _| all[i].dot(y));
    // Without strays: what is the robot's.
    let fitted = |k: usize| {
        let lasting = known.iter().zip(amounts.iter().skip(1)).filter(|((shape, ..), _)| *shape != Shape::Stray);
        amounts[0] + lasting.map(|((shape, at, _), amount)| amount * column(series, *shape, *at)[k]).sum::<f64>()
    };
    let change = |(place, &(shape, at, chance)): (usize, &(Shape, usize, f64))| {
        let others: Vec<_> =
            known.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, own)| *own).collect();
        let alike: Vec<Look> = looked(&basis_of(&others)).into_iter().filter(|own| own.shape == shape).collect();
        let most = alike.iter().fold(0.0_f64, |most, own| most.max(own.deviation.powi(2)));
        let possible = || alike.iter().filter(|own| own.deviation.powi(2) >= most - POSSIBLE).map(|own| own.at);
        let between = [possible().min().unwrap_or(at).min(at), possible().max().unwrap_or(at).max(at)];
        let by = amounts[place + 1];
        let (from, to) = match shape {
            Shape::Step => (fitted(at) - by, fitted(at)),
            Shape::Drift => (fitted(at), fitted(n - 1)),
            Shape::Stray => (fitted(at), series.values[at]),
        };
        Change {
            robot: series.robot.clone(),
            quantity: series.quantity.clone(),
            shape,
            night: String::new(),
            index: series.nights[at],
            between: between.map(|k| series.nights[k]),
            by,
            std_error: covariance[(place + 1, place + 1)].max(0.0).sqrt(),
            from,
            to,
            chance,
        }
    };
    let at_last = DVector::from_fn(all.len(), |i, _| match i.checked_sub(1).map(|own| known[own]) {
        None => 1.0,
        Some((Shape::Stray, ..)) => 0.0,
        Some((shape, at, _)) => column(series, shape, at)[n - 1],
    });
    let kept: Vec<usize> = (0..n).filter(|k| !known.iter().any(|own| (own.0, own.1) == (Shape::Stray, *k))).collect();
    let rest = Series {
        nights: kept.iter().map(|k| series.nights[*k]).collect(),
        values: kept.iter().map(|k| series.values[*k] - (fitted(*k) - amounts[0])).collect(),
        std_errors: kept.iter().map(|k| series.std_errors[*k]).collect(),
        ..series.clone()
    };
    Explained {
        rest,
        changes: known.iter().enumerate().map(change).collect(),
        last: fitted(n - 1),
        std_error: at_last.dot(&(&covariance * &at_last)).max(0.0).sqrt(),
    }
}
