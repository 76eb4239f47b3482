//! The interpreter: what the emitted code is tested against.

use dynid_model::expression::{Comparison, Function};

use super::{Input, Operation, Program};

impl Program {
    /// The values of the outputs, in order. `value` is asked for each live input.
    pub fn evaluate(&self, mut value: impl FnMut(&Input) -> f64) -> Vec<f64> {
        let mut values = vec![f64::NAN; self.len()];
        for node in self.live() {
            let of = |operand: super::Node| values[operand.index()];
            values[node.index()] = match self.operation_of(node) {
                Operation::Number(bits) => f64::from_bits(bits),
                Operation::Input(position) => value(&self.inputs[position].0),
                Operation::Negate(a) => -of(a),
                Operation::Add(a, b) => of(a) + of(b),
                Operation::Subtract(a, b) => of(a) - of(b),
                Operation::Multiply(a, b) => of(a) * of(b),
                Operation::Divide(a, b) => of(a) / of(b),
                Operation::Call(function, a) => call(function, of(a)),
                Operation::Minimum(a, b) => of(a).min(of(b)),
                Operation::Maximum(a, b) => of(a).max(of(b)),
                Operation::Select(comparison, [left, right, then, otherwise]) => {
                    let holds = match comparison {
                        Comparison::Less => of(left) < of(right),
                        Comparison::Greater => of(left) > of(right),
                    };
                    if holds { of(then) } else { of(otherwise) }
                }
            };
        }
        self.outputs.iter().map(|(_, node)| values[node.index()]).collect()
    }
}

fn call(function: Function, a: f64) -> f64 {
    match function {
        Function::Sin => a.sin(),
        Function::Cos => a.cos(),
        Function::Tan => a.tan(),
        Function::Tanh => a.tanh(),
        Function::Exp => a.exp(),
        Function::Ln => a.ln(),
        Function::Sqrt => a.sqrt(),
        Function::Abs => a.abs(),
        Function::Sign if a == 0.0 => 0.0,
        Function::Sign => a.signum(),
        // Two arguments: `Operation::Minimum`, `Operation::Maximum`.
        Function::Min | Function::Max => f64::NAN,
    }
}
