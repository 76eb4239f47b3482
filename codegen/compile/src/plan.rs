//! In which order a function's operations are carried out, and where its arguments and results lie.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use dynid_lower::{
    Node, Operation, Program,
    kernel::Function,
    program::{Comparison, Function as Call},
};

/// A function without its names.
pub(crate) struct Plan<'a> {
    pub program: &'a Program,
    /// What is computed, in order. Constants and inputs are not.
    pub steps: Vec<Step>,
    /// Where the inputs are.
    pub inputs: HashMap<Node, Place>,
    /// What goes where.
    pub results: Vec<(Node, Place)>,
}

/// An element of one of the arrays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub array: usize,
    pub element: usize,
}

/// What is computed at once.
#[derive(Debug)]
pub(crate) enum Step {
    /// One operation.
    Operation(Node),
    /// Sines and cosines.
    Angles(Vec<Angle>),
}

/// An angle, and the nodes of its sine and of its cosine where they are needed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Angle {
    pub of: Node,
    pub wanted: [Option<Node>; 2],
}

impl Step {
    /// What it computes.
    pub fn computed(&self) -> Vec<Node> {
        match self {
            &Step::Operation(node) => vec![node],
            Step::Angles(angles) => angles.iter().flat_map(|angle| angle.wanted).flatten().collect(),
        }
    }

    /// What it reads; a comparison's operands are those of "less".
    pub fn operands(&self, program: &Program) -> Vec<Node> {
        match self {
            Step::Angles(angles) => angles.iter().map(|angle| angle.of).collect(),
            &Step::Operation(node) => match program.operation_of(node) {
                Operation::Select(Comparison::Greater, [a, b, then, otherwise]) => vec![b, a, then, otherwise],
                operation => operation.operands().collect(),
            },
        }
    }
}

impl<'a> Plan<'a> {
    pub fn new(function: &'a Function) -> Self {
        let program = &function.program;
        let outputs: HashMap<&str, Node> =
            program.outputs().iter().map(|(name, node)| (name.as_str(), *node)).collect();
        let arguments = function.arguments.iter().map(|argument| &argument.elements);
        let results = function.results.iter().map(|results| &results.elements);
        let inputs = places(arguments).filter_map(|(input, place)| Some((program.find_input(input)?, place))).collect();
        let results =
            places(results).filter_map(|(output, place)| Some((*outputs.get(output.as_str())?, place))).collect();
        Plan { program, steps: steps(program), inputs, results }
    }

    /// Whether a node needs no computing.
    pub fn is_given(&self, node: Node) -> bool {
        is_given(self.program, node)
    }
}

/// Whether a node is a constant or an input.
fn is_given(program: &Program, node: Node) -> bool {
    program.number_of(node).is_some() || matches!(program.operation_of(node), Operation::Input(_))
}

/// The elements of arrays with their places.
fn places<'a, T: 'a>(arrays: impl Iterator<Item = &'a Vec<T>>) -> impl Iterator<Item = (&'a T, Place)> {
    arrays.enumerate().flat_map(|(array, elements)| {
        elements.iter().enumerate().map(move |(element, own)| (own, Place { array, element }))
    })
}

/// As the emitted Rust has it: first what all angles that come from inputs alone need, then all their sines and cosines at once,
/// since a scalar type may work on them side by side; then the rest, in the order of the program.
fn steps(program: &Program) -> Vec<Step> {
    let live = program.live();
    let mut angles: BTreeMap<Node, [Option<Node>; 2]> = BTreeMap::new();
    let mut calls = vec![false; program.len()];
    for &node in &live {
        let operation = program.operation_of(node);
        let is_call = matches!(operation, Operation::Call(..));
        calls[node.index()] = is_call || operation.operands().any(|operand| calls[operand.index()]);
        match operation {
            Operation::Call(Call::Sin, angle) => angles.entry(angle).or_default()[0] = Some(node),
            Operation::Call(Call::Cos, angle) => angles.entry(angle).or_default()[1] = Some(node),
            _ => {}
        }
    }
    let (first, mut others): (Vec<Angle>, BTreeMap<Node, Angle>) = (
        angles.iter().filter(|(of, _)| !calls[of.index()]).map(|(&of, &wanted)| Angle { of, wanted }).collect(),
        angles.iter().filter(|(of, _)| calls[of.index()]).map(|(&of, &wanted)| (of, Angle { of, wanted })).collect(),
    );
    let before: BTreeSet<Node> = program.reached(first.iter().map(|angle| angle.of)).into_iter().collect();

    let computed = live.into_iter().filter(|&node| !is_given(program, node));
    let (prior, rest): (Vec<Node>, Vec<Node>) = computed.partition(|node| before.contains(node));
    let mut steps: Vec<Step> = prior.into_iter().map(Step::Operation).collect();
    if !first.is_empty() {
        steps.push(Step::Angles(first));
    }
    steps.extend(rest.into_iter().filter_map(|node| match program.operation_of(node) {
        Operation::Call(Call::Sin | Call::Cos, angle) => others.remove(&angle).map(|angle| Step::Angles(vec![angle])),
        _ => Some(Step::Operation(node)),
    }));
    steps
}
