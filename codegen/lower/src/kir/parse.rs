//! Reading `.kir`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::spanned::Spanned;

use dynid_model::expression::{Comparison, Function};

use super::{Form, Kir, expression::FUNCTIONS};
use crate::{Input, Node, Program};

/// A `.kir` file that cannot be read: where, what was expected, what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}:{line}:{column}: {message}; write the file anew with `cargo xtask gen`", path.display())]
pub struct KirError {
    /// The file.
    pub path: PathBuf,
    /// From 1.
    pub line: usize,
    /// From 1, in characters.
    pub column: usize,
    /// What was found and what was expected.
    pub message: String,
}

/// A message and its column (from 0) within a line.
type Complaint = (usize, String);

impl Kir {
    /// Reads the text that [`Kir`]'s `Display` writes. `path` is only named in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Kir, KirError> {
        let mut reader = Reader::default();
        for (index, line) in text.lines().enumerate() {
            reader.line(line).map_err(|(column, message)| KirError {
                path: path.to_owned(),
                line: index + 1,
                column: column + 1,
                message,
            })?;
        }
        let end = text.lines().count();
        reader.finish().map_err(|message| KirError { path: path.to_owned(), line: end.max(1), column: 1, message })
    }
}

#[derive(Default)]
struct Reader {
    device: Option<String>,
    configuration: Option<usize>,
    free: Option<Vec<usize>>,
    locked: Option<Vec<usize>>,
    model_sha256: Option<String>,
    forms: Vec<Form>,
    program: Program,
    /// Inputs and terms by identifier.
    scope: BTreeMap<String, Node>,
    outputs: BTreeSet<String>,
}

impl Reader {
    fn line(&mut self, line: &str) -> Result<(), Complaint> {
        let trimmed = line.trim_end();
        if trimmed.is_empty() || trimmed.starts_with('#') {
            return Ok(());
        }
        let (keyword, rest) = trimmed.split_once(' ').unwrap_or((trimmed, ""));
        let at = keyword.chars().count() + 1;
        match keyword {
            "device" => self.device = Some(rest.to_owned()),
            "configuration" => self.configuration = Some(number(rest, at)?),
            "free" => self.free = Some(joints(rest, at)?),
            "locked" => self.locked = Some(joints(rest, at)?),
            "model" => match rest.strip_prefix("sha256 ") {
                Some(digest) => self.model_sha256 = Some(digest.to_owned()),
                None => return Err((at, "expected `sha256 <digest>`".to_owned())),
            },
            "form" => self.forms.push(form(rest, at)?),
            "let" => self.term(rest, at)?,
            "output" => self.output(rest, at)?,
            _ => self.declare(keyword, rest, at)?,
        }
        Ok(())
    }

    /// `parameter link.1.m kg`, `position q0 rad`, ...
    fn declare(&mut self, keyword: &str, rest: &str, at: usize) -> Result<(), Complaint> {
        let (name, unit) = rest.split_once(' ').unwrap_or((rest, ""));
        let joint = |prefix: &str| {
            let index = name.strip_prefix(prefix).and_then(|index| index.parse().ok());
            index.ok_or_else(|| (at, format!("`{name}`: expected `{prefix}<joint>`")))
        };
        let input = match keyword {
            "parameter" => Input::Parameter(name.to_owned()),
            "angle" => Input::Locked(joint("q")?),
            "position" => Input::Position(joint("q")?),
            "velocity" => Input::Velocity(joint("dq")?),
            "acceleration" => Input::Acceleration(joint("ddq")?),
            "torque" => Input::Torque(joint("tau")?),
            "prepared" => Input::Prepared(name.to_owned()),
            "signal" => Input::Signal(name.to_owned()),
            "state" => Input::State(name.to_owned()),
            _ => {
                let expected = "expected a header line, a declaration, `let` or `output`";
                return Err((0, format!("`{keyword}` begins no line of a .kir file; {expected}")));
            }
        };
        let identifier = input.identifier();
        if syn::parse_str::<syn::Ident>(&identifier).is_err() {
            return Err((at, format!("`{name}` is no name that an expression can use")));
        }
        self.unused(&identifier, at)?;
        let node = self.program.input(input, unit);
        self.scope.insert(identifier, node);
        Ok(())
    }

    /// `<name> = <expression>;`
    fn term(&mut self, rest: &str, at: usize) -> Result<(), Complaint> {
        let (name, node) = self.equation(rest, at)?;
        self.unused(&name, at)?;
        self.program.name(node, &name);
        self.scope.insert(name, node);
        Ok(())
    }

    fn output(&mut self, rest: &str, at: usize) -> Result<(), Complaint> {
        let (name, node) = self.equation(rest, at)?;
        if !self.outputs.insert(name.clone()) {
            return Err((at, format!("output `{name}` is given twice")));
        }
        self.program.output(&name, node);
        Ok(())
    }

    fn equation(&mut self, rest: &str, at: usize) -> Result<(String, Node), Complaint> {
        let equation = rest.split_once(" = ").and_then(|(name, right)| Some((name, right.strip_suffix(';')?)));
        let Some((name, right)) = equation else {
            return Err((at, "expected `name = expression;`".to_owned()));
        };
        if syn::parse_str::<syn::Ident>(name).is_err() {
            return Err((at, format!("`{name}` is no name for a term")));
        }
        let offset = at + name.chars().count() + 3;
        let shift = |error: syn::Error| (offset + error.span().start().column, error.to_string());
        let expression = syn::parse_str::<syn::Expr>(right).map_err(shift)?;
        let node = self.expression(&expression).map_err(shift)?;
        Ok((name.to_owned(), node))
    }

    fn unused(&self, name: &str, at: usize) -> Result<(), Complaint> {
        match self.scope.contains_key(name) {
            true => Err((at, format!("`{name}` is defined twice"))),
            false => Ok(()),
        }
    }

    fn expression(&mut self, expression: &syn::Expr) -> Result<Node, syn::Error> {
        let unknown = |what: &str| Err(syn::Error::new(expression.span(), what));
        match expression {
            syn::Expr::Lit(literal) => match &literal.lit {
                syn::Lit::Float(value) => Ok(self.program.number(value.base10_parse()?)),
                syn::Lit::Int(value) => Ok(self.program.number(value.base10_parse()?)),
                _ => unknown("expected a number"),
            },
            syn::Expr::Path(path) => match path.path.get_ident().map(ToString::to_string) {
                Some(name) => match self.scope.get(&name) {
                    Some(&node) => Ok(node),
                    None => unknown(&format!("`{name}` is not defined above this line")),
                },
                None => unknown("expected the name of a term"),
            },
            syn::Expr::Paren(inner) => self.expression(&inner.expr),
            syn::Expr::Unary(syn::ExprUnary { op: syn::UnOp::Neg(_), expr, .. }) => {
                let a = self.expression(expr)?;
                Ok(self.program.negate(a))
            }
            syn::Expr::Binary(binary) => {
                let a = self.expression(&binary.left)?;
                let b = self.expression(&binary.right)?;
                match binary.op {
                    syn::BinOp::Add(_) => Ok(self.program.add(a, b)),
                    syn::BinOp::Sub(_) => Ok(self.program.subtract(a, b)),
                    syn::BinOp::Mul(_) => Ok(self.program.multiply(a, b)),
                    syn::BinOp::Div(_) => Ok(self.program.divide(a, b)),
                    _ => unknown("expected `+`, `-`, `*` or `/`"),
                }
            }
            syn::Expr::Call(call) => self.call(call),
            syn::Expr::If(choice) => self.choice(choice),
            _ => unknown("expected a number, a name, a sum, a product, a call or `if .. { .. } else { .. }`"),
        }
    }

    fn call(&mut self, call: &syn::ExprCall) -> Result<Node, syn::Error> {
        let name = match &*call.func {
            syn::Expr::Path(path) => path.path.get_ident().map(ToString::to_string).unwrap_or_default(),
            _ => String::new(),
        };
        let Some((_, function)) = FUNCTIONS.iter().find(|(known, _)| *known == name) else {
            return Err(syn::Error::new(call.func.span(), format!("`{name}` is no known function")));
        };
        let arguments = call.args.iter().map(|argument| self.expression(argument)).collect::<Result<Vec<_>, _>>()?;
        match (function, arguments.as_slice()) {
            (Function::Min, &[a, b]) => Ok(self.program.minimum(a, b)),
            (Function::Max, &[a, b]) => Ok(self.program.maximum(a, b)),
            (Function::Min | Function::Max, _) => {
                Err(syn::Error::new(call.span(), format!("`{name}` takes two arguments")))
            }
            (_, &[a]) => Ok(self.program.call(*function, a)),
            _ => Err(syn::Error::new(call.span(), format!("`{name}` takes one argument"))),
        }
    }

    fn choice(&mut self, choice: &syn::ExprIf) -> Result<Node, syn::Error> {
        let condition = match &*choice.cond {
            syn::Expr::Binary(condition) => condition,
            other => return Err(syn::Error::new(other.span(), "expected `a < b` or `a > b`")),
        };
        let comparison = match condition.op {
            syn::BinOp::Lt(_) => Comparison::Less,
            syn::BinOp::Gt(_) => Comparison::Greater,
            operator => return Err(syn::Error::new(operator.span(), "expected `<` or `>`")),
        };
        let branch = |block: &syn::Block| match block.stmts.as_slice() {
            [syn::Stmt::Expr(value, None)] => Ok(value.clone()),
            _ => Err(syn::Error::new(block.span(), "expected one expression")),
        };
        let then = branch(&choice.then_branch)?;
        let otherwise = match choice.else_branch.as_ref().map(|(_, otherwise)| &**otherwise) {
            Some(syn::Expr::Block(block)) => branch(&block.block)?,
            Some(other) => other.clone(),
            None => return Err(syn::Error::new(choice.span(), "expected `else { .. }`")),
        };
        let left = self.expression(&condition.left)?;
        let right = self.expression(&condition.right)?;
        let then = self.expression(&then)?;
        let otherwise = self.expression(&otherwise)?;
        Ok(self.program.select(comparison, [left, right, then, otherwise]))
    }

    fn finish(self) -> Result<Kir, String> {
        fn required<T>(value: Option<T>, line: &str) -> Result<T, String> {
            value.ok_or_else(|| format!("the header line `{line}` is missing"))
        }
        Ok(Kir {
            device: required(self.device, "device <id>")?,
            configuration: required(self.configuration, "configuration <number>")?,
            free: required(self.free, "free <joints>")?,
            locked: required(self.locked, "locked <joints>")?,
            model_sha256: required(self.model_sha256, "model sha256 <digest>")?,
            forms: self.forms,
            program: self.program,
        })
    }
}

fn number(text: &str, at: usize) -> Result<usize, Complaint> {
    text.parse().map_err(|_| (at, format!("`{text}`: expected a number")))
}

fn joints(text: &str, at: usize) -> Result<Vec<usize>, Complaint> {
    match text {
        "none" => Ok(Vec::new()),
        _ => text.split(' ').map(|joint| number(joint, at)).collect(),
    }
}

fn form(text: &str, at: usize) -> Result<Form, Complaint> {
    let parts = text.split_once(": ").and_then(|(head, reason)| Some((head.split_once(' ')?, reason)));
    match parts {
        Some(((outputs, form), reason)) => {
            Ok(Form { outputs: outputs.to_owned(), form: form.to_owned(), reason: reason.to_owned() })
        }
        None => Err((at, "expected `<outputs> <form>: <reason>`".to_owned())),
    }
}
