//! Formulas of device and effect files as terms.

use std::collections::BTreeMap;

use dynid_model::Expression;
use dynid_model::expression::{BinaryOperator, Function};

use super::{Node, Program};

impl Program {
    /// The term of a formula whose symbols are in `scope`.
    ///
    /// # Errors
    /// The first symbol that is not.
    pub fn expression(&mut self, expression: &Expression, scope: &BTreeMap<String, Node>) -> Result<Node, String> {
        let node = match expression {
            Expression::Number(value) => self.number(*value),
            Expression::Symbol(symbol) => *scope.get(symbol).ok_or_else(|| symbol.clone())?,
            Expression::Negate(a) => {
                let a = self.expression(a, scope)?;
                self.negate(a)
            }
            Expression::Binary(operator, a, b) => {
                let (a, b) = (self.expression(a, scope)?, self.expression(b, scope)?);
                match operator {
                    BinaryOperator::Add => self.add(a, b),
                    BinaryOperator::Subtract => self.subtract(a, b),
                    BinaryOperator::Multiply => self.multiply(a, b),
                    BinaryOperator::Divide => self.divide(a, b),
                }
            }
            Expression::Call(function, arguments) => {
                let arguments =
                    arguments.iter().map(|argument| self.expression(argument, scope)).collect::<Result<Vec<_>, _>>()?;
                match (function, arguments.as_slice()) {
                    (Function::Min, &[a, b]) => self.minimum(a, b),
                    (Function::Max, &[a, b]) => self.maximum(a, b),
                    (function, &[a]) => self.call(*function, a),
                    // `dynid_model` has checked the number of arguments.
                    _ => self.number(f64::NAN),
                }
            }
            Expression::IfElse(comparison, operands) => {
                let mut nodes = Vec::with_capacity(4);
                for operand in operands.iter() {
                    nodes.push(self.expression(operand, scope)?);
                }
                self.select(*comparison, [nodes[0], nodes[1], nodes[2], nodes[3]])
            }
        };
        Ok(node)
    }
}
