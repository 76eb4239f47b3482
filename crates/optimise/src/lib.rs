//! Optimisers, and what a least-squares problem leaves open.

pub mod barrier;
pub mod body;
pub mod cma_es;
pub mod identifiability;
pub mod matrix;
pub mod physical;
pub mod quadratic;
pub mod region;
pub mod sqp;
