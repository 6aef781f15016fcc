//! The `surflux` command.
fn main() {}
