//! Names that data files and the runtime share: where an effect acts ([`Place`]), the stages of a drive path ([`Stage`]) and the
//! symbols of a link's ten inertial parameters ([`LINK_SYMBOLS`]).
//!
//! A crate of its own, so that the equations of motion need not link the reader of TOML files.

/// Where an effect sits: `command -> actuator -> transmission -> joint -> link -> sensor -> log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// Output `torque`: what leaves the actuator when `command` enters it. Signals `command`, `command_from`. At the
    /// stage `delay` the output is `delay`, by how much the command is late, and there are no signals.
    Actuator,
    /// Output `torque` on the joint side; own states on the motor side. `load` is what the actuator delivers.
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

/// The drive path, in its order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// The command arrives late.
    Delay,
    /// Small commands do nothing.
    DeadZone,
    /// Large commands are cut.
    Saturation,
    /// The command is smoothed.
    Lag,
    /// A constant is added to the command.
    Offset,
    /// A part of another joint's command is added.
    Coupling,
    /// From the command's unit to torque.
    Gain,
}

/// Symbols of a link's inertial parameters, in order; parameter names are `link.<number>.<symbol>`.
pub const LINK_SYMBOLS: [&str; 10] = ["m", "x", "y", "z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"];
