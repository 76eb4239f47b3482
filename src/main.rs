//! The `dynid` command.
fn main() {}
