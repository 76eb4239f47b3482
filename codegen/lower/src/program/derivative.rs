//! Derivatives by the chain rule over the terms of the graph.
//!
//! Each term that depends on the variable gets one derivative, built from those of its operands and shared with the
//! rest of the graph: no expression is expanded. At a kink (`abs`, `sign`, `min`, `max`, a choice) the derivative is
//! that of the branch taken.

use std::collections::BTreeMap;

use dynid_model::expression::{Comparison, Function};

use super::{Node, Operation, Program};

impl Program {
    /// `d of[k] / d by` for each k. `by` is any node; it counts as independent of everything before it.
    pub fn derivative(&mut self, of: &[Node], by: Node) -> Vec<Node> {
        let one = self.number(1.0);
        let mut derivatives = BTreeMap::from([(by, one)]);
        for node in self.reached(of.iter().copied()) {
            if node <= by {
                continue;
            }
            match self.derivative_of_term(node, &derivatives) {
                Some(derivative) if !self.is_zero(derivative) => derivatives.insert(node, derivative),
                _ => None,
            };
        }
        let zero = self.number(0.0);
        of.iter().map(|node| derivatives.get(node).copied().unwrap_or(zero)).collect()
    }

    /// The chain rule for one term; `None` where no operand depends on the variable.
    fn derivative_of_term(&mut self, node: Node, derivatives: &BTreeMap<Node, Node>) -> Option<Node> {
        let of = |operand: Node| derivatives.get(&operand).copied();
        match self.operation_of(node) {
            Operation::Number(_) | Operation::Input(_) => None,
            Operation::Negate(a) => of(a).map(|da| self.negate(da)),
            Operation::Add(a, b) => match (of(a), of(b)) {
                (Some(da), Some(db)) => Some(self.add(da, db)),
                (da, db) => da.or(db),
            },
            Operation::Subtract(a, b) => match (of(a), of(b)) {
                (Some(da), Some(db)) => Some(self.subtract(da, db)),
                (Some(da), None) => Some(da),
                (None, Some(db)) => Some(self.negate(db)),
                (None, None) => None,
            },
            Operation::Multiply(a, b) if a == b => {
                let da = of(a)?;
                let product = self.multiply(a, da);
                Some(self.add(product, product))
            }
            Operation::Multiply(a, b) => {
                let left = of(a).map(|da| self.multiply(da, b));
                let right = of(b).map(|db| self.multiply(a, db));
                match (left, right) {
                    (Some(left), Some(right)) => Some(self.add(left, right)),
                    (left, right) => left.or(right),
                }
            }
            Operation::Divide(a, b) => {
                // d(a/b) = (da - (a/b) db) * (1/b), where the reciprocal serves every variable
                let numerator = match (of(a), of(b)) {
                    (None, None) => return None,
                    (Some(da), None) => da,
                    (da, Some(db)) => {
                        let correction = self.multiply(node, db);
                        match da {
                            Some(da) => self.subtract(da, correction),
                            None => self.negate(correction),
                        }
                    }
                };
                let one = self.number(1.0);
                let reciprocal = self.divide(one, b);
                Some(self.multiply(numerator, reciprocal))
            }
            Operation::Call(function, a) => {
                let da = of(a)?;
                let slope = self.slope(function, a, node);
                Some(self.multiply(slope, da))
            }
            Operation::Minimum(a, b) => self.derivative_of_choice(Comparison::Less, [a, b, a, b], derivatives),
            Operation::Maximum(a, b) => self.derivative_of_choice(Comparison::Greater, [a, b, a, b], derivatives),
            Operation::Select(comparison, operands) => self.derivative_of_choice(comparison, operands, derivatives),
        }
    }

    fn derivative_of_choice(
        &mut self,
        comparison: Comparison,
        [left, right, then, otherwise]: [Node; 4],
        derivatives: &BTreeMap<Node, Node>,
    ) -> Option<Node> {
        let (then, otherwise) = (derivatives.get(&then).copied(), derivatives.get(&otherwise).copied());
        if then.is_none() && otherwise.is_none() {
            return None;
        }
        let zero = self.number(0.0);
        Some(self.select(comparison, [left, right, then.unwrap_or(zero), otherwise.unwrap_or(zero)]))
    }

    /// The derivative of `value = function(a)` by `a`.
    fn slope(&mut self, function: Function, a: Node, value: Node) -> Node {
        let one = self.number(1.0);
        match function {
            Function::Sin => self.cos(a),
            Function::Cos => {
                let sine = self.sin(a);
                self.negate(sine)
            }
            Function::Tan => {
                let square = self.multiply(value, value);
                self.add(one, square)
            }
            Function::Tanh => {
                let square = self.multiply(value, value);
                self.subtract(one, square)
            }
            Function::Exp => value,
            Function::Ln => self.divide(one, a),
            Function::Sqrt => {
                let half = self.number(0.5);
                self.divide(half, value)
            }
            Function::Abs => self.call(Function::Sign, a),
            Function::Sign | Function::Min | Function::Max => self.number(0.0),
        }
    }
}
