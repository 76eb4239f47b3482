//! Torques that are functions of position: springs, cogging, hysteresis.

use std::f64::consts::TAU;

use super::{Moment, Values};

/// One law at one joint.
#[derive(Debug, Clone, Copy)]
pub(super) enum Load {
    Spring {
        stiffness: f64,
        rest: f64,
    },
    /// `k[n] s^n` with `s = q - middle`, from the second order on
    Polynomial {
        k: [f64; 6],
        middle: f64,
    },
    Cogging {
        cosine: f64,
        sine: f64,
        period: f64,
    },
    /// Reid's damping, whose sign turns over a travel: `stiffness |q - rest| z`.
    Hysteresis {
        stiffness: f64,
        travel: f64,
    },
}

impl Load {
    /// The law of that id; `None` for an id of no such law.
    pub(super) fn read(id: &str, values: &Values<'_>) -> Result<Option<Self>, String> {
        let value = |symbol: &str| values.get(symbol);
        Ok(Some(match id {
            "spring" => Self::Spring { stiffness: value("Ks")?, rest: value("qeq")? },
            "spring_cubic" => Self::Polynomial { k: [0.0, 0.0, 0.0, value("K3")?, 0.0, 0.0], middle: value("q_mid")? },
            "spring_polynomial" => Self::Polynomial {
                k: [0.0, 0.0, value("K2")?, value("K3")?, 0.0, value("K5")?],
                middle: value("q_mid")?,
            },
            "cogging" => Self::Cogging { cosine: value("A")?, sine: value("B")?, period: value("period")? },
            "hysteresis" => Self::Hysteresis { stiffness: value("Kh")?, travel: value("travel")? },
            _ => return Ok(None),
        }))
    }

    /// Of a spring.
    pub(super) fn rest_position(&self) -> Option<f64> {
        match *self {
            Self::Spring { rest, .. } => Some(rest),
            _ => None,
        }
    }

    pub(super) fn n_states(&self) -> usize {
        usize::from(matches!(self, Self::Hysteresis { .. }))
    }

    /// Torque that resists the motion, where the joint's spring rests at `rest`; writes the rates of the law's states.
    pub(super) fn torque(&self, moment: &Moment<'_>, rest: f64, states: &[f64], rates: &mut [f64]) -> f64 {
        let q = moment.position();
        match *self {
            Self::Spring { stiffness, rest } => stiffness * (q - rest),
            Self::Polynomial { k, middle } => k.iter().rev().fold(0.0, |sum, k| sum * (q - middle) + k),
            Self::Hysteresis { stiffness, travel } => {
                let (dq, branch) = (moment.speed(), states[0]);
                // forwards the branch tends to 1, backwards to -1
                rates[0] = dq.abs() * (1.0_f64.copysign(dq) - branch) / travel;
                stiffness * (q - rest).abs() * branch
            }
            Self::Cogging { cosine, sine, period } => {
                let (s, c) = (TAU * q / period).sin_cos();
                cosine * c + sine * s
            }
        }
    }
}
