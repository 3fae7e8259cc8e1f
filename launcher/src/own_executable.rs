//! This executable, as a child is started from it.

/// The file that runs, which the kernel holds even after a build has replaced or removed it: every process
/// of a flight stays of one build, and a flight in the air can still rehearse and restart. A process that is
/// started by this path is called `exe` until it names itself, as `main` does first.
pub(crate) const OWN_EXECUTABLE: &str = "/proc/self/exe";
