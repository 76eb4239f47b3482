//! [`EffectKernel`]: the table entry of one effect, and [`Signal`]: what its formulas may read.

use core::fmt::Debug;

use crate::{Eight, Lanes, Width, kernel::functions};

/// The kernels of one effect. The generic functions behind one that is compiled in are in the effect's module, e.g.
/// `dynid_generated::effect_library::lugre::eval`.
///
/// A slice of a length other than stated makes a kernel return without writing (a debug build asserts).
#[derive(Debug, Clone, Copy)]
pub struct EffectKernel {
    /// Id of the effect.
    pub id: &'static str,
    /// Number of parameters, in the order of the effect's file.
    pub n_parameters: usize,
    /// Number of states.
    pub n_states: usize,
    /// Number of outputs.
    pub n_outputs: usize,
    /// The functions themselves.
    pub functions: &'static dyn EffectFunctions,
}

functions! {
    /// The functions of an [`EffectKernel`]: compiled in, or made while the program runs.
    EffectFunctions, EffectTable {
        /// Outputs and state rates from signals in the order of [`Signal`].
        eval(parameters: &[f64], signals: &[f64], states: &[f64], outputs: &mut [f64], rates: &mut [f64]);
        /// As `eval`, and the Jacobian of (outputs, rates) by (parameters, signals, states), row-major. At a kink it is
        /// the derivative of the branch taken.
        eval_gradient(parameters: &[f64], signals: &[f64], states: &[f64], outputs: &mut [f64], rates: &mut [f64], jacobian: &mut [f64]);
        /// As `eval`, of several joints or states at once.
        eval_lanes(parameters: &[Lanes], signals: &[Lanes], states: &[Lanes], outputs: &mut [Lanes], rates: &mut [Lanes]);
        /// As `eval`, of eight: parameters, signals and states stand one behind the other, as do outputs and rates.
        eval_of_eight(width: Width, given: &[Eight], results: &mut [Eight]);
        /// As `eval_gradient`, of several joints or states at once.
        eval_gradient_lanes(parameters: &[Lanes], signals: &[Lanes], states: &[Lanes], outputs: &mut [Lanes], rates: &mut [Lanes], jacobian: &mut [Lanes]);
    }
}

/// Number of signals: the length of the slice that effects read.
pub const N_SIGNALS: usize = 11;

/// What an effect may read, by its place in the slice of signals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Signal {
    /// Position of the joint (rad or m).
    Q,
    /// Its velocity.
    Dq,
    /// Its acceleration.
    Ddq,
    /// Time (s).
    T,
    /// Torque that the drive path delivers to the joint (N*m or N).
    Load,
    /// Sum of the joint's friction laws (N*m or N).
    Friction,
    /// Rest position of the joint's spring; 0 without one.
    Qeq,
    /// Position of the other joint of a pair.
    QFrom,
    /// Its velocity.
    DqFrom,
    /// Torque commanded at the joint (N*m or N).
    Command,
    /// Torque commanded at the other joint of a pair.
    CommandFrom,
}
