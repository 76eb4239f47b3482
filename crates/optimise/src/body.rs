//! A link's ten inertial parameters, of which some are sought, and how to keep them those of a body.
//!
//! With mass m and inertia I about the centroid, a body of that mass distribution exists if and only if `m >= 0` and
//! `S = tr(I)/2 - I >= 0` (see [`super::pseudo_inertia`]). S is linear in I, so every direction v gives a half-space
//! `v' S v >= 0`, and the eigenvectors of negative eigenvalues give those that an impossible inertia breaks.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::{
    pseudo_inertia::{ENTRIES, second_moment, symmetric},
    region::{Entry, HalfSpace},
};

/// A link's ten inertial parameters, each an unknown or a number.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Number of the link.
    pub link: usize,
    /// Mass, centroid and inertia about it, in the order of `dynid_model::Link::SYMBOLS`.
    pub inertial: [Entry; 10],
}

/// S may fall below zero by this share of its trace: rounding of decimal values.
const ROUNDING: f64 = 1e-9;
/// Cuts keep S above zero by this share of its trace, so that rounding cannot undo it.
const MARGIN: f64 = 1e-7;
/// Projections until a start that no body has counts as beyond mending.
const ROUNDS: usize = 1000;

impl Body {
    /// Its parameters at `x`.
    pub fn at(&self, x: &[f64]) -> [f64; 10] {
        self.inertial.map(|entry| entry.at(x))
    }

    /// Which of its parameters is which unknown.
    pub fn unknowns(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.inertial.iter().enumerate().filter_map(|(symbol, entry)| Some((symbol, entry.index()?)))
    }

    /// Its mass.
    pub fn mass(&self) -> Entry {
        self.inertial[0]
    }

    /// Its inertia, entry by entry: xx, xy, xz, yy, yz, zz.
    pub fn inertia(&self) -> [Entry; 6] {
        std::array::from_fn(|entry| self.inertial[4 + entry])
    }

    /// Whether any moment of inertia is sought; of what is known nobody asks whether a body can have it.
    pub fn has_unknown_inertia(&self) -> bool {
        self.inertia().into_iter().any(|entry| entry.index().is_some())
    }

    fn inertia_at(&self, x: &[f64]) -> [f64; 6] {
        self.inertia().map(|entry| entry.at(x))
    }

    /// Principal moments of inertia [kg m^2].
    pub fn moments(&self, x: &[f64]) -> [f64; 3] {
        let values = SymmetricEigen::new(symmetric(&self.inertia_at(x))).eigenvalues;
        [values[0], values[1], values[2]]
    }

    /// Whether such a body exists, up to rounding.
    pub fn is_physical(&self, x: &[f64]) -> bool {
        let inertia = self.inertia_at(x);
        let least = SymmetricEigen::new(second_moment(&inertia)).eigenvalues.min();
        self.mass().at(x) >= 0.0 && least >= -ROUNDING * symmetric(&inertia).trace().abs()
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
            let inertia = self.inertia_at(x);
            let trace = 0.5 * symmetric(&inertia).trace();
            let mut eigen = SymmetricEigen::new(second_moment(&inertia));
            eigen.eigenvalues.apply(|value| *value = value.max(MARGIN * trace.abs()));
            let lifted = eigen.recompose();
            let inertia = Matrix3::identity() * lifted.trace() - lifted;
            let mass = self.mass().at(x).max(0.0);
            let entries = ENTRIES.into_iter().zip(self.inertia()).map(|(place, entry)| (entry, inertia[place]));
            for (entry, value) in entries.chain([(self.mass(), mass)]) {
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
            for cut in cuts {
                let beyond = cut.excess(x);
                let square: f64 = cut.terms.iter().map(|(_, factor)| factor * factor).sum();
                if beyond > 0.0 && square > 0.0 {
                    for (index, factor) in cut.terms {
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
        if let Entry::Unknown(index) = self.mass()
            && x[index] < 0.0
        {
            cuts.push(HalfSpace { terms: vec![(index, -1.0)], limit: 0.0 });
        }
        let inertia = self.inertia_at(x);
        let trace = symmetric(&inertia).trace();
        let eigen = SymmetricEigen::new(second_moment(&inertia));
        for (value, v) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value < 0.5 * MARGIN * trace.abs() {
                cuts.extend(self.cut(&v.into_owned()));
            }
        }
        cuts
    }

    /// `v' S v >= MARGIN tr(I)`.
    fn cut(&self, v: &Vector3<f64>) -> Option<HalfSpace> {
        let mut terms = Vec::new();
        let mut limit = 0.0;
        for ((row, column), entry) in ENTRIES.into_iter().zip(self.inertia()) {
            let factor = if row == column { v[row] * v[row] - 0.5 + MARGIN } else { 2.0 * v[row] * v[column] };
            match entry {
                Entry::Known(value) => limit -= factor * value,
                Entry::Unknown(index) => terms.push((index, factor)),
            }
        }
        (!terms.is_empty()).then_some(HalfSpace { terms, limit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mass and six moments of inertia are the unknowns, in this order.
    fn body() -> Body {
        let entry = |symbol: usize| match symbol {
            0 => Entry::Unknown(0),
            1..=3 => Entry::Known(0.0),
            _ => Entry::Unknown(symbol - 3),
        };
        Body { link: 2, inertial: std::array::from_fn(entry) }
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
            x.extend(ENTRIES.map(|place| inertia[place]));
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
        let known = [1.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.2, 0.0, 0.0].map(Entry::Known);
        let mut plate = Body { link: 2, inertial: known };
        plate.inertial[9] = Entry::Unknown(0);
        let mut x = vec![0.9];
        assert!(plate.make_physical(&mut x, &[0.0], &[1.0]) && plate.is_physical(&x));
        assert!((x[0] - 0.5).abs() < 1e-6, "{x:?}");
    }
}
