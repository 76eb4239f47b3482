//! Numerical optimisation, and the identifiability of a least-squares problem.
//!
//! - [`sqp`]: sequential quadratic programming with a Gauss-Newton Hessian, for position errors;
//! - [`barrier`]: linear least squares with bounds and physically consistent links, by an interior-point method;
//! - [`pseudo_inertia`]: which inertial parameters a rigid body can have;
//! - [`cma_es`]: search without derivatives;
//! - [`identifiability`]: rank, null space and standard errors of a regressor;
//! - [`basis`]: what columns explain of a signal, and what they leave;
//! - [`matrix`]: how a matrix is written to a file.

pub mod barrier;
pub mod basis;
pub mod body;
pub mod cma_es;
pub mod identifiability;
pub mod matrix;
pub mod pseudo_inertia;
pub mod quadratic;
pub mod region;
pub mod sqp;
