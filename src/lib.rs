//! dynid.
