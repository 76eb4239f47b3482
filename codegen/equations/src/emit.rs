//! Polynomials as terms of a program.

use dynid_lower::{Node, Program};
use dynid_model::Device;

use crate::algebra::{Algebra, Polynomial};
use crate::arithmetic::Arithmetic;

/// What polynomials are written for: a device whose joints of `free` move, the others being locked.
pub struct Context<'a, A: Arithmetic> {
    /// The symbols.
    pub algebra: &'a Algebra<A>,
    /// The mechanism.
    pub device: &'a Device,
    /// Free joints, ascending.
    pub free: &'a [usize],
}

// Whatever the arithmetic, this is but three references.
impl<A: Arithmetic> Clone for Context<'_, A> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<A: Arithmetic> Copy for Context<'_, A> {}

/// `coefficient * leaf * product of symbols^exponent`.
#[derive(Debug, Clone)]
pub struct Term {
    /// A number.
    pub coefficient: f64,
    /// A value that is already there.
    pub leaf: Option<Node>,
    /// Of the symbols given beside.
    pub exponents: Vec<u8>,
}

impl<A: Arithmetic> Context<'_, A> {
    /// The polynomial in nested (Horner) form.
    pub fn emit(&self, program: &mut Program, polynomial: &Polynomial<A>) -> Node {
        let terms: Vec<Term> = polynomial
            .terms()
            .map(|(coefficient, exponents)| Term {
                coefficient: coefficient.to_f64(),
                leaf: None,
                exponents: exponents.to_vec(),
            })
            .collect();
        let mut symbol =
            |position: usize, program: &mut Program| self.algebra.node(position, self.device, self.free, program);
        nested(program, terms, &mut symbol)
    }
}

/// A sum of terms; the symbol that most of them share is factored out first.
pub fn nested(program: &mut Program, terms: Vec<Term>, symbol: &mut dyn FnMut(usize, &mut Program) -> Node) -> Node {
    if let [Term { coefficient, leaf, exponents }] = terms.as_slice() {
        let mut factors: Vec<Node> = leaf.iter().copied().collect();
        for (position, &exponent) in exponents.iter().enumerate().filter(|(_, exponent)| **exponent > 0) {
            let symbol = symbol(position, program);
            factors.extend((0..exponent).map(|_| symbol));
        }
        let product = program.product(&factors);
        let coefficient = program.number(*coefficient);
        return program.multiply(coefficient, product);
    }
    let Some(first) = terms.first() else { return program.number(0.0) };
    let count = |position: usize| terms.iter().filter(|term| term.exponents[position] > 0).count();
    let most = (0..first.exponents.len()).max_by_key(|&position| (count(position), std::cmp::Reverse(position)));
    let Some(position) = most.filter(|&position| count(position) > 1) else {
        let parts: Vec<Node> = terms.into_iter().map(|term| nested(program, vec![term], symbol)).collect();
        return program.sum(&parts);
    };
    let (mut with, without): (Vec<Term>, Vec<Term>) = terms.into_iter().partition(|term| term.exponents[position] > 0);
    for term in &mut with {
        term.exponents[position] -= 1;
    }
    let quotient = nested(program, with, symbol);
    let factor = symbol(position, program);
    let product = program.multiply(factor, quotient);
    let rest = nested(program, without, symbol);
    program.add(product, rest)
}
