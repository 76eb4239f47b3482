//! Scalar expressions in Rust's own syntax, as they stand in device and effect files.

/// A parsed scalar expression. Symbols are not resolved here.
#[derive(Debug, Clone, PartialEq)]
pub enum Expression {
    /// A literal, or `pi`.
    Number(f64),
    /// A joint variable (`q2`), a length (`L5`), a signal (`dq`) or a parameter (`Fc`).
    Symbol(String),
    /// `-x`.
    Negate(Box<Expression>),
    /// `a + b`, `a - b`, `a * b`, `a / b`.
    Binary(BinaryOperator, Box<Expression>, Box<Expression>),
    /// `sin(x)`, `tanh(x)`, `min(a, b)`, ...
    Call(Function, Vec<Expression>),
    /// `if a < b { x } else { y }`.
    IfElse(Comparison, Box<[Expression; 4]>),
}

/// An operator between two expressions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BinaryOperator {
    /// `a + b`
    Add,
    /// `a - b`
    Subtract,
    /// `a * b`
    Multiply,
    /// `a / b`
    Divide,
}

/// A function that an expression may call. `sign(0)` is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Function {
    /// sine
    Sin,
    /// cosine
    Cos,
    /// tangent
    Tan,
    /// hyperbolic tangent
    Tanh,
    /// exponential
    Exp,
    /// natural logarithm
    Ln,
    /// square root
    Sqrt,
    /// absolute value
    Abs,
    /// -1, 0 or 1
    Sign,
    /// the smaller of two
    Min,
    /// the larger of two
    Max,
}

/// A comparison between two expressions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Comparison {
    /// `a < b`
    Less,
    /// `a > b`
    Greater,
}
