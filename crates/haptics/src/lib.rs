//! The laboratory around a virtual wall: hands that touch it, how it is judged and tuned, and the impedance that a hand is shown.

pub mod felt;
pub mod wall;
