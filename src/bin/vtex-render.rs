//! The `vtex` command.
fn main() {}
