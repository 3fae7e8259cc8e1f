//! The `morphquad` executable: the launcher, and every process it starts.

fn main() {}
