//! From a [`Function`] to one that can be called while the process runs.
//!
//! A [`Routine`] is machine code (by Cranelift) where there is a code generator for the processor and the system grants executable
//! memory. Elsewhere its operations are interpreted, those of one kind together. Either way they are the operations of the Rust that
//! `dynid-lower` emits: the same bits.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod machine;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
#[path = "no_machine.rs"]
mod machine;
mod plan;
mod tape;
mod word;

use dynid_generated::Scalar;
use dynid_lower::kernel::Function;
use machine::Machine;
use plan::Plan;
use tape::Tape;
pub use word::Word;

/// A function that is ready to be called, from several threads if need be.
#[derive(Debug)]
pub struct Routine<S> {
    /// Lengths of the arguments and of the results.
    lengths: [Box<[usize]>; 2],
    code: Code<S>,
}

#[derive(Debug)]
enum Code<S> {
    Machine(Machine<S>),
    Tape(Tape<S>),
}

impl<S: Word> Routine<S> {
    /// Makes machine code where possible.
    pub fn new(function: &Function) -> Self {
        let plan = Plan::new(function);
        let code = Machine::new(&plan).map_or_else(|| Code::Tape(Tape::new(function, &plan)), Code::Machine);
        Routine { lengths: lengths(function), code }
    }
}

impl<S: Scalar> Routine<S> {
    /// Makes no machine code: for any scalar, e.g. many numbers at once, and for comparisons.
    pub fn interpreted(function: &Function) -> Self {
        Routine { lengths: lengths(function), code: Code::Tape(Tape::new(function, &Plan::new(function))) }
    }

    /// Whether it is machine code.
    pub fn is_machine_code(&self) -> bool {
        matches!(self.code, Code::Machine(_))
    }

    /// Fills the results from the arguments, in the order of the function's own. Slices of other lengths than its are left as they
    /// are (a debug build asserts).
    #[inline]
    pub fn call<const A: usize, const R: usize>(&self, arguments: [&[S]; A], results: [&mut [S]; R]) {
        let [own_arguments, own_results] = &self.lengths;
        let is_right = own_arguments.iter().copied().eq(arguments.iter().map(|given| given.len()))
            && own_results.iter().copied().eq(results.iter().map(|given| given.len()));
        debug_assert!(is_right, "every slice has the length that the function's own has");
        if !is_right {
            return;
        }
        match &self.code {
            Code::Machine(machine) => {
                // SAFETY: the lengths are the function's.
                #[allow(unsafe_code)]
                unsafe {
                    machine.call(arguments, results)
                }
            }
            Code::Tape(tape) => tape.call(arguments, results),
        }
    }
}

fn lengths(function: &Function) -> [Box<[usize]>; 2] {
    [
        function.arguments.iter().map(|own| own.elements.len()).collect(),
        function.results.iter().map(|own| own.elements.len()).collect(),
    ]
}
