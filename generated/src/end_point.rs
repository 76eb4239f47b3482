//! [`EndPoint`]: the table entry of a device's end point (its kinematics).

use crate::Operations;

/// Where the end point of a device is and how it moves, for `f64`; the generic functions behind it are in the device's
/// module `end_point`. All vectors stand in base axes.
///
/// A slice of a length other than stated makes a function return without writing (a debug build asserts).
#[derive(Debug, Clone, Copy)]
#[allow(clippy::type_complexity)]
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
    /// Position (3) and the rotation from the point's frame to the base's (3 x 3) at the positions of all joints.
    pub pose: fn(lengths: &[f64], q: &[f64], position: &mut [f64], rotation: &mut [f64]),
    /// As `pose`, and the Jacobian (6 x n): rows of velocity, then of angular velocity, for a unit of each joint's speed.
    pub motion: fn(lengths: &[f64], q: &[f64], position: &mut [f64], rotation: &mut [f64], jacobian: &mut [f64]),
}
