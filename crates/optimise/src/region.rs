//! Where a minimum is sought: bounds and linear inequalities.

use serde::{Deserialize, Serialize};

/// A number that is sought or known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Entry {
    /// An unknown, by its index.
    Unknown(usize),
    /// Its value.
    Known(f64),
}

impl Entry {
    /// The number at `x`.
    pub fn at(self, x: &[f64]) -> f64 {
        match self {
            Self::Unknown(index) => x[index],
            Self::Known(value) => value,
        }
    }

    /// Which unknown it is.
    pub fn index(self) -> Option<usize> {
        match self {
            Self::Unknown(index) => Some(index),
            Self::Known(_) => None,
        }
    }
}

/// `sum(factor * x[index]) <= limit`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HalfSpace {
    /// Index and factor.
    pub terms: Vec<(usize, f64)>,
    /// What the sum must not exceed.
    pub limit: f64,
}

impl HalfSpace {
    /// Where `larger` is not below `smaller`; `None` where both are known.
    pub fn of_order(larger: Entry, smaller: Entry) -> Option<Self> {
        match (larger, smaller) {
            (Entry::Unknown(larger), Entry::Unknown(smaller)) => {
                Some(Self { terms: vec![(smaller, 1.0), (larger, -1.0)], limit: 0.0 })
            }
            (Entry::Unknown(larger), Entry::Known(value)) => Some(Self { terms: vec![(larger, -1.0)], limit: -value }),
            (Entry::Known(value), Entry::Unknown(smaller)) => Some(Self { terms: vec![(smaller, 1.0)], limit: value }),
            (Entry::Known(_), Entry::Known(_)) => None,
        }
    }

    /// By how much `x` lies outside; negative inside.
    pub fn excess(&self, x: &[f64]) -> f64 {
        self.terms.iter().map(|(index, factor)| factor * x[*index]).sum::<f64>() - self.limit
    }

    /// Size of the sum's terms, which its rounding is measured by.
    pub(crate) fn size(&self, x: &[f64]) -> f64 {
        self.terms.iter().map(|(index, factor)| (factor * x[*index]).abs()).sum::<f64>() + self.limit.abs()
    }
}

/// Where a search may go. Entries of all vectors belong to the unknowns, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// Lower bounds; `-inf` where there is none.
    pub lower: Vec<f64>,
    /// Upper bounds; `inf` where there is none.
    pub upper: Vec<f64>,
    /// Linear inequalities; where a search makes cuts, those that it has met so far.
    pub half_spaces: Vec<HalfSpace>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_holds_where_the_larger_is_not_below_the_smaller() {
        let (known, first, second) = (Entry::Known(2.0), Entry::Unknown(0), Entry::Unknown(1));
        for (larger, smaller, x) in
            [(first, second, [5.0, 3.5]), (first, known, [3.5, 0.0]), (known, second, [0.0, 0.5])]
        {
            let order = HalfSpace::of_order(larger, smaller).expect("something is unknown");
            assert_eq!(order.excess(&x), -1.5);
            assert_eq!(order.excess(&x), smaller.at(&x) - larger.at(&x));
        }
        assert_eq!(HalfSpace::of_order(known, known), None);
    }
}
