//! What is computed once per parameter set, and what is computed at every step.

use std::collections::{BTreeMap, BTreeSet};

use super::{Input, Node, Operation, Program};

/// A program in its two stages.
#[derive(Debug, Clone)]
pub struct Split {
    /// From parameters and locked angles to the prepared values: one output each, named and ordered as `prepared`.
    pub prepare: Program,
    /// From prepared values, positions, velocities, accelerations to the outputs.
    pub eval: Program,
    /// Names of the prepared values.
    pub prepared: Vec<String>,
    /// The first so many prepared values are the lumps of inertial parameters in which the outputs `tau_<i>` are
    /// linear.
    pub n_lumps: usize,
}

impl Program {
    /// Splits the live part: `prepare` is what depends only on parameters and locked angles, `eval` the rest. A
    /// value is handed over where `eval` first needs it; constants and signs stay in `eval`.
    pub fn split(&self) -> Split {
        let live = self.live();
        let classes = self.classes(&live);
        let (handed_over, n_lumps) = self.handed_over(&live, &classes);

        let mut prepare = Program::new();
        let mut images = BTreeMap::new();
        for &node in live.iter().filter(|node| classes[node.index()] < Class::Moving) {
            let image = self.copy_term(node, &mut prepare, &images);
            if let Some(name) = self.name_of(node) {
                prepare.name(image, name);
            }
            images.insert(node, image);
        }
        let mut eval = Program::new();
        let mut values = BTreeMap::new();
        let mut prepared = Vec::new();
        for (node, image) in handed_over.iter().map(|&node| (node, images[&node])) {
            let name = self.prepared_name(node, prepared.len(), &classes);
            values.insert(node, eval.input(Input::Prepared(name.clone()), ""));
            prepare.output(&name, image);
            prepared.push(name);
        }

        for &node in &live {
            if values.contains_key(&node) {
                continue;
            }
            let known = self.number_of(node).is_some()
                || matches!(self.operation_of(node), Operation::Negate(a) if values.contains_key(&a));
            if classes[node.index()] == Class::Moving || known {
                let image = self.copy_term(node, &mut eval, &values);
                if let Some(name) = self.name_of(node) {
                    eval.name(image, name);
                }
                values.insert(node, image);
            }
        }
        for (name, node) in &self.outputs {
            eval.output(name, values[node]);
        }
        Split { prepare, eval, prepared, n_lumps }
    }

    /// Constant nodes that `eval` reads: the torques' lumps first (and how many they are), then other outputs' lumps,
    /// then what depends on no inertial parameter.
    fn handed_over(&self, live: &[Node], classes: &[Class]) -> (Vec<Node>, usize) {
        let unsigned = |node: Node| match self.operation_of(node) {
            Operation::Negate(positive) => positive,
            _ => node,
        };
        let read_by = |nodes: &[Node], roots: &[Node]| -> BTreeSet<Node> {
            let moving = nodes.iter().filter(|node| classes[node.index()] == Class::Moving);
            moving
                .flat_map(|&node| self.operation_of(node).operands())
                .chain(roots.iter().copied())
                .map(unsigned)
                .collect()
        };
        let torques: Vec<Node> =
            self.outputs.iter().filter(|(name, _)| name.starts_with("tau_")).map(|&(_, node)| node).collect();
        let by_torques = read_by(&self.reached(torques.iter().copied()), &torques);
        let outputs: Vec<Node> = self.outputs.iter().map(|&(_, node)| node).collect();

        let mut handed_over: Vec<Node> = read_by(live, &outputs)
            .into_iter()
            .filter(|node| matches!(classes[node.index()], Class::Inertial | Class::Fixed))
            .collect();
        let is_lump = |node: &Node| classes[node.index()] == Class::Inertial && by_torques.contains(node);
        handed_over.sort_by_key(|node| (!is_lump(node), classes[node.index()], *node));
        let n_lumps = handed_over.iter().filter(|node| is_lump(node)).count();
        (handed_over, n_lumps)
    }

    fn classes(&self, live: &[Node]) -> Vec<Class> {
        let mut classes = vec![Class::Number; self.len()];
        for &node in live {
            classes[node.index()] = match self.operation_of(node) {
                Operation::Input(position) => match &self.inputs[position].0 {
                    input if input.is_inertial() => Class::Inertial,
                    input if input.is_constant() => Class::Fixed,
                    _ => Class::Moving,
                },
                operation => {
                    let dominant = operation.operands().map(|operand| classes[operand.index()]);
                    dominant.max_by_key(|class| class.rank()).unwrap_or(Class::Number)
                }
            };
        }
        classes
    }

    fn copy_term(&self, node: Node, into: &mut Program, images: &BTreeMap<Node, Node>) -> Node {
        match self.operation_of(node) {
            Operation::Input(position) => {
                let (input, unit) = &self.inputs[position];
                into.input(input.clone(), unit)
            }
            operation => into.rebuild(operation, |operand| images[&operand]),
        }
    }

    /// The term's own name, the input's, or one by its place.
    fn prepared_name(&self, node: Node, place: usize, classes: &[Class]) -> String {
        if let Some(name) = self.name_of(node) {
            return name.to_owned();
        }
        match self.operation_of(node) {
            Operation::Input(position) => self.inputs[position].0.identifier(),
            _ if classes[node.index()] == Class::Inertial => self.free_name(&format!("lump{place}")),
            _ => self.free_name(&format!("constant{place}")),
        }
    }
}

/// What a node depends on. The order puts lumps before other prepared values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    /// Nothing.
    Number,
    /// A link's inertial parameters, and perhaps lengths and locked angles.
    Inertial,
    /// Lengths, gravity, locked angles.
    Fixed,
    /// Something that changes from step to step.
    Moving,
}

impl Class {
    /// The class of a term is that of its operand of highest rank.
    fn rank(self) -> u8 {
        match self {
            Class::Number => 0,
            Class::Fixed => 1,
            Class::Inertial => 2,
            Class::Moving => 3,
        }
    }
}
