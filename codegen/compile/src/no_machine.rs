//! Where there is no code generator for the processor.

use std::{convert::Infallible, marker::PhantomData};

use crate::plan::Plan;

/// Machine code that is never made.
#[derive(Debug)]
pub(crate) struct Machine<S>(Infallible, PhantomData<S>);

impl<S> Machine<S> {
    pub fn new(_: &Plan) -> Option<Self> {
        None
    }

    /// # Safety
    /// None: it cannot be called.
    #[allow(unsafe_code)]
    pub unsafe fn call<const A: usize, const R: usize>(&self, _: [&[S]; A], _: [&mut [S]; R]) {
        match self.0 {}
    }
}
