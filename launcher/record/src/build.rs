//! What the executable was built from.

use std::sync::OnceLock;

/// Of a build.
#[derive(Debug, Clone, Copy)]
pub struct Build {
    /// Commit, as `git describe --always --dirty` names it.
    pub git: &'static str,
    /// Compiler.
    pub rustc: &'static str,
    /// Name and version of each crate that may change a flight's numbers or its recording.
    pub crates: &'static str,
}

static BUILD: OnceLock<Build> = OnceLock::new();

/// Sets it, once, before anything else: only the executable knows, for a library that knew would be
/// rebuilt with every commit.
pub fn declare(build: Build) {
    BUILD.get_or_init(|| build);
}

/// As declared; `unknown` within a program that has declared nothing, such as a unit test.
#[must_use]
pub fn declared() -> Build {
    let unknown = "unknown";
    BUILD.get().copied().unwrap_or(Build { git: unknown, rustc: unknown, crates: unknown })
}
