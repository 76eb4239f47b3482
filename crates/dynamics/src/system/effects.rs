//! An effect of a model, ready to be placed into a [`super::System`].

use dynid_generated::{EffectKernel, Signal};
use dynid_signal_chain::{LINK_SYMBOLS, Place, Stage};

use super::SystemError;

/// One effect with its values, as a model gives it.
#[derive(Clone)]
pub struct PlacedEffect {
    /// Its formula.
    pub kernel: &'static EffectKernel,
    /// Where it sits on the signal chain.
    pub place: Place,
    /// Where on the drive path an actuator effect acts.
    pub stage: Option<Stage>,
    /// Whether it belongs to the friction family, whose sum at a joint is the signal `friction` of the others.
    pub is_friction: bool,
    /// The joint it acts on.
    pub joint: Option<usize>,
    /// The other joint of a pair.
    pub from: Option<usize>,
    /// Full parameter names, in the kernel's order.
    pub names: Vec<String>,
    /// Their values.
    pub parameters: Vec<f64>,
    /// Full names of the states.
    pub state_names: Vec<String>,
    /// States at the start of a run.
    pub initial_states: Vec<f64>,
    /// Those states that start at the speed of the joint instead.
    pub states_at_speed: Vec<usize>,
    /// Number (from 1) of the link that a body of a link effect joins.
    pub link: Option<usize>,
    /// What the kernel's outputs are, in its order.
    pub outputs: Vec<Output>,
    /// The signals that occur in its formulas.
    pub uses: SignalSet,
}

/// What an output of an effect is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// Torque on, or into, the joint.
    Torque,
    /// Torque on the other joint of a pair.
    TorqueFrom,
    /// Added to D.
    Inertia,
    /// What the log shows.
    Position,
    /// By how much the command is late (s).
    Delay,
    /// A number of a body that joins a link, by its place in [`LINK_SYMBOLS`].
    Body(usize),
    /// Something a simulation does not use.
    Other,
}

impl Output {
    /// By its name in an effect file.
    pub fn named(name: &str) -> Self {
        match name {
            "torque" => Self::Torque,
            "torque_from" => Self::TorqueFrom,
            "inertia" => Self::Inertia,
            "position" => Self::Position,
            "delay" => Self::Delay,
            _ => LINK_SYMBOLS.iter().position(|symbol| *symbol == name).map_or(Self::Other, Self::Body),
        }
    }
}

/// A set of signals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignalSet(u16);

impl SignalSet {
    /// The set of these signals.
    pub fn of(signals: &[Signal]) -> Self {
        Self(signals.iter().fold(0, |set, signal| set | 1 << (*signal as u16)))
    }

    /// The signal that `name` stands for in an effect file.
    pub fn named(name: &str) -> Option<Self> {
        let signal = match name {
            "q" => Signal::Q,
            "dq" => Signal::Dq,
            "ddq" => Signal::Ddq,
            "t" => Signal::T,
            "load" => Signal::Load,
            "friction" => Signal::Friction,
            "qeq" => Signal::Qeq,
            "q_from" => Signal::QFrom,
            "dq_from" => Signal::DqFrom,
            "command" => Signal::Command,
            "command_from" => Signal::CommandFrom,
            _ => return None,
        };
        Some(Self::of(&[signal]))
    }

    /// Both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether `signal` is in the set.
    pub fn contains(self, signal: Signal) -> bool {
        self.0 & Self::of(&[signal]).0 != 0
    }

    /// Whether none of these is in the set.
    pub fn excludes(self, signals: &[Signal]) -> bool {
        self.0 & Self::of(signals).0 == 0
    }

    /// Whether nothing but these is in the set.
    pub fn only(self, signals: &[Signal]) -> bool {
        self.0 & !Self::of(signals).0 == 0
    }
}

impl PlacedEffect {
    /// Whether its formulas hang on how the joints move, and not on commands and time alone.
    pub fn reads_motion(&self) -> bool {
        !self.uses.only(&[Signal::Command, Signal::CommandFrom, Signal::T])
    }

    /// Index of the first output of this kind.
    pub(super) fn output(&self, kind: Output) -> Option<usize> {
        self.outputs.iter().position(|output| *output == kind)
    }

    pub(super) fn check(&self) -> Result<(), SystemError> {
        let lengths = [
            ("parameters of an effect", self.parameters.len(), self.kernel.n_parameters),
            ("parameter names of an effect", self.names.len(), self.kernel.n_parameters),
            ("initial states of an effect", self.initial_states.len(), self.kernel.n_states),
            ("state names of an effect", self.state_names.len(), self.kernel.n_states),
            ("outputs of an effect", self.outputs.len(), self.kernel.n_outputs),
        ];
        for (what, found, expected) in lengths {
            if found != expected {
                return Err(SystemError::Length { what, found, expected });
            }
        }
        if self.kernel.n_outputs > super::MAX_OUTPUTS {
            return Err(SystemError::Length {
                what: "outputs of an effect",
                found: self.kernel.n_outputs,
                expected: super::MAX_OUTPUTS,
            });
        }
        Ok(())
    }
}
