//! The live page, used as people use it.

mod numbers;
mod reach;
mod robust;
mod the_loop;
