//! Least squares within bounds and among physical bodies: a primal interior-point method.
//!
//! Minimises `cost(x) + mu B(x)` for falling `mu` by damped Newton steps, where `B` is minus the logarithm of every
//! distance to a bound and `-log det P` of every link's pseudo-inertia (see [`super::pseudo_inertia`]). Steps run straight in
//! the standard parameters `(m, m c, J)` of the links: there the cost is quadratic and the barrier self-concordant, while
//! in mass, centroid and inertia, which the bounds are about, combinations that the cost does not see are curved. At the end the cost is within
//! `mu` times the number of constraints of the constrained minimum (Boyd & Vandenberghe, Convex Optimization,
//! section 11.3), far less than what one standard error makes of it.

use nalgebra::DVector;

use super::{
    body::Body,
    pseudo_inertia::{self, BodyBarrier, body_barrier, body_barrier_value},
    quadratic::Quadratic,
    region::Region,
};

/// The weight of the barrier falls by this factor from stage to stage.
const BARRIER_FALL: f64 = 0.1;
/// First and last weight of the barrier, in units of the cost: half a sum of squares over their variance.
const BARRIER_FIRST: f64 = 1.0;
const BARRIER_LAST: f64 = 1e-10;
/// A stage ends when a Newton step promises a fall of the cost by less than this share of the barrier's weight.
const STAGE_TOLERANCE: f64 = 1e-3;
/// A promised fall below this share of the cost drowns in its rounding. The gradient is still good there, so steps are
/// taken unseen, a few at most.
const ROUNDING: f64 = 1e-11;
const UNSEEN_STEPS: usize = 4;
/// Steps in one stage.
const STAGE_STEPS: usize = 60;
/// A step goes at most this far of the way to a bound.
const TO_BOUND: f64 = 0.99;

/// What is minimised.
pub trait Cost {
    /// Its value.
    fn value(&self, x: &[f64]) -> f64;
    /// Its value and derivatives, the second ones along the lines of `Interior::moved`.
    fn expand(&self, x: &[f64]) -> Quadratic;
}

/// Where a minimum is sought: strictly inside.
pub struct Interior {
    /// Bounds, the upper ones above the lower, and linear inequalities.
    pub region: Region,
    /// Links, which stay bodies where their inertia is sought.
    pub bodies: Vec<Body>,
    /// A natural size of each unknown, positive.
    pub scale: Vec<f64>,
}

impl Interior {
    /// Where a step leads: straight in the links' standard parameters, `x + step` to first order. Known numbers stay
    /// what they are. Not a number where a mass would vanish.
    fn moved(&self, x: &[f64], step: &[f64]) -> Vec<f64> {
        let mut moved: Vec<f64> = x.iter().zip(step).map(|(x, step)| x + step).collect();
        for link in &self.bodies {
            let here = link.at(x);
            let jacobian = pseudo_inertia::standard_jacobian(&here);
            let mut standard = pseudo_inertia::standard(&here);
            for (symbol, index) in link.unknowns() {
                standard.iter_mut().zip(&jacobian).for_each(|(value, row)| *value += row[symbol] * step[index]);
            }
            let there = pseudo_inertia::inertial(&standard);
            for (symbol, index) in link.unknowns() {
                moved[index] = if standard[0] > 0.0 { there[symbol] } else { f64::NAN };
            }
        }
        moved
    }

    /// For each unknown that is a link's centroid: the link's mass, by value and as an unknown.
    fn masses(&self, x: &[f64]) -> Vec<Option<(f64, Option<usize>)>> {
        let mut masses = vec![None; x.len()];
        for link in &self.bodies {
            for (symbol, index) in link.unknowns() {
                if (1..=3).contains(&symbol) {
                    masses[index] = Some((link.mass().at(x), link.mass().index()));
                }
            }
        }
        masses
    }
}

/// How a minimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The last stage reached its tolerance.
    Minimum,
    /// The last stage ran out of steps or found no step that lowers the cost.
    Stalled,
    /// The start lies outside, or the cost is not finite there.
    Infeasible,
}

/// Moves `x`, which lies strictly inside, to the minimum of `cost` there.
pub fn minimise(interior: &Interior, cost: &dyn Cost, x: &mut Vec<f64>) -> Ending {
    let mut weight = BARRIER_FIRST;
    loop {
        // An earlier stage only has to bring the next one near.
        let ending = stage(interior, cost, weight, x);
        if weight <= BARRIER_LAST || ending == Ending::Infeasible {
            return ending;
        }
        weight = (weight * BARRIER_FALL).max(BARRIER_LAST);
    }
}

/// Newton steps at one weight of the barrier.
fn stage(interior: &Interior, cost: &dyn Cost, weight: f64, x: &mut Vec<f64>) -> Ending {
    let mut damping = 0.0_f64;
    let mut unseen = 0;
    for _ in 0..STAGE_STEPS {
        let Some(here) = merit(interior, cost, weight, x) else { return Ending::Infeasible };
        let scale = DVector::from_column_slice(&interior.scale);
        // In units of the scales, where the damping means the same for every unknown.
        let gradient = here.gradient.component_mul(&scale);
        let mut hessian = here.hessian;
        for column in 0..hessian.ncols() {
            for row in 0..hessian.nrows() {
                hessian[(row, column)] *= scale[row] * scale[column];
            }
        }
        let mut moved = false;
        for _ in 0..12 {
            let mut damped = hessian.clone();
            for index in 0..damped.nrows() {
                damped[(index, index)] += damping * hessian[(index, index)].max(f64::MIN_POSITIVE);
            }
            let Some(factor) = damped.cholesky() else {
                damping = (10.0 * damping).max(1e-12);
                continue;
            };
            let step = -factor.solve(&gradient);
            let promised = -gradient.dot(&step);
            let is_unseen = promised <= ROUNDING * here.cost.abs();
            if promised <= STAGE_TOLERANCE * weight || (is_unseen && unseen == UNSEEN_STEPS) {
                return Ending::Minimum;
            }
            let step = step.component_mul(&scale);
            let promised = if is_unseen { f64::NEG_INFINITY } else { promised };
            unseen += usize::from(is_unseen);
            if let Some(next) = line_search(interior, cost, weight, x, &step, here.cost, promised) {
                *x = next;
                damping *= 0.1;
                moved = true;
                break;
            }
            damping = (10.0 * damping).max(1e-9);
        }
        if !moved {
            return Ending::Stalled;
        }
    }
    Ending::Stalled
}

/// The point along `step` that lowers the merit by a share of what was `promised` (Armijo's rule); the furthest one inside
/// where nothing (`-inf`) was.
fn line_search(
    interior: &Interior,
    cost: &dyn Cost,
    weight: f64,
    x: &[f64],
    step: &DVector<f64>,
    value: f64,
    promised: f64,
) -> Option<Vec<f64>> {
    let mut length = 1.0_f64;
    for (index, change) in step.iter().enumerate() {
        let room = if *change < 0.0 {
            interior.region.lower[index] - x[index]
        } else {
            interior.region.upper[index] - x[index]
        };
        if *change != 0.0 && room.is_finite() {
            length = length.min(TO_BOUND * room / change);
        }
    }
    for _ in 0..30 {
        let next = interior.moved(x, (step * length).as_slice());
        if let Some(barrier) = barrier_value(interior, &next)
            && cost.value(&next) + weight * barrier <= value - 1e-4 * length * promised
        {
            return Some(next);
        }
        length *= 0.5;
    }
    None
}

/// Cost plus barrier with derivatives; `None` outside of the region.
fn merit(interior: &Interior, cost: &dyn Cost, weight: f64, x: &[f64]) -> Option<Quadratic> {
    let barrier = barrier_value(interior, x)?;
    let Quadratic { cost: mut value, mut gradient, mut hessian } = cost.expand(x);
    value += weight * barrier;
    for (index, mass) in interior.masses(x).into_iter().enumerate() {
        for (distance, sign) in
            [(x[index] - interior.region.lower[index], 1.0), (interior.region.upper[index] - x[index], -1.0)]
        {
            if distance.is_infinite() {
                continue;
            }
            // A centroid's distance times the mass, m c - m c_lower, is linear in the standard parameters.
            let by_mass = mass.and_then(|(mass, unknown)| Some((unknown?, 1.0 / mass)));
            let slopes = [Some((index, sign / distance)), by_mass];
            for (row, slope) in slopes.into_iter().flatten() {
                gradient[row] -= weight * slope;
                for (column, other) in slopes.into_iter().flatten() {
                    hessian[(row, column)] += weight * slope * other;
                }
            }
        }
    }
    for half_space in &interior.region.half_spaces {
        let gap = -half_space.excess(x);
        for &(index, factor) in &half_space.terms {
            gradient[index] += weight * factor / gap;
            for &(other, other_factor) in &half_space.terms {
                hessian[(index, other)] += weight * factor * other_factor / (gap * gap);
            }
        }
    }
    for link in interior.bodies.iter().filter(|body| body.has_unknown_inertia()) {
        let inertial = link.at(x);
        let BodyBarrier { gradient: by, hessian: by_by, .. } = body_barrier(&inertial)?;
        let jacobian = pseudo_inertia::standard_jacobian(&inertial);
        for (symbol, index) in link.unknowns() {
            gradient[index] += weight * (0..10).map(|row| jacobian[row][symbol] * by[row]).sum::<f64>();
            let half: [f64; 10] = std::array::from_fn(|row| (0..10).map(|k| by_by[row][k] * jacobian[k][symbol]).sum());
            for (other_symbol, other) in link.unknowns() {
                hessian[(other, index)] +=
                    weight * (0..10).map(|row| jacobian[row][other_symbol] * half[row]).sum::<f64>();
            }
        }
    }
    value.is_finite().then_some(Quadratic { cost: value, gradient, hessian })
}

/// The barrier; `None` outside of the region.
fn barrier_value(interior: &Interior, x: &[f64]) -> Option<f64> {
    let mut value = 0.0;
    for (index, mass) in interior.masses(x).into_iter().enumerate() {
        for distance in [x[index] - interior.region.lower[index], interior.region.upper[index] - x[index]] {
            if distance.is_nan() || distance <= 0.0 {
                return None;
            }
            if distance.is_finite() {
                value -= (distance / interior.scale[index]).ln() + mass.map_or(0.0, |(mass, _)| mass.ln());
            }
        }
    }
    for half_space in &interior.region.half_spaces {
        let gap = -half_space.excess(x);
        let size = half_space.terms.iter().map(|(index, _)| interior.scale[*index]).fold(0.0, f64::max);
        if gap.is_nan() || gap <= 0.0 {
            return None;
        }
        value -= (gap / size).ln();
    }
    for link in interior.bodies.iter().filter(|body| body.has_unknown_inertia()) {
        value += body_barrier_value(&link.at(x))?;
    }
    value.is_finite().then_some(value)
}

/// Whether `x` lies strictly inside.
pub fn is_inside(interior: &Interior, x: &[f64]) -> bool {
    barrier_value(interior, x).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::{Entry, HalfSpace};
    use nalgebra::DMatrix;

    /// `(x - target)^T weights (x - target) / 2`
    struct Bowl {
        weights: DMatrix<f64>,
        target: Vec<f64>,
    }

    impl Cost for Bowl {
        fn value(&self, x: &[f64]) -> f64 {
            self.expand(x).cost
        }

        fn expand(&self, x: &[f64]) -> Quadratic {
            let offset = DVector::from_iterator(x.len(), x.iter().zip(&self.target).map(|(x, target)| x - target));
            let gradient = &self.weights * &offset;
            Quadratic { cost: 0.5 * offset.dot(&gradient), gradient, hessian: self.weights.clone() }
        }
    }

    fn bowl(weights: DMatrix<f64>, target: Vec<f64>) -> Bowl {
        Bowl { weights, target }
    }

    fn free(n: usize) -> Interior {
        let (lower, upper) = (vec![f64::NEG_INFINITY; n], vec![f64::INFINITY; n]);
        Interior { region: Region { lower, upper, half_spaces: vec![] }, bodies: vec![], scale: vec![1.0; n] }
    }

    #[test]
    fn without_constraints_the_minimum_is_exact() {
        let weights = DMatrix::from_row_slice(2, 2, &[1e8, 3e3, 3e3, 1.0]);
        let mut x = vec![5.0, -7.0];
        assert_eq!(minimise(&free(2), &bowl(weights, vec![0.25, 4.0]), &mut x), Ending::Minimum);
        assert!((x[0] - 0.25).abs() < 1e-9 && (x[1] - 4.0).abs() < 1e-6, "{x:?}");
    }

    /// minimise ((x-2)^2 + (y-2)^2 + x y)/2 with x <= 0.5: y = 2 - x/2 = 1.75.
    #[test]
    fn an_active_bound_moves_the_others_along() {
        let mut interior = free(2);
        interior.region.upper[0] = 0.5;
        interior.region.lower[1] = -10.0;
        let weights = DMatrix::from_row_slice(2, 2, &[1.0, 0.5, 0.5, 1.0]);
        // The same function, as a bowl about its free minimum (4/3, 4/3).
        let mut x = vec![0.0, 0.0];
        assert_eq!(minimise(&interior, &bowl(weights, vec![4.0 / 3.0, 4.0 / 3.0]), &mut x), Ending::Minimum);
        assert!((x[0] - 0.5).abs() < 1e-8, "{x:?}");
        assert!((x[1] - 1.75).abs() < 1e-8, "{x:?}");
        assert!(x[0] < 0.5);
    }

    /// Pulled towards moments (1, 1, 4), which no body has, the nearest body is the plate with zz = xx + yy: (2, 2, 4)
    /// less a third of the excess each way: 1 + 2/3, 1 + 2/3, 4 - 2/3.
    #[test]
    fn an_impossible_inertia_ends_at_the_nearest_possible_one() {
        let mut interior = free(3);
        use Entry::{Known, Unknown};
        let zero = Known(0.0);
        let inertial = [Known(2.0), zero, zero, zero, Unknown(0), zero, zero, Unknown(1), zero, Unknown(2)];
        interior.bodies = vec![Body { link: 1, inertial }];
        let mut x = vec![1.0, 1.0, 1.0];
        let ending = minimise(&interior, &bowl(DMatrix::identity(3, 3), vec![1.0, 1.0, 4.0]), &mut x);
        assert_eq!(ending, Ending::Minimum);
        for (found, expected) in x.iter().zip([5.0 / 3.0, 5.0 / 3.0, 10.0 / 3.0]) {
            assert!((found - expected).abs() < 1e-8, "{x:?}");
        }
        assert!(x[0] + x[1] > x[2]);
    }

    /// Pulled towards (1, 3) with x >= y: both end at 2. Pulled towards (3, 1): nothing holds.
    #[test]
    fn an_order_is_kept() {
        let mut interior = free(2);
        interior.region.half_spaces.extend(HalfSpace::of_order(Entry::Unknown(0), Entry::Unknown(1)));
        let mut x = vec![5.0, 0.0];
        assert_eq!(minimise(&interior, &bowl(DMatrix::identity(2, 2), vec![1.0, 3.0]), &mut x), Ending::Minimum);
        assert!((x[0] - 2.0).abs() < 1e-8 && (x[1] - 2.0).abs() < 1e-8 && x[0] > x[1], "{x:?}");
        let mut x = vec![5.0, 0.0];
        assert_eq!(minimise(&interior, &bowl(DMatrix::identity(2, 2), vec![3.0, 1.0]), &mut x), Ending::Minimum);
        assert!((x[0] - 3.0).abs() < 1e-8 && (x[1] - 1.0).abs() < 1e-8, "{x:?}");
    }

    #[test]
    fn a_start_outside_is_said() {
        let mut interior = free(1);
        interior.region.lower[0] = 0.0;
        let mut x = vec![-1.0];
        assert_eq!(minimise(&interior, &bowl(DMatrix::identity(1, 1), vec![1.0]), &mut x), Ending::Infeasible);
    }
}
