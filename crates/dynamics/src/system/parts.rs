//! A system taken apart, for whoever writes its equations down elsewhere.

use super::{Element, System};

/// Where effects act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// On the way from the command to the joint.
    Drive,
    /// Friction laws, whose sum at a joint other laws may read.
    Friction,
    /// Every other law that resists motion.
    Load,
    /// Between a joint and what its sensor shows.
    Sensor,
}

impl System {
    /// The effects of a part, in the order in which they act.
    pub fn part(&self, part: Part) -> Vec<&Element> {
        match part {
            Part::Drive => self.actuators.iter().chain(&self.transmissions).collect(),
            Part::Friction => self.frictions.iter().collect(),
            Part::Load => self.loads.iter().collect(),
            Part::Sensor => self.sensors.iter().collect(),
        }
    }

    /// What link effects add to entries of D, over the free joints: row, column, value.
    pub fn added_inertia(&self) -> &[(usize, usize, f64)] {
        &self.added_inertia
    }

    /// The effects' states at the start of a run from rest.
    pub fn initial_states(&self) -> &[f64] {
        &self.initial_states
    }
}
