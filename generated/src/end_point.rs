//! [`EndPoint`]: the table entry of a device's end point (its kinematics).

use core::fmt::Debug;

use crate::{Operations, kernel::functions};

/// Where the end point of a device is and how it moves, for `f64`. The generic functions behind one that is compiled in are in
/// the device's module `end_point`. All vectors stand in base axes.
///
/// A slice of a length other than stated makes a function return without writing (a debug build asserts).
#[derive(Debug, Clone, Copy)]
pub struct EndPoint {
    /// Id of the device.
    pub device: &'static str,
    /// The frame that the point is fixed to.
    pub frame: &'static str,
    /// Number of the device's joints: the length of `q`.
    pub n_joints: usize,
    /// Names of the lengths that the functions take, in order.
    pub parameters: &'static [&'static str],
    /// What each function costs.
    pub operations: &'static [Operations],
    /// The functions themselves.
    pub functions: &'static dyn EndPointFunctions,
}

functions! {
    /// The functions of an [`EndPoint`]: compiled in, or made while the program runs.
    EndPointFunctions, EndPointTable {
        /// Position (3) and the rotation from the point's frame to the base's (3 x 3) at the positions of all joints.
        pose(lengths: &[f64], q: &[f64], position: &mut [f64], rotation: &mut [f64]);
        /// As `pose`, and the Jacobian (6 x n): rows of velocity, then of angular velocity, for a unit of each joint's speed.
        motion(lengths: &[f64], q: &[f64], position: &mut [f64], rotation: &mut [f64], jacobian: &mut [f64]);
    }
}
