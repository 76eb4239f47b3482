//! What runs in a controller's loop of a kilohertz: walls, and the identified model that carries the device.
//!
//! What is built once may fail and allocate; a tick does neither, takes no lock and does not panic.

mod compensation;
mod estimator;
mod hand_stability;
mod partition;
mod plane;
mod rules;
mod velocity;
mod walls;

pub use compensation::{Compensation, CompensationError, CompensationRatios};
pub use estimator::Estimator;
pub use hand_stability::{Holding, largest_inertia_share};
pub use partition::{Partition, PartitionError};
pub use plane::{Plane, PlaneError, PlaneWall};
pub use rules::{LinearLaw, RuleTable, RuleTableError};
pub use velocity::FilteredVelocity;
pub use walls::{Law, VirtualTool, Wall, WallError};
