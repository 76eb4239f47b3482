//! One physical effect: a formula with parameters that vanishes at its null value.

use crate::{Expression, expression::Comparison};

/// An effect as its file describes it, checked.
#[derive(Debug, Clone)]
pub struct Effect {
    /// The file's stem, e.g. `lugre`.
    pub id: String,
    /// One line for people.
    pub title: String,
    /// Where on the signal chain it sits.
    pub place: Place,
    /// One joint, an ordered pair, or the device.
    pub scope: Scope,
    /// `friction` marks laws whose sum at a joint is its friction (what `friction_bias` scales); members of one
    /// `alternatives` group replace each other when added.
    pub family: Option<String>,
    /// Parameters in the order in which kernels take them.
    pub parameters: Vec<EffectParameter>,
    /// Own states, integrated along.
    pub states: Vec<EffectState>,
    /// Named intermediate terms, in order.
    pub terms: Vec<(String, Expression)>,
    /// What the place asks for: output name and formula (see [`Place`]).
    pub outputs: Vec<(String, Expression)>,
    /// Linear inequalities between parameters, e.g. `Fs > Fc` (thesis Eq. 4.1).
    pub inequalities: Vec<(String, Comparison, String)>,
    /// What the residual looks like when this effect is missing.
    pub seen_as: String,
    /// What it is mistaken for.
    pub not_seen_as: String,
    /// Where the equation comes from.
    pub source: String,
}

/// Where an effect sits: `command -> actuator -> transmission -> joint -> link -> sensor -> log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// Output `torque`: what leaves the actuator when `command` enters it. Signals `command`, `command_from`.
    Actuator,
    /// Output `torque` on the joint side; own states on the motor side.
    Transmission,
    /// Output `torque`: load torque that resists motion when positive along `dq`. Signals `q dq t load` (torque that
    /// the drive path delivers), `friction` (sum of the joint's friction laws), `qeq` (the joint's spring's rest
    /// position, 0 without a spring). A pair has `q_from dq_from` and output `torque_from`.
    Joint,
    /// Outputs `inertia` (added to the joint's diagonal entry of D) or, for a pair, `inertia` (added to both
    /// off-diagonal entries); or a change of one link's inertial parameters (`m`, `x`, .., `Izz` of a body to be
    /// merged into the last link that the joint moves).
    Link,
    /// Output `position`: what the log shows when the true position is `q`.
    Sensor,
}

/// What an effect is attached to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scope {
    /// `joint = i`
    Joint,
    /// `from = j`, `joint = i`
    Pair,
    /// neither
    Device,
}

/// A parameter of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectParameter {
    /// E.g. `sigma0`. Its parameter name is `joint.<i>.<effect>.<symbol>` or `joint.<i>.<effect>.<from>.<symbol>`.
    pub symbol: String,
    /// SI unit at a revolute joint, e.g. `N*m*s/rad`.
    pub unit: String,
    /// What it means.
    pub title: String,
    /// First guess.
    pub initial: f64,
    /// Default bounds.
    pub lower: f64,
    /// Default bounds.
    pub upper: f64,
    /// The value at which the effect vanishes; `None` for a parameter that does not matter then.
    pub null: Option<f64>,
    /// True where the law is known to be a numerical choice (e.g. `v_eps`) that no fit should move.
    pub fixed: bool,
}

/// A state of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectState {
    /// E.g. `z`; its rate is the output `rate_z`... named here.
    pub symbol: String,
    /// Unit at a revolute joint.
    pub unit: String,
    /// Value at the start of a run.
    pub initial: f64,
    /// Its time derivative.
    pub rate: Expression,
}
