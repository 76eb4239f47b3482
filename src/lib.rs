//! Robots' models from symbols to identified parameters: simulation, identification, diagnosis of missing physical
//! effects, and control with the models found. ARCHITECTURE.md has the map.

pub mod checkpoint;
pub mod compare;
pub mod control;
pub mod diagnose;
pub mod error;
pub mod excite;
pub mod experiment;
pub mod felt;
pub mod fit;
pub mod identify;
pub mod kinematics;
pub mod ladder;
pub mod log;
pub mod model;
pub mod output;
pub mod plan;
pub mod plot;
pub mod quality;
pub mod random;
pub mod report;
pub mod signal;
pub mod simulate;
pub mod system;
pub mod torque;
pub mod tour;
pub mod wall;
