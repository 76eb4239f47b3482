//! Why no wall can be met.

use super::Approach;
use dynid_dynamics::system::SystemError;

/// Why no contact could be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WallError {
    /// The model makes no equations.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The closed loop leaves all bounds.
    #[error(
        "the closed loop diverges at {time_s:.3} s at joint {joint}: the wall's gains, or what is carried of the device, are too \
         high for this sample time (lower them, or sample faster), or the simulation's steps too long (`step_s` of the setting)"
    )]
    Diverged {
        /// When (s).
        time_s: f64,
        /// The device's joint index.
        joint: usize,
    },
    /// The same, of one case among several.
    #[error("wall `{wall}`, {approach} approach, {hand}: {source}")]
    Case {
        /// The wall's name.
        wall: String,
        /// The approach's.
        approach: String,
        /// Which hand, in words.
        hand: String,
        /// What happened.
        source: Box<Self>,
    },
    /// Nobody can hold the device.
    #[error(transparent)]
    Kinematics(#[from] dynid_dynamics::kinematics::KinematicsError),
    /// No contact can start there.
    #[error(transparent)]
    Start(#[from] StartError),
    /// A plane that cannot be felt.
    #[error(transparent)]
    Plane(#[from] dynid_control::PlaneError),
    /// A model that cannot be carried.
    #[error(transparent)]
    Compensation(#[from] dynid_control::CompensationError),
    /// The device's own input is late, beside the controller's delay.
    #[error(
        "joint {joint}: the model's command arrives {span_s} s late (input_delay), which a wall is not simulated with; take the \
         effect out, and add as many samples to `delay_samples` of the setting"
    )]
    Late {
        /// The device's joint index.
        joint: usize,
        /// By how much (s).
        span_s: f64,
    },
    /// Nothing that is commanded reaches the joint.
    #[error("the model's drive lets no torque pass to joint {joint}: give its gain a value other than 0")]
    NoDrive {
        /// The device's joint index.
        joint: usize,
    },
}

impl WallError {
    /// Says in which case the loop diverged; `hand` is its number, or none for the typical one. What else is wrong is so in all
    /// cases.
    #[must_use]
    pub fn in_case(self, wall: &str, approach: &Approach, hand: Option<usize>) -> Self {
        let Self::Diverged { .. } = self else { return self };
        let hand = hand.map_or_else(|| "the typical hand".to_owned(), |hand| format!("hand {hand}"));
        Self::Case { wall: wall.to_owned(), approach: approach.name.clone(), hand, source: Box::new(self) }
    }
}

/// Why nothing can start at a posture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// The end point is in the wall.
    #[error("the end point starts {:.4} m inside of the wall; start outside, on the side that the normal points to", -distance)]
    Inside {
        /// From the plane (m).
        distance: f64,
    },
    /// The point cannot be moved along the normal.
    #[error(
        "at the start no joint moves the end point along the plane's normal, so the wall cannot be met; take another normal, or \
         another posture"
    )]
    Unreachable,
    /// The hand cannot hold the device.
    #[error(
        "the start is a singular posture: some motion of the joints moves the handle {ratio:.1e} times as much as another; the \
         hand could not hold it (bend the arm and the wrist)"
    )]
    Singular {
        /// Smallest over largest singular value of the Jacobian.
        ratio: f64,
    },
}
