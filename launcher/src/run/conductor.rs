//! The conductor: says when the flight starts, how far time may go, and where it ends.

use runtime::graph::Marks;
use runtime::ipc::{Bus, IpcSink, PortError, ServiceKind};
use runtime::{Graph, Sink as _};
use shared_types::{ClockMode, ClockRecord, Flag, Role};

/// How far ahead of the drained recording lockstep time may go [ns]. Half of the shallowest
/// reader of the tap at the highest loop rate fits in it many times over.
const CREDIT_NS: u64 = 250_000_000;

/// Pace of logical time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// Logical seconds per wall second.
    Times(f64),
    /// As fast as the machine can (lockstep only).
    Max,
}

/// Publishes the clock.
pub(super) struct Conductor {
    sink: IpcSink<ClockRecord>,
    record: ClockRecord,
    speed: Speed,
    duration_ns: u64,
}

impl Conductor {
    pub(super) fn new(
        bus: &Bus,
        mode: ClockMode,
        speed: Speed,
        duration_ns: u64,
    ) -> Result<Self, PortError> {
        let record = ClockRecord {
            end_ns: duration_ns,
            speed: if let Speed::Times(times) = speed { times } else { 1.0 },
            mode,
            ..ClockRecord::default()
        };
        let sink = bus.open_writer(ServiceKind::Clock)?;
        Ok(Self { sink, record, speed, duration_ns })
    }

    /// Starts the flight: logical time 0 is at `start_mono_ns`.
    pub(super) fn start(&mut self, start_mono_ns: u64) {
        self.record.start_mono_ns = start_mono_ns;
        self.record.started = Flag::Yes;
        self.record.allowed_ns =
            if self.record.mode == ClockMode::Lockstep { CREDIT_NS } else { u64::MAX };
        self.sink.send(self.record);
    }

    pub(super) fn mode(&self) -> ClockMode {
        self.record.mode
    }

    pub(super) fn end_ns(&self) -> u64 {
        self.record.end_ns
    }

    pub(super) fn start_mono_ns(&self) -> u64 {
        self.record.start_mono_ns
    }

    /// True if the flight was told to end before its time.
    pub(super) fn is_cut_short(&self) -> bool {
        self.record.end_ns < self.duration_ns
    }

    /// Lockstep: extends allowed time to what has been drained plus the credit, once half of the
    /// credit is used up. True if everybody should be woken.
    pub(super) fn extend(&mut self, drained_ns: u64, now_mono_ns: u64) -> bool {
        if self.record.mode != ClockMode::Lockstep {
            return false;
        }
        let mut allowed_ns = drained_ns.saturating_add(CREDIT_NS);
        let mut step_ns = CREDIT_NS / 2;
        if let Speed::Times(times) = self.speed {
            let elapsed_ns = now_mono_ns.saturating_sub(self.record.start_mono_ns) as f64 * times;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
            let paced_ns = elapsed_ns as u64;
            allowed_ns = allowed_ns.min(paced_ns);
            step_ns = 5_000_000;
        }
        if allowed_ns < self.record.allowed_ns.saturating_add(step_ns) {
            return false;
        }
        self.record.allowed_ns = allowed_ns;
        self.sink.send(self.record);
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
        self.sink.send(self.record);
    }

    /// Lets processes that have just joined see the clock.
    pub(super) fn serve_late_joiners(&mut self) {
        self.sink.serve_late_joiners();
    }
}

/// Instant through which every loop is final and drained.
pub(super) fn drained_ns(graph: &Graph, marks: &Marks) -> u64 {
    graph.nodes().iter().map(|n| marks[n.role.index()]).min().unwrap_or(0)
}

/// Loops that have permission to step and do not: the ones to blame when time stands still.
pub(super) fn stalled(graph: &Graph, marks: &Marks, allowed_ns: u64, end_ns: u64) -> Vec<Role> {
    graph
        .nodes()
        .iter()
        .filter(|n| {
            let t_ns = marks[n.role.index()];
            t_ns < end_ns && graph.runnable(n, t_ns, marks, allowed_ns)
        })
        .map(|n| n.role)
        .collect()
}

impl Conductor {
    pub(super) fn allowed_ns(&self) -> u64 {
        self.record.allowed_ns
    }
}
