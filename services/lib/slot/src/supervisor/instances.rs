//! Which process sits where, from the supervisor's side.

use crate::record::{SEATS, Seat};

/// An executable with its configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Program {
    /// Its place in the launcher's own list.
    pub number: u32,
    /// It may command its slot alone. Any other is watched for as long as it commands, whatever made it the owner, and
    /// has a trusted fallback.
    pub is_trusted: bool,
}

/// A process that has connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Instance {
    /// Hash of its state's layout: two of one layout are of one kind.
    pub layout: u64,
    /// Its rate \[mHz\]; 0 for one without a grid of its own.
    pub millihertz: u64,
    /// From its release to its command's effect \[ns\].
    pub latency_ns: u64,
}

/// State of the instance on a seat.
///
/// ```text
///   Free ──Spawn──▶ Starting ──Ready──▶ Seated ──retired──▶ Leaving
///    ▲                 │ Kill             │ Kill               │ Kill, if it stays
///    │                 ▼                  ▼                    ▼
///    └──────Died───── Dying ◀─────────────┴────────────────────┘
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum InstanceState {
    Free,
    Starting(Program),
    Seated(Program, Instance),
    Leaving(Program),
    Dying(Program),
}

impl InstanceState {
    pub(super) fn instance(&self) -> Option<&Instance> {
        match self {
            Self::Seated(_, instance) => Some(instance),
            _ => None,
        }
    }

    pub(super) fn program(&self) -> Option<Program> {
        match *self {
            Self::Free => None,
            Self::Starting(program)
            | Self::Seated(program, _)
            | Self::Leaving(program)
            | Self::Dying(program) => Some(program),
        }
    }
}

/// The instances of a slot, by seat.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Instances {
    states: [InstanceState; SEATS],
    /// First epoch in which the process that is there can have commanded.
    since: [u64; SEATS],
}

impl Instances {
    pub(super) fn new(states: [InstanceState; SEATS]) -> Self {
        Self { states, since: [0; SEATS] }
    }

    /// A process has connected; the record of `epoch` will be the first that knows it.
    pub(super) fn seat(&mut self, seat: Seat, program: Program, instance: Instance, epoch: u64) {
        self.set(seat, InstanceState::Seated(program, instance));
        self.since[seat.index()] = epoch;
    }

    pub(super) fn since(&self, seat: Seat) -> u64 {
        self.since[seat.index()]
    }

    pub(super) fn state(&self, seat: Seat) -> &InstanceState {
        &self.states[seat.index()]
    }

    pub(super) fn set(&mut self, seat: Seat, state: InstanceState) {
        self.states[seat.index()] = state;
    }

    pub(super) fn instance(&self, seat: Seat) -> Option<&Instance> {
        self.state(seat).instance()
    }

    pub(super) fn is_seated(&self, seat: Seat) -> bool {
        self.instance(seat).is_some()
    }

    pub(super) fn free(&self) -> Option<Seat> {
        Seat::ALL.into_iter().find(|seat| *self.state(*seat) == InstanceState::Free)
    }

    pub(super) fn layout(&self, seat: Seat) -> Option<u64> {
        self.instance(seat).map(|instance| instance.layout)
    }

    pub(super) fn period_ns(&self, seat: Seat) -> u64 {
        self.instance(seat).map_or(0, Instance::period_ns)
    }

    pub(super) fn periods_ns(&self) -> [u64; SEATS] {
        self.states.map(|state| state.instance().map_or(0, Instance::period_ns))
    }
}

/// Release grids count in thousandths of a hertz, so one second is this many \[mHz ns\].
const SECOND: u128 = 1_000_000_000_000;

impl Instance {
    /// Longest time between two of its releases \[ns\].
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        let rate = u128::from(self.millihertz);
        // A period of 0 would mean that no process sits there.
        if rate == 0 { 1 } else { u64::try_from(SECOND.div_ceil(rate)).unwrap_or(u64::MAX) }
    }

    /// Its first effective instant at or after `at_ns`: release floor(k·10⁹/rate) plus latency.
    #[must_use]
    pub fn effective_at_or_after(&self, at_ns: u64) -> u64 {
        let rate = u128::from(self.millihertz);
        if rate == 0 {
            return at_ns;
        }
        let release_ns = u128::from(at_ns.saturating_sub(self.latency_ns));
        // The last k on the exact grid at or before it, or the next one: floor() may round k down
        // on to the instant itself.
        let mut k = release_ns * rate / SECOND;
        while k * SECOND / rate < release_ns {
            k += 1;
        }
        u64::try_from(k * SECOND / rate).unwrap_or(u64::MAX).saturating_add(self.latency_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn instance(millihertz: u64, latency_ns: u64) -> Instance {
        Instance { layout: 1, millihertz, latency_ns }
    }

    #[test]
    fn effective_instants_are_the_releases_plus_the_latency() {
        let even = instance(100_000, 1_000_000);
        assert_eq!(even.period_ns(), 10_000_000);
        assert_eq!(even.effective_at_or_after(0), 1_000_000);
        assert_eq!(even.effective_at_or_after(1_000_001), 11_000_000);
        // 150 Hz: 0, 6666666, 13333333, 20000000.
        let odd = instance(150_000, 0);
        assert_eq!(odd.effective_at_or_after(6_666_666), 6_666_666);
        assert_eq!(odd.effective_at_or_after(6_666_667), 13_333_333);
        assert_eq!(odd.effective_at_or_after(13_333_334), 20_000_000);
        assert_eq!(instance(0, 5).effective_at_or_after(42), 42);
        assert!(instance(0, 5).period_ns() > 0, "it would not be a member on the wire");
    }

    proptest! {
        #[test]
        fn the_first_effective_instant_is_neither_early_nor_second(
            millihertz in 1_000_u64..10_000_000, latency_ns in 0_u64..5_000_000, at_ns in 0_u64..1 << 40,
        ) {
            let instance = instance(millihertz, latency_ns);
            let first = instance.effective_at_or_after(at_ns);
            prop_assert!(first >= at_ns.max(latency_ns));
            prop_assert!(first - at_ns.max(latency_ns) < instance.period_ns());
            prop_assert_eq!(instance.effective_at_or_after(first), first);
        }
    }
}
