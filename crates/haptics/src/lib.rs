//! The laboratory around a virtual wall: hands that touch it, how it is judged and tuned, and the impedance that a hand is shown.

pub mod rendered_impedance;
pub mod wall;
