//! The live page, used as people use it.

mod numbers;
mod the_loop;
