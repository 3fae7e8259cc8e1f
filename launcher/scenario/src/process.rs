//! What the processes of a flight are started from.

/// This executable, as a child is started from it: the file that runs, which the kernel holds even after a build
/// has replaced or removed it. Every process of a flight stays of one build, and a running flight can still
/// rehearse and restart. A process that is started by this path is called `exe` until it names itself, as `main`
/// does first.
pub const OWN_EXECUTABLE: &str = "/proc/self/exe";
