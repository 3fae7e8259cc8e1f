//! What a flight needs of the machine, whatever its scenario.

/// What the rings of a flight add up to once every one has gone round \[MB\].
pub const SHARED_MEMORY_MB: u64 = 160;

/// File descriptors that a launcher may have open at once: with a candidate in each slot 657 were counted.
pub const DESCRIPTORS: u64 = 768;
