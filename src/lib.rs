//! Robots' models from symbols to identified parameters: simulation, identification, diagnosis of missing physical
//! effects, and control with the models found. ARCHITECTURE.md has the map.

mod error;
pub mod tour;

pub use error::Error;
