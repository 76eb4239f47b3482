//! A stretch of a function's steps as Cranelift's instructions.

use std::{
    collections::{HashMap, HashSet},
    marker::PhantomData,
};

use cranelift_codegen::ir::{
    InstBuilder, MemFlags, StackSlotData, StackSlotKind, Type, Value,
    condcodes::FloatCC,
    types::{F64, F64X2, I64},
};
use cranelift_frontend::FunctionBuilder;
use dynid_lower::{Node, Operation, program::Function as Call};

use super::called;
use crate::{
    plan::{Angle, Place, Plan, Step},
    word::Word,
};

/// Every access is to memory that is there and aligned.
const TRUSTED: MemFlags = MemFlags::trusted();

/// Of a stack slot: 2^4 bytes.
pub(super) const ALIGNMENT: u8 = 4;

/// What a later part reads than the one that computes it, each with its place among what is handed on.
pub(super) fn shared(parts: &[&[Step]], plan: &Plan) -> HashMap<Node, usize> {
    let (mut earlier, mut shared) = (HashSet::new(), HashMap::new());
    for part in parts {
        for operand in part.iter().flat_map(|step| step.operands(plan.program)) {
            if earlier.contains(&operand) {
                let place = shared.len();
                shared.entry(operand).or_insert(place);
            }
        }
        earlier.extend(part.iter().flat_map(Step::computed));
    }
    shared
}

/// Writes one function of machine code.
pub(super) struct Part<'a, 'b, S> {
    builder: &'a mut FunctionBuilder<'b>,
    plan: &'a Plan<'a>,
    shared: &'a HashMap<Node, usize>,
    /// Pointers to the arguments, to the results and to what is handed on.
    given: [Value; 3],
    /// Pointers to the array of that number among the arguments (0) or the results (1).
    arrays: HashMap<(usize, usize), Value>,
    /// What is in a register, if the registers suffice.
    values: HashMap<Node, Value>,
    scalar: PhantomData<S>,
}

impl<'a, 'b, S: Word> Part<'a, 'b, S> {
    const TYPE: Type = if S::NUMBERS == 1 { F64 } else { F64X2 };

    pub fn new(
        builder: &'a mut FunctionBuilder<'b>,
        given: [Value; 3],
        plan: &'a Plan,
        shared: &'a HashMap<Node, usize>,
    ) -> Self {
        Part { builder, plan, shared, given, arrays: HashMap::new(), values: HashMap::new(), scalar: PhantomData }
    }

    /// Instructions for the steps. The first part also writes the results that need no computing.
    pub fn build(mut self, steps: &[Step], is_first: bool) {
        let mut results: HashMap<Node, Vec<Place>> = HashMap::new();
        self.plan.results.iter().for_each(|&(node, place)| results.entry(node).or_default().push(place));
        if is_first {
            for &(node, place) in &self.plan.results {
                if self.plan.is_given(node) {
                    let value = self.value(node);
                    self.store_result(value, place);
                }
            }
        }
        for step in steps {
            match step {
                &Step::Operation(node) => {
                    let value = self.operation(node, &step.operands(self.plan.program));
                    self.values.insert(node, value);
                }
                Step::Angles(angles) => self.sines_and_cosines(angles),
            }
            for node in step.computed() {
                let value = self.value(node);
                for &place in results.get(&node).into_iter().flatten() {
                    self.store_result(value, place);
                }
                if let Some(&place) = self.shared.get(&node) {
                    self.builder.ins().store(TRUSTED, value, self.given[2], offset::<S>(place));
                }
            }
        }
    }

    fn store_result(&mut self, value: Value, place: Place) {
        let array = self.array(1, place.array);
        self.builder.ins().store(TRUSTED, value, array, offset::<S>(place.element));
    }

    /// The pointer to an array.
    fn array(&mut self, which: usize, number: usize) -> Value {
        let (builder, given) = (&mut self.builder, self.given[which]);
        *self.arrays.entry((which, number)).or_insert_with(|| {
            builder.ins().load(I64, TRUSTED.with_readonly(), given, (number * size_of::<*const S>()) as i32)
        })
    }

    /// A value where it is used. What lies in memory is loaded anew for each use, as part of the instruction that uses it: that takes
    /// no register.
    fn value(&mut self, node: Node) -> Value {
        if let Some(&value) = self.values.get(&node) {
            return value;
        }
        if let Some(number) = self.plan.program.number_of(node) {
            return self.constant(number);
        }
        if let Some(&place) = self.plan.inputs.get(&node) {
            let array = self.array(0, place.array);
            return self.builder.ins().load(Self::TYPE, TRUSTED.with_readonly(), array, offset::<S>(place.element));
        }
        if let Some(&place) = self.shared.get(&node) {
            return self.builder.ins().load(Self::TYPE, TRUSTED, self.given[2], offset::<S>(place));
        }
        // An input that no array has is no number.
        self.constant(f64::NAN)
    }

    fn constant(&mut self, number: f64) -> Value {
        let value = self.builder.ins().f64const(number);
        if S::NUMBERS == 1 { value } else { self.builder.ins().splat(Self::TYPE, value) }
    }

    fn operation(&mut self, node: Node, operands: &[Node]) -> Value {
        let operands: Vec<Value> = operands.iter().map(|&operand| self.value(operand)).collect();
        match (self.plan.program.operation_of(node), operands.as_slice()) {
            (Operation::Negate(_), &[a]) => self.builder.ins().fneg(a),
            (Operation::Add(..), &[a, b]) => self.builder.ins().fadd(a, b),
            (Operation::Subtract(..), &[a, b]) => self.builder.ins().fsub(a, b),
            (Operation::Multiply(..), &[a, b]) => self.builder.ins().fmul(a, b),
            (Operation::Divide(..), &[a, b]) => self.builder.ins().fdiv(a, b),
            (Operation::Minimum(..), &[a, b]) => self.if_less(a, b, a, b),
            (Operation::Maximum(..), &[a, b]) => self.if_less(b, a, a, b),
            (Operation::Select(..), &[a, b, then, otherwise]) => self.if_less(a, b, then, otherwise),
            (Operation::Call(Call::Sqrt, _), &[a]) => self.builder.ins().sqrt(a),
            (Operation::Call(Call::Abs, _), &[a]) => self.builder.ins().fabs(a),
            (Operation::Call(Call::Sign, _), &[a]) => self.sign(a),
            (Operation::Call(call, _), &[a]) => match called::of::<S>(call) {
                Some(function) => self.call(function, &[a], 1)[0],
                None => self.constant(f64::NAN),
            },
            // Numbers and inputs are no steps.
            _ => self.constant(f64::NAN),
        }
    }

    fn if_less(&mut self, a: Value, b: Value, then: Value, otherwise: Value) -> Value {
        let is_less = self.builder.ins().fcmp(FloatCC::LessThan, a, b);
        if S::NUMBERS == 1 {
            return self.builder.ins().select(is_less, then, otherwise);
        }
        let mask = self.builder.ins().bitcast(Self::TYPE, MemFlags::new(), is_less);
        self.builder.ins().bitselect(mask, then, otherwise)
    }

    fn sign(&mut self, a: Value) -> Value {
        let [zero, one, minus_one] = [0.0, 1.0, -1.0].map(|number| self.constant(number));
        // Keeps a NaN.
        let neither = self.builder.ins().fmul(a, zero);
        let negative = self.if_less(a, zero, minus_one, neither);
        self.if_less(zero, a, one, negative)
    }

    /// In pairs from the last on: as a scalar type pairs the angles that it is given.
    fn sines_and_cosines(&mut self, angles: &[Angle]) {
        for group in angles.rchunks(called::MOST_ANGLES).rev() {
            let arguments: Vec<Value> = group.iter().map(|angle| self.value(angle.of)).collect();
            let function = called::sines_and_cosines::<S>(group.len());
            let results = self.call(function, &arguments, 2 * group.len());
            let (sines, cosines) = results.split_at(group.len());
            for (angle, values) in group.iter().zip(sines.iter().zip(cosines)) {
                let computed = angle.wanted.into_iter().zip([*values.0, *values.1]);
                self.values.extend(computed.filter_map(|(node, value)| Some((node?, value))));
            }
        }
    }

    /// The so many results of a function.
    fn call(&mut self, function: called::Called<S>, arguments: &[Value], n_results: usize) -> Vec<Value> {
        // Results that come in pairs do not straddle two lines of the cache.
        let first = arguments.len().next_multiple_of(2);
        let bytes = (first + n_results) * size_of::<S>();
        let slot = StackSlotData::new(StackSlotKind::ExplicitSlot, bytes as u32, ALIGNMENT);
        let slot = self.builder.create_sized_stack_slot(slot);
        for (place, &argument) in arguments.iter().enumerate() {
            self.builder.ins().stack_store(argument, slot, offset::<S>(place));
        }
        let mut signature = self.builder.func.signature.clone();
        signature.params.truncate(2);
        let signature = self.builder.import_signature(signature);
        let function = self.builder.ins().iconst(I64, function as usize as i64);
        let [from, to] = [0, first].map(|place| self.builder.ins().stack_addr(I64, slot, offset::<S>(place)));
        self.builder.ins().call_indirect(signature, function, &[from, to]);
        let places = first..first + n_results;
        places.map(|place| self.builder.ins().stack_load(Self::TYPE, slot, offset::<S>(place))).collect()
    }
}

/// Of the element of that number, in bytes.
fn offset<S>(element: usize) -> i32 {
    (element * size_of::<S>()) as i32
}
