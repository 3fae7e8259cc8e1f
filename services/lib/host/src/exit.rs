//! Exit codes of the `morphquad` command and of the processes of a run.

/// All went well.
pub const PASS: u8 = 0;
/// A gate failed.
pub const GATE_FAILED: u8 = 1;
/// Wrong usage or configuration.
pub const USAGE: u8 = 2;
/// The environment is unfit or busy.
pub const UNFIT: u8 = 3;
/// A process under test crashed.
pub const CRASHED: u8 = 4;
/// The flight passed, but a swap of its script was refused or taken back.
pub const SWAP_FAILED: u8 = 5;
/// Interrupted by the user.
pub const INTERRUPTED: u8 = 130;
