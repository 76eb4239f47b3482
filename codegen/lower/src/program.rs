//! A shared graph of scalar operations with names: what `.kir` text is read into and written from.
//!
//! The constructors fold constants and identities and return an existing node where an equal one exists, so common
//! terms are eliminated as the graph grows. Dead terms are those that no output reaches; every pass that counts,
//! writes or emits looks at live nodes only.
//!
//! No constructor changes a result beyond the sign of a zero (and `x * 0`, `x - x`, which are 0 for every finite
//! `x`): sums and products are never reassociated but for powers of two, negations only move outwards. So a program computes
//! the same bits whichever passes it went through.
//!
//! Inputs are parameters by name, locked angles, and position, velocity and acceleration of the free joints, numbered as in the
//! device. Passes: `substitute`, `append`, `select_outputs`, `compact`; `derivative` (chain rule, by any node); `split` (what
//! depends only on parameters and locked angles, and the rest); `operations` (costs; negations are free); `evaluate` (the
//! interpreter).

mod derivative;
mod evaluate;
mod expression;
mod operations;
mod rewrite;
mod split;
mod statements;

use std::collections::{BTreeMap, HashMap};

pub use dynid_model::expression::{Comparison, Function};
pub use operations::OperationCounts;
pub use split::Split;

/// A value in a [`Program`]. Only meaningful in the program that made it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Node(u32);

impl Node {
    /// Position in [`Program::operation_of`]'s order: operands come before what uses them.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// How a node is computed from earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Operation {
    /// A constant that is not negative, as the bits of an `f64` (see [`Operation::number`]).
    Number(u64),
    /// Index into [`Program::inputs`].
    Input(usize),
    /// `-a`; free.
    Negate(Node),
    /// `a + b`
    Add(Node, Node),
    /// `a - b`
    Subtract(Node, Node),
    /// `a * b`
    Multiply(Node, Node),
    /// `a / b`
    Divide(Node, Node),
    /// A function of one argument.
    Call(Function, Node),
    /// The smaller of two.
    Minimum(Node, Node),
    /// The larger of two.
    Maximum(Node, Node),
    /// `if a < b { x } else { y }` as `[a, b, x, y]`; both branches are computed.
    Select(Comparison, [Node; 4]),
}

impl Operation {
    /// The value of a constant.
    pub fn number(self) -> Option<f64> {
        match self {
            Operation::Number(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// What the operation reads, in order.
    pub fn operands(self) -> impl Iterator<Item = Node> {
        use Operation::*;
        let (operands, count) = match self {
            Number(_) | Input(_) => ([Node(0); 4], 0),
            Negate(a) | Call(_, a) => ([a; 4], 1),
            Add(a, b) | Subtract(a, b) | Multiply(a, b) | Divide(a, b) | Minimum(a, b) | Maximum(a, b) => {
                ([a, b, a, a], 2)
            }
            Select(_, operands) => (operands, 4),
        };
        operands.into_iter().take(count)
    }
}

/// What a program is given from outside. Joint indices are the device's.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Input {
    /// A model parameter by its full name, e.g. `link.3.m`, `length.L5`, `base.gz`.
    Parameter(String),
    /// Angle of a locked joint: `q<i>`.
    Locked(usize),
    /// Position of a free joint: `q<i>`.
    Position(usize),
    /// Velocity of a free joint: `dq<i>`.
    Velocity(usize),
    /// Acceleration of a free joint: `ddq<i>`.
    Acceleration(usize),
    /// Torque at a free joint: `tau<i>`.
    Torque(usize),
    /// What `prepare` made, by its name (only after [`Program::split`]).
    Prepared(String),
    /// A signal of an effect, e.g. `dq`.
    Signal(String),
    /// A state of an effect, e.g. `z`.
    State(String),
}

impl Input {
    /// The identifier by which expressions refer to it: a parameter's dots become underscores.
    pub fn identifier(&self) -> String {
        match self {
            Input::Parameter(name) => name.replace('.', "_"),
            Input::Locked(joint) | Input::Position(joint) => format!("q{joint}"),
            Input::Velocity(joint) => format!("dq{joint}"),
            Input::Acceleration(joint) => format!("ddq{joint}"),
            Input::Torque(joint) => format!("tau{joint}"),
            Input::Prepared(name) | Input::Signal(name) | Input::State(name) => name.clone(),
        }
    }

    /// True for what stays constant while a model moves: parameters and locked angles.
    pub fn is_constant(&self) -> bool {
        matches!(self, Input::Parameter(_) | Input::Locked(_) | Input::Prepared(_))
    }

    /// True for one of a link's ten inertial parameters.
    pub fn is_inertial(&self) -> bool {
        matches!(self, Input::Parameter(name) if name.starts_with("link."))
    }
}

/// A graph of scalar operations with named inputs, named terms and named outputs.
#[derive(Debug, Clone, Default)]
pub struct Program {
    operations: Vec<Operation>,
    /// Lookup only, never iterated: the order of a program never depends on hashes.
    index: HashMap<Operation, Node>,
    inputs: Vec<(Input, String)>,
    names: BTreeMap<Node, String>,
    named: BTreeMap<String, Node>,
    outputs: Vec<(String, Node)>,
}

impl Program {
    /// An empty program.
    pub fn new() -> Program {
        Program::default()
    }

    // --- inputs -----------------------------------------------------------------------------------------------

    /// The input's node; declares it with its unit at first use.
    pub fn input(&mut self, input: Input, unit: &str) -> Node {
        let position = match self.inputs.iter().position(|(known, _)| *known == input) {
            Some(position) => position,
            None => {
                self.inputs.push((input, unit.to_owned()));
                self.inputs.len() - 1
            }
        };
        self.intern(Operation::Input(position))
    }

    /// A model parameter by its full name.
    pub fn parameter(&mut self, name: &str, unit: &str) -> Node {
        self.input(Input::Parameter(name.to_owned()), unit)
    }

    /// Angle (rad) or distance (m) of a locked joint.
    pub fn locked(&mut self, joint: usize, unit: &str) -> Node {
        self.input(Input::Locked(joint), unit)
    }

    /// Position of a free joint, `q<joint>`.
    pub fn position(&mut self, joint: usize, unit: &str) -> Node {
        self.input(Input::Position(joint), unit)
    }

    /// Velocity of a free joint, `dq<joint>`.
    pub fn velocity(&mut self, joint: usize, unit: &str) -> Node {
        self.input(Input::Velocity(joint), unit)
    }

    /// Acceleration of a free joint, `ddq<joint>`.
    pub fn acceleration(&mut self, joint: usize, unit: &str) -> Node {
        self.input(Input::Acceleration(joint), unit)
    }

    /// The declared inputs with their units, in order of declaration.
    pub fn inputs(&self) -> &[(Input, String)] {
        &self.inputs
    }

    /// The node of a declared input.
    pub fn find_input(&self, input: &Input) -> Option<Node> {
        let position = self.inputs.iter().position(|(known, _)| known == input)?;
        self.index.get(&Operation::Input(position)).copied()
    }

    // --- names and outputs ------------------------------------------------------------------------------------

    /// Keeps a name for a term, to the emitted code and the report. The first name of a node stays; a name that
    /// another node has taken gets a number appended. Numbers and inputs take no name.
    pub fn name(&mut self, node: Node, name: &str) -> Node {
        let nameless = self.number_of(node).is_some() || matches!(self.operation_of(node), Operation::Input(_));
        if !nameless && !self.names.contains_key(&node) {
            let free = self.free_name(name);
            self.named.insert(free.clone(), node);
            self.names.insert(node, free);
        }
        node
    }

    /// The name of a term, if it has one.
    pub fn name_of(&self, node: Node) -> Option<&str> {
        self.names.get(&node).map(String::as_str)
    }

    /// Declares an output; a second one of the same name replaces the first.
    pub fn output(&mut self, name: &str, node: Node) {
        match self.outputs.iter_mut().find(|(known, _)| known == name) {
            Some((_, known)) => *known = node,
            None => self.outputs.push((name.to_owned(), node)),
        }
    }

    /// Outputs in order of declaration.
    pub fn outputs(&self) -> &[(String, Node)] {
        &self.outputs
    }

    /// The node of an output.
    pub fn find_output(&self, name: &str) -> Option<Node> {
        self.outputs.iter().find(|(known, _)| known == name).map(|&(_, node)| node)
    }

    /// `wanted`, or with the first number appended that makes it unlike every name, input and output.
    pub(crate) fn free_name(&self, wanted: &str) -> String {
        let taken = |name: &str| {
            self.named.contains_key(name) || self.inputs.iter().any(|(input, _)| input.identifier() == name)
        };
        if !taken(wanted) {
            return wanted.to_owned();
        }
        (2..).map(|number| format!("{wanted}_{number}")).find(|name| !taken(name)).unwrap_or_default()
    }

    // --- constructors -----------------------------------------------------------------------------------------

    /// A constant; a negative one is the negation of a positive one.
    pub fn number(&mut self, value: f64) -> Node {
        if value < 0.0 {
            let positive = self.intern(Operation::Number((-value).to_bits()));
            return self.intern(Operation::Negate(positive));
        }
        let value = if value == 0.0 { 0.0 } else { value };
        self.intern(Operation::Number(value.to_bits()))
    }

    /// `-a`
    pub fn negate(&mut self, a: Node) -> Node {
        match self.operation_of(a) {
            Operation::Number(_) if self.is_zero(a) => a,
            Operation::Negate(positive) => positive,
            _ => self.intern(Operation::Negate(a)),
        }
    }

    /// `a + b`
    pub fn add(&mut self, a: Node, b: Node) -> Node {
        match (self.number_of(a), self.number_of(b)) {
            (Some(x), Some(y)) => return self.number(x + y),
            (Some(0.0), _) => return b,
            (_, Some(0.0)) => return a,
            _ => {}
        }
        match (self.signed(a), self.signed(b)) {
            ((a, false), (b, false)) if a == b => {
                let two = self.number(2.0);
                self.multiply(two, a)
            }
            ((a, false), (b, false)) => self.intern(Operation::Add(a, b)),
            ((a, false), (b, true)) => self.subtract(a, b),
            ((a, true), (b, false)) => self.subtract(b, a),
            ((a, true), (b, true)) => {
                let sum = self.add(a, b);
                self.negate(sum)
            }
        }
    }

    /// `a - b`
    pub fn subtract(&mut self, a: Node, b: Node) -> Node {
        match (self.number_of(a), self.number_of(b)) {
            (Some(x), Some(y)) => return self.number(x - y),
            (Some(0.0), _) => return self.negate(b),
            (_, Some(0.0)) => return a,
            _ => {}
        }
        match (self.signed(a), self.signed(b)) {
            ((a, false), (b, false)) if a == b => self.number(0.0),
            ((a, false), (b, false)) => match self.index.get(&Operation::Subtract(b, a)) {
                Some(&opposite) => self.negate(opposite),
                None => self.intern(Operation::Subtract(a, b)),
            },
            ((a, false), (b, true)) => self.add(a, b),
            ((a, true), (b, false)) => {
                let sum = self.add(a, b);
                self.negate(sum)
            }
            ((a, true), (b, true)) => self.subtract(b, a),
        }
    }

    /// `a * b`
    pub fn multiply(&mut self, a: Node, b: Node) -> Node {
        match (self.number_of(a), self.number_of(b)) {
            (Some(x), Some(y)) => return self.number(x * y),
            (Some(0.0), _) | (_, Some(0.0)) => return self.number(0.0),
            (Some(1.0), _) => return b,
            (_, Some(1.0)) => return a,
            _ => {}
        }
        match (self.signed(a), self.signed(b)) {
            ((a, false), (b, false)) => {
                self.scaled_twice(a, b).unwrap_or_else(|| self.intern(Operation::Multiply(a, b)))
            }
            ((a, sign_a), (b, sign_b)) => {
                let product = self.multiply(a, b);
                if sign_a == sign_b { product } else { self.negate(product) }
            }
        }
    }

    /// `c1 * (c2 * x)` as `(c1 * c2) * x` for powers of two, which no rounding can tell apart.
    fn scaled_twice(&mut self, a: Node, b: Node) -> Option<Node> {
        let power_of_two = |program: &Program, node: Node| {
            program.number_of(node).filter(|value| value.to_bits() << 12 == 0 && value.is_normal())
        };
        let (outer, product) = match (power_of_two(self, a), power_of_two(self, b)) {
            (Some(outer), None) => (outer, b),
            (None, Some(outer)) => (outer, a),
            _ => return None,
        };
        let Operation::Multiply(x, y) = self.operation_of(product) else { return None };
        let (inner, x) = match (power_of_two(self, x), power_of_two(self, y)) {
            (Some(inner), _) => (inner, y),
            (_, Some(inner)) => (inner, x),
            _ => return None,
        };
        let factor = self.number(outer * inner);
        Some(self.multiply(factor, x))
    }

    /// `a / b`
    pub fn divide(&mut self, a: Node, b: Node) -> Node {
        match (self.number_of(a), self.number_of(b)) {
            (Some(x), Some(y)) if y != 0.0 => return self.number(x / y),
            (Some(0.0), None) => return a,
            (_, Some(1.0)) => return a,
            _ => {}
        }
        match (self.signed(a), self.signed(b)) {
            ((a, false), (b, false)) => self.intern(Operation::Divide(a, b)),
            ((a, sign_a), (b, sign_b)) => {
                let quotient = self.divide(a, b);
                if sign_a == sign_b { quotient } else { self.negate(quotient) }
            }
        }
    }

    /// `terms[0] + terms[1] + ..`, from the left; 0 without terms.
    pub fn sum(&mut self, terms: &[Node]) -> Node {
        let zero = self.number(0.0);
        terms.iter().fold(zero, |sum, &term| self.add(sum, term))
    }

    /// `factors[0] * factors[1] * ..`, from the left; 1 without factors.
    pub fn product(&mut self, factors: &[Node]) -> Node {
        let one = self.number(1.0);
        factors.iter().fold(one, |product, &factor| self.multiply(product, factor))
    }

    /// `sin(a)`
    pub fn sin(&mut self, a: Node) -> Node {
        self.call(Function::Sin, a)
    }

    /// `cos(a)`
    pub fn cos(&mut self, a: Node) -> Node {
        self.call(Function::Cos, a)
    }

    /// A function of one argument; odd and even ones pull a sign out.
    ///
    /// # Panics
    /// For `min` and `max`, which have two arguments: see [`Program::minimum`], [`Program::maximum`].
    pub fn call(&mut self, function: Function, a: Node) -> Node {
        use Function::*;
        assert!(!matches!(function, Min | Max), "`min` and `max` take two arguments");
        if let Some(value) = self.number_of(a) {
            match (function, value) {
                (Sin | Tan | Tanh | Sqrt | Abs | Sign, 0.0) => return self.number(0.0),
                (Cos | Exp, 0.0) | (Sqrt, 1.0) => return self.number(1.0),
                (Ln, 1.0) => return self.number(0.0),
                (Abs, value) => return self.number(value.abs()),
                (Sign, value) if !value.is_nan() => return self.number(value.signum()),
                _ => {}
            }
        }
        match (function, self.signed(a)) {
            (Sin | Tan | Tanh | Sign, (positive, true)) => {
                let value = self.intern(Operation::Call(function, positive));
                self.negate(value)
            }
            (Cos | Abs, (positive, true)) => self.intern(Operation::Call(function, positive)),
            _ => self.intern(Operation::Call(function, a)),
        }
    }

    /// The smaller of two.
    pub fn minimum(&mut self, a: Node, b: Node) -> Node {
        if a == b {
            return a;
        }
        self.intern(Operation::Minimum(a, b))
    }

    /// The larger of two.
    pub fn maximum(&mut self, a: Node, b: Node) -> Node {
        if a == b {
            return a;
        }
        self.intern(Operation::Maximum(a, b))
    }

    /// `if left < right { then } else { otherwise }` (or `>`).
    pub fn select(&mut self, comparison: Comparison, [left, right, then, otherwise]: [Node; 4]) -> Node {
        if then == otherwise {
            return then;
        }
        if let (Some(x), Some(y)) = (self.number_of(left), self.number_of(right)) {
            let holds = match comparison {
                Comparison::Less => x < y,
                Comparison::Greater => x > y,
            };
            return if holds { then } else { otherwise };
        }
        self.intern(Operation::Select(comparison, [left, right, then, otherwise]))
    }

    // --- looking ----------------------------------------------------------------------------------------------

    /// How a node is computed.
    pub fn operation_of(&self, node: Node) -> Operation {
        self.operations[node.index()]
    }

    /// The value of a constant node.
    pub fn number_of(&self, node: Node) -> Option<f64> {
        match self.operation_of(node) {
            Operation::Negate(positive) => self.operation_of(positive).number().map(|value| -value),
            operation => operation.number(),
        }
    }

    /// True where the node is the constant 0.
    pub fn is_zero(&self, node: Node) -> bool {
        self.number_of(node) == Some(0.0)
    }

    /// Number of nodes, live or dead.
    pub fn len(&self) -> usize {
        self.operations.len()
    }

    /// True without any node.
    pub fn is_empty(&self) -> bool {
        self.operations.is_empty()
    }

    /// The nodes that the outputs reach, in order: operands come before what uses them.
    pub fn live(&self) -> Vec<Node> {
        self.reached(self.outputs.iter().map(|&(_, node)| node))
    }

    /// The nodes that `roots` reach, in order.
    pub fn reached(&self, roots: impl IntoIterator<Item = Node>) -> Vec<Node> {
        let mut reached = vec![false; self.len()];
        for root in roots {
            reached[root.index()] = true;
        }
        for index in (0..self.len()).rev() {
            if reached[index] {
                for operand in self.operations[index].operands() {
                    reached[operand.index()] = true;
                }
            }
        }
        self.nodes().filter(|node| reached[node.index()]).collect()
    }

    /// The live inputs, in order of declaration.
    pub fn live_inputs(&self) -> Vec<&Input> {
        let mut used = vec![false; self.inputs.len()];
        for node in self.live() {
            if let Operation::Input(position) = self.operation_of(node) {
                used[position] = true;
            }
        }
        self.inputs.iter().zip(used).filter(|(_, used)| *used).map(|((input, _), _)| input).collect()
    }

    pub(crate) fn nodes(&self) -> impl Iterator<Item = Node> + use<> {
        (0..self.operations.len() as u32).map(Node)
    }

    /// A node without its sign, and whether it had one.
    fn signed(&self, node: Node) -> (Node, bool) {
        match self.operation_of(node) {
            Operation::Negate(positive) => (positive, true),
            _ => (node, false),
        }
    }

    /// The node of an operation: an equal one where it exists. Sums and products are equal in either order; the
    /// order of the first is kept, so that text that is read and written again stays as it was.
    fn intern(&mut self, operation: Operation) -> Node {
        let key = match operation {
            Operation::Add(a, b) if b < a => Operation::Add(b, a),
            Operation::Multiply(a, b) if b < a => Operation::Multiply(b, a),
            other => other,
        };
        if let Some(&node) = self.index.get(&key) {
            return node;
        }
        let node = Node(self.operations.len() as u32);
        self.operations.push(operation);
        self.index.insert(key, node);
        node
    }
}
