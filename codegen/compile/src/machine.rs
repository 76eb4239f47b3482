//! A function as machine code, by Cranelift.
//!
//! Cranelift is told to optimise nothing: programs are already without common terms, and what it would schedule anew it would
//! spill. A function of many operations becomes several, since the time to allocate registers grows faster than linearly.
#![allow(unsafe_code)]

mod called;
mod part;

use std::{
    fmt,
    marker::PhantomData,
    mem::transmute,
    panic::{AssertUnwindSafe, catch_unwind},
    ptr,
    sync::{Mutex, PoisonError},
};

use cranelift_codegen::{
    Context,
    ir::{AbiParam, InstBuilder, StackSlotData, StackSlotKind, Value, types::I64},
    settings::{self, Configurable},
};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{Module, default_libcall_names};

use crate::{
    plan::{Plan, Step},
    word::Word,
};
use part::Part;

/// So many steps at most become one function of machine code.
const MOST_STEPS: usize = 1_000;

/// So many bytes at most are handed on, on a stack that a thread may have little of.
const MOST_SHARED: usize = 1 << 18;

/// What machine code is called with: the arguments, the results and what parts of a function hand on.
type Entry<S> = unsafe extern "C" fn(*const *const S, *const *mut S, *mut S);

/// Code in executable memory.
pub(crate) struct Machine<S> {
    entry: Entry<S>,
    /// Owns the memory; only for when that is given back.
    module: Mutex<Option<Box<JITModule>>>,
}

impl<S: Word> Machine<S> {
    /// `None` where the processor is none that code can be made for, or where the system grants no executable memory.
    pub fn new(plan: &Plan) -> Option<Self> {
        // What cannot be had comes as an error, but for a system without barriers across threads or an instruction that the code
        // generator lacks: those come as a panic.
        catch_unwind(AssertUnwindSafe(|| Maker::<S>::new()?.machine(plan))).ok().flatten()
    }
}

impl<S> Machine<S> {
    /// # Safety
    /// The lengths of the slices are the function's.
    #[inline]
    pub unsafe fn call<const A: usize, const R: usize>(&self, arguments: [&[S]; A], results: [&mut [S]; R]) {
        let arguments = arguments.map(<[S]>::as_ptr);
        let results = results.map(<[S]>::as_mut_ptr);
        // SAFETY: the code is there for as long as `self`. It reads and writes elements that the function's arrays have, as these
        // have by what the caller promises; several parts have an entry that makes room for what they hand on.
        unsafe { (self.entry)(arguments.as_ptr(), results.as_ptr(), ptr::null_mut()) }
    }
}

impl<S> fmt::Debug for Machine<S> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Machine").field("entry", &(self.entry as *const ())).finish_non_exhaustive()
    }
}

impl<S> Drop for Machine<S> {
    fn drop(&mut self) {
        if let Some(module) = self.module.get_mut().unwrap_or_else(PoisonError::into_inner).take() {
            // SAFETY: nobody else has the entry, and calls borrow `self`.
            unsafe { module.free_memory() }
        }
    }
}

/// Makes the machine code of one function.
struct Maker<S> {
    module: JITModule,
    context: Context,
    builders: FunctionBuilderContext,
    scalar: PhantomData<S>,
}

impl<S: Word> Maker<S> {
    fn new() -> Option<Self> {
        let mut flags = settings::builder();
        for (name, value) in [
            ("opt_level", "none"),
            ("regalloc_algorithm", "backtracking"),
            ("enable_verifier", if cfg!(debug_assertions) { "true" } else { "false" }),
            // What is handed on may be larger than the page that ends a stack.
            ("enable_probestack", "true"),
            ("probestack_strategy", "inline"),
            // What `cranelift-jit` asks for.
            ("is_pic", "false"),
            ("use_colocated_libcalls", "false"),
        ] {
            flags.set(name, value).ok()?;
        }
        let isa = cranelift_native::builder().ok()?.finish(settings::Flags::new(flags)).ok()?;
        let module = JITModule::new(JITBuilder::with_isa(isa, default_libcall_names()));
        let context = module.make_context();
        Some(Maker { module, context, builders: FunctionBuilderContext::new(), scalar: PhantomData })
    }

    fn machine(mut self, plan: &Plan) -> Option<Machine<S>> {
        let mut chunks: Vec<&[Step]> = plan.steps.chunks(MOST_STEPS).collect();
        if chunks.is_empty() {
            chunks.push(&[]);
        }
        let shared = part::shared(&chunks, plan);
        if shared.len() * size_of::<S>() > MOST_SHARED {
            return None;
        }
        let parts = chunks.iter().enumerate().map(|(number, steps)| {
            self.function(|builder, given| Part::<S>::new(builder, given, plan, &shared).build(steps, number == 0))
        });
        let parts = parts.collect::<Option<Vec<_>>>()?;
        let entry = match parts.as_slice() {
            &[only] => only,
            several => self.function(|builder, given| row(builder, given, several, shared.len() * size_of::<S>()))?,
        };
        // SAFETY: the address is that of a function with the signature that `function` gives it.
        let entry = unsafe { transmute::<*const u8, Entry<S>>(entry) };
        Some(Machine { entry, module: Mutex::new(Some(Box::new(self.module))) })
    }

    /// The address of a function with this body.
    fn function(&mut self, body: impl FnOnce(&mut FunctionBuilder, [Value; 3])) -> Option<*const u8> {
        self.module.clear_context(&mut self.context);
        self.context.func.signature = self.module.make_signature();
        self.context.func.signature.params = vec![AbiParam::new(I64); 3];
        let mut builder = FunctionBuilder::new(&mut self.context.func, &mut self.builders);
        let block = builder.create_block();
        builder.append_block_params_for_function_params(block);
        builder.switch_to_block(block);
        builder.seal_block(block);
        let &[arguments, results, shared] = builder.block_params(block) else { return None };
        body(&mut builder, [arguments, results, shared]);
        builder.ins().return_(&[]);
        builder.finalize();
        let id = self.module.declare_anonymous_function(&self.context.func.signature).ok()?;
        self.module.define_function(id, &mut self.context).ok()?;
        self.module.finalize_definitions().ok()?;
        Some(self.module.get_finalized_function(id))
    }
}

/// Calls one function after the other with what it is called with, but a place for what they hand on.
fn row(builder: &mut FunctionBuilder, [arguments, results, _]: [Value; 3], entries: &[*const u8], bytes: usize) {
    let slot =
        builder.create_sized_stack_slot(StackSlotData::new(StackSlotKind::ExplicitSlot, bytes as u32, part::ALIGNMENT));
    let shared = builder.ins().stack_addr(I64, slot, 0);
    let signature = builder.func.signature.clone();
    let signature = builder.import_signature(signature);
    for &entry in entries {
        let entry = builder.ins().iconst(I64, entry as i64);
        builder.ins().call_indirect(signature, entry, &[arguments, results, shared]);
    }
}
