//! How long the supervisor of a slot waits for what, by each clock.

/// How the slot's time runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Clock {
    /// A record is in time if its instant has not been allowed yet.
    Lockstep,
    /// A record is in time if it is one and a half periods ahead.
    Realtime,
}

/// Times of one slot's supervision. All are logical time \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SlotConfig {
    /// Clock.
    pub clock: Clock,
    /// Lockstep: a flip lies at least this far beyond what is allowed.
    pub margin_ns: u64,
    /// From something the flight did to the answer: in lockstep beyond anything that can have been
    /// allowed by then, so that the answer's instant does not depend on when the supervisor saw it.
    pub react_ns: u64,
    /// From an owner's death to its successor's start, if no other process can take over.
    pub restart_ns: u64,
    /// How long the consumer may be on its own before its owner is taken for useless, beside three of
    /// the owner's periods.
    pub unguided_ns: u64,
    /// From a record's instant until it is written again, if it is not confirmed.
    pub acknowledge_ns: u64,
    /// From the end of a rollback window until the old owner leaves, if that end is confirmed: more than a consumer takes
    /// to report a trip, or to be replaced because it has ignored one.
    pub close_ns: u64,
    /// Flips that are not confirmed so often are taken back.
    pub tries_max: u32,
    /// Standbys lost in a row, or refused, before there shall be none.
    pub standby_losses_max: u32,
    /// An owner that is not trusted has a trusted fallback: the last owner, or the program that the flight began with.
    pub keeps_fallback: bool,
    /// From a rehearsal's instant until its answer is about a flight that is past.
    pub rehearsal_ns: u64,
    /// How long a standby shadows where no request says it: in a slot that was found in flight, and as the fallback of
    /// an owner that is not trusted \[ns\].
    pub standby_shadow_ns: u64,
}

impl SlotConfig {
    /// For simulated time.
    pub const LOCKSTEP: Self = Self {
        clock: Clock::Lockstep,
        margin_ns: 0,
        react_ns: 500_000_000,
        restart_ns: 100_000_000,
        unguided_ns: 200_000_000,
        acknowledge_ns: 500_000_000,
        close_ns: 100_000_000,
        tries_max: 5,
        standby_losses_max: 3,
        keeps_fallback: true,
        rehearsal_ns: 2_000_000_000,
        standby_shadow_ns: 2_000_000_000,
    };
    /// For flights by the wall clock.
    pub const REALTIME: Self = Self {
        clock: Clock::Realtime,
        react_ns: 0,
        restart_ns: 0,
        acknowledge_ns: 100_000_000,
        ..Self::LOCKSTEP
    };
}
