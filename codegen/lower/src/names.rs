//! Names of a program's terms where it is written out.

use std::collections::{BTreeMap, BTreeSet};

use crate::{Node, Operation, Program};

/// Inputs and named terms first, each unlike all that is taken; then `t1`, `t2`, .. for others that are to have one.
pub(crate) struct Names {
    taken: BTreeSet<String>,
    n_numbered: usize,
    of: BTreeMap<Node, String>,
}

impl Names {
    /// The program's own names of its `live` nodes, with underscores appended where they are taken.
    pub(crate) fn new(program: &Program, live: &[Node], taken: BTreeSet<String>) -> Self {
        let mut names = Self { taken, n_numbered: 0, of: BTreeMap::new() };
        for &node in live {
            if let Operation::Input(position) = program.operation_of(node) {
                names.insert(node, program.inputs()[position].0.identifier());
            }
        }
        for &node in live {
            if let Some(name) = program.name_of(node) {
                names.insert(node, name.to_owned());
            }
        }
        names
    }

    /// Numbers a node that has no name.
    pub(crate) fn number(&mut self, node: Node) {
        if !self.of.contains_key(&node) {
            self.n_numbered += 1;
            self.insert(node, format!("t{}", self.n_numbered));
        }
    }

    /// The names by node.
    pub(crate) fn into_map(self) -> BTreeMap<Node, String> {
        self.of
    }

    fn insert(&mut self, node: Node, mut name: String) {
        while !self.taken.insert(name.clone()) {
            name.push('_');
        }
        self.of.insert(node, name);
    }
}
