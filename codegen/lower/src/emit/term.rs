//! A term as a Rust expression over `S: Scalar`.

use std::collections::BTreeMap;

use dynid_model::expression::{Comparison, Function};
use proc_macro2::{Ident, Literal, TokenStream};
use quote::{format_ident, quote};

use crate::{Node, Operation, Program};

/// Writes terms; those in `names` by name, all others in place.
pub(super) struct Terms<'a> {
    pub program: &'a Program,
    pub names: &'a BTreeMap<Node, Ident>,
}

/// How tightly an expression binds.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Sum,
    Product,
    Sign,
    Atom,
}

impl Terms<'_> {
    /// How the term is computed.
    pub fn definition(&self, node: Node) -> TokenStream {
        self.operation(node).0
    }

    /// The term where it is used.
    pub fn reference(&self, node: Node) -> TokenStream {
        self.term(node).0
    }

    fn term(&self, node: Node) -> (TokenStream, Binding) {
        match self.names.get(&node) {
            Some(name) => (quote!(#name), Binding::Atom),
            None => self.operation(node),
        }
    }

    fn operation(&self, node: Node) -> (TokenStream, Binding) {
        match self.program.operation_of(node) {
            Operation::Number(bits) => {
                let value = Literal::f64_unsuffixed(f64::from_bits(bits));
                (quote!(S::constant(#value)), Binding::Atom)
            }
            Operation::Input(position) => {
                let name = format_ident!("{}", self.program.inputs()[position].0.identifier());
                (quote!(#name), Binding::Atom)
            }
            Operation::Negate(a) => match self.program.number_of(a) {
                Some(value) => {
                    let value = Literal::f64_unsuffixed(-value);
                    (quote!(S::constant(#value)), Binding::Atom)
                }
                None => {
                    let a = self.at_least(a, Binding::Sign);
                    (quote!(-#a), Binding::Sign)
                }
            },
            Operation::Add(a, b) => self.infix(a, quote!(+), b, Binding::Sum),
            Operation::Subtract(a, b) => self.infix(a, quote!(-), b, Binding::Sum),
            Operation::Multiply(a, b) => self.infix(a, quote!(*), b, Binding::Product),
            Operation::Divide(a, b) => self.infix(a, quote!(/), b, Binding::Product),
            Operation::Call(function, a) => {
                let method = format_ident!("{}", method(function));
                let a = self.at_least(a, Binding::Atom);
                (quote!(#a.#method()), Binding::Atom)
            }
            Operation::Minimum(a, b) => {
                let (a, b) = (self.at_least(a, Binding::Atom), self.reference(b));
                (quote!(#a.minimum(#b)), Binding::Atom)
            }
            Operation::Maximum(a, b) => {
                let (a, b) = (self.at_least(a, Binding::Atom), self.reference(b));
                (quote!(#a.maximum(#b)), Binding::Atom)
            }
            Operation::Select(comparison, [left, right, then, otherwise]) => {
                let (small, large) = match comparison {
                    Comparison::Less => (left, right),
                    Comparison::Greater => (right, left),
                };
                let [small, large, then, otherwise] =
                    [small, large, then, otherwise].map(|operand| self.reference(operand));
                (quote!(S::if_less(#small, #large, #then, #otherwise)), Binding::Atom)
            }
        }
    }

    /// `a <operator> b`; the right operand must bind tighter, since operators associate to the left.
    fn infix(&self, a: Node, operator: TokenStream, b: Node, binding: Binding) -> (TokenStream, Binding) {
        let tighter = if binding == Binding::Sum { Binding::Product } else { Binding::Sign };
        let (a, b) = (self.at_least(a, binding), self.at_least(b, tighter));
        (quote!(#a #operator #b), binding)
    }

    fn at_least(&self, node: Node, binding: Binding) -> TokenStream {
        let (tokens, own) = self.term(node);
        if own < binding { quote!((#tokens)) } else { tokens }
    }
}

/// The method of `Scalar`; sines and cosines are computed in pairs before they are used.
fn method(function: Function) -> &'static str {
    match function {
        Function::Sin => "sin",
        Function::Cos => "cos",
        Function::Tan => "tan",
        Function::Tanh => "tanh",
        Function::Exp => "exp",
        Function::Ln => "ln",
        Function::Sqrt => "sqrt",
        Function::Abs => "abs",
        Function::Sign => "sign",
        Function::Min => "minimum",
        Function::Max => "maximum",
    }
}
