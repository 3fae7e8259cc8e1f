//! Exit codes of the `morphquad` command and of the processes of a run.

/// All went well.
pub const PASS: u8 = 0;
/// The flight failed or the vehicle was lost, or a result is not what it has to be.
pub const FAILED: u8 = 1;
/// Wrong usage or configuration.
pub const USAGE: u8 = 2;
/// The environment is unfit or busy.
pub const UNFIT: u8 = 3;
/// A process crashed that the flight cannot go on without.
pub const CRASHED: u8 = 4;
/// The flight passed, but a swap of its script was refused or taken back.
pub const SWAP_FAILED: u8 = 5;
/// Interrupted by the user.
pub const INTERRUPTED: u8 = 130;
