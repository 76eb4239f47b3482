//! Which inertial parameters a body can have.
//!
//! With mass m and inertia I about the centroid, a body of that mass distribution exists if and only if `m >= 0` and
//! `S = tr(I)/2 - I >= 0` (S is the second moment of its density; this is the pseudo-inertia's Schur complement:
//! Wensing et al. 2018). S is linear in I, so every direction v gives a half-space `v' S v >= 0`, and the eigenvectors
//! of negative eigenvalues give those that an impossible inertia breaks.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use dynid_optimise::sqp::HalfSpace;
use dynid_user_model::Model;

/// Rotational inertia of one link, entry by entry a known value or the index of an unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Number of the link.
    pub link: usize,
    mass: Entry,
    /// `Ixx Ixy Ixz Iyy Iyz Izz`.
    inertia: [Entry; 6],
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Entry {
    Known(f64),
    Unknown(usize),
}

impl Entry {
    fn value(self, x: &[f64]) -> f64 {
        match self {
            Self::Known(value) => value,
            Self::Unknown(index) => x[index],
        }
    }
}

/// Row and column of each entry of `Body::inertia`.
const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
const SYMBOLS: [&str; 6] = ["Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"];

/// S may fall below zero by this share of its trace: rounding of decimal values.
const ROUNDING: f64 = 1e-9;
/// Cuts keep S above zero by this share of its trace, so that rounding cannot undo it.
const MARGIN: f64 = 1e-7;
/// Projections until a start that no body has counts as beyond mending.
const ROUNDS: usize = 1000;

impl Body {
    /// The links that have an unknown moment of inertia or mass. Links of which not all values are given are left out.
    pub fn all(unknowns: &[&str], known: &BTreeMap<String, f64>) -> Vec<Self> {
        let mut links: Vec<usize> = unknowns.iter().filter_map(|name| link_of(name)).collect();
        links.sort_unstable();
        links.dedup();
        links.into_iter().filter_map(|link| Self::new(link, unknowns, known)).collect()
    }

    fn new(link: usize, unknowns: &[&str], known: &BTreeMap<String, f64>) -> Option<Self> {
        let entry = |symbol: &str| {
            let name = format!("link.{link}.{symbol}");
            match unknowns.iter().position(|unknown| *unknown == name) {
                Some(index) => Some(Entry::Unknown(index)),
                None => known.get(&name).copied().map(Entry::Known),
            }
        };
        let mut inertia = [Entry::Known(0.0); 6];
        for (slot, symbol) in inertia.iter_mut().zip(SYMBOLS) {
            *slot = entry(symbol)?;
        }
        let mass = entry("m")?;
        let moves = |entry: &Entry| matches!(entry, Entry::Unknown(_));
        (moves(&mass) || inertia.iter().any(moves)).then_some(Self { link, mass, inertia })
    }

    fn matrix(&self, x: &[f64]) -> Matrix3<f64> {
        let mut matrix = Matrix3::zeros();
        for ((row, column), entry) in PLACES.into_iter().zip(self.inertia) {
            matrix[(row, column)] = entry.value(x);
            matrix[(column, row)] = entry.value(x);
        }
        matrix
    }

    /// Principal moments of inertia [kg m^2].
    pub fn moments(&self, x: &[f64]) -> [f64; 3] {
        let values = SymmetricEigen::new(self.matrix(x)).eigenvalues;
        [values[0], values[1], values[2]]
    }

    /// Whether such a body exists, up to rounding.
    pub fn is_physical(&self, x: &[f64]) -> bool {
        let inertia = self.matrix(x);
        let least = SymmetricEigen::new(second_moment(&inertia)).eigenvalues.min();
        self.mass.value(x) >= 0.0 && least >= -ROUNDING * inertia.trace().abs()
    }

    /// Moves `x` to a body that exists, near by and within the bounds: projections in turn on the bodies and on the bounds
    /// meet where both hold. False where they do not meet.
    pub fn make_physical(&self, x: &mut [f64], lower: &[f64], upper: &[f64]) -> bool {
        let start = x.to_vec();
        if self.lift(x, lower, upper) {
            return true;
        }
        // Lifting S needs all three moments free to grow; what is known stands in its way.
        x.copy_from_slice(&start);
        self.cut_back(x, lower, upper)
    }

    /// Lifts the negative eigenvalues of S to zero, again and again.
    fn lift(&self, x: &mut [f64], lower: &[f64], upper: &[f64]) -> bool {
        for _ in 0..ROUNDS {
            if self.cuts(x).is_empty() {
                return true;
            }
            let inertia = self.matrix(x);
            let trace = 0.5 * inertia.trace();
            let mut eigen = SymmetricEigen::new(second_moment(&inertia));
            eigen.eigenvalues.apply(|value| *value = value.max(MARGIN * trace.abs()));
            let lifted = eigen.recompose();
            let inertia = Matrix3::identity() * lifted.trace() - lifted;
            let mass = self.mass.value(x).max(0.0);
            let entries = PLACES.into_iter().zip(self.inertia).map(|(place, entry)| (entry, inertia[place]));
            for (entry, value) in entries.chain([(self.mass, mass)]) {
                if let Entry::Unknown(index) = entry {
                    x[index] = value.clamp(lower[index], upper[index]);
                }
            }
        }
        false
    }

    /// Projects on every half-space that `x` breaks, again and again.
    fn cut_back(&self, x: &mut [f64], lower: &[f64], upper: &[f64]) -> bool {
        for _ in 0..ROUNDS {
            let cuts = self.cuts(x);
            if cuts.is_empty() {
                return self.is_physical(x);
            }
            for HalfSpace { terms, limit } in cuts {
                let beyond = terms.iter().map(|(index, factor)| factor * x[*index]).sum::<f64>() - limit;
                let square: f64 = terms.iter().map(|(_, factor)| factor * factor).sum();
                if beyond > 0.0 && square > 0.0 {
                    for (index, factor) in terms {
                        x[index] = (x[index] - beyond / square * factor).clamp(lower[index], upper[index]);
                    }
                }
            }
        }
        false
    }

    /// Half-spaces that all bodies lie in and that `x` breaks.
    pub fn cuts(&self, x: &[f64]) -> Vec<HalfSpace> {
        let mut cuts = Vec::new();
        if let Entry::Unknown(index) = self.mass
            && x[index] < 0.0
        {
            cuts.push(HalfSpace { terms: vec![(index, -1.0)], limit: 0.0 });
        }
        let inertia = self.matrix(x);
        let eigen = SymmetricEigen::new(second_moment(&inertia));
        for (value, v) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value < 0.5 * MARGIN * inertia.trace().abs() {
                cuts.extend(self.cut(&v.into_owned()));
            }
        }
        cuts
    }

    /// `v' S v >= MARGIN tr(I)`.
    fn cut(&self, v: &Vector3<f64>) -> Option<HalfSpace> {
        let mut terms = Vec::new();
        let mut limit = 0.0;
        for ((row, column), entry) in PLACES.into_iter().zip(self.inertia) {
            let factor = if row == column { v[row] * v[row] - 0.5 + MARGIN } else { 2.0 * v[row] * v[column] };
            match entry {
                Entry::Known(value) => limit -= factor * value,
                Entry::Unknown(index) => terms.push((index, factor)),
            }
        }
        (!terms.is_empty()).then_some(HalfSpace { terms, limit })
    }
}

/// `S = tr(I)/2 - I`.
fn second_moment(inertia: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * (0.5 * inertia.trace()) - inertia
}

/// Moves those of `bodies` that cannot exist to ones near by, within the bounds; their links.
pub(super) fn make_physical(bodies: &[Body], x: &mut [f64], lower: &[f64], upper: &[f64]) -> Vec<usize> {
    let moved = bodies.iter().filter(|body| !body.is_physical(x) && body.make_physical(x, lower, upper));
    moved.map(|body| body.link).collect()
}

/// Moves every link of `model` that no body can be to one near by, within the bounds, and notes it. A link that its bounds
/// keep impossible stays.
pub fn made_physical(mut model: Model) -> Model {
    let (mut names, mut x, mut lower, mut upper) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut known = BTreeMap::new();
    for (name, parameter) in model.parameters() {
        if parameter.fixed {
            known.insert(name, parameter.value);
        } else {
            names.push(name);
            x.push(parameter.value);
            lower.push(parameter.lower);
            upper.push(parameter.upper);
        }
    }
    let unknowns: Vec<&str> = names.iter().map(String::as_str).collect();
    for link in make_physical(&Body::all(&unknowns, &known), &mut x, &lower, &upper) {
        model.notes.push(format!("link {link} started with an inertia that no body has; moved to a body's near by"));
    }
    for (name, value) in names.iter().zip(&x) {
        // The names are the model's own.
        let _known = model.set_value(name, *value);
    }
    model
}

/// The number of the link whose mass or moment of inertia `name` is.
fn link_of(name: &str) -> Option<usize> {
    let (number, symbol) = name.strip_prefix("link.")?.split_once('.')?;
    let matters = symbol == "m" || SYMBOLS.contains(&symbol);
    matters.then(|| number.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body() -> Body {
        let unknowns = ["link.2.m", "link.2.Ixx", "link.2.Ixy", "link.2.Ixz", "link.2.Iyy", "link.2.Iyz", "link.2.Izz"];
        let mut bodies = Body::all(&unknowns, &BTreeMap::new());
        assert_eq!(bodies.len(), 1);
        bodies.remove(0)
    }

    /// Point masses make a body, so their inertia passes; a broken triangle inequality does not, and its cut says so.
    #[test]
    fn bodies_pass_and_impossible_inertias_are_cut_off() {
        let points = [(0.3, [0.1, 0.0, 0.2]), (0.2, [-0.1, 0.3, 0.0]), (0.5, [0.0, -0.12, -0.12])];
        let mut inertia = Matrix3::zeros();
        for (mass, p) in points {
            let p = Vector3::from(p);
            inertia += (Matrix3::identity() * p.norm_squared() - p * p.transpose()) * mass;
        }
        let vector = |inertia: &Matrix3<f64>| {
            let mut x = vec![1.0];
            x.extend(PLACES.map(|place| inertia[place]));
            x
        };
        let possible = vector(&inertia);
        assert!(body().is_physical(&possible));
        let mut broken = inertia;
        broken[(2, 2)] = inertia[(0, 0)] + inertia[(1, 1)] + 0.01;
        let impossible = vector(&broken);
        assert!(!body().is_physical(&impossible));
        let cuts = body().cuts(&impossible);
        assert!(!cuts.is_empty());
        for cut in cuts {
            let at = |x: &[f64]| cut.terms.iter().map(|(index, factor)| factor * x[*index]).sum::<f64>();
            assert!(at(&impossible) > cut.limit, "the cut leaves the impossible point out");
            assert!(at(&possible) <= cut.limit, "the cut keeps every body");
        }
        let mut mended = impossible.clone();
        let (lower, upper) = ([0.0, 0.0, -1.0, -1.0, 0.0, -1.0, 0.0], [2.0; 7]);
        assert!(body().make_physical(&mut mended, &lower, &upper));
        assert!(body().is_physical(&mended));
        let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(distance(&mended, &impossible) < distance(&possible, &impossible), "{mended:?}");
        let mut held = impossible.clone();
        let mut floor = lower;
        floor[6] = impossible[6];
        let mut ceiling = upper;
        (ceiling[1], ceiling[4]) = (inertia[(0, 0)], inertia[(1, 1)]);
        assert!(!body().make_physical(&mut held, &floor, &ceiling), "these bounds hold no body");
    }

    /// A flat plate turns about its normal with the sum of its other two moments; none turns more heavily.
    #[test]
    fn one_unknown_moment_is_cut_back_to_what_the_known_ones_allow() {
        let known = [("m", 1.0), ("Ixx", 0.3), ("Ixy", 0.0), ("Ixz", 0.0), ("Iyy", 0.2), ("Iyz", 0.0)];
        let known = known.map(|(symbol, value)| (format!("link.2.{symbol}"), value)).into_iter().collect();
        let bodies = Body::all(&["link.2.Izz"], &known);
        let mut x = vec![0.9];
        assert!(bodies[0].make_physical(&mut x, &[0.0], &[1.0]) && bodies[0].is_physical(&x));
        assert!((x[0] - 0.5).abs() < 1e-6, "{x:?}");
    }
}
