//! A scalar with its first and second time derivative, and expressions evaluated over it.
//!
//! A joint variable enters as `(q, dq, ddq)`; whatever is computed from it carries its own rate and acceleration by
//! the chain rule, exact to rounding: `d2f/dt2 = f'' x'^2 + f' x''`.

use std::ops::{Add, Div, Mul, Neg, Sub};

use dynid_model::Expression;
use dynid_model::expression::{BinaryOperator, Comparison, Function};

/// A value, its rate and its acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Jet {
    /// The value itself.
    pub value: f64,
    /// First derivative in time.
    pub rate: f64,
    /// Second derivative in time.
    pub acceleration: f64,
}

impl Jet {
    /// A value that does not move.
    pub const fn constant(value: f64) -> Self {
        Self { value, rate: 0.0, acceleration: 0.0 }
    }

    /// `f(self)`, given the value of `f` and of its first two derivatives at `self.value`.
    fn chain(self, value: f64, first: f64, second: f64) -> Self {
        Self {
            value,
            rate: first * self.rate,
            acceleration: second * self.rate * self.rate + first * self.acceleration,
        }
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            rate: self.rate + other.rate,
            acceleration: self.acceleration + other.acceleration,
        }
    }
}

impl Neg for Jet {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, rate: -self.rate, acceleration: -self.acceleration }
    }
}

impl Sub for Jet {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self {
            value: self.value * other.value,
            rate: self.rate * other.value + self.value * other.rate,
            acceleration: self.acceleration * other.value
                + 2.0 * self.rate * other.rate
                + self.value * other.acceleration,
        }
    }
}

impl Div for Jet {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let inverse = 1.0 / other.value;
        self * other.chain(inverse, -inverse * inverse, 2.0 * inverse * inverse * inverse)
    }
}

/// The value of `expression` where `symbol` gives each symbol's value.
pub fn evaluate(expression: &Expression, symbol: &dyn Fn(&str) -> Jet) -> Jet {
    match expression {
        Expression::Number(value) => Jet::constant(*value),
        Expression::Symbol(name) => symbol(name),
        Expression::Negate(inner) => -evaluate(inner, symbol),
        Expression::Binary(operator, left, right) => {
            let (left, right) = (evaluate(left, symbol), evaluate(right, symbol));
            match operator {
                BinaryOperator::Add => left + right,
                BinaryOperator::Subtract => left - right,
                BinaryOperator::Multiply => left * right,
                BinaryOperator::Divide => left / right,
            }
        }
        Expression::Call(function, arguments) => {
            let arguments: Vec<Jet> = arguments.iter().map(|argument| evaluate(argument, symbol)).collect();
            call(*function, &arguments)
        }
        Expression::IfElse(comparison, parts) => {
            let [left, right, then, otherwise] = &**parts;
            let (left, right) = (evaluate(left, symbol).value, evaluate(right, symbol).value);
            let holds = match comparison {
                Comparison::Less => left < right,
                Comparison::Greater => left > right,
            };
            evaluate(if holds { then } else { otherwise }, symbol)
        }
    }
}

fn call(function: Function, arguments: &[Jet]) -> Jet {
    let x = arguments[0];
    let v = x.value;
    match function {
        Function::Sin => x.chain(v.sin(), v.cos(), -v.sin()),
        Function::Cos => x.chain(v.cos(), -v.sin(), -v.cos()),
        Function::Tan => {
            let tangent = v.tan();
            let slope = 1.0 + tangent * tangent;
            x.chain(tangent, slope, 2.0 * tangent * slope)
        }
        Function::Tanh => {
            let tangent = v.tanh();
            let slope = 1.0 - tangent * tangent;
            x.chain(tangent, slope, -2.0 * tangent * slope)
        }
        Function::Exp => x.chain(v.exp(), v.exp(), v.exp()),
        Function::Ln => x.chain(v.ln(), 1.0 / v, -1.0 / (v * v)),
        Function::Sqrt => {
            let root = v.sqrt();
            x.chain(root, 0.5 / root, -0.25 / (root * v))
        }
        Function::Abs => x.chain(v.abs(), sign(v), 0.0),
        Function::Sign => Jet::constant(sign(v)),
        Function::Min => {
            if v <= arguments[1].value {
                x
            } else {
                arguments[1]
            }
        }
        Function::Max => {
            if v >= arguments[1].value {
                x
            } else {
                arguments[1]
            }
        }
    }
}

/// -1, 0 or 1; unlike `f64::signum`, `sign(0) = 0`.
pub fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along x(t) = sin(3t), y(t) = 2 + t^2, every operation's rate and acceleration against central differences.
    #[test]
    fn derivatives_match_central_differences() {
        let at = |t: f64| {
            let x = Jet { value: (3.0 * t).sin(), rate: 3.0 * (3.0 * t).cos(), acceleration: -9.0 * (3.0 * t).sin() };
            let y = Jet { value: 2.0 + t * t, rate: 2.0 * t, acceleration: 2.0 };
            vec![
                x * y,
                x / y,
                x - y,
                call(Function::Sin, &[y]),
                call(Function::Cos, &[x]),
                call(Function::Tan, &[x]),
                call(Function::Tanh, &[x]),
                call(Function::Exp, &[x]),
                call(Function::Ln, &[y]),
                call(Function::Sqrt, &[y]),
                call(Function::Abs, &[x]),
            ]
        };
        let (t, h) = (0.37, 1e-4);
        for (index, ((before, here), after)) in at(t - h).iter().zip(at(t)).zip(at(t + h)).enumerate() {
            let rate = (after.value - before.value) / (2.0 * h);
            let acceleration = (after.rate - before.rate) / (2.0 * h);
            assert!((here.rate - rate).abs() < 1e-5, "operation {index}: {} is not {rate}", here.rate);
            assert!(
                (here.acceleration - acceleration).abs() < 1e-4,
                "operation {index}: {} is not {acceleration}",
                here.acceleration
            );
        }
    }
}
