//! From text to [`Expression`], by way of `syn`.

use std::{f64::consts::PI, ops::Range};

use syn::{BinOp, Expr, Lit, Stmt, UnOp, spanned::Spanned};

use crate::{
    error::did_you_mean,
    expression::{BinaryOperator, Comparison, Expression, Function},
};

/// What is wrong with an expression, at a byte range of its text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExpressionError {
    /// In bytes from the start of the expression.
    pub span: Range<usize>,
    /// What was expected and found.
    pub message: String,
    /// The remedy.
    pub help: String,
}

const GRAMMAR: &str = "write numbers, `pi`, names, `+ - * /`, calls such as `sin(x)`, or `if a < b { x } else { y }`";

impl Expression {
    /// Reads an expression.
    ///
    /// # Errors
    /// Text that is no expression, an unknown function, a wrong number of arguments; with its place.
    pub fn parse(text: &str) -> Result<Self, ExpressionError> {
        // An empty text has no token that could be pointed at.
        if text.trim().is_empty() {
            return Err(error_at(0..text.len(), "expected an expression, found nothing", GRAMMAR));
        }
        if let Some(error) = too_large(text) {
            return Err(error);
        }
        if let Some(error) = unbalanced(text) {
            return Err(error);
        }
        let tree = syn::parse_str::<Expr>(text).map_err(|error| {
            let mut span = error.span().byte_range();
            if span.is_empty() || span.end > text.len() {
                // `syn` points at the end of input with an empty span.
                span = text.trim_end().len().saturating_sub(1)..text.trim_end().len();
            }
            error_at(span, format!("`{}` is not an expression: {error}", text.trim()), GRAMMAR)
        })?;
        convert(&tree)
    }
}

fn error_at(span: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> ExpressionError {
    ExpressionError { span, message: message.into(), help: help.into() }
}

/// Bytes of an expression.
pub const LONGEST: usize = 4096;

/// How deep an expression may nest: brackets, signs before a term, `if`s. What reads and lowers it calls itself once a level.
pub const DEEPEST: usize = 96;

/// Refuses what is longer or deeper than may be, before anything descends into it.
fn too_large(text: &str) -> Option<ExpressionError> {
    if text.len() > LONGEST {
        let message = format!("an expression of {} bytes; it may have {LONGEST}", text.len());
        return Some(error_at(0..1, message, "make it shorter, or several terms of it"));
    }
    // Each of these may open a level: an opening bracket until it is closed; a sign, a character that stands in no expression, or a word
    // behind another, which `if` and `else` are too, for all that follows.
    let (mut open, mut signs, mut others, mut deepest) = (0_usize, 0_usize, 0_usize, (0, 0));
    let (mut in_word, mut after_word, mut blank) = (false, false, false);
    for (at, character) in text.char_indices() {
        let is_word = character.is_alphanumeric() || character == '_';
        match character {
            '(' | '{' | '[' => open += 1,
            ')' | '}' | ']' => open = open.saturating_sub(1),
            '-' | '+' | '*' | '/' => signs += 1,
            _ if is_word => {
                others += usize::from(!in_word && after_word && blank && !character.is_numeric());
                signs = 0;
            }
            '.' | ',' | '<' | '>' => {}
            _ if character.is_whitespace() => {}
            _ => others += 1,
        }
        if !character.is_whitespace() {
            after_word = is_word;
        }
        (in_word, blank) = (is_word, character.is_whitespace());
        if open + signs + others > deepest.0 {
            deepest = (open + signs + others, at);
        }
    }
    (deepest.0 > DEEPEST).then(|| {
        let end = deepest.1 + text[deepest.1..].chars().next().map_or(0, char::len_utf8);
        let message = format!("the expression is nested more than {DEEPEST} levels deep");
        error_at(deepest.1..end, message, "make it shallower, or several terms of it")
    })
}

/// The first bracket that lacks its other half.
fn unbalanced(text: &str) -> Option<ExpressionError> {
    const REMEDY: &str = "give every bracket its other half";
    const PAIRS: [(char, char); 3] = [('(', ')'), ('{', '}'), ('[', ']')];
    let mut open: Vec<(usize, char, char)> = Vec::new();
    for (at, character) in text.char_indices() {
        if let Some((opening, closing)) = PAIRS.into_iter().find(|(opening, _)| *opening == character) {
            open.push((at, opening, closing));
        } else if PAIRS.iter().any(|(_, closing)| *closing == character) {
            match open.pop() {
                Some((.., closing)) if closing == character => {}
                Some((_, opening, closing)) => {
                    let message = format!("`{character}` where `{opening}` is open: expected `{closing}`");
                    return Some(error_at(at..at + 1, message, REMEDY));
                }
                None => return Some(error_at(at..at + 1, format!("`{character}` closes nothing"), REMEDY)),
            }
        }
    }
    let (at, opening, closing) = open.pop()?;
    Some(error_at(at..at + 1, format!("`{opening}` is not closed: expected `{closing}`"), REMEDY))
}

fn unsupported<T>(node: &impl Spanned, what: &str) -> Result<T, ExpressionError> {
    Err(error_at(node.span().byte_range(), format!("{what} cannot stand in an expression"), GRAMMAR))
}

fn convert(tree: &Expr) -> Result<Expression, ExpressionError> {
    match tree {
        Expr::Lit(literal) => number(&literal.lit),
        Expr::Path(path) => {
            let Some(name) = path.path.get_ident().filter(|_| path.qself.is_none()) else {
                return unsupported(tree, "a path");
            };
            let name = name.to_string();
            Ok(if name == "pi" { Expression::Number(PI) } else { Expression::Symbol(name) })
        }
        Expr::Paren(inner) => convert(&inner.expr),
        Expr::Group(inner) => convert(&inner.expr),
        Expr::Unary(unary) if matches!(unary.op, UnOp::Neg(_)) => {
            Ok(Expression::Negate(Box::new(convert(&unary.expr)?)))
        }
        Expr::Binary(binary) => {
            let operator = match binary.op {
                BinOp::Add(_) => BinaryOperator::Add,
                BinOp::Sub(_) => BinaryOperator::Subtract,
                BinOp::Mul(_) => BinaryOperator::Multiply,
                BinOp::Div(_) => BinaryOperator::Divide,
                BinOp::BitXor(_) => {
                    return Err(error_at(
                        binary.op.span().byte_range(),
                        "`^` is not an operator here",
                        "write a power as a product, e.g. `x * x`",
                    ));
                }
                _ => return unsupported(&binary.op, "this operator"),
            };
            Ok(Expression::Binary(operator, Box::new(convert(&binary.left)?), Box::new(convert(&binary.right)?)))
        }
        Expr::Call(call) => {
            let name = match &*call.func {
                Expr::Path(path) => path.path.get_ident().map(ToString::to_string),
                _ => None,
            };
            let Some(name) = name else { return unsupported(&*call.func, "a call of this") };
            let Some(function) = Function::named(&name) else {
                return Err(error_at(
                    call.func.span().byte_range(),
                    format!("unknown function `{name}`"),
                    did_you_mean(&name, Function::ALL.map(Function::name)),
                ));
            };
            if call.args.len() != function.n_arguments() {
                return Err(error_at(
                    tree.span().byte_range(),
                    format!("`{name}` takes {} argument(s), found {}", function.n_arguments(), call.args.len()),
                    GRAMMAR,
                ));
            }
            Ok(Expression::Call(function, call.args.iter().map(convert).collect::<Result<_, _>>()?))
        }
        Expr::If(branch) => {
            let (comparison, a, b) = match &*branch.cond {
                Expr::Binary(binary) => match binary.op {
                    BinOp::Lt(_) => (Comparison::Less, &binary.left, &binary.right),
                    BinOp::Gt(_) => (Comparison::Greater, &binary.left, &binary.right),
                    _ => return unsupported(&binary.op, "a condition other than `a < b` or `a > b`"),
                },
                other => return unsupported(other, "a condition other than `a < b` or `a > b`"),
            };
            let Some((_, otherwise)) = &branch.else_branch else {
                return unsupported(tree, "an `if` without `else`");
            };
            let otherwise = match &**otherwise {
                Expr::Block(block) if block.label.is_none() => block_value(&block.block)?,
                other => convert(other)?,
            };
            let parts = [convert(a)?, convert(b)?, block_value(&branch.then_branch)?, otherwise];
            Ok(Expression::IfElse(comparison, Box::new(parts)))
        }
        other => unsupported(other, "this"),
    }
}

fn block_value(block: &syn::Block) -> Result<Expression, ExpressionError> {
    match block.stmts.as_slice() {
        [Stmt::Expr(value, None)] => convert(value),
        _ => unsupported(block, "a block of anything but one expression"),
    }
}

fn number(literal: &Lit) -> Result<Expression, ExpressionError> {
    let (digits, suffix) = match literal {
        Lit::Int(literal) => (literal.base10_digits(), literal.suffix()),
        Lit::Float(literal) => (literal.base10_digits(), literal.suffix()),
        other => return unsupported(other, "a literal that is no number"),
    };
    match digits.parse::<f64>() {
        Ok(value) if value.is_finite() && suffix.is_empty() => Ok(Expression::Number(value)),
        _ if !suffix.is_empty() => Err(error_at(
            literal.span().byte_range(),
            format!("a number takes no suffix, found `{suffix}`"),
            "write a product as `2 * x`",
        )),
        _ => unsupported(literal, "a number that is not finite"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(text: &str) -> String {
        let error = Expression::parse(text).unwrap_err();
        format!("{}\n{}\n= {}", text, " ".repeat(error.span.start) + &"^".repeat(error.span.len()), error.message)
    }

    #[test]
    fn what_would_take_too_much_is_refused_before_it_is_read() {
        let deep =
            |before: &str, after: &str, count: usize| format!("{}x{}", before.repeat(count), after.repeat(count));
        for (before, after) in [
            ("(", ")"),
            ("-", ""),
            ("!", ""),
            ("&", ""),
            ("return ", ""),
            ("sin(", ")"),
            ("if 1 < 2 { ", " } else { 1 }"),
            ("if 1 < 2 { 1 } else ", ""),
            ("1 - (", ")"),
        ] {
            for count in [100, 1000, 100_000] {
                let error = Expression::parse(&deep(before, after, count)).unwrap_err();
                assert!(
                    error.message.contains("nested") || error.message.contains("bytes"),
                    "{before}: {}",
                    error.message
                );
            }
        }
        for (before, after) in [("(", ")"), ("-", ""), ("sin(", ")")] {
            Expression::parse(&deep(before, after, DEEPEST)).unwrap();
        }
        // A long sum is deep only to the left, as far as its length allows.
        Expression::parse(&deep("1+", "", LONGEST / 2 - 1)).unwrap();
    }

    #[test]
    fn errors_point_at_the_token() {
        let wrong = [
            "q1 + sine(q2)",
            "2 * q1 +",
            "q1 ^ 2",
            "2q1",
            "min(a)",
            "if a < b { c }",
            "a.sin()",
            "(a",
            "a) + b",
            "if a < b { (c } else { d }",
            "a % b",
            "",
        ];
        insta::assert_snapshot!(wrong.map(told).join("\n\n"));
    }
}
