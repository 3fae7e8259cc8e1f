//! Nothing but dependencies. Cargo chooses the features of a dependency from the packages that it is asked to
//! build, so that `cargo run`, `cargo test --workspace` and `cargo test -p NAME` would each compile much of what
//! they share once more, and tests would run with other features than the product, such as another parser of
//! floating-point numbers in JSON. Every package depends on this crate, directly or not, and this crate asks for
//! all features that any of them asks for.
