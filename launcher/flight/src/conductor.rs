//! The conductor: says when the flight starts, how far time may go, and where it ends.

use runtime::clock::WallMap;
use runtime::graph::CREDIT_NS;
use runtime::ipc::{Bus, IpcSink, PortError, RECORDER_CAPACITY, STATE_DEPTH, ServiceKind};
use runtime::{Graph, MarkView as _, SeatMarks, Sink as _};
use shared_types::{ClockMode, ClockRecord, Flag, Role, RollEntry, Seat};
use simulate::Speed;

/// How long loops may stand still, and what time it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct StallCheck {
    pub(super) now_mono_ns: u64,
    pub(super) stall_ns: u64,
    pub(super) lag_ns: u64,
}

/// Publishes the clock.
pub(super) struct Conductor {
    sink: IpcSink<ClockRecord>,
    record: ClockRecord,
    speed: Speed,
    duration_ns: u64,
    credit_ns: u64,
}

impl Conductor {
    pub(super) fn new(
        bus: &Bus,
        mode: ClockMode,
        speed: Speed,
        duration_ns: u64,
        graph: &Graph,
    ) -> Result<Self, PortError> {
        let record = ClockRecord {
            end_ns: duration_ns,
            speed: if let Speed::Times(times) = speed { times } else { 1.0 },
            mode,
            ..ClockRecord::default()
        };
        let sink = bus.open_writer(ServiceKind::Clock)?;
        Ok(Self { sink, record, speed, duration_ns, credit_ns: credit_ns(graph) })
    }

    /// Goes on with the time of a launcher that has died.
    pub(super) fn take_over(
        bus: &Bus,
        record: ClockRecord,
        duration_ns: u64,
        graph: &Graph,
    ) -> Result<Self, PortError> {
        let speed = Speed::Times(record.speed);
        let new = Self::new(bus, record.mode, speed, duration_ns, graph)?;
        Ok(Self { record, ..new })
    }

    /// Says again what time it is.
    pub(super) fn say_again(&mut self) {
        self.sink.send(&self.record);
    }

    /// The last word on time.
    pub(super) fn record(&self) -> &ClockRecord {
        &self.record
    }

    /// Starts the flight: logical time 0 is at `start_mono_ns`; allowed time ends at `cap_ns`.
    pub(super) fn start(&mut self, start_mono_ns: u64, cap_ns: u64) {
        self.record.start_mono_ns = start_mono_ns;
        self.record.started = Flag::Yes;
        self.record.allowed_ns = if self.record.mode == ClockMode::Lockstep {
            self.credit_ns.min(cap_ns)
        } else {
            u64::MAX
        };
        self.sink.send(&self.record);
    }

    pub(super) fn mode(&self) -> ClockMode {
        self.record.mode
    }

    pub(super) fn has_started(&self) -> bool {
        self.record.started.is_set()
    }

    /// Lockstep: steps at or after this instant have not run yet \[ns\].
    pub(super) fn allowed_ns(&self) -> u64 {
        self.record.allowed_ns
    }

    /// Logical time by the wall clock \[ns\].
    pub(super) fn wall_ns(&self, now_mono_ns: u64) -> u64 {
        WallMap::new(&self.record).logical_ns(now_mono_ns)
    }

    pub(super) fn end_ns(&self) -> u64 {
        self.record.end_ns
    }

    /// True if the flight was told to end before its time.
    pub(super) fn is_cut_short(&self) -> bool {
        self.record.end_ns < self.duration_ns
    }

    /// Lockstep: extends allowed time to what has been drained plus the credit, once half of the
    /// credit is used up, and never beyond `cap_ns`. True if everybody should be woken.
    pub(super) fn extend(&mut self, drained_ns: u64, cap_ns: u64, now_mono_ns: u64) -> bool {
        if self.record.mode != ClockMode::Lockstep {
            return false;
        }
        let mut allowed_ns = drained_ns.saturating_add(self.credit_ns);
        let mut step_ns = self.credit_ns / 2;
        if let Speed::Times(times) = self.speed {
            let elapsed_ns = now_mono_ns.saturating_sub(self.record.start_mono_ns) as f64 * times;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
            let paced_ns = elapsed_ns as u64;
            allowed_ns = allowed_ns.min(paced_ns);
            step_ns = step_ns.min(5_000_000);
        }
        // The last bit before the cap may be as short as it is.
        let reaches_cap = allowed_ns >= cap_ns && cap_ns > self.record.allowed_ns;
        allowed_ns = allowed_ns.min(cap_ns);
        if !reaches_cap && allowed_ns < self.record.allowed_ns.saturating_add(step_ns) {
            return false;
        }
        self.record.allowed_ns = allowed_ns;
        self.sink.send(&self.record);
        true
    }

    /// Ends the flight at the first instant that nobody can have passed yet.
    pub(super) fn end_early(&mut self, now_logical_ns: u64) {
        let end_ns = if self.record.mode == ClockMode::Lockstep {
            self.record.allowed_ns
        } else {
            now_logical_ns + 50_000_000
        };
        self.record.end_ns = self.record.end_ns.min(end_ns);
        self.sink.send(&self.record);
    }

    /// Tells finished processes that everything has been drained. True if they did not know.
    pub(super) fn let_leave(&mut self) -> bool {
        let news = !self.record.may_leave.is_set();
        if news {
            self.record.may_leave = Flag::Yes;
            self.sink.send(&self.record);
        }
        news
    }

    /// Lets processes that have just joined see the clock.
    pub(super) fn serve_late_joiners(&mut self) {
        self.sink.serve_late_joiners();
    }
}

/// Half of what the tap's shallowest reader holds of the fastest loop: no sample and no state can
/// be overwritten before it is drained.
fn credit_ns(graph: &Graph) -> u64 {
    let depth = RECORDER_CAPACITY.min(STATE_DEPTH) as u64;
    let fastest_ns = graph.nodes().iter().map(|n| n.rate.period_ns()).min().unwrap_or(1);
    (depth / 2 * fastest_ns).min(CREDIT_NS)
}

impl Conductor {
    /// Processes to blame for standing still; see [`stalled`].
    pub(super) fn stalled(
        &self,
        graph: &Graph,
        present: &[RollEntry],
        marks: &SeatMarks,
        check: StallCheck,
    ) -> Vec<RollEntry> {
        stalled(&self.record, graph, present, marks, check)
    }
}

/// Processes to blame for standing still. Lockstep, once nobody has moved for long enough: whoever has
/// permission to step. Realtime: whoever lags behind the plant by more than `lag_ns`, or the plant, if it
/// lags behind the wall clock by more than `stall_ns`; a machine that stalls as a whole stalls all of them,
/// and only the longer timeout applies. Once the plant has finished it cannot run ahead of a loop that
/// stands still just before the end: the wall clock does.
fn stalled(
    record: &ClockRecord,
    graph: &Graph,
    present: &[RollEntry],
    marks: &SeatMarks,
    check: StallCheck,
) -> Vec<RollEntry> {
    let wall_ns = WallMap::new(record).logical_ns(check.now_mono_ns);
    let plant_ns = match marks.of_role(Role::Plant) {
        mark_ns if mark_ns < record.end_ns => mark_ns,
        _ => wall_ns.max(record.end_ns),
    };
    let long_over = record.end_ns.saturating_add(check.stall_ns) < wall_ns;
    let is_stalled = |entry: &&RollEntry| {
        let Some(node) = graph.node(entry.role) else { return false };
        let seat = Seat { role: entry.role, index: entry.seat };
        let mark_ns = marks.of_seat(seat, entry.generation);
        // Whoever has just taken a seat in flight has not had its first word yet.
        let arrives = mark_ns == 0 && (entry.seat > 0 || entry.generation > 0) && !long_over;
        if mark_ns >= record.end_ns || (arrives && record.mode != ClockMode::Lockstep) {
            false
        } else if record.mode == ClockMode::Lockstep {
            graph.runnable(node, mark_ns, marks, record.allowed_ns)
        } else if node.role == Role::Plant {
            mark_ns.saturating_add(check.stall_ns) < wall_ns
        } else {
            mark_ns.saturating_add(check.lag_ns) < plant_ns
        }
    };
    present.iter().filter(is_stalled).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::Scenario;

    const MS: u64 = 1_000_000;

    /// Roles blamed for standing still `now_ms` after the beginning of a flight of `end_ms`.
    fn blamed(end_ms: u64, generation: u32, marks_ms: &[(Role, u64)], now_ms: u64) -> Vec<Role> {
        let scenario = Scenario::load("hover", &[]).expect("a shipped scenario");
        let graph = scenario.graph().expect("wired");
        let record = ClockRecord {
            end_ns: end_ms * MS,
            speed: 1.0,
            mode: ClockMode::Realtime,
            started: Flag::Yes,
            ..ClockRecord::default()
        };
        let entry = |&(role, _): &(Role, u64)| {
            let generation = if role == Role::Plant { 0 } else { generation };
            RollEntry { role, generation, present: Flag::Yes, ..RollEntry::default() }
        };
        let present: Vec<RollEntry> = marks_ms.iter().map(entry).collect();
        let mut marks = SeatMarks::default();
        for (entry, (role, mark_ms)) in present.iter().zip(marks_ms) {
            marks.advance(*role, 0, entry.generation, mark_ms.saturating_mul(MS));
        }
        let check = StallCheck { now_mono_ns: now_ms * MS, stall_ns: 2000 * MS, lag_ns: 300 * MS };
        stalled(&record, &graph, &present, &marks, check).iter().map(|e| e.role).collect()
    }

    #[test]
    fn a_loop_that_hangs_just_before_the_end_is_blamed_once_the_wall_clock_is_ahead() {
        let blamed = |mark_ms, now_ms| {
            blamed(3000, 0, &[(Role::Plant, u64::MAX), (Role::Position, mark_ms)], now_ms)
        };
        // It has as long as in the middle of the flight.
        assert_eq!(blamed(2940, 3200), []);
        assert_eq!(blamed(2940, 3241), [Role::Position]);
        assert_eq!(blamed(3000, 9000), [], "it has finished");
    }

    #[test]
    fn a_loop_is_blamed_by_the_plant_and_not_by_the_clock_while_the_plant_is_late() {
        let of =
            |plant_ms| blamed(3000, 0, &[(Role::Plant, plant_ms), (Role::Position, 1000)], 2500);
        assert_eq!(of(1200), []);
        assert_eq!(of(1400), [Role::Position]);
        assert_eq!(of(400), [Role::Plant], "which has the longer timeout");
    }

    #[test]
    fn a_successor_that_never_says_a_word_is_blamed_when_the_flight_has_long_been_over() {
        let blamed =
            |now_ms| blamed(3000, 1, &[(Role::Plant, u64::MAX), (Role::Position, 0)], now_ms);
        assert_eq!(blamed(4900), []);
        assert_eq!(blamed(5100), [Role::Position]);
    }
}
