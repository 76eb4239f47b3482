//! The live page, used as people use it.

mod the_loop;
