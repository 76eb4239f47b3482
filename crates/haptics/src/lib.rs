//! Simulation of haptic rendering: virtual walls under simulated hands, how they are judged and tuned, and the impedance that a
//! compensated device renders.
//!
//! - [`wall`]: contact with a wall at one joint: [`wall::Setting`], [`wall::WallFile`], [`wall::contact()`], [`wall::Measures`],
//!   [`wall::compare()`], [`wall::tune()`]; [`wall::space`]: the whole device at a plane;
//! - [`rendered_impedance`]: inertia, friction and stiffness over frequency, with and without compensation.

pub mod rendered_impedance;
pub mod wall;
