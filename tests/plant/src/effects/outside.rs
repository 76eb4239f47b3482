//! Effects that the library does not have. A program that is told nothing must say that it does not know them.
//!
//! Those of the drive (`command_cubic`, `command_root`, `gain_ripple`, `gain_droop`) are in [`super::drive`].

use std::f64::consts::TAU;

use super::{Moment, Values};

/// Ids of all effects outside of the library.
pub const IDS: [&str; 17] = [
    "command_cubic",
    "command_root",
    "gain_ripple",
    "gain_droop",
    "viscous_position",
    "speed_product",
    "speed_square_from",
    "gyroscopic",
    "friction_position_from",
    "spring_between",
    "resonance",
    "torque_wave",
    "command_position",
    "wandering_detent",
    "stiffness_growth",
    "viscous_from",
    "position_product",
];

/// A torque that resists the motion.
#[derive(Debug, Clone, Copy)]
pub(super) enum Outside {
    /// `F sin(k q) dq`: a bearing that is tighter at one end.
    ViscousPosition { f: f64, k: f64 },
    /// `G dq dq_from`
    SpeedProduct { g: f64, from: usize },
    /// `G dq_from^2`: centrifugal, of a part that the model lacks.
    SpeedSquareFrom { g: f64, from: usize },
    /// `G dq_from dq_other`
    Gyroscopic { g: f64, from: usize, other: usize },
    /// `F (q_from - q0) tanh(dq / v_eps)`: a bearing that another joint's cable loads.
    FrictionPositionFrom { f: f64, q0: f64, v_eps: f64, from: usize },
    /// `K (q - ratio q_from)`, and `-ratio` times it at the other joint: a cable between two joints.
    SpringBetween { k: f64, other: usize, ratio_here: f64, ratio_other: f64 },
    /// A body `J` on a spring `K` with damping `d` hangs on the joint.
    Resonance { j: f64, k: f64, d: f64 },
    /// `A sin(2 pi f t)`: a fan, the mains.
    TorqueWave { a: f64, hz: f64 },
    /// `C command q`
    CommandPosition { c: f64 },
    /// `A sin(2 pi q / (period (1 + growth q)))`: a magnetic detent whose pitch is not constant.
    WanderingDetent { a: f64, period: f64, growth: f64 },
    /// `K t (q - q0)`: a spring that grows stiffer as time goes by.
    StiffnessGrowth { k: f64, q0: f64 },
    /// `F dq_from` at this joint alone, without the reaction at the other.
    ViscousFrom { f: f64, from: usize },
    /// `K q q_from`
    PositionProduct { k: f64, from: usize },
}

/// One law, and what it does at another joint.
type Read = (Outside, Option<(usize, Outside)>);

impl Outside {
    /// The law of that id; `None` for an id of no such law.
    pub(super) fn read(id: &str, joint: usize, values: &Values<'_>) -> Result<Option<Read>, String> {
        let value = |symbol: &str| values.get(symbol);
        let law = match id {
            "viscous_position" => Self::ViscousPosition { f: value("F")?, k: value("k")? },
            "speed_product" => Self::SpeedProduct { g: value("G")?, from: values.from()? },
            "speed_square_from" => Self::SpeedSquareFrom { g: value("G")?, from: values.from()? },
            "gyroscopic" => {
                Self::Gyroscopic { g: value("G")?, from: values.from()?, other: value("other")?.round() as usize }
            }
            "friction_position_from" => Self::FrictionPositionFrom {
                f: value("F")?,
                q0: value("q0")?,
                v_eps: value("v_eps")?,
                from: values.from()?,
            },
            "spring_between" => {
                let (k, ratio, from) = (value("K")?, value("ratio")?, values.from()?);
                let here = Self::SpringBetween { k, other: from, ratio_here: 1.0, ratio_other: -ratio };
                let there = Self::SpringBetween { k, other: joint, ratio_here: -ratio, ratio_other: 1.0 };
                return Ok(Some((here, Some((from, there)))));
            }
            "resonance" => Self::Resonance { j: value("J")?, k: value("K")?, d: value("d")? },
            "torque_wave" => Self::TorqueWave { a: value("A")?, hz: value("hz")? },
            "command_position" => Self::CommandPosition { c: value("C")? },
            "wandering_detent" => {
                Self::WanderingDetent { a: value("A")?, period: value("period")?, growth: value("growth")? }
            }
            "stiffness_growth" => Self::StiffnessGrowth { k: value("K")?, q0: value("q0")? },
            "viscous_from" => Self::ViscousFrom { f: value("F")?, from: values.from()? },
            "position_product" => Self::PositionProduct { k: value("K")?, from: values.from()? },
            _ => return Ok(None),
        };
        Ok(Some((law, None)))
    }

    pub(super) fn n_states(&self) -> usize {
        if matches!(self, Self::Resonance { .. }) { 2 } else { 0 }
    }

    pub(super) fn torque(&self, moment: &Moment<'_>, states: &[f64], rates: &mut [f64]) -> f64 {
        let (q, dq) = (moment.position(), moment.speed());
        match *self {
            Self::ViscousPosition { f, k } => f * (k * q).sin() * dq,
            Self::SpeedProduct { g, from } => g * dq * moment.dq[from],
            Self::SpeedSquareFrom { g, from } => g * moment.dq[from] * moment.dq[from],
            Self::Gyroscopic { g, from, other } => g * moment.dq[from] * moment.dq[other],
            Self::FrictionPositionFrom { f, q0, v_eps, from } => f * (moment.q[from] - q0) * (dq / v_eps).tanh(),
            Self::SpringBetween { k, other, ratio_here, ratio_other } => {
                k * ratio_here * (ratio_here * q + ratio_other * moment.q[other])
            }
            Self::Resonance { j, k, d } => {
                // how far the body runs ahead of the joint, and its own speed
                let (ahead, speed) = (states[0], states[1]);
                let pull = k * ahead + d * (speed - dq);
                rates[0] = speed - dq;
                rates[1] = -pull / j;
                -pull
            }
            Self::TorqueWave { a, hz } => a * (TAU * hz * moment.time).sin(),
            Self::CommandPosition { c } => c * moment.commands[moment.joint] * q,
            Self::WanderingDetent { a, period, growth } => a * (TAU * q / (period * (1.0 + growth * q))).sin(),
            Self::StiffnessGrowth { k, q0 } => k * moment.time * (q - q0),
            Self::ViscousFrom { f, from } => f * moment.dq[from],
            Self::PositionProduct { k, from } => k * q * moment.q[from],
        }
    }
}
