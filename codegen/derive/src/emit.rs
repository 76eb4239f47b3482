//! Polynomials as terms of a program.

use dynid_lower::{Node, Program};
use dynid_model::Device;
use symbolica::domains::rational::Rational;

use crate::algebra::{Algebra, Polynomial};

/// What polynomials are written for: a device whose joints of `free` move, the others being locked.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// The symbols.
    pub algebra: &'a Algebra,
    /// The mechanism.
    pub device: &'a Device,
    /// Free joints, ascending.
    pub free: &'a [usize],
}

/// A term under construction: coefficient and exponents.
pub type Term = (f64, Vec<u8>);

impl Context<'_> {
    /// The polynomial in nested (Horner) form.
    pub fn emit(&self, program: &mut Program, polynomial: &Polynomial) -> Node {
        let terms = polynomial
            .terms()
            .map(|(coefficient, exponents): (&Rational, &[u8])| (coefficient.to_f64(), exponents.to_vec()))
            .collect();
        self.emit_terms(program, terms)
    }

    /// A sum of terms, the symbol of most terms being factored out first.
    pub fn emit_terms(&self, program: &mut Program, terms: Vec<Term>) -> Node {
        if let [(coefficient, exponents)] = terms.as_slice() {
            let mut factors = Vec::new();
            for (position, &exponent) in exponents.iter().enumerate() {
                let symbol = (exponent > 0).then(|| self.algebra.node(position, self.device, self.free, program));
                factors.extend((0..exponent).filter_map(|_| symbol));
            }
            let product = program.product(&factors);
            let coefficient = program.number(*coefficient);
            return program.multiply(coefficient, product);
        }
        let Some((_, first)) = terms.first() else { return program.number(0.0) };
        let count = |position: usize| terms.iter().filter(|(_, exponents)| exponents[position] > 0).count();
        let most = (0..first.len()).max_by_key(|&position| (count(position), std::cmp::Reverse(position)));
        let Some(position) = most.filter(|&position| count(position) > 1) else {
            let parts: Vec<Node> = terms.into_iter().map(|term| self.emit_terms(program, vec![term])).collect();
            return program.sum(&parts);
        };
        let (with, without): (Vec<Term>, Vec<Term>) =
            terms.into_iter().partition(|(_, exponents)| exponents[position] > 0);
        let quotient = with
            .into_iter()
            .map(|(coefficient, mut exponents)| {
                exponents[position] -= 1;
                (coefficient, exponents)
            })
            .collect();
        let quotient = self.emit_terms(program, quotient);
        let symbol = self.algebra.node(position, self.device, self.free, program);
        let product = program.multiply(symbol, quotient);
        let rest = self.emit_terms(program, without);
        program.add(product, rest)
    }
}
