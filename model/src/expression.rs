//! Scalar expressions in Rust's own syntax, as they stand in device and effect files.

use std::{collections::BTreeMap, f64::consts::PI, fmt};

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
    /// `if a < b { x } else { y }`: the four are `a, b, x, y`.
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

/// `constant + sum(coefficient * symbol)`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Affine {
    /// The part without symbols.
    pub constant: f64,
    /// By symbol; none is zero.
    pub coefficients: BTreeMap<String, f64>,
}

impl Expression {
    /// The value, where `lookup` gives the value of each symbol.
    ///
    /// # Errors
    /// The first symbol that `lookup` does not know.
    pub fn evaluate(&self, lookup: &dyn Fn(&str) -> Option<f64>) -> Result<f64, String> {
        Ok(match self {
            Self::Number(value) => *value,
            Self::Symbol(name) => lookup(name).ok_or_else(|| name.clone())?,
            Self::Negate(x) => -x.evaluate(lookup)?,
            Self::Binary(operator, a, b) => operator.apply(a.evaluate(lookup)?, b.evaluate(lookup)?),
            Self::Call(function, arguments) => {
                let values = arguments.iter().map(|x| x.evaluate(lookup)).collect::<Result<Vec<_>, _>>()?;
                function.apply(&values)
            }
            Self::IfElse(comparison, parts) => {
                let [a, b, x, y] = &**parts;
                let holds = comparison.holds(a.evaluate(lookup)?, b.evaluate(lookup)?);
                if holds { x.evaluate(lookup)? } else { y.evaluate(lookup)? }
            }
        })
    }

    /// The value, if no symbol stands in it.
    pub fn constant(&self) -> Option<f64> {
        self.evaluate(&|_| None).ok()
    }

    /// Visits each symbol, in the order of the text; a symbol that stands twice comes twice.
    pub fn for_each_symbol(&self, visit: &mut dyn FnMut(&str)) {
        match self {
            Self::Number(_) => {}
            Self::Symbol(name) => visit(name),
            Self::Negate(x) => x.for_each_symbol(visit),
            Self::Binary(_, a, b) => {
                a.for_each_symbol(visit);
                b.for_each_symbol(visit);
            }
            Self::Call(_, arguments) => arguments.iter().for_each(|x| x.for_each_symbol(visit)),
            Self::IfElse(_, parts) => parts.iter().for_each(|x| x.for_each_symbol(visit)),
        }
    }

    /// Whether the symbol stands in it.
    pub fn contains(&self, symbol: &str) -> bool {
        let mut found = false;
        self.for_each_symbol(&mut |name| found |= name == symbol);
        found
    }

    /// The expression as `constant + sum(coefficient * symbol)`, if it is written as sums and numeric multiples.
    pub fn affine(&self) -> Option<Affine> {
        if let Some(constant) = self.constant() {
            return Some(Affine { constant, coefficients: BTreeMap::new() });
        }
        match self {
            Self::Symbol(name) => Some(Affine { constant: 0.0, coefficients: [(name.clone(), 1.0)].into() }),
            Self::Negate(x) => Some(x.affine()?.scaled(-1.0)),
            Self::Binary(BinaryOperator::Add, a, b) => Some(a.affine()?.plus(&b.affine()?, 1.0)),
            Self::Binary(BinaryOperator::Subtract, a, b) => Some(a.affine()?.plus(&b.affine()?, -1.0)),
            Self::Binary(BinaryOperator::Multiply, a, b) => match (a.constant(), b.constant()) {
                (Some(factor), _) => Some(b.affine()?.scaled(factor)),
                (_, Some(factor)) => Some(a.affine()?.scaled(factor)),
                _ => None,
            },
            Self::Binary(BinaryOperator::Divide, a, b) => Some(a.affine()?.scaled(1.0 / b.constant()?)),
            _ => None,
        }
    }
}

impl Affine {
    fn scaled(mut self, factor: f64) -> Self {
        self.constant *= factor;
        self.coefficients.values_mut().for_each(|coefficient| *coefficient *= factor);
        self.without_zeros()
    }

    fn plus(mut self, other: &Self, factor: f64) -> Self {
        self.constant += factor * other.constant;
        for (name, coefficient) in &other.coefficients {
            *self.coefficients.entry(name.clone()).or_insert(0.0) += factor * coefficient;
        }
        self.without_zeros()
    }

    fn without_zeros(mut self) -> Self {
        self.coefficients.retain(|_, coefficient| *coefficient != 0.0);
        self
    }
}

impl BinaryOperator {
    /// The value of `a operator b`.
    pub fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
        }
    }

    /// As it is written.
    pub fn symbol(self) -> char {
        match self {
            Self::Add => '+',
            Self::Subtract => '-',
            Self::Multiply => '*',
            Self::Divide => '/',
        }
    }

    fn precedence(self) -> u8 {
        match self {
            Self::Add | Self::Subtract => SUM,
            Self::Multiply | Self::Divide => PRODUCT,
        }
    }
}

impl Function {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Sin,
        Self::Cos,
        Self::Tan,
        Self::Tanh,
        Self::Exp,
        Self::Ln,
        Self::Sqrt,
        Self::Abs,
        Self::Sign,
        Self::Min,
        Self::Max,
    ];

    /// As it is written.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Tanh => "tanh",
            Self::Exp => "exp",
            Self::Ln => "ln",
            Self::Sqrt => "sqrt",
            Self::Abs => "abs",
            Self::Sign => "sign",
            Self::Min => "min",
            Self::Max => "max",
        }
    }

    /// The function of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|function| function.name() == name)
    }

    /// How many arguments it takes.
    pub fn n_arguments(self) -> usize {
        if matches!(self, Self::Min | Self::Max) { 2 } else { 1 }
    }

    /// Its value; not a number where an argument is missing.
    pub fn apply(self, arguments: &[f64]) -> f64 {
        let x = arguments.first().copied().unwrap_or(f64::NAN);
        let y = arguments.get(1).copied().unwrap_or(f64::NAN);
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Tanh => x.tanh(),
            Self::Exp => x.exp(),
            Self::Ln => x.ln(),
            Self::Sqrt => x.sqrt(),
            Self::Abs => x.abs(),
            Self::Sign => {
                if x > 0.0 {
                    1.0
                } else if x < 0.0 {
                    -1.0
                } else {
                    // 0, and what is not a number stays so
                    x * 0.0
                }
            }
            Self::Min => {
                if y < x {
                    y
                } else {
                    x
                }
            }
            Self::Max => {
                if y > x {
                    y
                } else {
                    x
                }
            }
        }
    }
}

impl Comparison {
    /// Whether `a comparison b`.
    pub fn holds(self, a: f64, b: f64) -> bool {
        match self {
            Self::Less => a < b,
            Self::Greater => a > b,
        }
    }

    /// As it is written.
    pub fn symbol(self) -> char {
        match self {
            Self::Less => '<',
            Self::Greater => '>',
        }
    }
}

const LOWEST: u8 = 0;
const SUM: u8 = 1;
const PRODUCT: u8 = 2;
const UNARY: u8 = 3;

/// Rust syntax with no more parentheses than needed; `parse(print(x)) == x`.
impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_at(self, LOWEST, f)
    }
}

/// Writes an operand of an operator that binds as tightly as `precedence`.
fn write_at(expression: &Expression, precedence: u8, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let own = match expression {
        Expression::Binary(operator, ..) => operator.precedence(),
        Expression::Number(value) if value.is_sign_negative() => UNARY,
        Expression::Negate(_) => UNARY,
        Expression::IfElse(..) => LOWEST,
        _ => u8::MAX,
    };
    if own < precedence {
        f.write_str("(")?;
        write_at(expression, LOWEST, f)?;
        return f.write_str(")");
    }
    match expression {
        Expression::Number(value) if *value == PI => f.write_str("pi"),
        Expression::Number(value) => write!(f, "{value:?}"),
        Expression::Symbol(name) => f.write_str(name),
        Expression::Negate(x) => {
            f.write_str("-")?;
            write_at(x, UNARY, f)
        }
        Expression::Binary(operator, a, b) => {
            write_at(a, own, f)?;
            write!(f, " {} ", operator.symbol())?;
            write_at(b, own + 1, f)
        }
        Expression::Call(function, arguments) => {
            write!(f, "{}(", function.name())?;
            for (index, argument) in arguments.iter().enumerate() {
                f.write_str(if index == 0 { "" } else { ", " })?;
                write_at(argument, LOWEST, f)?;
            }
            f.write_str(")")
        }
        Expression::IfElse(comparison, parts) => {
            let [a, b, x, y] = &**parts;
            f.write_str("if ")?;
            write_at(a, SUM, f)?;
            write!(f, " {} ", comparison.symbol())?;
            write_at(b, SUM, f)?;
            write!(f, " {{ {x} }} else {{ {y} }}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Expression {
        Expression::parse(text).unwrap()
    }

    #[test]
    fn evaluates() {
        let value = |text: &str| parse(text).evaluate(&|name| if name == "q2" { Some(0.5) } else { None }).unwrap();
        assert_eq!(value("-q2 - pi/2"), -0.5 - PI / 2.0);
        assert_eq!(value("2 * (q2 + 1) / 4 - 1e-1"), 0.65);
        assert_eq!(value("if q2 < 1 { min(q2, 3) } else { 7 }"), 0.5);
        assert_eq!(value("sign(q2) + sign(-q2) + sign(0)"), 0.0);
        assert_eq!(value("-q2 * q2"), -0.25);
        assert_eq!(value("max(1.0, sqrt(abs(-4)))"), 2.0);
    }

    #[test]
    fn prints_no_needless_parentheses() {
        assert_eq!(parse("((a)*(b)) - (c - (d))").to_string(), "a * b - (c - d)");
        assert_eq!(parse("-(a + b) * (-c)").to_string(), "-(a + b) * -c");
        assert_eq!(parse("(if a < b+1 { x } else { 2 }) + 1").to_string(), "(if a < b + 1.0 { x } else { 2.0 }) + 1.0");
        assert_eq!(parse("pi / 2").to_string(), "pi / 2.0");
    }

    #[test]
    fn affine_form() {
        let affine = parse("pi/2 - 2*(q1 - q0) + q1*2 - q5/1 - q3 + q3").affine().unwrap();
        assert_eq!(affine.constant, PI / 2.0);
        assert_eq!(affine.coefficients, [("q0".to_owned(), 2.0), ("q5".to_owned(), -1.0)].into());
        assert_eq!(parse("q0 * q1").affine(), None);
        assert_eq!(parse("sin(q0)").affine(), None);
    }

    fn any_expression() -> impl Strategy<Value = Expression> {
        let leaf = prop_oneof![
            (0.0f64..1e6).prop_map(Expression::Number),
            Just(Expression::Number(1e-300)),
            Just(Expression::Number(PI)),
            "[a-zA-Z_][a-zA-Z0-9]{0,4}"
                .prop_filter("keywords are no symbols", |name| syn::parse_str::<syn::Ident>(name).is_ok()
                    && name != "pi"
                    && name != "_")
                .prop_map(Expression::Symbol),
        ];
        leaf.prop_recursive(5, 40, 4, |inner| {
            let operator = prop::sample::select(vec![
                BinaryOperator::Add,
                BinaryOperator::Subtract,
                BinaryOperator::Multiply,
                BinaryOperator::Divide,
            ]);
            let comparison = prop::sample::select(vec![Comparison::Less, Comparison::Greater]);
            prop_oneof![
                inner.clone().prop_map(|x| Expression::Negate(Box::new(x))),
                (operator, inner.clone(), inner.clone()).prop_map(|(operator, a, b)| Expression::Binary(
                    operator,
                    Box::new(a),
                    Box::new(b)
                )),
                (prop::sample::select(Function::ALL.to_vec()), inner.clone(), inner.clone()).prop_map(
                    |(function, a, b)| {
                        let mut arguments = vec![a, b];
                        arguments.truncate(function.n_arguments());
                        Expression::Call(function, arguments)
                    }
                ),
                (comparison, inner.clone(), inner.clone(), inner.clone(), inner)
                    .prop_map(|(comparison, a, b, x, y)| Expression::IfElse(comparison, Box::new([a, b, x, y]))),
            ]
        })
    }

    proptest! {
        #[test]
        fn print_then_parse_is_the_identity(expression in any_expression()) {
            let text = expression.to_string();
            prop_assert_eq!(Expression::parse(&text).unwrap(), expression, "{}", text);
        }

        #[test]
        fn any_text_is_parsed_or_refused(text in "[-+*/()<>{}a-z0-9., ]{0,20}") {
            if let Ok(expression) = Expression::parse(&text) {
                prop_assert_eq!(Expression::parse(&expression.to_string()).unwrap(), expression);
            }
        }
    }
}
