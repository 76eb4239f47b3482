//! Control laws for a loop of a kilohertz: what is built once may fail and allocate, a tick does neither.

mod partition;
mod rules;
mod velocity;
mod walls;

pub use partition::{Partition, PartitionError};
pub use rules::{LinearLaw, RuleTable, RuleTableError};
pub use velocity::FilteredVelocity;
pub use walls::{Law, VirtualTool, Wall, WallError};
