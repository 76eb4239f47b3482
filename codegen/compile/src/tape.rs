//! A function's operations as batches of one kind, which are carried out without a look at each.

mod maker;

use std::sync::{Mutex, PoisonError};

use dynid_generated::Scalar;
use dynid_lower::{kernel::Function, program::Function as Call};

use crate::plan::{Place, Plan};
use maker::Maker;

/// Values stand in slots: constants, then the elements of the arguments, then what each batch computes.
#[derive(Debug)]
pub(crate) struct Tape<S> {
    constants: Vec<S>,
    batches: Vec<Batch>,
    results: Vec<(u32, Place)>,
    n_slots: usize,
    /// What calls computed in, for the next ones: one each that run at the same time.
    scratch: Mutex<Vec<Vec<S>>>,
}

/// Operations of one kind, of which a later one may read an earlier one's.
#[derive(Debug)]
struct Batch {
    kind: Kind,
    /// The slots that are read, those of one operation after the other.
    operands: Vec<u32>,
    /// The first slot that is filled.
    start: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    Minimum,
    Maximum,
    /// `if a < b { x } else { y }`
    Less,
    Call(Call),
    /// All sines, then all cosines, of one step: its number keeps it alone.
    Angles(usize),
}

impl<S: Scalar> Tape<S> {
    pub fn new(function: &Function, plan: &Plan) -> Self {
        let mut maker = Maker::new(function, plan);
        let batches = maker.batches();
        let results = plan.results.iter().map(|&(node, place)| (maker.slot(node), place)).collect();
        let constants = maker.constants.iter().map(|&value| S::constant(value)).collect();
        Tape { constants, batches, results, n_slots: maker.n_slots, scratch: Mutex::default() }
    }

    /// The lengths of the slices are the function's.
    pub fn call<const A: usize, const R: usize>(&self, arguments: [&[S]; A], results: [&mut [S]; R]) {
        let kept = self.scratch.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut values = kept.unwrap_or_else(|| {
            let mut values = self.constants.clone();
            values.resize(self.n_slots, S::constant(0.0));
            values
        });
        let mut first = self.constants.len();
        for argument in arguments {
            values[first..first + argument.len()].copy_from_slice(argument);
            first += argument.len();
        }
        self.batches.iter().for_each(|batch| batch.carry_out(&mut values));
        for &(slot, Place { array, element }) in &self.results {
            results[array][element] = values[slot as usize];
        }
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).push(values);
    }
}

impl Batch {
    fn carry_out<S: Scalar>(&self, values: &mut [S]) {
        match self.kind {
            Kind::Negate => self.each(values, |[a]| -a),
            Kind::Add => self.each(values, |[a, b]| a + b),
            Kind::Subtract => self.each(values, |[a, b]| a - b),
            Kind::Multiply => self.each(values, |[a, b]| a * b),
            Kind::Divide => self.each(values, |[a, b]| a / b),
            Kind::Minimum => self.each(values, |[a, b]| a.minimum(b)),
            Kind::Maximum => self.each(values, |[a, b]| a.maximum(b)),
            Kind::Less => self.each(values, |[a, b, then, otherwise]| S::if_less(a, b, then, otherwise)),
            Kind::Angles(_) => self.sines_and_cosines(values),
            Kind::Call(call) => match call {
                Call::Tan => self.each(values, |[a]| a.tan()),
                Call::Tanh => self.each(values, |[a]| a.tanh()),
                Call::Exp => self.each(values, |[a]| a.exp()),
                Call::Ln => self.each(values, |[a]| a.ln()),
                Call::Sqrt => self.each(values, |[a]| a.sqrt()),
                Call::Abs => self.each(values, |[a]| a.abs()),
                Call::Sign => self.each(values, |[a]| a.sign()),
                // Kinds of their own.
                Call::Sin | Call::Cos | Call::Min | Call::Max => {}
            },
        }
    }

    #[inline]
    fn each<S: Scalar, const N: usize>(&self, values: &mut [S], of: impl Fn([S; N]) -> S) {
        for (place, operands) in (self.start..).zip(self.operands.as_chunks::<N>().0) {
            values[place] = of(operands.map(|operand| values[operand as usize]));
        }
    }

    /// From the last on in pairs, as a scalar type pairs the angles that it is given.
    fn sines_and_cosines<S: Scalar>(&self, values: &mut [S]) {
        let n = self.operands.len();
        let (odd, pairs) = self.operands.as_rchunks::<2>();
        let mut place = self.start;
        let mut fill = |values: &mut [S], sine, cosine| {
            (values[place], values[place + n]) = (sine, cosine);
            place += 1;
        };
        for &angle in odd {
            let ([sine], [cosine]) = S::sines_cosines([values[angle as usize]]);
            fill(values, sine, cosine);
        }
        for pair in pairs {
            let (sines, cosines) = S::sines_cosines(pair.map(|angle| values[angle as usize]));
            sines.into_iter().zip(cosines).for_each(|(sine, cosine)| fill(values, sine, cosine));
        }
    }
}
