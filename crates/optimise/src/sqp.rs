//! Sequential quadratic programming with a Gauss-Newton Hessian.
//!
//! Every iteration minimises `g'd + d'(H + lambda M)d / 2` over the step `d` under bounds and linear inequalities.
//! Convex constraints that are not linear (a link's inertia must be one that a body can have) come as cuts: half-spaces
//! that hold everywhere and that the last step broke; the subproblem is solved again until none is broken. A step that
//! does not lower the cost as foreseen, or cannot be simulated, raises the damping `lambda` (Levenberg-Marquardt, with
//! Nielsen's update).

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT},
};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{
    quadratic::Quadratic,
    region::{HalfSpace, Region},
};

/// What is minimised.
pub trait Objective {
    /// The cost at `x`; `None` where the model cannot be simulated.
    fn cost(&self, x: &[f64]) -> Option<f64>;

    /// Cost, gradient and Gauss-Newton Hessian at `x`.
    fn quadratic(&self, x: &[f64]) -> Option<Quadratic>;

    /// Weight of an unknown's squared change in the damping (`M`); by default its diagonal entry of the Hessian.
    ///
    /// Where the data know some combinations a million times better than others, that default all but stops the latter;
    /// an unknown's range treats all alike.
    fn metric(&self, _unknown: usize) -> Option<f64> {
        None
    }

    /// Half-spaces that contain every allowed point and that `x` lies outside of; none where `x` is allowed.
    fn cuts(&self, x: &[f64]) -> Vec<HalfSpace>;
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Linearisations at most.
    pub iterations: usize,
    /// Converged when the foreseen decrease is below this share of the cost ...
    pub share: f64,
    /// ... or below this.
    pub decrease: f64,
}

impl Limits {
    /// Of a cost that counts squared standard deviations: below one of them it is noise or, where the model is perfect, rounding, and
    /// its shares mean nothing.
    pub const fn of_squares(iterations: usize, share: f64) -> Self {
        Self { iterations, share, decrease: share }
    }

    /// A decrease not worth taking at `cost`.
    fn negligible(&self, cost: f64) -> f64 {
        (self.share * cost).max(self.decrease)
    }
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// No step promises a decrease worth taking.
    Converged,
    /// The iterations are used up.
    IterationLimit,
    /// No step, however short, keeps its promise; or the start cannot be simulated.
    Stuck,
    /// The caller asked to stop.
    Interrupted,
}

/// Where a search ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The best point.
    pub x: Vec<f64>,
    /// The cost around it; `None` only where the start cannot be simulated.
    pub quadratic: Option<Quadratic>,
    /// How.
    pub ended: Ended,
    /// Linearisations used.
    pub iterations: usize,
}

/// One iteration, for those who watch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// From 1, within this search.
    pub number: usize,
    /// The cost that it reached.
    pub cost: f64,
    /// Length of its step, in units of the foreseen standard deviation of each unknown.
    pub step: f64,
}

/// All that a search carries from one iteration to the next: continued from here it takes the same steps to the last
/// bit, for cost and derivatives at `x` follow from `x` alone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// The best point so far.
    pub x: Vec<f64>,
    /// Levenberg and Marquardt's damping.
    pub damping: f64,
    /// What the damping grows by after a step that keeps no promise.
    pub growth: f64,
    /// Accepted steps in a row that were hardly worth taking.
    pub idle: usize,
    /// Whether the last step was damped more than was tried first.
    pub is_shortened: bool,
    /// Linearisations used.
    pub iterations: usize,
    /// Linear inequalities, and the cuts met so far.
    pub half_spaces: Vec<HalfSpace>,
}

impl State {
    /// A search that has not begun.
    pub fn start(x: &[f64], region: &Region) -> Self {
        Self {
            x: x.to_vec(),
            damping: FIRST_DAMPING,
            growth: FIRST_GROWTH,
            idle: 0,
            is_shortened: false,
            iterations: 1,
            half_spaces: region.half_spaces.clone(),
        }
    }
}

/// Whether to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SearchControl {
    /// Go on.
    Continue,
    /// Stop at the best point so far.
    Stop,
    /// Take the best point so far for the end: what is still to be gained is not worth the time.
    GoodEnough,
}

/// Damping at the start: nearly a full Gauss-Newton step.
const FIRST_DAMPING: f64 = 1e-3;
/// What the damping grows by after the first step that keeps no promise.
const FIRST_GROWTH: f64 = 2.0;
/// Up to this damping a step is as good as a Gauss-Newton step.
const UNDAMPED: f64 = 0.1;
/// Beyond this damping the step is too short to matter.
const LAST_DAMPING: f64 = 1e12;
/// So many accepted steps in a row, each of a decrease below so many tolerances, are enough: a valley so flat is not
/// worth following to its end.
const IDLE_ITERATIONS: usize = 3;
const IDLE: f64 = 3.0;
/// A search that gets stuck still ends at a minimum if all that is promised is below this share of the cost: where the cost
/// has kinks and small jumps (friction that turns, or differs on two sides), the last promises are not kept.
const NEAR: f64 = 1e-3;
/// A step counts as good from this share of the foreseen decrease.
const ACCEPTED_SHARE: f64 = 1e-3;
/// A constraint farther away than so many free steps is put there: a bound that is a trillion steps away ruins the
/// interior point's arithmetic.
const FARTHEST: f64 = 1e3;
/// How often a subproblem is solved again for new cuts.
const CUT_ROUNDS: usize = 30;
/// A constraint that a scaled step breaks by less than an interior point resolves is not broken.
const BROKEN: f64 = 1e-9;

/// Minimises `objective` from `start`, which lies within `region`; cuts are added to it.
pub fn minimise(
    objective: &impl Objective,
    region: &mut Region,
    start: &[f64],
    limits: &Limits,
    watch: &mut dyn FnMut(&Iteration) -> SearchControl,
) -> Outcome {
    let state = State::start(start, region);
    resume(objective, region, state, None, limits, &mut |iteration, _| watch(iteration))
}

/// As [`minimise`], from any state that `watch` was shown; `known` is the cost around it, if that is known.
pub fn resume(
    objective: &impl Objective,
    region: &mut Region,
    state: State,
    known: Option<Quadratic>,
    limits: &Limits,
    watch: &mut dyn FnMut(&Iteration, &State) -> SearchControl,
) -> Outcome {
    let State { mut x, mut damping, mut growth, mut idle, mut is_shortened, mut iterations, half_spaces } = state;
    region.half_spaces = half_spaces;
    let Some(mut quadratic) = known.or_else(|| objective.quadratic(&x)) else {
        return Outcome { x, quadratic: None, ended: Ended::Stuck, iterations: 0 };
    };
    let ended = loop {
        if damping > LAST_DAMPING || idle >= IDLE_ITERATIONS {
            // The least damped subproblem that can be solved promises most.
            let near = [FIRST_DAMPING, UNDAMPED, 1.0]
                .into_iter()
                .find_map(|damping| allowed_step(objective, region, &quadratic, &x, damping))
                .is_some_and(|step| foreseen_decrease(&quadratic, &step) <= NEAR * quadratic.cost.max(1.0));
            break if near { Ended::Converged } else { Ended::Stuck };
        }
        let Some(step) = allowed_step(objective, region, &quadratic, &x, damping) else {
            damping *= growth;
            growth *= 2.0;
            continue;
        };
        let foreseen = foreseen_decrease(&quadratic, &step);
        // A damped step promises little because it is short, not because the minimum is near.
        if damping <= UNDAMPED && foreseen <= limits.negligible(quadratic.cost) {
            break Ended::Converged;
        }
        if iterations >= limits.iterations {
            break Ended::IterationLimit;
        }
        let trial = moved(region, &x, &step);
        // A subproblem solved to its tolerance only may promise nothing; two negative numbers have a positive share.
        let is_kept = |cost: f64| foreseen > 0.0 && (quadratic.cost - cost) / foreseen >= ACCEPTED_SHARE;
        // After a step that kept its promise at once the next mostly does, and its derivatives are wanted; else its cost tells first.
        let is_shorter = growth > FIRST_GROWTH;
        let is_promising = !(is_shorter || is_shortened) || objective.cost(&trial).is_some_and(is_kept);
        let next = if is_promising { objective.quadratic(&trial).filter(|next| is_kept(next.cost)) } else { None };
        let Some(next) = next else {
            damping *= growth;
            growth *= 2.0;
            continue;
        };
        let decrease = quadratic.cost - next.cost;
        let share = decrease / foreseen;
        let length = (0..x.len()).map(|k| step[k] * step[k] * quadratic.hessian[(k, k)]).sum::<f64>().sqrt();
        x = trial;
        quadratic = next;
        iterations += 1;
        damping *= (1.0 - (2.0 * share - 1.0).powi(3)).clamp(0.1, 1.0);
        damping = damping.max(1e-12);
        growth = FIRST_GROWTH;
        is_shortened = is_shorter;
        idle = if decrease <= IDLE * limits.negligible(quadratic.cost) { idle + 1 } else { 0 };
        let reported = Iteration { number: iterations - 1, cost: quadratic.cost, step: length };
        let half_spaces = region.half_spaces.clone();
        match watch(&reported, &State { x: x.clone(), damping, growth, idle, is_shortened, iterations, half_spaces }) {
            SearchControl::Continue => {}
            SearchControl::Stop => break Ended::Interrupted,
            SearchControl::GoodEnough => break Ended::Converged,
        }
    };
    Outcome { x, quadratic: Some(quadratic), ended, iterations }
}

/// `x + step`, of which rounding alone can leave the bounds that the step keeps.
fn moved(region: &Region, x: &[f64], step: &DVector<f64>) -> Vec<f64> {
    let bounds = region.lower.iter().zip(&region.upper);
    x.iter().zip(step.iter()).zip(bounds).map(|((x, step), (lower, upper))| (x + step).clamp(*lower, *upper)).collect()
}

/// By how much `step` lowers the undamped quadratic.
fn foreseen_decrease(quadratic: &Quadratic, step: &DVector<f64>) -> f64 {
    -(quadratic.gradient.dot(step) + 0.5 * step.dot(&(&quadratic.hessian * step)))
}

/// The step of the damped subproblem, within the region and all cuts.
fn allowed_step(
    objective: &impl Objective,
    region: &mut Region,
    quadratic: &Quadratic,
    x: &[f64],
    damping: f64,
) -> Option<DVector<f64>> {
    let mut hessian = quadratic.hessian.clone();
    for k in 0..x.len() {
        hessian[(k, k)] += damping * objective.metric(k).unwrap_or(quadratic.hessian[(k, k)]);
    }
    for _ in 0..CUT_ROUNDS {
        let step = subproblem(&hessian, &quadratic.gradient, region, x)?;
        let cuts = objective.cuts(&moved(region, x, &step));
        if cuts.is_empty() {
            return Some(step);
        }
        region.half_spaces.extend(cuts);
    }
    None
}

/// Minimises `g'd + d'Hd / 2` with `x + d` in the region.
fn subproblem(hessian: &DMatrix<f64>, gradient: &DVector<f64>, region: &Region, x: &[f64]) -> Option<DVector<f64>> {
    let n = x.len();
    // Unit diagonal: the unknowns have all sorts of units.
    let scale = DVector::from_fn(n, |k, _| 1.0 / hessian[(k, k)].max(f64::MIN_POSITIVE).sqrt());
    let scaled = DMatrix::from_fn(n, n, |row, column| hessian[(row, column)] * scale[row] * scale[column]);
    let slope = gradient.component_mul(&scale);
    let found = match scaled.clone().cholesky() {
        Some(factor) => by_violated(&factor.unpack(), &slope, region, x, &scale)?,
        None => {
            let limits = constraints(region, x, &scale, FARTHEST * slope.amax().max(1.0));
            let all: Vec<&Constraint> = limits.iter().collect();
            programme(&upper_triangle(&scaled), slope.as_slice(), n, &all)?
        }
    };
    // The interior point stops a hair from the bounds, on either side.
    Some(DVector::from_fn(n, |k, _| (found[k] * scale[k]).clamp(region.lower[k] - x[k], region.upper[k] - x[k])))
}

/// The scaled step where the Hessian is `L L'`: in `z = L'y` the cost is a distance, and a constraint has a part only once a step
/// breaks it, which few do.
fn by_violated(
    lower: &DMatrix<f64>,
    slope: &DVector<f64>,
    region: &Region,
    x: &[f64],
    scale: &DVector<f64>,
) -> Option<DVector<f64>> {
    let n = x.len();
    let target = lower.solve_lower_triangular(slope)?;
    let step_of = |z: &DVector<f64>| lower.tr_solve_lower_triangular(z);
    let mut step = step_of(&-&target)?;
    if within(region, x, &step.component_mul(scale)) {
        return Some(step);
    }
    let limits = constraints(region, x, scale, FARTHEST * step.amax().max(1.0));
    let identity = CscMatrix::identity(n);
    let mut is_kept = vec![false; limits.len()];
    let mut kept: Vec<Constraint> = Vec::new();
    loop {
        let known = kept.len();
        for (limit, is_kept) in limits.iter().zip(&mut is_kept) {
            if !*is_kept && limit.excess(&step) > BROKEN {
                *is_kept = true;
                let mut row = DVector::zeros(n);
                limit.terms.iter().for_each(|(index, factor)| row[*index] += factor);
                let row = lower.solve_lower_triangular(&row)?;
                let length = row.norm().max(f64::MIN_POSITIVE);
                let terms = row.iter().map(|entry| entry / length).enumerate().collect();
                kept.push(Constraint { terms, limit: limit.limit / length });
            }
        }
        if kept.len() == known {
            return Some(step);
        }
        let all: Vec<&Constraint> = kept.iter().collect();
        step = step_of(&programme(&identity, target.as_slice(), n, &all)?)?;
    }
}

/// `argmin y'Hy / 2 + g'y` within all `limits`.
fn programme(hessian: &CscMatrix<f64>, gradient: &[f64], n: usize, limits: &[&Constraint]) -> Option<DVector<f64>> {
    let mut columns: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
    for (row, limit) in limits.iter().enumerate() {
        limit.terms.iter().for_each(|(column, factor)| columns[*column].push((row, *factor)));
    }
    let mut starts = vec![0];
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for column in columns {
        for (row, value) in column {
            rows.push(row);
            values.push(value);
        }
        starts.push(rows.len());
    }
    let matrix = CscMatrix::new(limits.len(), n, starts, rows, values);
    let bounds: Vec<f64> = limits.iter().map(|limit| limit.limit).collect();
    let settings = DefaultSettingsBuilder::default().verbose(false).build().ok()?;
    let cones = [SupportedConeT::NonnegativeConeT(bounds.len())];
    let mut solver = DefaultSolver::new(hessian, gradient, &matrix, &bounds, &cones, settings).ok()?;
    solver.solve();
    let is_solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    is_solved.then(|| DVector::from_column_slice(&solver.solution.x))
}

fn within(region: &Region, x: &[f64], step: &DVector<f64>) -> bool {
    let trial: Vec<f64> = x.iter().zip(step.iter()).map(|(x, step)| x + step).collect();
    let bounded = trial.iter().zip(&region.lower).zip(&region.upper).all(|((x, low), high)| low <= x && x <= high);
    bounded && region.half_spaces.iter().all(|half_space| half_space.excess(&trial) <= 1e-12 * half_space.size(&trial))
}

/// `sum of factor y[index] <= limit`, of a scaled step y.
struct Constraint {
    terms: Vec<(usize, f64)>,
    limit: f64,
}

impl Constraint {
    /// By how much a step breaks it.
    fn excess(&self, step: &DVector<f64>) -> f64 {
        self.terms.iter().map(|(index, factor)| factor * step[*index]).sum::<f64>() - self.limit
    }
}

/// The region for the scaled step `y = d / scale`, every constraint scaled to length one and no limit beyond `farthest`.
fn constraints(region: &Region, x: &[f64], scale: &DVector<f64>, farthest: f64) -> Vec<Constraint> {
    let mut all = Vec::new();
    let mut add = |terms: &[(usize, f64)], limit: f64| {
        let length = terms.iter().map(|(index, factor)| (factor * scale[*index]).powi(2)).sum::<f64>().sqrt();
        if limit.is_finite() && length > 0.0 {
            let terms = terms.iter().map(|(index, factor)| (*index, factor * scale[*index] / length)).collect();
            all.push(Constraint { terms, limit: (limit / length).min(farthest) });
        }
    };
    for k in 0..x.len() {
        add(&[(k, 1.0)], (region.upper[k] - x[k]).max(0.0));
        add(&[(k, -1.0)], (x[k] - region.lower[k]).max(0.0));
    }
    for half_space in &region.half_spaces {
        // `x` is allowed up to rounding; the step zero must be feasible.
        add(&half_space.terms, (-half_space.excess(x)).max(0.0));
    }
    all
}

fn upper_triangle(matrix: &DMatrix<f64>) -> CscMatrix<f64> {
    let n = matrix.nrows();
    let mut starts = vec![0];
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for column in 0..n {
        for row in 0..=column {
            rows.push(row);
            values.push(matrix[(row, column)]);
        }
        starts.push(rows.len());
    }
    CscMatrix::new(n, n, starts, rows, values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dynid_random::Random;

    /// Rosenbrock's valley as a least-squares problem, optionally within the unit disk.
    struct Valley {
        disk: bool,
    }

    impl Objective for Valley {
        fn cost(&self, x: &[f64]) -> Option<f64> {
            Some(0.5 * ((1.0 - x[0]).powi(2) + 100.0 * (x[1] - x[0] * x[0]).powi(2)))
        }

        fn quadratic(&self, x: &[f64]) -> Option<Quadratic> {
            let residual = DVector::from_vec(vec![1.0 - x[0], 10.0 * (x[1] - x[0] * x[0])]);
            let jacobian = DMatrix::from_row_slice(2, 2, &[-1.0, 0.0, -20.0 * x[0], 10.0]);
            Some(Quadratic {
                cost: self.cost(x)?,
                gradient: jacobian.transpose() * &residual,
                hessian: jacobian.transpose() * jacobian,
            })
        }

        fn cuts(&self, x: &[f64]) -> Vec<HalfSpace> {
            let length = x[0].hypot(x[1]);
            if !self.disk || length <= 1.0 + 1e-9 {
                return Vec::new();
            }
            vec![HalfSpace { terms: vec![(0, x[0] / length), (1, x[1] / length)], limit: 1.0 }]
        }
    }

    const LIMITS: Limits = Limits::of_squares(200, 1e-14);

    fn region() -> Region {
        Region { lower: vec![f64::NEG_INFINITY; 2], upper: vec![f64::INFINITY; 2], half_spaces: Vec::new() }
    }

    #[test]
    fn the_valley_is_followed_to_its_end() {
        let end =
            minimise(&Valley { disk: false }, &mut region(), &[-1.2, 1.0], &LIMITS, &mut |_| SearchControl::Continue);
        assert!((end.x[0] - 1.0).abs() < 1e-6 && (end.x[1] - 1.0).abs() < 1e-6, "{:?}", end.x);
        assert!(end.iterations < 100, "{}", end.iterations);
    }

    #[test]
    fn a_bound_holds_and_is_optimal() {
        let mut region = region();
        region.upper[0] = 0.5;
        let end =
            minimise(&Valley { disk: false }, &mut region, &[-1.2, 1.0], &LIMITS, &mut |_| SearchControl::Continue);
        assert_eq!(end.ended, Ended::Converged);
        assert!((end.x[0] - 0.5).abs() < 1e-7 && end.x[0] <= 0.5, "{:?}", end.x);
        assert!((end.x[1] - 0.25).abs() < 1e-5, "{:?}", end.x);
    }

    /// The same optimum within bounds of which one is absurdly far, as a limit of torque is that stands where it limits nothing.
    #[test]
    fn a_far_bound_does_no_harm() {
        let near =
            minimise(&Valley { disk: true }, &mut region(), &[-0.5, 0.5], &LIMITS, &mut |_| SearchControl::Continue);
        let mut far = region();
        far.lower = vec![-1e12; 2];
        far.upper = vec![1e15; 2];
        let end = minimise(&Valley { disk: true }, &mut far, &[-0.5, 0.5], &LIMITS, &mut |_| SearchControl::Continue);
        assert!((end.x[0] - near.x[0]).abs() < 1e-6 && (end.x[1] - near.x[1]).abs() < 1e-6, "{:?}", end.x);
    }

    /// The published optimum of Rosenbrock's function in the unit disk: (0.7864, 0.6177).
    #[test]
    fn cuts_keep_to_a_curved_region() {
        let end =
            minimise(&Valley { disk: true }, &mut region(), &[-0.5, 0.5], &LIMITS, &mut |_| SearchControl::Continue);
        assert!((end.x[0] - 0.786_415).abs() < 1e-4 && (end.x[1] - 0.617_698).abs() < 1e-4, "{:?}", end.x);
        assert!(end.x[0].hypot(end.x[1]) <= 1.0 + 1e-8);
    }

    /// Stopped after any iteration and continued from its state, the search ends at the same bits.
    #[test]
    fn a_search_goes_on_as_if_it_had_never_stopped() {
        let (objective, start) = (Valley { disk: true }, [-0.5, 0.5]);
        let mut whole_region = region();
        let whole = minimise(&objective, &mut whole_region, &start, &LIMITS, &mut |_| SearchControl::Continue);
        assert!(whole.iterations > 5, "{}", whole.iterations);
        for stop in 1..whole.iterations {
            let mut region = region();
            let mut kept = None;
            let state = State::start(&start, &region);
            let first = resume(&objective, &mut region, state, None, &LIMITS, &mut |reported, state| {
                kept = Some(state.clone());
                if reported.number == stop { SearchControl::Stop } else { SearchControl::Continue }
            });
            assert_eq!(first.ended, Ended::Interrupted);
            let mut region = self::region();
            let state = kept.expect("an iteration was reported");
            let end = resume(&objective, &mut region, state, None, &LIMITS, &mut |_, _| SearchControl::Continue);
            assert_eq!(end, whole, "stopped after iteration {stop}");
            assert_eq!(region, whole_region, "stopped after iteration {stop}");
        }
    }

    /// A valley that counts how often its derivatives are asked for.
    struct Counted {
        valley: Valley,
        linearised: std::cell::Cell<usize>,
    }

    impl Objective for Counted {
        fn cost(&self, x: &[f64]) -> Option<f64> {
            self.valley.cost(x)
        }

        fn quadratic(&self, x: &[f64]) -> Option<Quadratic> {
            self.linearised.set(self.linearised.get() + 1);
            self.valley.quadratic(x)
        }

        fn cuts(&self, x: &[f64]) -> Vec<HalfSpace> {
            self.valley.cuts(x)
        }
    }

    /// Down a bent valley every other step is too long: after one that was shortened, derivatives are asked for where a step is taken only.
    #[test]
    fn few_derivatives_are_of_steps_that_are_not_taken() {
        let counted = Counted { valley: Valley { disk: false }, linearised: 0.into() };
        let end = minimise(&counted, &mut region(), &[-1.2, 1.0], &LIMITS, &mut |_| SearchControl::Continue);
        let wasted = counted.linearised.get() - end.iterations;
        assert!(4 * wasted < end.iterations, "{wasted} beside {}", end.iterations);
    }

    /// A cost of nothing but rounding: its gradient promises what no step keeps.
    struct Rounding;

    impl Objective for Rounding {
        fn cost(&self, _: &[f64]) -> Option<f64> {
            Some(1e-22)
        }

        fn quadratic(&self, x: &[f64]) -> Option<Quadratic> {
            let (gradient, hessian) = (DVector::from_element(1, 1e-11), DMatrix::identity(1, 1));
            Some(Quadratic { cost: self.cost(x)?, gradient, hessian })
        }

        fn cuts(&self, _: &[f64]) -> Vec<HalfSpace> {
            Vec::new()
        }
    }

    #[test]
    fn a_perfect_model_converges() {
        let mut region = Region { lower: vec![f64::NEG_INFINITY], upper: vec![f64::INFINITY], half_spaces: Vec::new() };
        let limits = Limits::of_squares(50, 1e-6);
        let end = minimise(&Rounding, &mut region, &[1.0], &limits, &mut |_| SearchControl::Continue);
        assert_eq!(end.ended, Ended::Converged);
    }

    #[test]
    fn what_no_step_breaks_has_no_part_in_it() {
        let mut random = Random::new(7);
        for n in [1, 3, 8, 20] {
            for _ in 0..10 {
                let root = DMatrix::from_vec(n, n, random.vector(n * n, -1.0, 1.0));
                let hessian = &root * root.transpose() + DMatrix::identity(n, n) * 1e-3;
                let gradient = DVector::from_vec(random.vector(n, -1.0, 1.0));
                let x = random.vector(n, -0.2, 0.2);
                let half_space = |random: &mut Random| {
                    let terms: Vec<(usize, f64)> = random.vector(n, -1.0, 1.0).into_iter().enumerate().collect();
                    let limit = terms.iter().map(|(k, factor)| factor * x[*k]).sum::<f64>() + 0.1;
                    HalfSpace { terms, limit }
                };
                let half_spaces = (0..n).map(|_| half_space(&mut random)).collect();
                let region = Region { lower: vec![-0.5; n], upper: vec![0.7; n], half_spaces };
                let found = subproblem(&hessian, &gradient, &region, &x).expect("it has a solution");
                let scale = DVector::from_element(n, 1.0);
                let limits = constraints(&region, &x, &scale, f64::INFINITY);
                let all: Vec<&Constraint> = limits.iter().collect();
                let expected = programme(&upper_triangle(&hessian), gradient.as_slice(), n, &all).expect("a solution");
                let cost = |step: &DVector<f64>| gradient.dot(step) + 0.5 * step.dot(&(&hessian * step));
                assert!((cost(&found) - cost(&expected)).abs() < 1e-6 * cost(&expected).abs().max(1e-3));
                assert!(limits.iter().all(|limit| limit.excess(&found) < 1e-6));
            }
        }
    }

    /// `x + (lower - x)` is not `lower` for about every other pair of numbers.
    #[test]
    fn a_step_to_a_bound_stays_within_it() {
        let mut random = Random::new(5);
        let mut rounded = 0;
        for _ in 0..1000 {
            let (lower, x) = (random.between(0.1, 0.4), random.between(0.4, 1.7));
            let region = Region { lower: vec![lower], upper: vec![f64::INFINITY], half_spaces: vec![] };
            let step = DVector::from_element(1, lower - x);
            rounded += usize::from(x + step[0] < lower);
            assert!(moved(&region, &[x], &step)[0] >= lower);
        }
        assert!(rounded > 0, "the clamp matters");
    }
}
