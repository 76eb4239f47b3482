//! Polynomials of our own, for where no computer algebra system is at hand.

use std::cmp::Ordering;

use crate::{arithmetic::Arithmetic, fraction::Fraction};

/// A polynomial as a sorted list of terms.
#[derive(Debug, Clone, PartialEq)]
pub struct Exact {
    width: usize,
    coefficients: Vec<Fraction>,
    /// Of each term `width` of them, one after the other.
    exponents: Vec<u8>,
}

impl Exact {
    fn zero(width: usize) -> Self {
        Self { width, coefficients: Vec::new(), exponents: Vec::new() }
    }

    fn exponents_of(&self, term: usize) -> &[u8] {
        &self.exponents[term * self.width..(term + 1) * self.width]
    }

    fn push(&mut self, coefficient: Fraction, exponents: &[u8]) {
        if coefficient != Fraction::ZERO {
            self.coefficients.push(coefficient);
            self.exponents.extend_from_slice(exponents);
        }
    }

    /// Terms in any order, like ones among them.
    fn collected(width: usize, coefficients: &[Fraction], exponents: &[u8]) -> Self {
        let of = |term: usize| &exponents[term * width..(term + 1) * width];
        let mut order: Vec<usize> = (0..coefficients.len()).collect();
        order.sort_by(|a, b| of(*a).cmp(of(*b)));
        let mut sum = Self::zero(width);
        for alike in order.chunk_by(|a, b| of(*a) == of(*b)) {
            sum.push(alike.iter().fold(Fraction::ZERO, |sum, term| sum + coefficients[*term]), of(alike[0]));
        }
        sum
    }

    /// `self + factor other`
    fn merged(&self, other: &Self, factor: Fraction) -> Self {
        let mut sum = Self::zero(self.width);
        let (mut own, mut others) = (0, 0);
        while own < self.coefficients.len() || others < other.coefficients.len() {
            let order = match (own < self.coefficients.len(), others < other.coefficients.len()) {
                (true, true) => self.exponents_of(own).cmp(other.exponents_of(others)),
                (true, false) => Ordering::Less,
                (false, _) => Ordering::Greater,
            };
            let mut coefficient = Fraction::ZERO;
            let exponents = if order.is_le() { self.exponents_of(own) } else { other.exponents_of(others) };
            if order.is_le() {
                coefficient = coefficient + self.coefficients[own];
                own += 1;
            }
            if order.is_ge() {
                coefficient = coefficient + factor * other.coefficients[others];
                others += 1;
            }
            sum.push(coefficient, exponents);
        }
        sum
    }
}

impl Arithmetic for Exact {
    /// How many there are.
    type Symbols = usize;

    fn symbols(names: &[String]) -> usize {
        names.len()
    }

    fn from_terms(symbols: &usize, terms: impl IntoIterator<Item = (Vec<u8>, Fraction)>) -> Self {
        let (mut coefficients, mut exponents) = (Vec::new(), Vec::new());
        for (own, coefficient) in terms {
            coefficients.push(coefficient);
            exponents.extend(own);
        }
        Self::collected(*symbols, &coefficients, &exponents)
    }

    fn terms(&self) -> impl Iterator<Item = (Fraction, &[u8])> {
        self.coefficients.iter().copied().zip(self.exponents.chunks_exact(self.width.max(1)))
    }

    fn plus(&self, other: &Self) -> Self {
        self.merged(other, Fraction::ONE)
    }

    fn minus(&self, other: &Self) -> Self {
        self.merged(other, -Fraction::ONE)
    }

    fn times(&self, other: &Self) -> Self {
        let n_products = self.coefficients.len() * other.coefficients.len();
        let mut coefficients = Vec::with_capacity(n_products);
        let mut exponents = Vec::with_capacity(n_products * self.width);
        for (own, a) in self.terms() {
            for (others, b) in other.terms() {
                // A power that is too high is as bad as a number that is too large.
                let is_exact = a.iter().zip(b).all(|(a, b)| a.checked_add(*b).is_some());
                coefficients.push(if is_exact { own * others } else { Fraction::NONE });
                exponents.extend(a.iter().zip(b).map(|(a, b)| a.saturating_add(*b)));
            }
        }
        Self::collected(self.width, &coefficients, &exponents)
    }

    fn negative(&self) -> Self {
        let coefficients = self.coefficients.iter().map(|own| -*own).collect();
        Self { width: self.width, coefficients, exponents: self.exponents.clone() }
    }

    fn by(&self, position: usize) -> Self {
        let mut sum = Self::zero(self.width);
        for (coefficient, exponents) in self.terms().filter(|(_, exponents)| exponents[position] > 0) {
            let mut lower = exponents.to_vec();
            lower[position] -= 1;
            sum.push(coefficient * Fraction::from(i64::from(exponents[position])), &lower);
        }
        sum
    }
}
