//! Build dependencies take part in the choice of features only if there is a build script.

fn main() {}
