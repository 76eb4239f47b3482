//! Which terms get a line of their own when a program is written as text.

use super::{Node, Operation, Program};

/// An expression of more operations is cut into two lines: for the reader, and because compilers recurse over it.
const MOST_OPERATIONS: usize = 24;

impl Program {
    /// The live terms that need a line, in order: those with a name, those that are used more than once and those
    /// that would make an expression too long. Numbers and inputs need none, and a sign none of its own.
    pub(crate) fn statements(&self) -> Vec<Node> {
        let live = self.live();
        let mut uses = vec![0usize; self.len()];
        for node in live.iter().flat_map(|&node| self.operation_of(node).operands()) {
            uses[node.index()] += 1;
        }
        for (_, node) in self.outputs() {
            uses[node.index()] += 1;
        }
        // Operations of a term where it is used: none once it has a line.
        let mut size = vec![0usize; self.len()];
        let mut statements = Vec::new();
        for node in live {
            let operation = self.operation_of(node);
            if self.number_of(node).is_some() || matches!(operation, Operation::Input(_)) {
                continue;
            }
            let own = 1 + operation.operands().map(|operand| size[operand.index()]).sum::<usize>();
            let shared = uses[node.index()] > 1 && !matches!(operation, Operation::Negate(_));
            if self.name_of(node).is_some() || shared || own > MOST_OPERATIONS {
                statements.push(node);
            } else {
                size[node.index()] = own;
            }
        }
        statements
    }
}
