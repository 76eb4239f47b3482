//! What a program costs.

use std::collections::BTreeSet;

use dynid_model::expression::Function;

use super::{Node, Operation, Program};

/// Operations of the live part of a program. Negation is free: it folds into the sum or product beside it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct OperationCounts {
    /// Additions and subtractions.
    pub adds: usize,
    /// Multiplications.
    pub muls: usize,
    /// Divisions.
    pub divs: usize,
    /// Arguments of which the sine, the cosine or both are needed; a pair is computed at once.
    pub sincos: usize,
    /// Other functions, `min`, `max` and choices.
    pub calls: usize,
}

impl OperationCounts {
    /// Additions, multiplications and divisions: what forms are compared by.
    pub fn arithmetic(&self) -> usize {
        self.adds + self.muls + self.divs
    }
}

impl Program {
    /// Counts the operations that the outputs need, each shared term once.
    pub fn operations(&self) -> OperationCounts {
        self.count(&self.live())
    }

    /// Counts the operations that these outputs need.
    pub fn operations_for(&self, outputs: &[&str]) -> OperationCounts {
        self.count(&self.reached(outputs.iter().filter_map(|name| self.find_output(name))))
    }

    fn count(&self, nodes: &[Node]) -> OperationCounts {
        let mut counts = OperationCounts::default();
        let mut angles = BTreeSet::new();
        for &node in nodes {
            match self.operation_of(node) {
                Operation::Number(_) | Operation::Input(_) | Operation::Negate(_) => {}
                Operation::Add(..) | Operation::Subtract(..) => counts.adds += 1,
                Operation::Multiply(..) => counts.muls += 1,
                Operation::Divide(..) => counts.divs += 1,
                Operation::Call(Function::Sin | Function::Cos, angle) => {
                    angles.insert(angle);
                }
                Operation::Call(..) | Operation::Minimum(..) | Operation::Maximum(..) | Operation::Select(..) => {
                    counts.calls += 1;
                }
            }
        }
        counts.sincos = angles.len();
        counts
    }
}
