//! Fits a model to the torque error: bounded, weighted least squares among physical bodies.
//!
//! Along the measured motion the torque error is linear in the links' standard parameters `pi = (m, m c, J)` (through
//! the kernel's lumps) and in most parameters of the effects; the others, and the gain that the error is divided by, are
//! linearised anew in every iteration (Gauss-Newton). Rows are weighted by the standard deviation of their joint's
//! residual, which is found along with the parameters (iteratively reweighted, Gautier & Poignet 2001). Links stay
//! physical and parameters in their bounds ([`dynid_optimise::pseudo_inertia`]).
//!
//! Directions that the data do not see are pulled towards the start by a prior of a hundred natural sizes, weak
//! enough to be far below what the data say about the others; they are named in the result.

mod residuals;

use std::collections::BTreeMap;

use dynid_model::{Link, Parameter};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{FitStatus, link_parameter};
use dynid_dynamics::system::System;
use dynid_logs::{experiment::Role, motion::Motion};
use dynid_optimise::{
    barrier::{Cost, Ending, Interior, is_inside, minimise},
    body::Body,
    identifiability::{Compressed, NO_EFFECT, Standing, standing},
    pseudo_inertia,
    quadratic::Quadratic,
    region::{Entry, HalfSpace, Region},
};
use dynid_signal::statistics::{correlation_time, counted};
use dynid_torque::{JointLinear, RigidColumns, linearise, rigid_columns};

pub use residuals::TorqueResiduals;

/// Standard deviation of the prior about the start, in natural sizes of each parameter: a numerical choice.
const PRIOR_SCALES: f64 = 100.0;
/// The fit has converged when an iteration changes the merit (minus the logarithm of the likelihood) by less than this; a
/// standard error makes 0.5 of it.
const COST_TOLERANCE: f64 = 1e-2;
/// Where a step does not lead down, the next one is held to the point it starts from: first and last weight, relative to
/// what the data say about a parameter on average, of a move by its natural size.
const DAMPING_FIRST: f64 = 1e-6;
const DAMPING_LAST: f64 = 1e3;
/// So many steps in a row that gain nothing are enough.
const IDLE_ITERATIONS: usize = 3;
/// A search that gets stuck still ends at a minimum if the linearised equations promise less than this per sample: where
/// the error has kinks (friction that turns with its load), the last promises are not kept.
const NEAR: f64 = 1e-3;
/// Rounds in which weights and parameters are found together for one linearisation.
const WEIGHT_ROUNDS: usize = 20;
/// Weights have settled when none changes by more than this share.
const WEIGHT_TOLERANCE: f64 = 1e-4;
/// A joint's residual is never taken for smaller than this share of its torque.
const LEAST_NOISE: f64 = 1e-9;
/// A parameter within this share of its natural size of a bound is held by it.
const HELD: f64 = 1e-6;

/// One run to fit to, or to judge by.
#[derive(Debug, Clone)]
pub struct TorqueRun {
    /// For people, e.g. the log's file name.
    pub name: String,
    /// Only runs of [`Role::Fit`] enter the fit.
    pub role: Role,
    /// The model at the run's configuration; its values are replaced by those of the fit.
    pub system: System,
    /// What was measured.
    pub motion: Motion,
}

/// What a torque fit found.
#[derive(Debug, Clone)]
pub struct TorqueFit {
    /// How it ended.
    pub status: FitStatus,
    /// Linearisations.
    pub iterations: usize,
    /// Half the sum of squared torque errors at the start, each joint's over the variance of its final residual.
    pub cost_before: f64,
    /// The same at the end.
    pub cost_after: f64,
    /// Every parameter that the fit could move, in the order given.
    pub parameters: Vec<FittedParameter>,
    /// Number of combinations of them that the data determine: the base parameters.
    pub rank: usize,
    /// Largest over smallest singular value of the weighted regressor, columns scaled to one length.
    pub condition: f64,
    /// Combinations of parameters that do not change the torque: name and change, largest 1.
    pub flat: Vec<Vec<(String, f64)>>,
    /// Pairs whose estimates are correlated by more than 0.95.
    pub correlated: Vec<(String, String, f64)>,
    /// What is left at each joint of the device that was free in a run.
    pub joints: Vec<JointNoise>,
    /// Links whose inertia is held by physics, not by the data.
    pub links_at_physical_limit: Vec<usize>,
}

/// A fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Its name.
    pub name: String,
    /// Where it started.
    pub start: f64,
    /// Where it ended; the start where it is not identifiable and nothing pushed it.
    pub value: f64,
    /// One standard deviation, from the residual and its autocorrelation; `None` where there is none to state: held, or not
    /// identifiable.
    pub std_error: Option<f64>,
    /// Whether the data determine it by itself.
    pub identifiable: bool,
    /// Whether its bound holds it.
    pub held: bool,
}

/// The residual of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointNoise {
    /// The device's joint index.
    pub joint: usize,
    /// Standard deviation of its torque error [unit of the command].
    pub sigma: f64,
    /// Number of successive samples that share one independent error.
    pub correlation_time: f64,
    /// Samples used.
    pub n_samples: usize,
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TorqueFitError {
    /// No run to fit to.
    #[error("the experiment has no run with role = \"fit\"; give one that role")]
    NoRun,
    /// Every parameter is fixed, or none acts in the runs.
    #[error(
        "no parameter of the model can be moved by these runs: all are fixed or act on other joints; free one (remove fixed = true) or add an effect"
    )]
    NothingToFit,
    /// Filters and masks left nothing.
    #[error(
        "{run}: no sample of joint {joint} counts: min_speed, mask and the filter's edges leave none; lower min_speed or lengthen the log"
    )]
    NoSamples {
        /// The run.
        run: String,
        /// The joint.
        joint: usize,
    },
    /// Fixed values and bounds leave no physical body.
    #[error(
        "link {link}: its fixed moments of inertia and its bounds leave no body that could exist; free them (fixed = false) or widen the bounds"
    )]
    NoBody {
        /// Number of the link.
        link: usize,
    },
    /// Bounds that leave nothing between them, or nothing that keeps an effect's inequalities.
    #[error(
        "the bounds of the model's parameters leave no values that keep the inequalities of its effects (e.g. `v4 > v1`); widen the bounds"
    )]
    NoRoom,
    /// The parameter list lacks a name that the equations need.
    #[error("the equations need `{name}`, which the model does not give; add it to the model's values")]
    MissingParameter {
        /// Its name.
        name: String,
    },
}

/// Fits `parameters` (all of the model's, in its order) to the runs with role fit. Of a pair in `orders`, names of
/// parameters, the first is never below the second. It takes `at_most` so many linearisations; `progress` hears iteration
/// and cost.
///
/// # Errors
/// No run to fit to, nothing to fit, no samples left, bounds that no body satisfies.
pub fn fit(
    runs: &[TorqueRun],
    parameters: &[(String, Parameter)],
    orders: &[(String, String)],
    at_most: usize,
    progress: &mut dyn FnMut(usize, f64),
) -> Result<TorqueFit, TorqueFitError> {
    let runs: Vec<&TorqueRun> = runs.iter().filter(|run| run.role == Role::Fit).collect();
    check_runs(&runs)?;
    let layout = Layout::new(&runs, parameters)?;
    let rigid: Vec<Vec<RigidColumns>> = runs.iter().map(|run| rigid_columns(&run.system, &run.motion)).collect();

    let mut x = layout.start.clone();
    let mut data = Data::new(&layout, &runs, &rigid, &x, false);
    // What the runs do not touch keeps its value and leaves the problem.
    let layout = layout.touched(&data);
    if layout.start.is_empty() {
        return Err(TorqueFitError::NothingToFit);
    }
    let within = layout.within(orders);
    x.clone_from(&layout.start);
    let start_residuals = data.square_sums();
    let start_sigma = data.deviations();
    let mut status = FitStatus::IterationLimit;
    let mut iterations = 0;
    let mut damping = 0.0;
    let mut idle = 0;
    while iterations < at_most {
        iterations += 1;
        let (next, ending) = solve(&layout, &within, &data, &x, damping)?;
        let next_data = Data::new(&layout, &runs, &rigid, &next, false);
        let gain = data.merit() - next_data.merit();
        if gain >= -COST_TOLERANCE {
            x = next;
            data = next_data;
            progress(iterations, data.cost(&start_sigma));
            // A damped step may be short because it is damped.
            if gain < COST_TOLERANCE && damping <= DAMPING_FIRST {
                status = if ending == Ending::Stalled { FitStatus::NumericalError } else { FitStatus::Converged };
                break;
            }
            damping = if damping <= DAMPING_FIRST { 0.0 } else { 0.1 * damping };
            idle = if gain < COST_TOLERANCE { idle + 1 } else { 0 };
        } else if damping < DAMPING_LAST {
            damping = (10.0 * damping).max(DAMPING_FIRST);
            continue;
        } else {
            // Not even a tiny step along the gradient helps.
            idle = IDLE_ITERATIONS;
        }
        if idle >= IDLE_ITERATIONS {
            let (best, ending) = solve(&layout, &within, &data, &x, 0.0)?;
            let promised = data.merit() - data.merit_at(&layout.phi(&best));
            let is_near = ending == Ending::Minimum && promised <= NEAR * data.samples();
            status = if is_near { FitStatus::Converged } else { FitStatus::NumericalError };
            break;
        }
    }
    let data = Data::new(&layout, &runs, &rigid, &x, true);
    Ok(conclude(&layout, &within, &data, &x, &start_residuals, status, iterations))
}

/// That there are runs, and that samples of every free joint count in each.
fn check_runs(runs: &[&TorqueRun]) -> Result<(), TorqueFitError> {
    if runs.is_empty() {
        return Err(TorqueFitError::NoRun);
    }
    for run in runs {
        for (slot, &joint) in run.system.kernel().free.iter().enumerate() {
            if !run.motion.used[slot].contains(&true) {
                return Err(TorqueFitError::NoSamples { run: run.name.clone(), joint });
            }
        }
    }
    Ok(())
}

/// The minimum of the linearised problem, weights included, started from `x` and held to it by `damping`.
fn solve(
    layout: &Layout,
    within: &Interior,
    data: &Data,
    x: &[f64],
    damping: f64,
) -> Result<(Vec<f64>, Ending), TorqueFitError> {
    let mut sigma = data.deviations();
    let mut solution = x.to_vec();
    let mut ending = Ending::Minimum;
    for _ in 0..WEIGHT_ROUNDS {
        let cost = Weighted::new(layout, data, &sigma, x, damping);
        let mut next = layout.interior(within, &solution)?;
        ending = minimise(within, &cost, &mut next);
        solution = next;
        let found = data.deviations_at(&layout.phi(&solution));
        let change = sigma.iter().map(|(joint, sigma)| (found[joint] / sigma - 1.0).abs()).fold(0.0, f64::max);
        sigma = found;
        if change < WEIGHT_TOLERANCE {
            break;
        }
    }
    Ok((solution, ending))
}

/// How parameters stand in the equations.
///
/// `phi` holds the ten standard parameters of every link that occurs, then the parameters of the effects: what the
/// equations are linear in. `x` holds the unknowns.
#[derive(Debug, Clone)]
struct Layout {
    links: Vec<Body>,
    effects: Vec<EffectLayout>,
    /// Names of the unknowns.
    names: Vec<String>,
    start: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    scale: Vec<f64>,
}

#[derive(Debug, Clone)]
struct EffectLayout {
    name: String,
    value: Entry,
}

impl Layout {
    fn new(runs: &[&TorqueRun], parameters: &[(String, Parameter)]) -> Result<Self, TorqueFitError> {
        let mut layout = Self {
            links: Vec::new(),
            effects: Vec::new(),
            names: Vec::new(),
            start: Vec::new(),
            lower: Vec::new(),
            upper: Vec::new(),
            scale: Vec::new(),
        };
        let occurs = |name: &str| {
            runs.iter().any(|run| {
                run.system.kernel().parameters.contains(&name) || run.system.effect_names().iter().any(|n| n == name)
            })
        };
        for (name, parameter) in parameters {
            if let Some((number, symbol)) = link_parameter(name) {
                let link = match layout.links.iter().position(|body| body.link == number) {
                    Some(index) => index,
                    None => {
                        layout.links.push(Body { link: number, inertial: [Entry::Known(0.0); 10] });
                        layout.links.len() - 1
                    }
                };
                // A moment of inertia that no equation knows may have to move for the others to be a body's.
                let is_inertia = symbol >= 4;
                layout.links[link].inertial[symbol] = layout.admit(name, parameter, is_inertia || occurs(name));
            } else if name.starts_with("joint.") || name.starts_with("device.") {
                if !occurs(name) {
                    continue;
                }
                let value = layout.admit(name, parameter, true);
                layout.effects.push(EffectLayout { name: name.clone(), value });
            }
        }
        for run in runs {
            for name in run.system.kernel().parameters {
                if !parameters.iter().any(|(other, _)| other == name) {
                    return Err(TorqueFitError::MissingParameter { name: (*name).to_owned() });
                }
            }
            for name in run.system.effect_names() {
                if !parameters.iter().any(|(other, _)| other == name) {
                    return Err(TorqueFitError::MissingParameter { name: name.clone() });
                }
            }
        }
        // A link that no equation knows has nothing to say.
        layout.links.retain(|link| Link::SYMBOLS.iter().any(|s| occurs(&format!("link.{}.{s}", link.link))));
        layout.set_scales();
        Ok(layout)
    }

    /// Makes a parameter an unknown, if it may move.
    fn admit(&mut self, name: &str, parameter: &Parameter, occurs: bool) -> Entry {
        let Parameter { value, mut lower, upper, fixed } = *parameter;
        if name.ends_with(".m") && name.starts_with("link.") {
            lower = lower.max(0.0);
        }
        if fixed || !occurs || lower >= upper {
            return Entry::Known(value);
        }
        self.names.push(name.to_owned());
        self.start.push(value);
        self.lower.push(lower);
        self.upper.push(upper);
        self.scale.push(f64::NAN);
        Entry::Unknown(self.start.len() - 1)
    }

    /// Natural sizes: a link's mass, how far its mass lies from its frame, its moments of inertia; an effect's start.
    fn set_scales(&mut self) {
        let values: Vec<[f64; 10]> = self.links.iter().map(|link| link.at(&self.start)).collect();
        let largest_mass = values.iter().map(|values| values[0]).fold(0.0, f64::max);
        let largest_arm = values.iter().flat_map(|values| &values[1..4]).fold(0.0_f64, |a, c| a.max(c.abs()));
        for (link, values) in self.links.iter().zip(values) {
            let [m, x, y, z, xx, _, _, yy, _, zz] = values;
            let mass = if m > 0.0 {
                m
            } else if largest_mass > 0.0 {
                largest_mass
            } else {
                1.0
            };
            let arm = x.abs().max(y.abs()).max(z.abs()).max(0.3 * largest_arm).max(0.01);
            let inertia = (xx + yy + zz).max(mass * (0.3 * arm).powi(2));
            for (symbol, index) in link.unknowns() {
                self.scale[index] = match symbol {
                    0 => mass,
                    1..=3 => arm,
                    _ => inertia,
                };
            }
        }
        for effect in &self.effects {
            if let Entry::Unknown(index) = effect.value {
                let range = self.upper[index] - self.lower[index];
                let of_range = if range.is_finite() { 1e-2 * range } else { 1.0 };
                let start = self.start[index];
                self.scale[index] = if start == 0.0 { of_range } else { start.abs() };
            }
        }
    }

    /// The layout without those unknowns that nothing in `data` depends on.
    fn touched(&self, data: &Data) -> Self {
        let information: DMatrix<f64> = data.joints.values().map(|joint| joint.equations.information()).sum();
        let jacobian = self.jacobian(&self.start);
        let strength = |index: usize| {
            let column = jacobian.column(index);
            (column.transpose() * &information * column)[0].max(0.0).sqrt() * self.scale[index]
        };
        let strengths: Vec<f64> = (0..self.start.len()).map(strength).collect();
        let strongest = strengths.iter().copied().fold(0.0, f64::max);
        let mut keep: Vec<bool> = strengths.iter().map(|strength| *strength > NO_EFFECT * strongest).collect();
        // One moment of inertia that moves needs the others of its link to stay a body.
        for link in &self.links {
            let moments: Vec<usize> = link.inertia().into_iter().filter_map(Entry::index).collect();
            if moments.iter().any(|&index| keep[index]) {
                moments.into_iter().for_each(|index| keep[index] = true);
            }
        }
        let number: Vec<Option<usize>> = keep
            .iter()
            .scan(0, |next, &keep| {
                *next += usize::from(keep);
                Some(keep.then_some(*next - 1))
            })
            .collect();
        let mut layout = self.clone();
        let renumber = |entry: &mut Entry| {
            if let Entry::Unknown(index) = *entry {
                *entry = number[index].map_or(Entry::Known(self.start[index]), Entry::Unknown);
            }
        };
        layout.links.iter_mut().for_each(|link| link.inertial.iter_mut().for_each(renumber));
        layout.effects.iter_mut().for_each(|effect| renumber(&mut effect.value));
        let select = |values: &[f64]| values.iter().zip(&keep).filter(|(_, keep)| **keep).map(|(v, _)| *v).collect();
        layout.start = select(&self.start);
        layout.lower = select(&self.lower);
        layout.upper = select(&self.upper);
        layout.scale = select(&self.scale);
        layout.names = self.names.iter().zip(&keep).filter(|(_, keep)| **keep).map(|(name, _)| name.clone()).collect();
        layout
    }

    fn n_phi(&self) -> usize {
        10 * self.links.len() + self.effects.len()
    }

    fn phi(&self, x: &[f64]) -> DVector<f64> {
        let links = self.links.iter().flat_map(|link| pseudo_inertia::standard(&link.at(x)));
        let effects = self.effects.iter().map(|effect| effect.value.at(x));
        DVector::from_iterator(self.n_phi(), links.chain(effects))
    }

    /// Derivative of [`Layout::phi`].
    fn jacobian(&self, x: &[f64]) -> DMatrix<f64> {
        let mut jacobian = DMatrix::zeros(self.n_phi(), x.len());
        for (block, link) in self.links.iter().enumerate() {
            let by = pseudo_inertia::standard_jacobian(&link.at(x));
            for (symbol, index) in link.unknowns() {
                (0..10).for_each(|row| jacobian[(10 * block + row, index)] = by[row][symbol]);
            }
        }
        for (row, effect) in self.effects.iter().enumerate() {
            if let Entry::Unknown(index) = effect.value {
                jacobian[(10 * self.links.len() + row, index)] = 1.0;
            }
        }
        jacobian
    }

    fn within(&self, orders: &[(String, String)]) -> Interior {
        let entry = |name: &String| self.effects.iter().find(|effect| effect.name == *name).map(|effect| effect.value);
        let half_spaces = orders
            .iter()
            .filter_map(|(larger, smaller)| HalfSpace::of_order(entry(larger)?, entry(smaller)?))
            .collect();
        Interior {
            region: Region { lower: self.lower.clone(), upper: self.upper.clone(), half_spaces },
            bodies: self.links.clone(),
            scale: self.scale.clone(),
        }
    }

    /// A point strictly inside of the region, near `x`.
    fn interior(&self, within: &Interior, x: &[f64]) -> Result<Vec<f64>, TorqueFitError> {
        for margin in [1e-2, 1e-4, 1e-6, 1e-8] {
            let mut point = x.to_vec();
            for link in &self.links {
                if !link.has_unknown_inertia() {
                    continue;
                }
                let inertial = link.at(&point);
                let inertia: [f64; 6] = std::array::from_fn(|entry| inertial[4 + entry]);
                let moments = link.inertia().into_iter().filter_map(Entry::index);
                let size = moments.map(|index| self.scale[index]).fold(0.0, f64::max);
                let inside = pseudo_inertia::inside(&inertia, margin * size);
                for (entry, value) in link.inertia().into_iter().zip(inside) {
                    if let Entry::Unknown(index) = entry {
                        point[index] = value;
                    }
                }
            }
            for (index, value) in point.iter_mut().enumerate() {
                let (lower, upper) = (self.lower[index], self.upper[index]);
                let room = (margin * self.scale[index]).min(0.25 * (upper - lower));
                *value = value.clamp(lower + room, upper - room);
            }
            for half_space in &within.region.half_spaces {
                let excess = half_space.excess(&point);
                // Either end may have no room on its side, so both go the whole way.
                for &(index, factor) in &half_space.terms {
                    if excess > -margin * self.scale[index] {
                        let moved = point[index] - factor * (excess + 2.0 * margin * self.scale[index]);
                        let (lower, upper) = (self.lower[index], self.upper[index]);
                        let room = (0.5 * margin * self.scale[index]).min(0.1 * (upper - lower));
                        point[index] = moved.clamp(lower + room, upper - room);
                    }
                }
            }
            if is_inside(within, &point) {
                return Ok(point);
            }
        }
        let link = self
            .links
            .iter()
            .find(|link| link.has_unknown_inertia() && pseudo_inertia::body_barrier_value(&link.at(x)).is_none());
        Err(link.map_or(TorqueFitError::NoRoom, |link| TorqueFitError::NoBody { link: link.link }))
    }
}

/// The linearised equations of all runs, by joint of the device.
struct Data {
    joints: BTreeMap<usize, JointData>,
}

struct JointData {
    /// `A phi = b`, rows in the unit of the command.
    equations: Compressed,
    /// Sum of squared torque errors where the equations were linearised.
    residual_squared: f64,
    /// Sum of squared torques.
    torque_squared: f64,
    n_samples: usize,
    /// Of the residual.
    correlation_time: f64,
}

impl Data {
    /// Linearises all runs about `x`; correlation times, which only standard errors need, are found if asked for.
    fn new(layout: &Layout, runs: &[&TorqueRun], rigid: &[Vec<RigidColumns>], x: &[f64], with_errors: bool) -> Self {
        let parts: Vec<Vec<(usize, JointData)>> =
            runs.par_iter().zip(rigid).map(|(run, rigid)| run_equations(layout, run, rigid, x, with_errors)).collect();
        let mut joints: BTreeMap<usize, JointData> = BTreeMap::new();
        for (joint, part) in parts.into_iter().flatten() {
            let Some(sum) = joints.get_mut(&joint) else {
                joints.insert(joint, part);
                continue;
            };
            sum.equations.merge(&part.equations, 1.0);
            // The mean over the runs, by their numbers of samples.
            let (a, b) = (sum.n_samples as f64, part.n_samples as f64);
            sum.correlation_time = (a * sum.correlation_time + b * part.correlation_time) / (a + b);
            sum.n_samples += part.n_samples;
            sum.residual_squared += part.residual_squared;
            sum.torque_squared += part.torque_squared;
        }
        Self { joints }
    }

    fn square_sums(&self) -> BTreeMap<usize, f64> {
        self.joints.iter().map(|(joint, data)| (*joint, data.residual_squared)).collect()
    }

    /// Standard deviation of each joint's torque error where the equations were linearised.
    fn deviations(&self) -> BTreeMap<usize, f64> {
        self.joints.iter().map(|(joint, data)| (*joint, data.deviation(data.residual_squared))).collect()
    }

    /// Standard deviation of each joint's torque error at `phi`, by the linear equations.
    fn deviations_at(&self, phi: &DVector<f64>) -> BTreeMap<usize, f64> {
        let deviation = |data: &JointData| data.deviation(data.equations.residual_squared(phi));
        self.joints.iter().map(|(joint, data)| (*joint, deviation(data))).collect()
    }

    /// Minus the logarithm of the likelihood, the joints' variances being what they are: what weighting each joint by its
    /// own residual makes small.
    fn merit(&self) -> f64 {
        self.merit_of(&|data| data.residual_squared)
    }

    /// The same at `phi`, by the linear equations.
    fn merit_at(&self, phi: &DVector<f64>) -> f64 {
        self.merit_of(&|data| data.equations.residual_squared(phi))
    }

    fn merit_of(&self, squares: &dyn Fn(&JointData) -> f64) -> f64 {
        let merit = |data: &JointData| data.n_samples as f64 * data.deviation(squares(data)).ln();
        let merit: f64 = self.joints.values().map(merit).sum();
        if merit.is_finite() { merit } else { f64::INFINITY }
    }

    /// Number of samples, those of every joint counted.
    fn samples(&self) -> f64 {
        self.joints.values().map(|data| data.n_samples as f64).sum()
    }

    /// Half the sum of squared torque errors over their variances.
    fn cost(&self, sigma: &BTreeMap<usize, f64>) -> f64 {
        self.joints.iter().map(|(joint, data)| 0.5 * data.residual_squared / sigma[joint].powi(2)).sum()
    }
}

impl JointData {
    fn deviation(&self, residual_squared: f64) -> f64 {
        let n = self.n_samples as f64;
        let least = LEAST_NOISE * (self.torque_squared / n).sqrt();
        (residual_squared / n).sqrt().max(least).max(f64::MIN_POSITIVE.sqrt())
    }
}

/// The equations of one run, for each of its free joints.
fn run_equations(
    layout: &Layout,
    run: &TorqueRun,
    rigid: &[RigidColumns],
    x: &[f64],
    with_errors: bool,
) -> Vec<(usize, JointData)> {
    let compressed = |own: JointRows| {
        let mut local = Compressed::new(own.spread.nrows());
        local.push(&own.matrix);
        let motion = &run.motion;
        let residual_squared = own.counted().map(|residual| residual.powi(2)).sum();
        let torque = motion.filtered(&motion.command[own.joint]);
        let data = JointData {
            equations: local.spread(&own.spread),
            residual_squared,
            torque_squared: own.rows.iter().map(|&sample| torque[sample].powi(2)).sum(),
            n_samples: own.rows.len(),
            correlation_time: if with_errors {
                correlation_time(&counted(&own.residual, &motion.used[own.slot]), own.rows.len())
            } else {
                1.0
            },
        };
        (own.joint, data)
    };
    run_rows(layout, run, rigid, x).into_par_iter().map(compressed).collect()
}

/// The equations of one free joint along a run, a row for each sample that counts.
struct JointRows {
    /// The device's joint index.
    joint: usize,
    /// Its place among the free joints.
    slot: usize,
    /// The samples that count.
    rows: Vec<usize>,
    /// `A | b` over what occurs in this run and joint: lumps, then effect parameters.
    matrix: DMatrix<f64>,
    /// From those to phi.
    spread: DMatrix<f64>,
    /// The torque error at every sample.
    residual: Vec<f64>,
}

impl JointRows {
    /// The torque errors that count.
    fn counted(&self) -> impl Iterator<Item = f64> {
        self.rows.iter().map(|&sample| self.residual[sample])
    }
}

/// The equations of one run about `x`, free joint by free joint.
fn run_rows(layout: &Layout, run: &TorqueRun, rigid: &[RigidColumns], x: &[f64]) -> Vec<JointRows> {
    let mut system = run.system.clone();
    layout.install(&mut system, x);
    let lumps_by_pi = lumps_by_standard(layout, &system);
    let effect_of: Vec<Option<usize>> = system
        .effect_names()
        .iter()
        .map(|name| layout.effects.iter().position(|effect| effect.name == *name))
        .collect();
    let linear = linearise(&system, &run.motion, rigid);
    let n_phi = layout.n_phi();
    let free = system.kernel().free;
    let joint = |(slot, linear): (usize, JointLinear)| {
        let used = &run.motion.used[slot];
        let rows: Vec<usize> = (0..used.len()).filter(|&row| used[row]).collect();
        let lumps: Vec<usize> = (0..rigid[slot].len()).filter(|&lump| rigid[slot][lump].is_some()).collect();
        let effects: Vec<usize> =
            (0..linear.by_parameter.len()).filter(|&index| linear.by_parameter[index].is_some()).collect();
        let width = lumps.len() + effects.len();
        let mut matrix = DMatrix::zeros(rows.len(), width + 1);
        let mut fill = |column: usize, values: &[f64], factor: f64| {
            rows.iter().enumerate().for_each(|(row, &sample)| matrix[(row, column)] = factor * values[sample]);
        };
        for (column, &lump) in lumps.iter().enumerate() {
            match (&rigid[slot][lump], &linear.passed) {
                (Some(values), None) => fill(column, values, 1.0 / linear.slope),
                (Some(values), Some(passed)) => {
                    let values: Vec<f64> = values.iter().zip(passed).map(|(value, passed)| value / passed).collect();
                    fill(column, &values, 1.0 / linear.slope);
                }
                (None, _) => {}
            }
        }
        for (column, &index) in effects.iter().enumerate() {
            if let Some(values) = &linear.by_parameter[index] {
                fill(lumps.len() + column, values, -1.0);
            }
        }
        // b = A phi + residual, so that the linear equations give the residual where they were made.
        let lump_values = &system.prepared()[..system.kernel().n_lumps];
        let effect_values = system.effect_parameters();
        let here = lumps.iter().map(|&lump| lump_values[lump]).chain(effects.iter().map(|&index| effect_values[index]));
        let here = DVector::from_iterator(width, here);
        let prediction = matrix.columns(0, width) * &here;
        for (row, &sample) in rows.iter().enumerate() {
            matrix[(row, width)] = prediction[row] + linear.residual[sample];
        }
        let mut spread = DMatrix::zeros(width, n_phi);
        for (row, &lump) in lumps.iter().enumerate() {
            spread.row_mut(row).columns_mut(0, lumps_by_pi.ncols()).copy_from(&lumps_by_pi.row(lump));
        }
        for (row, &index) in effects.iter().enumerate() {
            if let Some(effect) = effect_of[index] {
                spread[(lumps.len() + row, 10 * layout.links.len() + effect)] = 1.0;
            }
        }
        JointRows { joint: free[slot], slot, rows, matrix, spread, residual: linear.residual }
    };
    linear.into_par_iter().enumerate().map(joint).collect()
}

impl Layout {
    /// Gives `system` the values of `x`.
    fn install(&self, system: &mut System, x: &[f64]) {
        let mut link_parameters = system.link_parameters().to_vec();
        for (value, name) in link_parameters.iter_mut().zip(system.kernel().parameters) {
            let Some((number, symbol)) = link_parameter(name) else { continue };
            if let Some(link) = self.links.iter().find(|link| link.link == number) {
                *value = link.at(x)[symbol];
            }
        }
        let mut effect_parameters = system.effect_parameters().to_vec();
        for (value, name) in effect_parameters.iter_mut().zip(system.effect_names()) {
            if let Some(effect) = self.effects.iter().find(|effect| effect.name == *name) {
                *value = effect.value.at(x);
            }
        }
        system.set_parameters(&link_parameters, &effect_parameters);
    }
}

/// The matrix that takes the standard parameters of all links to the lumps of a system's kernel: n_lumps x 10 n_links.
///
/// Lumps are linear in the standard parameters. For a body of unit mass at its frame's origin without inertia, mass,
/// centroid and inertia change the standard parameters one by one, so the gradient of `prepare` there is that matrix.
fn lumps_by_standard(layout: &Layout, system: &System) -> DMatrix<f64> {
    let kernel = system.kernel();
    let places: Vec<Option<usize>> = kernel
        .parameters
        .iter()
        .map(|name| {
            let (number, symbol) = link_parameter(name)?;
            let link = layout.links.iter().position(|link| link.link == number)?;
            Some(10 * link + symbol)
        })
        .collect();
    let mut parameters = system.link_parameters().to_vec();
    for (value, place) in parameters.iter_mut().zip(&places) {
        if let Some(place) = place {
            *value = f64::from(u8::from(place % 10 == 0));
        }
    }
    let n_parameters = parameters.len();
    let mut gradient = vec![0.0; kernel.prepared.len() * n_parameters];
    kernel.functions.prepare_gradient(&parameters, system.locked(), &mut gradient);
    let mut matrix = DMatrix::zeros(kernel.n_lumps, 10 * layout.links.len());
    for lump in 0..kernel.n_lumps {
        for (parameter, place) in places.iter().enumerate() {
            if let Some(place) = *place {
                matrix[(lump, place)] = gradient[lump * n_parameters + parameter];
            }
        }
    }
    matrix
}

/// The linearised, weighted cost with its prior.
struct Weighted<'a> {
    layout: &'a Layout,
    /// All joints' equations, rows over their standard deviations.
    equations: Compressed,
    factor: DMatrix<f64>,
    information: DMatrix<f64>,
    /// Where the step starts.
    from: &'a [f64],
    /// Weight of a move from there by the natural size of a parameter.
    hold: f64,
}

impl<'a> Weighted<'a> {
    fn new(layout: &'a Layout, data: &Data, sigma: &BTreeMap<usize, f64>, from: &'a [f64], damping: f64) -> Self {
        let mut equations = Compressed::new(layout.n_phi());
        for (joint, data) in &data.joints {
            equations.merge(&data.equations, 1.0 / sigma[joint]);
        }
        let (factor, information) = (equations.factor(), equations.information());
        let jacobian = &factor * layout.jacobian(from);
        let known =
            jacobian.column_iter().zip(&layout.scale).map(|(column, scale)| column.norm_squared() * scale * scale);
        let hold = damping * known.sum::<f64>() / from.len() as f64;
        Self { layout, equations, factor, information, from, hold }
    }

    /// Distance from where the step starts, in natural sizes.
    fn moved(&self, x: &[f64]) -> DVector<f64> {
        DVector::from_fn(x.len(), |index, _| (x[index] - self.from[index]) / self.layout.scale[index])
    }

    /// Distance from the start in standard deviations of the prior.
    fn prior(&self, x: &[f64]) -> DVector<f64> {
        let layout = self.layout;
        DVector::from_fn(x.len(), |index, _| (x[index] - layout.start[index]) / (PRIOR_SCALES * layout.scale[index]))
    }
}

impl Cost for Weighted<'_> {
    fn value(&self, x: &[f64]) -> f64 {
        let data = self.equations.residual_squared(&self.layout.phi(x));
        0.5 * (data + self.prior(x).norm_squared() + self.hold * self.moved(x).norm_squared())
    }

    fn expand(&self, x: &[f64]) -> Quadratic {
        let jacobian = self.layout.jacobian(x);
        let residual = self.equations.residual(&self.layout.phi(x));
        let mut gradient = jacobian.transpose() * (self.factor.transpose() * residual);
        let mut hessian = jacobian.transpose() * (&self.information * &jacobian);
        for (index, distance) in self.prior(x).iter().enumerate() {
            let deviation = PRIOR_SCALES * self.layout.scale[index];
            gradient[index] += distance / deviation;
            hessian[(index, index)] += deviation.powi(-2);
        }
        for (index, distance) in self.moved(x).iter().enumerate() {
            gradient[index] += self.hold * distance / self.layout.scale[index];
            hessian[(index, index)] += self.hold / self.layout.scale[index].powi(2);
        }
        Quadratic { cost: self.value(x), gradient, hessian }
    }
}

/// Standard errors, flags and status at the solution.
fn conclude(
    layout: &Layout,
    within: &Interior,
    data: &Data,
    x: &[f64],
    start_residuals: &BTreeMap<usize, f64>,
    status: FitStatus,
    iterations: usize,
) -> TorqueFit {
    let n = x.len();
    let sigma = data.deviations();
    let cost_before = start_residuals.iter().map(|(joint, sum)| 0.5 * sum / sigma[joint].powi(2)).sum();
    let held: Vec<bool> = (0..n)
        .map(|index| {
            let room = (x[index] - layout.lower[index]).min(layout.upper[index] - x[index]);
            room < HELD * layout.scale[index]
        })
        .collect();

    let jacobian = layout.jacobian(x);
    let mut weighted = Compressed::new(layout.n_phi());
    let mut noise = DMatrix::zeros(n, n);
    for (joint, data) in &data.joints {
        weighted.merge(&data.equations, 1.0 / sigma[joint]);
        let information = jacobian.transpose() * data.equations.information() * &jacobian;
        noise += information * (data.correlation_time / sigma[joint].powi(2));
    }
    let factor = weighted.factor() * &jacobian;
    let all = standing(&factor, &noise, &layout.scale);
    // A parameter on its bound is known as far as the others are concerned.
    let moving = if held.contains(&true) {
        let without_held =
            DMatrix::from_fn(factor.nrows(), n, |row, column| if held[column] { 0.0 } else { factor[(row, column)] });
        standing(&without_held, &noise, &layout.scale)
    } else {
        all.clone()
    };

    let parameters: Vec<FittedParameter> = (0..n)
        .map(|index| FittedParameter {
            name: layout.names[index].clone(),
            start: layout.start[index],
            value: x[index],
            std_error: if held[index] { None } else { moving.std_error[index] },
            identifiable: all.identifiable[index],
            held: held[index],
        })
        .collect();
    let links_at_physical_limit: Vec<usize> = layout
        .links
        .iter()
        .filter(|link| link.has_unknown_inertia() && at_limit(&link.at(x)))
        .map(|link| link.link)
        .collect();
    let status = match status {
        FitStatus::Converged if held.contains(&true) || !links_at_physical_limit.is_empty() => FitStatus::HeldByBound,
        FitStatus::Converged if parameters.iter().any(|parameter| !parameter.identifiable) => {
            FitStatus::NotIdentifiable
        }
        other => other,
    };
    debug_assert!(is_inside(within, x), "a fit ends inside of its bounds");
    TorqueFit {
        status,
        iterations,
        cost_before,
        cost_after: data.cost(&sigma),
        rank: all.rank,
        condition: all.condition,
        flat: named(&all, &layout.names),
        correlated: correlated(&moving, &layout.names),
        parameters,
        joints: data
            .joints
            .iter()
            .map(|(joint, data)| JointNoise {
                joint: *joint,
                sigma: sigma[joint],
                correlation_time: data.correlation_time,
                n_samples: data.n_samples,
            })
            .collect(),
        links_at_physical_limit,
    }
}

/// Whether the second moment of a link is singular to within what the barrier leaves.
fn at_limit(inertial: &[f64; 10]) -> bool {
    let inertia: [f64; 6] = std::array::from_fn(|entry| inertial[4 + entry]);
    let trace = inertia[0] + inertia[3] + inertia[5];
    pseudo_inertia::inside(&inertia, HELD * trace) != inertia
}

fn named(standing: &Standing, names: &[String]) -> Vec<Vec<(String, f64)>> {
    let name = |flat: &Vec<f64>| {
        let entries = flat.iter().zip(names).filter(|(change, _)| **change != 0.0);
        entries.map(|(change, name)| (name.clone(), *change)).collect()
    };
    standing.flat.iter().map(name).collect()
}

fn correlated(standing: &Standing, names: &[String]) -> Vec<(String, String, f64)> {
    /// From here on two estimates are hardly told apart.
    const STRONG: f64 = 0.95;
    let mut pairs = Vec::new();
    for row in 0..names.len() {
        for column in row + 1..names.len() {
            let correlation = standing.correlation[(row, column)];
            if correlation.abs() > STRONG {
                pairs.push((names[row].clone(), names[column].clone(), correlation));
            }
        }
    }
    pairs
}

#[cfg(test)]
mod tests;
