//! Which processes there are, which seats may command, and how time runs.

use crate::{Flag, Header, code, sample};

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
        /// Reference and morph schedule.
        Pilot = 5,
        /// Judge of owners that have not proven themselves.
        Monitor = 6,
        /// Owner records, inside the launcher.
        Supervisor = 7,
    }
}

/// Label and number of seats of every role, in the order of their codes.
const ROLES: [(Role, &str, u32); 8] = [
    (Role::Plant, "plant", 1),
    (Role::Estimator, "estimator", 1),
    (Role::Position, "position", 4),
    (Role::Attitude, "attitude", 4),
    (Role::Disturbance, "disturbance", 1),
    (Role::Pilot, "pilot", 1),
    (Role::Monitor, "monitor", 1),
    (Role::Supervisor, "supervisor", 1),
];

// What finds a role by its code, and the numbers of its seats, depend on this.
const _: () = {
    let mut code = 0;
    while code < ROLES.len() {
        assert!(ROLES[code].0.index() == code && ROLES[code].2 as usize <= SEATS);
        assert!(code >= Role::STEPPING.len() || Role::STEPPING[code].index() == code);
        code += 1;
    }
};

impl Role {
    /// Every role that steps, in data-flow order.
    pub const STEPPING: [Self; 7] = [
        Self::Plant,
        Self::Estimator,
        Self::Position,
        Self::Attitude,
        Self::Disturbance,
        Self::Pilot,
        Self::Monitor,
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

    /// How many processes may take part in the role at once: a slot has an owner, a fallback and room
    /// for two that are about to be either.
    #[must_use]
    pub const fn seats(self) -> u32 {
        self.info().2
    }

    /// What is known of it; of a code from elsewhere that no role has, what is known of the last one.
    const fn info(self) -> &'static (Self, &'static str, u32) {
        const LAST: usize = ROLES.len() - 1;
        &ROLES[if self.index() < LAST { self.index() } else { LAST }]
    }

    /// True for a role whose owner can change.
    #[must_use]
    pub const fn is_slot(self) -> bool {
        self.seats() > 1
    }

    /// Lower-case name used for progress services, tables and the command line.
    #[must_use]
    pub const fn label(self) -> &'static str {
        self.info().1
    }
}

/// Most seats that a role has, see [`Role::seats`].
pub const SEATS: usize = 4;

/// No seat at all.
pub const NO_SEAT: u32 = u32::MAX;

/// A place that a process takes in the data flow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Seat {
    /// What is done there.
    pub role: Role,
    /// Which of the role's seats, below [`Role::seats`].
    pub index: u32,
}

impl Seat {
    /// The seat that a role's process takes at the start.
    #[must_use]
    pub const fn first(role: Role) -> Self {
        Self { role, index: 0 }
    }

    /// How many numbers seats have, see [`Seat::number`]: each role that steps has as many as any.
    pub const COUNT: usize = Role::STEPPING.len() * SEATS;

    /// How many seats there are, of all roles that step together.
    pub const TOTAL: usize = {
        let (mut total, mut index) = (0, 0);
        while index < Role::STEPPING.len() {
            total += Role::STEPPING[index].seats() as usize;
            index += 1;
        }
        total
    };

    /// Place of this seat among [`Seat::COUNT`]; none of a role that does not step.
    #[must_use]
    pub fn number(self) -> Option<usize> {
        let index = usize::try_from(self.index).ok().filter(|index| *index < SEATS)?;
        self.role.is_stepping().then(|| self.role.index() * SEATS + index)
    }

    /// All seats of a role.
    pub fn all(role: Role) -> impl Iterator<Item = Self> {
        (0..role.seats()).map(move |index| Self { role, index })
    }

    /// Name for services and tables: `attitude` for the first seat, then `attitude-1`.
    #[must_use]
    pub fn label(self) -> String {
        match self.index {
            0 => self.role.label().to_owned(),
            index => format!("{}-{index}", self.role.label()),
        }
    }
}

/// A process as the transport knows it, whatever it claims to be.
pub type NodeId = [u64; 2];

sample! {
    /// Which process sits where: one line of the [`Registry`].
    pub struct RegistryEntry {
        /// The process, as reported by the transport.
        pub node: [u64; 2],
        /// Its control period \[ns\].
        pub period_ns: u64,
        /// What it does.
        pub role: Role,
        /// Its seat.
        pub seat: u32,
        /// How many processes have had the seat before it.
        pub generation: u32,
        /// Set while it sits there; what it sent before it left still counts.
        pub present: Flag,
    }
}

/// Lines of the registry; the oldest of processes that have left make room.
pub const REGISTRY_LINES: usize = 64;

sample! {
    /// Every process that may publish. Written by the supervisor alone, which has received the [`Hello`] of each.
    pub struct Registry {
        /// The lines in use come first.
        pub entries: [RegistryEntry; 64],
        /// How many are in use.
        pub count: u64,
    }
}

sample! {
    /// Which seats command a slot from an instant on. Epochs only grow; only the supervisor writes.
    ///
    /// A command counts if its writer sits on the owner's seat by the record in effect at the
    /// command's own effective instant.
    pub struct OwnerRecord {
        /// Identity and time; `valid_ns` is the instant of the change.
        pub header: Header,
        /// Epoch, counted from 1.
        pub epoch: u64,
        /// Control period of the controller on each seat \[ns\]; 0 if the seat is free.
        pub period_ns: [u64; 4],
        /// Seat whose commands count.
        pub owner: u32,
        /// Seat that takes over when the owner falls silent; [`NO_SEAT`] for none.
        pub fallback: u32,
        /// Slot the record is about: [`Role::Position`] or [`Role::Attitude`].
        pub slot: Role,
        /// The owner is of another kind than its predecessor: consumers limit the step between them.
        pub kind_changed: Flag,
        /// The owner has not proven itself: the monitor judges it, and a trip of it counts.
        pub watched: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
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
    /// The conductor's settings of the clock. Published seldom; the last one counts.
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
        #[padding]
        pub reserved: u32,
    }
}

sample! {
    /// How far a process has got: everything released before `mark_ns` is final.
    pub struct Progress {
        /// Instant of the first release not completely published \[ns\].
        pub mark_ns: u64,
        /// Nothing that another loop waits for is published for a release before this instant, beyond what has been;
        /// 0, or any instant before the mark, stands for the mark \[ns\].
        pub quiet_until_ns: u64,
        /// Steps run.
        pub steps: u64,
        /// `CLOCK_MONOTONIC` before every reader that had its ports open was given what had been published \[ns\]. A
        /// reader that has opened its own later may not have what this mark promises. 0 if the
        /// writer does not report it.
        pub served_mono_ns: u64,
        /// Restarts of the process.
        pub generation: u32,
        /// Process id.
        pub pid: u32,
    }
}

sample! {
    /// A process has opened all its ports.
    pub struct Hello {
        /// Layout of its published state.
        pub state_layout: u64,
        /// Its period \[ns\].
        pub period_ns: u64,
        /// Process id.
        pub pid: u32,
        /// Restarts of the process.
        pub generation: u32,
        /// Role it fills.
        pub role: Role,
        /// Seat it takes.
        pub seat: u32,
    }
}

sample! {
    /// The orders for a process that takes a seat in flight, sent ahead of the state it continues from.
    pub struct Handover {
        /// First instant at which it may step \[ns\]; 0 if it goes on right after the state.
        pub join_ns: u64,
        /// Until then it follows the slot's owner before each step, see `Service::track` \[ns\].
        pub track_until_ns: u64,
        /// The state of a process of its own kind follows.
        pub has_state: Flag,
        /// Realtime: the releases since that state are run at once, on the history of their inputs.
        pub catches_up: Flag,
        /// By [`Seat::number`], generation of the first process whose samples are taken. Whether
        /// samples of one that has gone before would still arrive depends on chance.
        pub first_generations: [u32; Seat::COUNT],
    }
}
