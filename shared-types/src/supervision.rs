//! Who may command, and how each loop is doing.

use crate::{Flag, Header, code, sample};
use iceoryx2::prelude::ZeroCopySend;

code! {
    /// A seat in the data flow; one process fills one role.
    pub enum Role {
        /// Simulated vehicle.
        Plant = 0,
        /// State estimator.
        Estimator = 1,
        /// Position controller.
        Position = 2,
        /// Attitude controller.
        Attitude = 3,
        /// Disturbance injector.
        Disturbance = 4,
        /// Reference and morph schedule, inside the launcher.
        Pilot = 5,
        /// Owner records, inside the launcher.
        Supervisor = 6,
    }
}

impl Role {
    /// Every role that steps, in data-flow order.
    pub const STEPPING: [Self; 6] = [
        Self::Plant,
        Self::Estimator,
        Self::Position,
        Self::Attitude,
        Self::Disturbance,
        Self::Pilot,
    ];

    /// Position in [`Role::STEPPING`].
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// True for a role that steps.
    #[must_use]
    pub const fn is_stepping(self) -> bool {
        self.index() < Self::STEPPING.len()
    }

    /// Lower-case name used for progress services, tables and the command line.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Estimator => "estimator",
            Self::Position => "position",
            Self::Attitude => "attitude",
            Self::Disturbance => "disturbance",
            Self::Pilot => "pilot",
            _ => "supervisor",
        }
    }
}

/// Identity of a publisher, taken from the transport and never from a field the sender fills.
pub type Author = [u64; 2];

sample! {
    /// Who owns a slot from an instant on. Epochs only grow; only the supervisor writes.
    pub struct OwnerRecord {
        /// Identity and time; `valid_ns` is the instant of the change.
        pub header: Header,
        /// Epoch, counted from 1.
        pub epoch: u64,
        /// Publisher whose commands count.
        pub owner: [u64; 2],
        /// Publisher that takes over when the owner falls silent; zeros for none.
        pub fallback: [u64; 2],
        /// Control period of the owner \[ns\].
        pub period_ns: u64,
        /// Slot the record is about: [`Role::Position`] or [`Role::Attitude`].
        pub slot: Role,
        /// Keeps the size a multiple of eight bytes.
        pub reserved: u32,
    }
}

sample! {
    /// Running totals of one loop, published every tenth of a second of logical time.
    pub struct LoopStats {
        /// Identity and time.
        pub header: Header,
        /// Steps run.
        pub steps: u64,
        /// Releases skipped because the loop was late.
        pub skipped: u64,
        /// Late releases that were run after all.
        pub caught_up: u64,
        /// Steps started at their input deadline without final inputs.
        pub input_deadline_misses: u64,
        /// Delayed samples that arrived after the step in which they should have taken effect.
        pub late_samples: u64,
        /// Sequence numbers never received.
        pub lost_samples: u64,
        /// Waits that ended by their wall-clock limit although a wake-up was due.
        pub rescued_waits: u64,
        /// Restarts of the process.
        pub generation: u64,
        /// The loop.
        pub role: Role,
        /// Keeps the size a multiple of eight bytes.
        pub reserved: u32,
    }
}

code! {
    /// In what respect a step departed from what edges and time alone prescribe.
    pub enum DeviationKind {
        /// Samples `first..=last` took effect at this step although an earlier one should have had
        /// them; `due_ns` is the effective instant of the first.
        LateSamples = 0,
        /// Samples `first..=last` never arrived.
        LostSamples = 1,
        /// The step started at its input deadline, before this input was final; `first` deadlines
        /// have passed since the step before.
        MissedDeadline = 2,
        /// Releases `first..=last` of the loop's grid were left out before this step.
        SkippedReleases = 3,
        /// `first` times the loop found a later release past and ran the earlier one all the same.
        CaughtUp = 4,
        /// From sample `first` on, `author` writes the input.
        Writer = 5,
        /// The process has been restarted and went on from the state of release `first`.
        Resumed = 6,
        /// The loop left in order, and sample `last` was the last of this input that it had; 0 if
        /// there was none. What came after it would have been late.
        Ended = 7,
    }
}

sample! {
    /// Where a step's inputs were not what edges and time prescribe. With it a recording tells what
    /// each step has seen: nominally all samples in effect, which need not be written down.
    pub struct Deviation {
        /// Identity and time; `release_ns` is the step's. Each life of a process counts for itself:
        /// the seat is eight times the generation, plus the role.
        pub header: Header,
        /// Writer of the input, as told by the transport; zeros unless the kind is `Writer`.
        pub author: [u64; 2],
        /// First sequence, release or number, see the kind.
        pub first: u64,
        /// Last sequence or release, see the kind; equal to `first` if there is only one.
        pub last: u64,
        /// Instant from which the first late sample should have been in effect \[ns\], else 0.
        pub due_ns: u64,
        /// Topic of the input, padded with zeros; empty if the kind is about the loop as a whole.
        pub input: [u8; 24],
        /// What happened.
        pub kind: DeviationKind,
        /// The loop it happened to.
        pub role: Role,
        /// Seat of the input's writer.
        pub writer_seat: u32,
        /// Keeps the size a multiple of eight bytes.
        pub reserved: u32,
    }
}

impl Deviation {
    /// Topic name as the sample holds it.
    ///
    /// Names of 24 bytes and more are cut; a test keeps the floor plan shorter.
    #[must_use]
    pub fn input_from(name: &str) -> [u8; 24] {
        let mut input = [0; 24];
        for (slot, byte) in input.iter_mut().zip(name.bytes()) {
            *slot = byte;
        }
        input
    }

    /// Name of the input's topic; empty if there is none.
    #[must_use]
    pub fn input_name(&self) -> &str {
        let end = self.input.iter().position(|byte| *byte == 0).unwrap_or(self.input.len());
        core::str::from_utf8(&self.input[..end]).unwrap_or_default()
    }
}

code! {
    /// How the flight's clock runs.
    pub enum ClockMode {
        /// Simulated time, as fast as the processes can.
        Lockstep = 0,
        /// Logical time follows the wall clock.
        Realtime = 1,
    }
}

sample! {
    /// The conductor's word on time. Published seldom; the last one counts.
    pub struct ClockRecord {
        /// Lockstep: steps at or after this instant may not run yet \[ns\].
        pub allowed_ns: u64,
        /// Steps at or after this instant never run \[ns\].
        pub end_ns: u64,
        /// Realtime: `CLOCK_MONOTONIC` at logical time 0 \[ns\].
        pub start_mono_ns: u64,
        /// Realtime: logical seconds per wall second.
        pub speed: f64,
        /// Clock mode.
        pub mode: ClockMode,
        /// Zero until the flight has started.
        pub started: Flag,
        /// Set once everything has been drained: until then a finished process keeps its ports,
        /// for readers that have not connected to them yet.
        pub may_leave: Flag,
        /// Keeps the size a multiple of eight bytes.
        pub reserved: u32,
    }
}

sample! {
    /// How far a process has got: everything released before `mark_ns` is final.
    pub struct Progress {
        /// Instant of the first release not completely published \[ns\].
        pub mark_ns: u64,
        /// Steps run.
        pub steps: u64,
        /// `CLOCK_MONOTONIC` when the mark was published \[ns\].
        pub publish_mono_ns: u64,
        /// Restarts of the process.
        pub generation: u32,
        /// Process id.
        pub pid: u32,
    }
}

sample! {
    /// A process has opened all its ports.
    pub struct Hello {
        /// Publisher of the slot command it would write; zeros if it fills no slot.
        pub command_author: [u64; 2],
        /// Layout of its published state.
        pub state_layout: u64,
        /// Process id.
        pub pid: u32,
        /// Restarts of the process.
        pub generation: u32,
        /// Role it fills.
        pub role: Role,
        /// Keeps the size a multiple of eight bytes.
        pub reserved: u32,
    }
}
