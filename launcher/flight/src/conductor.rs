//! The conductor: publishes when the flight starts, how far time may go, and where it ends.

use runtime::clock::WallMap;
use runtime::graph::CREDIT_NS;
use runtime::ipc::{Bus, IpcSink, PortError, RECORDER_CAPACITY, STATE_DEPTH, ServiceKind};
use runtime::{Graph, Sink as _};
use shared_types::{ClockMode, ClockRecord, Flag};
use simulate::Speed;

/// Publishes the clock.
pub(super) struct Conductor {
    sink: IpcSink<ClockRecord>,
    record: ClockRecord,
    speed: Speed,
    duration_ns: u64,
    credit_ns: u64,
    /// Host instant from which a flight in lockstep is held to a pace \[ns\].
    paced_from_ns: u64,
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
        let credit_ns = credit_ns(graph);
        Ok(Self { sink, record, speed, duration_ns, credit_ns, paced_from_ns: 0 })
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

    /// Publishes again what time it is.
    pub(super) fn publish_again(&mut self) {
        self.sink.send(&self.record);
    }

    /// The clock record as it was published last.
    pub(super) fn record(&self) -> &ClockRecord {
        &self.record
    }

    /// Starts the flight: logical time 0 is at `start_mono_ns`; allowed time ends at `cap_ns`.
    pub(super) fn start(&mut self, start_mono_ns: u64, cap_ns: u64) {
        self.record.start_mono_ns = start_mono_ns;
        self.paced_from_ns = start_mono_ns;
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

    /// True if the flight was ordered to end before its time.
    pub(super) fn is_cut_short(&self) -> bool {
        self.record.end_ns < self.duration_ns
    }

    /// Lockstep: how far time may be at a host instant, if it is held to a pace \[ns\].
    pub(super) fn paced_ns(&self, now_mono_ns: u64) -> u64 {
        let Speed::Times(times) = self.speed else { return u64::MAX };
        let elapsed_ns = now_mono_ns.saturating_sub(self.paced_from_ns) as f64 * times;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let paced_ns = elapsed_ns as u64;
        paced_ns
    }

    /// Holds it to its pace from a host instant that is not on the flight's clock \[ns\].
    pub(super) fn pace_from(&mut self, from_mono_ns: u64) {
        self.paced_from_ns = from_mono_ns;
    }

    /// Allows time up to an instant of a flight whose clock this launcher moves \[ns\].
    pub(super) fn allow(&mut self, allowed_ns: u64) {
        self.record.allowed_ns = allowed_ns;
        self.sink.send(&self.record);
    }

    /// Lockstep: extends allowed time to what has been drained plus the credit, once half of the
    /// credit is used up, and never beyond `cap_ns`. True if all processes should be woken.
    pub(super) fn extend(&mut self, drained_ns: u64, cap_ns: u64, now_mono_ns: u64) -> bool {
        if self.record.mode != ClockMode::Lockstep {
            return false;
        }
        let mut allowed_ns = drained_ns.saturating_add(self.credit_ns);
        let mut step_ns = self.credit_ns / 2;
        if let Speed::Times(_) = self.speed {
            allowed_ns = allowed_ns.min(self.paced_ns(now_mono_ns));
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

    /// Ends the flight at the first instant that no process can have passed yet.
    pub(super) fn end_early(&mut self, now_logical_ns: u64) {
        let end_ns = if self.record.mode == ClockMode::Lockstep {
            self.record.allowed_ns
        } else {
            now_logical_ns + 50_000_000
        };
        self.record.end_ns = self.record.end_ns.min(end_ns);
        self.sink.send(&self.record);
    }

    /// Notifies finished processes that everything has been drained. True if they did not know.
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
