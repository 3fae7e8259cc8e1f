//! The loop of a real process: waits for permission, runs whole intervals, reports how far it got.
//!
//! `lockstep.rs` and `realtime.rs` are the two clocks, `timed.rs` is one that the launcher moves, `timing.rs` what a
//! script has a process take, `surroundings.rs` the processes that it waits for and wakes.

mod lockstep;
mod realtime;
mod surroundings;
mod timed;
mod timing;

pub(crate) use timing::Ports;
pub use timing::Timing;

use crate::clock::{WallMap, mono_now_ns};
use crate::executor::Executor;
use crate::graph::Graph;
use crate::ipc::{
    Bus, IpcSink, LatestPort, PortError, ServiceKind, StatePublisher, StateSubscriber, TurnTaker,
    WakeListener,
};
use crate::output::Sink as _;
use crate::pacing::WAIT_LIMIT_NS;
use crate::seat_marks::SeatMarks;
use crate::service::RestoreError;
use crate::upkeep::Upkeep;
use crate::watch::StopFlags;
use core::time::Duration;
use shared_types::wire::Value as _;
use shared_types::{ClockMode, ClockRecord, Handover, Hello, Progress, Seat};
use surroundings::{Neighbour, SlotReader};
use thiserror::Error;

/// See [`WAIT_LIMIT_NS`].
const WAIT_LIMIT: Duration = Duration::from_nanos(WAIT_LIMIT_NS);
/// Longest wait for a hand-over state in realtime \[ns\]. In lockstep time is held meanwhile, also if the launcher is
/// stopped, and one that dies is noticed.
const HANDOVER_LIMIT_NS: u64 = 5_000_000_000;

/// How a process left its loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The flight's end was reached.
    Finished,
    /// A signal asked for it.
    Signalled,
    /// The launcher died and no other took over in time.
    LauncherGone,
    /// Its seat was given up.
    Retired,
}

/// Why a process could not fly.
#[derive(Debug, Error)]
pub enum ProcessError {
    /// A port could not be had.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The state offered by the supervisor does not fit.
    #[error("cannot continue from the predecessor's state: {0}")]
    Restore(#[from] RestoreError),
    /// No state was offered in time.
    #[error("no state of the predecessor arrived within 5 s")]
    NoHandover,
}

/// A component in its process, with every port open.
pub struct Process<'a> {
    bus: &'a Bus,
    executor: Executor,
    graph: Graph,
    neighbours: Vec<Neighbour>,
    slots: Vec<SlotReader>,
    clock: LatestPort<ClockRecord>,
    progress: IpcSink<Progress>,
    listener: WakeListener,
    marks: SeatMarks,
    stop: StopFlags,
    seat: Seat,
    pid: u32,
    /// Instant from which the seat is no longer this process's \[ns\].
    leave_ns: u64,
    /// The mark that was published last \[ns\].
    published_ns: Option<u64>,
    /// Lockstep: see [`Progress::quiet_until_ns`] \[ns\].
    quiet_until_ns: u64,
    /// `CLOCK_MONOTONIC` when all ports were open \[ns\].
    opened_mono_ns: u64,
    upkeep: Upkeep,
    /// The processes that were registered at the last look.
    registered: u64,
    timed_out: bool,
    /// The time that it takes, if a script sets it.
    timing: Option<Timing>,
    /// The orders for its turns on a clock that the launcher moves.
    turns: Option<TurnTaker>,
    /// It has published its totals.
    has_finished: bool,
}

impl core::fmt::Debug for Process<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Process").field("executor", &self.executor).finish_non_exhaustive()
    }
}

impl<'a> Process<'a> {
    /// Opens what every process needs besides its topics: clock, progress, wake-ups and state.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(
        bus: &'a Bus,
        mut executor: Executor,
        graph: Graph,
        stop: StopFlags,
    ) -> Result<Self, PortError> {
        let role = executor.node().role;
        let seat = Seat { role, index: executor.place().seat };
        let size = executor.component.layout().state_size();
        let state = StatePublisher::open(bus, ServiceKind::State(seat), size)?;
        executor.connect_state(Box::new(state));
        let neighbours = Neighbour::open_all(bus, &graph, role)?;
        let slots = SlotReader::open_all(bus, &graph, role)?;
        Ok(Self {
            bus,
            executor,
            graph,
            neighbours,
            slots,
            clock: LatestPort::clock(bus)?,
            progress: bus.open_writer(ServiceKind::Progress(seat))?,
            listener: WakeListener::open(bus, seat)?,
            marks: SeatMarks::default(),
            stop,
            seat,
            pid: std::process::id(),
            leave_ns: u64::MAX,
            published_ns: None,
            quiet_until_ns: 0,
            // The executor has opened its own before, and fields are made in their order here.
            opened_mono_ns: mono_now_ns(),
            upkeep: Upkeep::of_this_thread(),
            registered: 0,
            timed_out: false,
            timing: None,
            turns: None,
            has_finished: false,
        })
    }

    /// Lets it take the time that a script sets.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn take_time(&mut self, timing: Timing) -> Result<(), PortError> {
        if timing.ports.is_some() {
            let generation = self.executor.place().generation;
            self.turns = Some(TurnTaker::open(self.bus, self.seat, generation)?);
        }
        self.timing = Some(timing);
        Ok(())
    }

    /// Reports to the supervisor that all ports are open.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn send_hello(&self) -> Result<IpcSink<Hello>, PortError> {
        let mut hello = self.bus.open_writer::<Hello>(ServiceKind::Hello)?;
        hello.send(&Hello {
            state_layout: self.executor.component.layout().hash(),
            period_ns: self.executor.node().rate.period_ns(),
            pid: self.pid,
            generation: self.executor.place().generation,
            role: self.seat.role,
            seat: self.seat.index,
        });
        Ok(hello)
    }

    /// Waits for the hand-over: where in the flight to begin, and from what state.
    ///
    /// # Errors
    /// Nothing came, or the state does not fit this build.
    pub fn take_over(&mut self) -> Result<(), ProcessError> {
        let mut port = StateSubscriber::handovers(self.bus, self.seat)?;
        let deadline_ns = mono_now_ns() + HANDOVER_LIMIT_NS;
        let mut outcome = None;
        while outcome.is_none() {
            while port.receive(|header, bytes| {
                if header.generation == self.executor.place().generation {
                    outcome = Some(begin(&mut self.executor, bytes));
                }
            }) {}
            // If a stop was requested meanwhile, it has nothing to take over: `run` ends before its first step.
            if self.stop_requested().is_some() {
                return Ok(());
            }
            if mono_now_ns() > deadline_ns && self.read_clock().mode != ClockMode::Lockstep {
                return Err(ProcessError::NoHandover);
            }
            let _ = self.listener.wait(Duration::from_millis(2));
        }
        outcome.map_or(Ok(()), |restored| restored.map_err(ProcessError::from))
    }

    /// Flies until the end of the flight or a stop request.
    pub fn run(&mut self) -> Ending {
        let record = loop {
            if let Some(ending) = self.stop_requested() {
                return ending;
            }
            match self.clock.latest() {
                Some(record) if record.started.is_set() => break *record,
                // A flight that no launcher has started, no launcher takes over.
                _ if self.stop.launcher_gone() => return Ending::LauncherGone,
                _ => self.wait(WAIT_LIMIT),
            }
        };
        self.look_around();
        self.publish_progress();
        let (timing, turns) = (self.timing.take(), self.turns.take());
        let takes_turns = turns.is_some();
        let ports = timing.as_ref().and_then(|timing| timing.ports.clone());
        let ending = if let (Some(timing), Some(ports), Some(turns)) = (&timing, ports, turns) {
            self.run_timed(timing, &ports, &turns)
        } else if record.mode == ClockMode::Lockstep {
            self.run_lockstep()
        } else {
            self.run_realtime(WallMap::new(&record), timing.as_ref())
        };
        self.finish(takes_turns);
        if ending == Ending::Finished {
            // Nothing will ever follow: a process that still waits for this one need not.
            // On a clock that the launcher moves it is waited for as long as it would be by the wall clock.
            if !takes_turns {
                self.announce(self.executor.mark_ns(), u64::MAX);
            }
            // Without a launcher no process is left that could permit it, and none that reads on.
            while self.stop_requested().is_none()
                && !self.read_clock().may_leave.is_set()
                && !self.stop.launcher_gone()
            {
                self.wait(WAIT_LIMIT);
            }
        }
        ending
    }

    /// Publishes the totals of the flight, once. A process that a script has stopped all the time
    /// has nothing to report.
    fn finish(&mut self, takes_turns: bool) {
        let is_first = !core::mem::replace(&mut self.has_finished, true);
        if is_first && (!takes_turns || self.executor.steps() > 0) {
            self.executor.finish();
        }
    }

    fn read_clock(&mut self) -> ClockRecord {
        self.clock.latest().copied().unwrap_or_default()
    }

    /// A reader that has just joined must not learn of the mark before it has the history of
    /// topics that were not sent in this interval.
    fn serve_and_send(&mut self, mark_ns: u64) {
        let served_mono_ns = mono_now_ns();
        self.executor.serve_late_joiners();
        self.published_ns = Some(mark_ns);
        self.progress.send(&Progress {
            mark_ns,
            quiet_until_ns: self.quiet_until_ns.max(mark_ns),
            steps: self.executor.steps(),
            served_mono_ns,
            generation: self.executor.place().generation,
            pid: self.pid,
        });
    }

    fn wait(&mut self, limit: Duration) {
        self.timed_out = !self.listener.wait(limit);
        if self.timed_out {
            // Idle long enough to look after peers that have just (re)joined.
            self.serve_again();
        }
    }

    /// Gives readers that have just joined what was published before, and repeats the mark: they do
    /// not trust one from before their ports were open.
    fn serve_again(&mut self) {
        match self.published_ns {
            Some(mark_ns) => self.serve_and_send(mark_ns),
            None => self.executor.serve_late_joiners(),
        }
    }

    fn stop_requested(&self) -> Option<Ending> {
        if self.stop.signalled() {
            Some(Ending::Signalled)
        } else if self.stop.grace_over() {
            Some(Ending::LauncherGone)
        } else {
            None
        }
    }
}

/// Begins where a hand-over states.
fn begin(executor: &mut Executor, bytes: &[u8]) -> Result<(), RestoreError> {
    let expected = Handover::PACKED_SIZE;
    if bytes.len() < expected {
        return Err(RestoreError::Size { actual: bytes.len(), expected });
    }
    let (order, state) = bytes.split_at(expected);
    executor.begin(&Handover::unpack(order), state)
}
