//! Between the motor and the joint: a shaft that twists, gears with play. Behind either stands the motor, a rotor of its
//! own: `Jm dw = motor - through`, and `through` drives the joint.

use super::{Moment, Values};

/// What stands between the motor's torque and the joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transmission {
    /// kg m^2
    rotor: f64,
    contact: Contact,
}

#[derive(Debug, Clone, Copy)]
enum Contact {
    /// A shaft, stiff and damped.
    Shaft { stiffness: f64, damping: f64 },
    /// Two flanks `gap` apart, stiff and damped; the damping sets in over a tenth of the gap.
    Flanks { gap: f64, stiffness: f64, damping: f64 },
}

impl Transmission {
    /// The transmission of that id; `None` for an id of none.
    pub(super) fn read(id: &str, values: &Values<'_>) -> Result<Option<Self>, String> {
        let value = |symbol: &str| values.get(symbol);
        let (rotor, contact) = match id {
            "joint_elasticity" => {
                let stiffness = 1.0 / value("compliance")?;
                (value("Jm")?, Contact::Shaft { stiffness, damping: value("damping")? })
            }
            "backlash" => {
                let (rotor, time) = (value("Jm")?, value("T_contact")?);
                let (stiffness, damping) = (rotor / (time * time), rotor / time);
                (rotor, Contact::Flanks { gap: value("gap")?, stiffness, damping })
            }
            _ => return Ok(None),
        };
        Ok(Some(Self { rotor, contact }))
    }

    /// How far the motor runs ahead of the joint, and its own speed.
    pub(super) fn n_states(&self) -> usize {
        2
    }

    /// Torque that arrives at the joint when the motor gives `motor`; writes the rates of the states.
    pub(super) fn torque(&self, motor: f64, moment: &Moment<'_>, states: &[f64], rates: &mut [f64]) -> f64 {
        let (ahead, speed) = (states[0], states[1]);
        let slip = speed - moment.speed();
        let through = match self.contact {
            Contact::Shaft { stiffness, damping } => stiffness * ahead + damping * slip,
            Contact::Flanks { gap, stiffness, damping } => {
                let depth = (ahead.abs() - 0.5 * gap).max(0.0);
                let grip = (depth / (0.1 * gap)).min(1.0);
                (stiffness * depth).copysign(ahead) + grip * damping * slip
            }
        };
        rates[0] = slip;
        rates[1] = (motor - through) / self.rotor;
        through
    }
}
