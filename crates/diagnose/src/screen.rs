//! Score tests: how much of what a model leaves would a candidate explain, the model's own parameters being free to make up
//! for it? No refit is needed: the own parameters are projected out to first order.

use dynid_model::Parameter;
use nalgebra::{Cholesky, DMatrix, Dyn};
use rayon::prelude::*;

use super::{
    candidate::{Candidate, Probe, keep_orders},
    error_signal::{Block, View},
    joint_weights::Weighed,
};
use dynid_user_model::Model;

/// What a candidate would explain, at the best of its tried values.
#[derive(Debug, Clone)]
pub struct Score {
    /// Who.
    pub candidate: Candidate,
    /// `sum n_eff ln(after / before) + k ln n_eff`: lower is better, 0 is nothing gained.
    pub information: f64,
    /// Share of the squared error that it explains, over all joints (each weighed alike).
    pub explained: f64,
    /// The model with the candidate at its first estimate.
    pub estimate: Model,
    /// Other estimates, by the next best of the tried values.
    pub others: Vec<Model>,
    /// Whether the values were sought more finely than the grid: then a single fit is not to be trusted, for its valley is
    /// narrow and others lie beside it.
    pub is_narrow: bool,
}

/// What a change of the errors leaves.
struct Remainder {
    /// `sum n_eff ln(after / before)` over the joints.
    gain: f64,
    /// Independent samples.
    independent: f64,
    /// Share of the squared error that is gone, over all joints (each weighed alike).
    explained: f64,
}

/// What the torque error says of a candidate, and what simulations with an observer say.
pub(super) type Scored = (Option<Score>, Option<Score>);

/// Other estimates that a score keeps.
const OTHERS: usize = 2;

/// The model's own parameters, ready to be projected out of an error signal.
pub struct Screen<'a> {
    view: &'a dyn View,
    /// The errors as they are.
    raw: Vec<Block>,
    /// The errors, each weighed by its joint's, and the own parameters to be taken out.
    problem: Weighed,
    /// The weight of each error.
    weights: Vec<f64>,
    /// Joint and independent samples of each block, and where it ends.
    blocks: Vec<(usize, f64, usize)>,
}

impl<'a> Screen<'a> {
    /// Of what `base` leaves of the view's logs; `None` where it cannot be evaluated or leaves nothing.
    pub fn new(view: &'a dyn View, base: &Model, moving: &[(String, Parameter)]) -> Option<Self> {
        let raw = view.errors(base)?;
        let mut end = 0;
        let blocks: Vec<(usize, f64, usize)> = raw
            .iter()
            .map(|block| {
                end += block.values.len();
                (block.joint, block.independent, end)
            })
            .collect();
        let columns: Vec<(f64, Vec<f64>)> =
            moving.par_iter().filter_map(|(name, parameter)| own_column(view, base, &raw, name, parameter)).collect();
        if end == 0 {
            return None;
        }
        let own = DMatrix::from_fn(end, columns.len(), |row, column| columns[column].1[row]);
        // A parameter's own range is all that is known of it beforehand.
        let prior: Vec<f64> = columns.iter().map(|(spread, _)| spread.powi(-2)).collect();
        let problem = Weighed::new(&raw, &own, &prior);
        let weights = problem.of_rows(&raw);
        Some(Self { view, raw, problem, weights, blocks })
    }

    /// Sum of squares, unweighed, of what the own parameters leave.
    pub(super) fn squares(&self) -> f64 {
        self.problem.left.iter().zip(&self.weights).map(|(left, weight)| (left / weight).powi(2)).sum()
    }

    /// How the errors of `model` differ from the base's, weighed and projected.
    fn change(&self, model: &Model, from: &[Block]) -> Option<Vec<f64>> {
        self.changed(&self.view.errors(model)?, from)
    }

    /// How these errors differ from the base's, weighed and projected.
    fn changed(&self, errors: &[Block], from: &[Block]) -> Option<Vec<f64>> {
        let mut change = Vec::with_capacity(self.problem.left.len());
        for (block, base) in errors.iter().zip(from) {
            if block.values.len() != base.values.len() {
                return None;
            }
            change.extend(block.values.iter().zip(&base.values).map(|(value, base)| value - base));
        }
        change.iter_mut().zip(&self.weights).for_each(|(value, weight)| *value *= weight);
        Some(self.problem.projected(change))
    }

    /// Scores a candidate by the best of its probes; `None` where none can be evaluated or none changes anything.
    pub fn score(&self, candidate: &Candidate, probes: &[Probe]) -> Option<Score> {
        let mut tried: Vec<(f64, f64, Model)> = probes.par_iter().filter_map(|probe| self.score_probe(probe)).collect();
        tried.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut tried = tried.into_iter();
        let (information, explained, estimate) = tried.next()?;
        let others = tried.take(OTHERS).map(|(.., model)| model).collect();
        Some(Score { candidate: candidate.clone(), information, explained, estimate, others, is_narrow: false })
    }

    /// A score whose estimate has the values of these names brought nearer to the best: what is tried is a coarse grid, and the
    /// valleys of some laws are narrower. What a fit may not move, a choice say, stays; so does 0. The rest of the score
    /// remains the grid's.
    pub(super) fn refined(&self, score: Score, names: &[String]) -> Score {
        /// Factors of a value, tried one after the other: the meshes of the grids are three to five wide, and a fit of the
        /// narrowest law that is known, backlash, must begin within a fourth of its values.
        const FACTORS: [f64; 3] = [1.6, 1.25, 1.12];
        /// Rounds over all values with a factor, at most: a mesh and more.
        const ROUNDS: usize = 4;
        let may_move = |name: &&String| {
            let found = score.estimate.parameter(name);
            found.is_some_and(|parameter| !parameter.fixed && parameter.value != 0.0)
        };
        let names: Vec<&String> = names.iter().filter(may_move).collect();
        let score = Score { is_narrow: true, ..score };
        let Some(mut least) = self.gain_of(&score.estimate) else { return score };
        let mut estimate = score.estimate.clone();
        for factor in FACTORS {
            for _ in 0..ROUNDS {
                let moved = |(name, factor): (&&String, f64)| {
                    let Parameter { value, lower, upper, .. } = estimate.parameter(name)?;
                    let mut moved = estimate.clone();
                    moved.set_value(name, (factor * value).clamp(lower, upper)).ok()?;
                    keep_orders(&mut moved);
                    Some((self.gain_of(&moved)?, moved))
                };
                let trials: Vec<(&&String, f64)> =
                    names.iter().flat_map(|name| [(name, factor), (name, 1.0 / factor)]).collect();
                let tried: Vec<Option<(f64, Model)>> = trials.into_par_iter().map(moved).collect();
                let best = tried.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0));
                let Some((gain, model)) = best.filter(|(gain, _)| *gain < least) else { break };
                (least, estimate) = (gain, model);
            }
        }
        if estimate.digest() == score.estimate.digest() {
            return score;
        }
        let mut others = vec![score.estimate];
        others.extend(score.others);
        others.truncate(OTHERS);
        Score { estimate, others, ..score }
    }

    /// `sum n_eff ln(after / before)` of a model as it is.
    fn gain_of(&self, model: &Model) -> Option<f64> {
        let change = self.change(model, &self.raw)?;
        let after: Vec<f64> = self.problem.left.iter().zip(&change).map(|(left, change)| left + change).collect();
        Some(self.of_joints(&after).gain).filter(|gain| gain.is_finite())
    }

    /// What is left where the errors, weighed and projected, become `after`.
    fn of_joints(&self, after: &[f64]) -> Remainder {
        let mut joints: std::collections::BTreeMap<usize, (f64, f64, f64)> = std::collections::BTreeMap::new();
        let mut from = 0;
        for &(joint, independent, end) in &self.blocks {
            let sum = joints.entry(joint).or_insert((0.0, 0.0, 0.0));
            sum.0 += self.problem.left[from..end].iter().map(|value| value * value).sum::<f64>();
            sum.1 += after[from..end].iter().map(|value| value * value).sum::<f64>();
            sum.2 += independent;
            from = end;
        }
        let gain = joints
            .values()
            .filter(|(before, ..)| *before > 0.0)
            .map(|(before, after, independent)| independent * (after / before).max(f64::MIN_POSITIVE).ln())
            .sum();
        let (before, rest): (f64, f64) =
            joints.values().fold((0.0, 0.0), |(before, rest), joint| (before + joint.0, rest + joint.1));
        Remainder {
            gain,
            independent: joints.values().map(|(.., independent)| independent).sum(),
            explained: 1.0 - rest / before,
        }
    }

    fn score_probe(&self, probe: &Probe) -> Option<(f64, f64, Model)> {
        /// Smaller changes are rounding.
        const NOTHING: f64 = 1e-9;
        let size = |column: &[f64]| (column.iter().map(|value| value * value).sum::<f64>()).sqrt();
        let scale = NOTHING * (self.problem.left.len() as f64).sqrt();
        let shape = self.view.errors(&probe.model)?;
        let mut columns = Vec::new();
        let mut bounds = Vec::new();
        let whole = self.changed(&shape, &self.raw)?;
        let has_whole = size(&whole) > scale;
        if has_whole {
            columns.push(whole);
            // A law that is not proportional to its values holds near where it was tried.
            bounds.push(if probe.scaled.is_empty() { (0.0, 1.5) } else { (0.0, 20.0) });
        }
        let mut stepped = Vec::new();
        for (index, step) in probe.steps.iter().enumerate() {
            let mut units = vec![0.0; probe.steps.len()];
            units[index] = 1.0;
            let Some(column) = self.change(&probe.at(1.0, &units), &shape) else { continue };
            if size(&column) > scale {
                columns.push(column);
                bounds.push(step.range);
                stepped.push(index);
            }
        }
        if columns.is_empty() {
            return None;
        }
        // The error is measured minus modelled: adding the effect changes it by these columns.
        let taken = bounded_least_squares(&columns, &self.problem.left, &bounds);
        let mut after = self.problem.left.clone();
        for (column, amount) in columns.iter().zip(&taken) {
            after.iter_mut().zip(column).for_each(|(value, column)| *value += amount * column);
        }
        let Remainder { gain, independent, explained } = self.of_joints(&after);
        let unknowns = columns.len() as f64 + f64::from(u8::from(probe.scaled.len() > 1));
        let information = gain + unknowns * independent.max(2.0).ln();
        let factor = if has_whole { taken[0] } else { 1.0 };
        let mut units = vec![0.0; probe.steps.len()];
        for (amount, index) in taken.iter().skip(usize::from(has_whole)).zip(&stepped) {
            units[*index] = *amount;
        }
        information.is_finite().then(|| (information, explained, probe.at(factor, &units)))
    }
}

/// The information of the own parameters, with what is known of them beforehand.
pub(super) fn regular(own: &DMatrix<f64>, prior: &[f64]) -> Option<Cholesky<f64, Dyn>> {
    /// Smaller than this share of the largest is rounding.
    const ROUNDING: f64 = 1e-13;
    let mut information = own.clone();
    let largest = information.diagonal().iter().copied().fold(0.0, f64::max);
    for (index, prior) in prior.iter().enumerate() {
        information[(index, index)] += prior.max(ROUNDING * largest).max(f64::MIN_POSITIVE);
    }
    Cholesky::new(information)
}

/// How the errors change with one of the model's own parameters, and its range; `None` for one that is held or that
/// changes nothing.
pub(super) fn own_column(
    view: &dyn View,
    base: &Model,
    raw: &[Block],
    name: &str,
    parameter: &Parameter,
) -> Option<(f64, Vec<f64>)> {
    /// A step is this share of the range.
    const STEP: f64 = 1e-4;
    /// Nearer to a bound than this share of the range is on it.
    const ON_BOUND: f64 = 1e-6;
    let Parameter { value, lower, upper, fixed } = *parameter;
    let half = 0.5 * (upper - lower);
    let spread = if half.is_finite() { half } else { (2.0 * value.abs()).max(1.0) };
    if fixed || spread <= 0.0 || value - lower < ON_BOUND * spread || upper - value < ON_BOUND * spread {
        return None;
    }
    // A wide range is no reason for a large step of a small value.
    let size = if value == 0.0 { spread } else { spread.min(10.0 * value.abs()) };
    let step = if value + STEP * size <= upper { STEP * size } else { -STEP * size };
    let mut moved = base.clone();
    moved.set_value(name, value + step).ok()?;
    let errors = view.errors(&moved)?;
    let mut column = Vec::new();
    for (block, base) in errors.iter().zip(raw) {
        column.extend(block.values.iter().zip(&base.values).map(|(value, base)| (value - base) / step));
    }
    column.iter().any(|value| *value != 0.0).then_some((spread, column))
}

/// The amounts within bounds that make `|left + sum amount * column|` smallest.
fn bounded_least_squares(columns: &[Vec<f64>], left: &[f64], bounds: &[(f64, f64)]) -> Vec<f64> {
    /// Sweeps over the amounts; there are a handful of them.
    const SWEEPS: usize = 500;
    let n = columns.len();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let hessian = DMatrix::from_fn(n, n, |row, column| dot(&columns[row], &columns[column]));
    let gradient: Vec<f64> = columns.iter().map(|column| dot(column, left)).collect();
    let mut amounts = vec![0.0; n];
    for _ in 0..SWEEPS {
        let mut moved = 0.0_f64;
        for index in 0..n {
            let slope = gradient[index] + (0..n).map(|other| hessian[(index, other)] * amounts[other]).sum::<f64>();
            if hessian[(index, index)] > 0.0 {
                let next = (amounts[index] - slope / hessian[(index, index)]).clamp(bounds[index].0, bounds[index].1);
                moved = moved.max((next - amounts[index]).abs());
                amounts[index] = next;
            }
        }
        if moved == 0.0 {
            break;
        }
    }
    amounts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors that vanish where the two speeds of Turner's law are these (rad/s), in a narrow valley across both.
    struct Valley {
        v1: f64,
        v4: f64,
    }

    impl View for Valley {
        fn errors(&self, model: &Model) -> Option<Vec<Block>> {
            let of = |symbol: &str| model.parameter(&format!("joint.0.turner.{symbol}")).map(|own| own.value);
            let values = match (of("v1"), of("v4")) {
                (Some(v1), Some(v4)) => {
                    let (along, across) = ((v1 / self.v1).ln(), (v4 / self.v4).ln());
                    vec![10.0 * (along + across), along - 2.0 * across, 1e-3]
                }
                _ => vec![20.0; 3],
            };
            Some(vec![Block { joint: 0, independent: 30.0, values }])
        }
    }

    fn with_turner(v1: f64, v4: f64) -> (Model, Model, Vec<String>) {
        let mut base = Model::of_device(dynid_model::device("planar2r").unwrap());
        base.effects.clear();
        let mut model = base.clone();
        model.add_effect("turner", Some(0), None).unwrap();
        let names = ["v1", "v4"].map(|symbol| format!("joint.0.turner.{symbol}"));
        model.set_value(&names[0], v1).unwrap();
        model.set_value(&names[1], v4).unwrap();
        (base, model, names.into())
    }

    fn refined(view: &Valley, (base, model, names): &(Model, Model, Vec<String>)) -> Vec<f64> {
        let screen = Screen::new(view, base, &[]).unwrap();
        let candidate = Candidate { effect: "turner".to_owned(), joint: Some(0), from: None };
        let score = Score {
            candidate,
            information: -1.0,
            explained: 0.5,
            estimate: model.clone(),
            others: Vec::new(),
            is_narrow: false,
        };
        let refined = screen.refined(score, names);
        assert!(refined.others.iter().all(|other| other.digest() == model.digest()));
        names.iter().map(|name| refined.estimate.parameter(name).unwrap().value).collect()
    }

    #[test]
    fn values_are_brought_near_the_best_of_a_narrow_valley() {
        let found = refined(&Valley { v1: 0.05, v4: 0.3 }, &with_turner(0.1, 0.12));
        assert!((found[0] / 0.05).ln().abs() < 0.2 && (found[1] / 0.3).ln().abs() < 0.2, "{found:?}");
    }

    #[test]
    fn values_keep_their_order_and_what_is_fixed_stays() {
        // The valley's bottom lies where the inequality v4 > v1 does not hold.
        let found = refined(&Valley { v1: 0.4, v4: 0.1 }, &with_turner(0.1, 0.2));
        assert!(found[1] >= found[0], "{found:?}");
        let (base, mut model, names) = with_turner(0.1, 0.12);
        let own = model.parameter(&names[0]).unwrap();
        model.set(&names[0], Parameter { fixed: true, ..own }).unwrap();
        let found = refined(&Valley { v1: 0.05, v4: 0.3 }, &(base, model, names));
        assert!(found[0] == 0.1 && found[1] != 0.12, "{found:?}");
    }

    #[test]
    fn amounts_stay_within_their_bounds() {
        let columns = [vec![1.0, 0.0, 1.0], vec![0.0, 1.0, 1.0]];
        // left + C a = 0 at a = (2, -3)
        let left = [-2.0, 3.0, 1.0];
        let free = bounded_least_squares(&columns, &left, &[(-9.0, 9.0), (-9.0, 9.0)]);
        assert!((free[0] - 2.0).abs() < 1e-9 && (free[1] + 3.0).abs() < 1e-9, "{free:?}");
        // With a1 >= 0 the second stays at 0 and the first is the best alone: -(c.left)/(c.c) = 0.5.
        let bound = bounded_least_squares(&columns, &left, &[(-9.0, 9.0), (0.0, 9.0)]);
        assert!((bound[0] - 0.5).abs() < 1e-9 && bound[1] == 0.0, "{bound:?}");
    }
}
