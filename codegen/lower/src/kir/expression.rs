//! A term as an expression in Rust's syntax, with no more parentheses than it needs.

use std::collections::BTreeMap;

use dynid_model::expression::{Comparison, Function};

use crate::{Node, Operation, Program};

/// Prints terms; those in `names` by name, all others in place.
pub(super) struct Printer<'a> {
    pub program: &'a Program,
    pub names: &'a BTreeMap<Node, String>,
}

/// How tightly an expression binds.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Sum,
    Product,
    Sign,
    Atom,
}

impl Printer<'_> {
    /// How the term is computed.
    pub fn definition(&self, node: Node) -> String {
        self.write_operation(node).0
    }

    /// The term where it is used: its name if it has one.
    pub fn reference(&self, node: Node) -> String {
        self.write(node).0
    }

    fn write(&self, node: Node) -> (String, Binding) {
        match self.names.get(&node) {
            Some(name) => (name.clone(), Binding::Atom),
            None => self.write_operation(node),
        }
    }

    fn write_operation(&self, node: Node) -> (String, Binding) {
        match self.program.operation_of(node) {
            Operation::Number(bits) => (format!("{:?}", f64::from_bits(bits)), Binding::Atom),
            Operation::Input(position) => (self.program.inputs()[position].0.identifier(), Binding::Atom),
            Operation::Negate(a) => (format!("-{}", self.at_least(a, Binding::Sign)), Binding::Sign),
            Operation::Add(a, b) => self.infix(a, "+", b, Binding::Sum),
            Operation::Subtract(a, b) => self.infix(a, "-", b, Binding::Sum),
            Operation::Multiply(a, b) => self.infix(a, "*", b, Binding::Product),
            Operation::Divide(a, b) => self.infix(a, "/", b, Binding::Product),
            Operation::Call(function, a) => {
                (format!("{}({})", function_name(function), self.reference(a)), Binding::Atom)
            }
            Operation::Minimum(a, b) => (format!("min({}, {})", self.reference(a), self.reference(b)), Binding::Atom),
            Operation::Maximum(a, b) => (format!("max({}, {})", self.reference(a), self.reference(b)), Binding::Atom),
            Operation::Select(comparison, [left, right, then, otherwise]) => {
                let sign = match comparison {
                    Comparison::Less => "<",
                    Comparison::Greater => ">",
                };
                let text = format!(
                    "(if {} {sign} {} {{ {} }} else {{ {} }})",
                    self.reference(left),
                    self.reference(right),
                    self.reference(then),
                    self.reference(otherwise)
                );
                (text, Binding::Atom)
            }
        }
    }

    /// `a <operator> b`; the right operand must bind tighter, since operators associate to the left.
    fn infix(&self, a: Node, operator: &str, b: Node, binding: Binding) -> (String, Binding) {
        let tighter = if binding == Binding::Sum { Binding::Product } else { Binding::Sign };
        (format!("{} {operator} {}", self.at_least(a, binding), self.at_least(b, tighter)), binding)
    }

    fn at_least(&self, node: Node, binding: Binding) -> String {
        let (text, own) = self.write(node);
        if own < binding { format!("({text})") } else { text }
    }
}

/// The functions by their names in expressions.
pub(crate) const FUNCTIONS: [(&str, Function); 11] = [
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tan", Function::Tan),
    ("tanh", Function::Tanh),
    ("exp", Function::Exp),
    ("ln", Function::Ln),
    ("sqrt", Function::Sqrt),
    ("abs", Function::Abs),
    ("sign", Function::Sign),
    ("min", Function::Min),
    ("max", Function::Max),
];

fn function_name(function: Function) -> &'static str {
    FUNCTIONS.iter().find(|(_, known)| *known == function).map_or("", |(name, _)| name)
}
