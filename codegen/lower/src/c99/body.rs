//! The statements of one function.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use dynid_model::expression::{Comparison, Function as Call};

use super::number;
use crate::kernel::Function;
use crate::names::Names;
use crate::{Node, Operation, Program};

/// What no local variable may be called: words of C, macros of `<math.h>` that look like variables, and functions of `<math.h>`, since a
/// local variable hides the function that a later term calls.
const TAKEN: [&str; 60] = [
    "auto",
    "break",
    "case",
    "char",
    "const",
    "continue",
    "default",
    "do",
    "double",
    "else",
    "enum",
    "extern",
    "float",
    "for",
    "goto",
    "if",
    "inline",
    "int",
    "long",
    "register",
    "restrict",
    "return",
    "short",
    "signed",
    "sizeof",
    "static",
    "struct",
    "switch",
    "typedef",
    "union",
    "unsigned",
    "void",
    "volatile",
    "while",
    "_Bool",
    "_Complex",
    "_Imaginary",
    "asm",
    "near",
    "far",
    "NAN",
    "INFINITY",
    "HUGE_VAL",
    "EDOM",
    "ERANGE",
    "OVERFLOW",
    "UNDERFLOW",
    "DOMAIN",
    "SING",
    "PLOSS",
    "TLOSS",
    "linux",
    "cos",
    "exp",
    "fabs",
    "log",
    "sin",
    "sqrt",
    "tan",
    "tanh",
];

/// What the names of the file's own functions that terms call have after the prefix.
const HELPERS: [&str; 7] = ["sine", "cosine", "sine_cosine", "exponential", "sign", "minimum", "maximum"];

/// How tightly an expression binds.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Choice,
    Sum,
    Product,
    Sign,
    Atom,
}

/// A function's terms and their names.
pub(super) struct Body<'a> {
    function: &'a Function,
    program: &'a Program,
    prefix: &'a str,
    names: BTreeMap<Node, String>,
}

impl<'a> Body<'a> {
    pub fn new(function: &'a Function, prefix: &'a str) -> Self {
        let program = &function.program;
        let mut body = Body { function, program, prefix, names: BTreeMap::new() };
        body.give_names();
        body
    }

    /// Arguments, terms, results.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        let live = self.program.live();
        for argument in &self.function.arguments {
            let mut is_read = false;
            for (place, input) in argument.elements.iter().enumerate() {
                let node = self.program.find_input(input).filter(|node| live.contains(node));
                if let Some(name) = node.and_then(|node| self.names.get(&node)) {
                    writeln!(text, "    const double {name} = {}[{place}];", argument.name)?;
                    is_read = true;
                }
            }
            if !is_read {
                writeln!(text, "    (void){};", argument.name)?;
            }
        }
        self.write_terms(&live, text)?;
        for results in &self.function.results {
            if results.elements.is_empty() {
                writeln!(text, "    (void){};", results.name)?;
            }
            for (place, output) in results.elements.iter().enumerate() {
                if let Some(node) = self.program.find_output(output) {
                    writeln!(text, "    {}[{place}] = {};", results.name, self.term(node).0)?;
                }
            }
        }
        Ok(())
    }

    /// First the sines and cosines of angles that come from inputs alone, since their work overlaps; then the rest in order.
    fn write_terms(&self, live: &[Node], text: &mut String) -> std::fmt::Result {
        let mut angles: BTreeMap<Node, [Option<Node>; 2]> = BTreeMap::new();
        for &node in live {
            match self.program.operation_of(node) {
                Operation::Call(Call::Sin, angle) => angles.entry(angle).or_default()[0] = Some(node),
                Operation::Call(Call::Cos, angle) => angles.entry(angle).or_default()[1] = Some(node),
                _ => {}
            }
        }
        let (first, mut pending): (Vec<Node>, BTreeSet<Node>) = {
            let (first, others): (Vec<Node>, Vec<Node>) = angles.keys().partition(|angle| self.is_from_inputs(**angle));
            (first, others.into_iter().collect())
        };
        let before: BTreeSet<Node> = self.program.reached(first.iter().copied()).into_iter().collect();
        for &node in live.iter().filter(|node| before.contains(node)) {
            self.write_term(node, text)?;
        }
        first.iter().try_for_each(|angle| self.write_sine_and_cosine(*angle, angles[angle], text))?;
        for &node in live.iter().filter(|node| !before.contains(node)) {
            match self.program.operation_of(node) {
                Operation::Call(Call::Sin | Call::Cos, angle) => {
                    if pending.remove(&angle) {
                        self.write_sine_and_cosine(angle, angles[&angle], text)?;
                    }
                }
                _ => self.write_term(node, text)?,
            }
        }
        Ok(())
    }

    fn write_term(&self, node: Node, text: &mut String) -> std::fmt::Result {
        match (self.names.get(&node), self.program.operation_of(node)) {
            (None, _) | (_, Operation::Input(_)) => Ok(()),
            (Some(name), _) => writeln!(text, "    const double {name} = {};", self.operation(node).0),
        }
    }

    /// What is not needed is a local that the compiler drops.
    fn write_sine_and_cosine(&self, angle: Node, wanted: [Option<Node>; 2], text: &mut String) -> std::fmt::Result {
        let prefix = self.prefix;
        let of = self.term(angle).0;
        let [sine, cosine] = wanted.map(|node| node.and_then(|node| self.names.get(&node)));
        match (sine, cosine) {
            (Some(sine), Some(cosine)) => {
                writeln!(text, "    double {sine}, {cosine};\n    {prefix}_sine_cosine({of}, &{sine}, &{cosine});")
            }
            (Some(sine), None) => writeln!(text, "    const double {sine} = {prefix}_sine({of});"),
            (None, Some(cosine)) => writeln!(text, "    const double {cosine} = {prefix}_cosine({of});"),
            (None, None) => Ok(()),
        }
    }

    fn is_from_inputs(&self, node: Node) -> bool {
        self.program.reached([node]).iter().all(|&node| !matches!(self.program.operation_of(node), Operation::Call(..)))
    }

    /// Inputs, named terms, terms that are used more than once, sines and cosines have a name.
    fn give_names(&mut self) {
        let arrays = self.function.arguments.iter().map(|own| own.name);
        let results = self.function.results.iter().map(|own| own.name);
        let helpers = HELPERS.map(|name| format!("{}_{name}", self.prefix));
        let taken: BTreeSet<String> = arrays.chain(results).chain(TAKEN).map(str::to_owned).chain(helpers).collect();
        let live = self.program.live();
        let outputs: Vec<Node> = self
            .function
            .results
            .iter()
            .flat_map(|own| &own.elements)
            .filter_map(|output| self.program.find_output(output))
            .collect();
        let mut uses: BTreeMap<Node, usize> = BTreeMap::new();
        let read = live.iter().flat_map(|node| self.program.operation_of(*node).operands());
        read.chain(outputs).for_each(|node| *uses.entry(node).or_default() += 1);
        let mut names = Names::new(self.program, &live, taken);
        for &node in &live {
            let is_shared = uses.get(&node).is_some_and(|uses| *uses > 1);
            let is_wanted = match self.program.operation_of(node) {
                Operation::Number(_) | Operation::Input(_) | Operation::Negate(_) => false,
                Operation::Call(Call::Sin | Call::Cos, _) => true,
                _ => is_shared,
            };
            if is_wanted {
                names.number(node);
            }
        }
        self.names = names.into_map();
    }

    /// A term where it is used.
    fn term(&self, node: Node) -> (String, Binding) {
        match self.names.get(&node) {
            Some(name) => (name.clone(), Binding::Atom),
            None => self.operation(node),
        }
    }

    fn operation(&self, node: Node) -> (String, Binding) {
        match self.program.operation_of(node) {
            Operation::Number(bits) => (number(f64::from_bits(bits)), Binding::Atom),
            Operation::Input(position) => (self.program.inputs()[position].0.identifier(), Binding::Atom),
            Operation::Negate(a) => (format!("-{}", self.at_least(a, Binding::Atom)), Binding::Sign),
            Operation::Add(a, b) => self.infix(a, "+", b, Binding::Sum),
            Operation::Subtract(a, b) => self.infix(a, "-", b, Binding::Sum),
            Operation::Multiply(a, b) => self.infix(a, "*", b, Binding::Product),
            Operation::Divide(a, b) => self.infix(a, "/", b, Binding::Product),
            Operation::Call(function, a) => {
                let a = self.term(a).0;
                let prefix = self.prefix;
                let called = match function {
                    Call::Sin => format!("{prefix}_sine({a})"),
                    Call::Cos => format!("{prefix}_cosine({a})"),
                    Call::Exp => format!("{prefix}_exponential({a})"),
                    Call::Sign => format!("{prefix}_sign({a})"),
                    Call::Tan => format!("tan({a})"),
                    Call::Tanh => format!("tanh({a})"),
                    Call::Ln => format!("log({a})"),
                    Call::Sqrt => format!("sqrt({a})"),
                    // Two arguments: operations of their own.
                    Call::Abs | Call::Min | Call::Max => format!("fabs({a})"),
                };
                (called, Binding::Atom)
            }
            Operation::Minimum(a, b) => self.of_two("minimum", [a, b]),
            Operation::Maximum(a, b) => self.of_two("maximum", [a, b]),
            Operation::Select(Comparison::Less, operands) => self.choice(operands),
            Operation::Select(Comparison::Greater, [a, b, then, otherwise]) => self.choice([b, a, then, otherwise]),
        }
    }

    fn of_two(&self, helper: &str, operands: [Node; 2]) -> (String, Binding) {
        let [a, b] = operands.map(|operand| self.term(operand).0);
        (format!("{}_{helper}({a}, {b})", self.prefix), Binding::Atom)
    }

    /// `small < large ? then : otherwise`
    fn choice(&self, operands: [Node; 4]) -> (String, Binding) {
        let [small, large, then, otherwise] = operands.map(|operand| self.at_least(operand, Binding::Sum));
        (format!("{small} < {large} ? {then} : {otherwise}"), Binding::Choice)
    }

    /// `a <operator> b`; the right operand must bind tighter, since operators associate to the left.
    fn infix(&self, a: Node, operator: &str, b: Node, binding: Binding) -> (String, Binding) {
        let tighter = if binding == Binding::Sum { Binding::Product } else { Binding::Sign };
        (format!("{} {operator} {}", self.at_least(a, binding), self.at_least(b, tighter)), binding)
    }

    fn at_least(&self, node: Node, binding: Binding) -> String {
        let (text, own) = self.term(node);
        if own < binding { format!("({text})") } else { text }
    }
}
