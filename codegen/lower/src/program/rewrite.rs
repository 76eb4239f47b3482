//! Copies of a program in which nodes are replaced, dropped or joined with another program's.

use std::collections::BTreeMap;

use super::{Input, Node, Operation, Program};

impl Program {
    /// The live part alone, in the same order.
    pub fn compact(&self) -> Program {
        self.substitute(|_, _| None)
    }

    /// The part that the named outputs need; outputs that do not exist are left out.
    pub fn select_outputs(&self, outputs: &[&str]) -> Program {
        let mut selected = self.clone();
        selected.outputs.retain(|(name, _)| outputs.contains(&name.as_str()));
        selected.compact()
    }

    /// A copy in which inputs are replaced, e.g. accelerations by 0. `replace` is asked for each live input and may
    /// build its replacement in the new program; `None` keeps the input.
    pub fn substitute(&self, replace: impl FnMut(&Input, &mut Program) -> Option<Node>) -> Program {
        let mut copy = Program::new();
        let images = copy.copied(self, replace, true);
        for (name, node) in &self.outputs {
            copy.output(name, images[node]);
        }
        copy
    }

    /// Copies the live part of `other` into this program, with its names and outputs. Equal inputs become one.
    pub fn append(&mut self, other: &Program) {
        let images = self.copied(other, |_, _| None, true);
        for (name, node) in &other.outputs {
            self.output(name, images[node]);
        }
    }

    /// Copies the live part of `other` into this program, nameless, with its inputs replaced as `replace` says; returns what its
    /// outputs have become, in their order.
    pub fn inline(&mut self, other: &Program, replace: impl FnMut(&Input, &mut Program) -> Option<Node>) -> Vec<Node> {
        let images = self.copied(other, replace, false);
        other.outputs.iter().map(|(_, node)| images[node]).collect()
    }

    /// Copies the live part of `other`; returns what each of its nodes has become.
    fn copied(
        &mut self,
        other: &Program,
        mut replace: impl FnMut(&Input, &mut Program) -> Option<Node>,
        with_names: bool,
    ) -> BTreeMap<Node, Node> {
        let mut images = BTreeMap::new();
        for node in other.live() {
            let image = match other.operation_of(node) {
                Operation::Input(position) => {
                    let (input, unit) = &other.inputs[position];
                    match replace(input, self) {
                        Some(image) => image,
                        None => self.input(input.clone(), unit),
                    }
                }
                operation => self.rebuild(operation, |operand| images[&operand]),
            };
            if let Some(name) = other.name_of(node).filter(|_| with_names) {
                self.name(image, name);
            }
            images.insert(node, image);
        }
        images
    }

    /// The same operation on other operands, through the folding constructors.
    ///
    /// An input's place in the list is this program's own matter, so inputs are not rebuilt here.
    pub(super) fn rebuild(&mut self, operation: Operation, image: impl Fn(Node) -> Node) -> Node {
        match operation {
            Operation::Number(bits) => self.number(f64::from_bits(bits)),
            Operation::Input(position) => self.intern(Operation::Input(position)),
            Operation::Negate(a) => self.negate(image(a)),
            Operation::Add(a, b) => self.add(image(a), image(b)),
            Operation::Subtract(a, b) => self.subtract(image(a), image(b)),
            Operation::Multiply(a, b) => self.multiply(image(a), image(b)),
            Operation::Divide(a, b) => self.divide(image(a), image(b)),
            Operation::Call(function, a) => self.call(function, image(a)),
            Operation::Minimum(a, b) => self.minimum(image(a), image(b)),
            Operation::Maximum(a, b) => self.maximum(image(a), image(b)),
            Operation::Select(comparison, operands) => self.select(comparison, operands.map(image)),
        }
    }
}
