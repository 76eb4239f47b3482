//! Which operations of a plan are carried out together.

use std::collections::HashMap;

use dynid_lower::{Node, Operation, kernel::Function};

use super::{Batch, Kind};
use crate::plan::{Plan, Step};

/// Gives every value its slot.
pub(super) struct Maker<'a> {
    plan: &'a Plan<'a>,
    slots: HashMap<Node, u32>,
    pub constants: Vec<f64>,
    pub n_slots: usize,
}

/// Steps of one kind whose operands are there.
type Ready = Vec<(Kind, Vec<usize>)>;

impl<'a> Maker<'a> {
    /// Places constants and arguments.
    pub fn new(function: &Function, plan: &'a Plan) -> Self {
        let mut maker = Maker { plan, slots: HashMap::new(), constants: Vec::new(), n_slots: 0 };
        for node in plan.program.live() {
            if plan.is_given(node) && !plan.inputs.contains_key(&node) {
                // An input that no array has is no number.
                maker.constants.push(plan.program.number_of(node).unwrap_or(f64::NAN));
                maker.fill_next(node);
            }
        }
        let mut firsts = Vec::new();
        for argument in &function.arguments {
            firsts.push(maker.n_slots);
            maker.n_slots += argument.elements.len();
        }
        let placed = plan.inputs.iter().map(|(&node, place)| (node, (firsts[place.array] + place.element) as u32));
        maker.slots.extend(placed);
        maker
    }

    pub fn slot(&self, node: Node) -> u32 {
        self.slots[&node]
    }

    fn fill_next(&mut self, node: Node) {
        self.slots.insert(node, self.n_slots as u32);
        self.n_slots += 1;
    }

    /// Whichever kind most operations are ready of comes next, with those of the same kind that become ready by that.
    pub fn batches(&mut self) -> Vec<Batch> {
        let plan = self.plan;
        let operands: Vec<Vec<Node>> = plan.steps.iter().map(|step| step.operands(plan.program)).collect();
        let mut missing = vec![0_usize; operands.len()];
        let mut waiting: HashMap<Node, Vec<usize>> = HashMap::new();
        let mut ready = Ready::new();
        for (step, operands) in operands.iter().enumerate() {
            for &operand in operands.iter().filter(|&operand| !self.slots.contains_key(operand)) {
                waiting.entry(operand).or_default().push(step);
                missing[step] += 1;
            }
            if missing[step] == 0 {
                add(&mut ready, plan, step);
            }
        }
        let mut batches = Vec::new();
        while let Some(most) = (0..ready.len()).max_by_key(|&kind| ready[kind].1.len()) {
            let mut batch = Batch { kind: ready[most].0, operands: Vec::new(), start: self.n_slots };
            let mut done = 0;
            while let Some(&step) = ready[most].1.get(done) {
                done += 1;
                batch.operands.extend(operands[step].iter().map(|&operand| self.slot(operand)));
                self.fill(&plan.steps[step]);
                let computed = plan.steps[step].computed();
                for step in computed.iter().filter_map(|node| waiting.remove(node)).flatten() {
                    missing[step] -= 1;
                    if missing[step] == 0 {
                        add(&mut ready, plan, step);
                    }
                }
            }
            ready.swap_remove(most);
            batches.push(batch);
        }
        batches
    }

    /// Gives slots to what a step computes.
    fn fill(&mut self, step: &Step) {
        match step {
            &Step::Operation(node) => self.fill_next(node),
            Step::Angles(angles) => {
                for which in [0, 1] {
                    for (place, angle) in angles.iter().enumerate() {
                        let slot = self.n_slots + place;
                        self.slots.extend(angle.wanted[which].map(|node| (node, slot as u32)));
                    }
                    self.n_slots += angles.len();
                }
            }
        }
    }
}

fn add(ready: &mut Ready, plan: &Plan, step: usize) {
    let kind = kind_of(plan, step);
    match ready.iter_mut().find(|(known, _)| *known == kind) {
        Some((_, steps)) => steps.push(step),
        None => ready.push((kind, vec![step])),
    }
}

fn kind_of(plan: &Plan, step: usize) -> Kind {
    let &Step::Operation(node) = &plan.steps[step] else { return Kind::Angles(step) };
    match plan.program.operation_of(node) {
        Operation::Add(..) => Kind::Add,
        Operation::Subtract(..) => Kind::Subtract,
        Operation::Multiply(..) => Kind::Multiply,
        Operation::Divide(..) => Kind::Divide,
        Operation::Minimum(..) => Kind::Minimum,
        Operation::Maximum(..) => Kind::Maximum,
        Operation::Select(..) => Kind::Less,
        Operation::Call(call, _) => Kind::Call(call),
        // Numbers and inputs are no steps.
        Operation::Negate(_) | Operation::Number(_) | Operation::Input(_) => Kind::Negate,
    }
}
