//! Real-time control: virtual walls, and compensation by the identified model. A loop at a kilohertz links this crate alone.
//!
//! - [`Estimator`]: position, velocity and acceleration of now from sampled, quantised positions;
//! - [`Compensation`]: commands that carry gravity, friction and a part of the inertia;
//! - [`Wall`]: a virtual wall at one joint, with its [`Law`] (spring and damper, fuzzy rules, virtual coupling, leaky spring) and
//!   an optional passivity controller; [`PlaneWall`]: such a wall at the end point;
//! - [`RuleTable`] over two [`Partition`]s: fuzzy sets that add up to one, so that at most four rules apply at a time;
//! - [`FilteredVelocity`]: the thesis's velocity filter (Eq. 4.7);
//! - [`largest_inertia_share`]: how much inertia may be compensated in a given hand. Not for use in a tick.
//!
//! These parts do not know each other; a loop adds up their torques. Constructors may fail and allocate; a tick does neither,
//! takes no lock and does not panic (`tests/real_time.rs` counts allocations).

mod compensation;
mod hand_stability;
mod motion_estimator;
mod partition;
mod plane;
mod rules;
mod wall_velocity;
mod walls;

pub use compensation::{Compensation, CompensationError, CompensationRatios};
pub use hand_stability::{Holding, largest_inertia_share};
pub use motion_estimator::Estimator;
pub use partition::{Partition, PartitionError};
pub use plane::{Plane, PlaneError, PlaneWall};
pub use rules::{LinearLaw, RuleTable, RuleTableError};
pub use wall_velocity::FilteredVelocity;
pub use walls::{Law, VirtualTool, Wall, WallError};
