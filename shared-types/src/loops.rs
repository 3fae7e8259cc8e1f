//! supervisor -> recorder: what loops have run and missed, and how their processes begin.

use crate::{Flag, Header, Role, code, sample};

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
        #[machine]
        pub rescued_waits: u64,
        /// Restarts of the process.
        #[machine]
        pub generation: u64,
        /// Realtime: allocations since the loop was warm; 0 if they are not counted.
        #[machine]
        pub allocations: u64,
        /// Realtime: allocations of the transport meanwhile, not counted above: one for each sample sent.
        #[machine]
        pub transport_allocations: u64,
        /// Realtime: page faults since the loop was warm that memory resolved.
        #[machine]
        pub minor_faults: u64,
        /// Realtime: page faults since the loop was warm that waited for a disk.
        #[machine]
        pub major_faults: u64,
        /// Allocations meanwhile in stretches next to a change of the registry, not counted above.
        #[machine]
        pub allocations_at_changes: u64,
        /// Page faults in such stretches, not counted above.
        #[machine]
        pub faults_at_changes: u64,
        /// The loop.
        pub role: Role,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
    }
}

code! {
    /// In what respect a step departed from what edges and time alone prescribe.
    pub enum DeviationKind {
        /// Samples `first..=last` took effect at this step although an earlier one should have had
        /// them; `due_ns` is the effective instant of the first.
        LateSamples = 0,
        /// Samples `first..=last` never arrived. With `due_ns` their writer did not count for some of the time until then,
        /// so that no loop waited for them, and none is missed.
        LostSamples = 1,
        /// The step started at its input deadline, before this input was final; `first` deadlines
        /// have passed since the step before.
        MissedDeadline = 2,
        /// Releases `first..=last` of the loop's grid were left out before this step.
        SkippedReleases = 3,
        /// `first` times the loop found a later release past and ran the earlier one all the same.
        CaughtUp = 4,
        /// The process has been restarted and went on from the state of release `first`.
        Resumed = 5,
        /// The loop left in order, another process follows on the writer's seat, or the writer had gone when the loop
        /// began in flight, and sample `last` was the last of this writer that the loop had; 0 if there was none at
        /// all. What came after it would have been late.
        Ended = 6,
        /// Sample `first` was the first of this writer that the loop had; the writer may have published others
        /// before. A process that went on from a state or joined in flight reports it of every
        /// writer whose samples it takes at all, with 0 if it had one before its first step; any
        /// process reports it where another one follows on the writer's seat.
        Began = 7,
    }
}

sample! {
    /// Where a step's inputs were not what edges and time prescribe. With it a recording shows what
    /// each step has seen: nominally all samples in effect, which need not be written down.
    pub struct Deviation {
        /// Identity and time; `release_ns` is the step's. Each life of a process counts for itself:
        /// the seat encodes role, seat and generation.
        pub header: Header,
        /// First sequence, release or number, see the kind.
        pub first: u64,
        /// Last sequence or release, see the kind; equal to `first` if there is only one.
        pub last: u64,
        /// Instant from which the first late sample should have been in effect, or from which the writer of lost ones
        /// counts again \[ns\]; else 0.
        pub due_ns: u64,
        /// Topic of the input, padded with zeros; empty if the kind is about the loop as a whole.
        #[topic]
        pub input: [u8; 24],
        /// What happened.
        pub kind: DeviationKind,
        /// The loop it happened to.
        pub role: Role,
        /// Seat of the input's writer.
        pub writer_seat: u32,
        /// How many processes had that seat before it; 0 where a restarted writer goes on with the numbers.
        #[machine]
        pub writer_generation: u32,
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
    /// What a [`Seating`] reports.
    pub enum SeatingKind {
        /// A process begins in flight.
        Joined = 0,
        /// The process is not waited for any more: it was killed, stopped, or died.
        Lost = 1,
    }
}

sample! {
    /// A process that takes a slot's seat in flight, and how it begins; or its end, unless it leaves in
    /// order and reports it itself. A process that begins with the flight is in the scenario.
    pub struct Seating {
        /// Identity and time of the joining, or of the loss. Each life counts for itself, as in
        /// [`Deviation`].
        pub header: Header,
        /// First instant at which it may step \[ns\]; 0 if it goes on right after its state.
        pub join_ns: u64,
        /// Until then it follows what its slot applies \[ns\].
        pub track_until_ns: u64,
        /// Release of the state that it goes on from, in the grid of its writer.
        pub state_release: u64,
        /// Name of the controller, padded with zeros.
        pub controller: [u8; 64],
        /// What is reported.
        pub kind: SeatingKind,
        /// The slot.
        pub role: Role,
        /// The seat.
        pub seat: u32,
        /// How many processes had the seat before.
        #[machine]
        pub generation: u32,
        /// There is a state to go on from.
        pub has_state: Flag,
        /// Seat whose process published that state.
        pub state_seat: u32,
        /// Generation of that process.
        pub state_generation: u32,
        /// Realtime: it first runs the releases that it has missed.
        pub catches_up: Flag,
        /// The controller is a service of the executable, not an executable of its own.
        pub built_in: Flag,
        /// It has a scenario of its own to configure it.
        pub configured: Flag,
    }
}

impl Seating {
    /// Name of a controller as the sample holds it; longer ones are cut.
    #[must_use]
    pub fn controller_from(name: &str) -> [u8; 64] {
        let mut controller = [0; 64];
        for (slot, byte) in controller.iter_mut().zip(name.bytes()) {
            *slot = byte;
        }
        controller
    }

    /// Name of the controller.
    #[must_use]
    pub fn controller_name(&self) -> &str {
        let end = self.controller.iter().position(|byte| *byte == 0);
        let name = &self.controller[..end.unwrap_or(self.controller.len())];
        core::str::from_utf8(name).unwrap_or_default()
    }
}
