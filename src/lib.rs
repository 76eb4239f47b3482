//! dynid.
pub mod fit;
pub mod simulate;
pub mod system;
