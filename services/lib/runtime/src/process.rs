//! The loop of a real process: waits for permission, runs whole intervals, says how far it got.

use crate::clock::{WallMap, mono_now_ns, sleep_until};
use crate::executor::{Executor, StepStamps};
use crate::graph::{Edge, Graph, Roles};
use crate::input::{InputSet as _, Source as _};
use crate::ipc::{
    Bus, IpcSink, IpcSource, LatestPort, PortError, ServiceKind, StatePublisher, StateSubscriber,
    WakeListener, WakeNotifier,
};
use crate::output::Sink as _;
use crate::ownership::{MarkView as _, SeatMarks};
use crate::service::{RestoreError, Service, state_layout, state_size};
use crate::watch::StopFlags;
use core::time::Duration;
use shared_types::wire::Value as _;
use shared_types::{
    ClockMode, ClockRecord, Handover, Hello, OwnerRecord, Progress, Role, RollEntry, Seat,
    TopicInfo, topics,
};
use thiserror::Error;

/// Wall-clock limit of every wait, after which shared memory is read again.
const WAIT_LIMIT: Duration = Duration::from_millis(20);
/// Longest wait for a hand-over state \[ns\].
const HANDOVER_LIMIT_NS: u64 = 5_000_000_000;

/// How a process left its loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The flight's end was reached.
    Finished,
    /// A signal asked for it.
    Signalled,
    /// The launcher died and nobody took over within the grace period.
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

/// How far a seat has got, and how to wake whoever sits there.
struct Neighbour {
    seat: Seat,
    progress: Option<LatestPort<Progress>>,
    wake: Option<WakeNotifier>,
    /// Generation and period \[ns\] of whoever sits there.
    present: Option<(u32, u64)>,
}

/// A slot's owner records, for whoever waits for the slot or sits in it.
struct SlotReader {
    role: Role,
    records: IpcSource<OwnerRecord>,
}

/// A component in its process, with every port open.
pub struct Process<'a, S: Service> {
    bus: &'a Bus,
    executor: Executor<S>,
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
    timed_out: bool,
}

impl<S: Service> core::fmt::Debug for Process<'_, S> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Process").field("executor", &self.executor).finish_non_exhaustive()
    }
}

impl<'a, S: Service> Process<'a, S> {
    /// Opens what every process needs besides its topics: clock, progress, wake-ups and state.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(
        bus: &'a Bus,
        mut executor: Executor<S>,
        graph: Graph,
        stop: StopFlags,
    ) -> Result<Self, PortError> {
        let role = executor.node().role;
        let seat = Seat { role, index: executor.place().seat };
        let state = StatePublisher::open(bus, ServiceKind::State(seat), state_size::<S>())?;
        executor.connect_state(Box::new(state));
        let mut neighbours = Vec::new();
        for node in graph.nodes().iter().filter(|n| n.role != role) {
            let upstream = graph.waits_for(role, node.role);
            let downstream = graph.waits_for(node.role, role);
            for seat in Seat::all(node.role).filter(|_| upstream || downstream) {
                neighbours.push(Neighbour {
                    seat,
                    progress: upstream.then(|| LatestPort::progress(bus, seat)).transpose()?,
                    wake: downstream.then(|| WakeNotifier::open(bus, seat)).transpose()?,
                    present: None,
                });
            }
        }
        let mut slots = Vec::new();
        for topic in [&topics::ATTITUDE_OWNER, &topics::POSITION_OWNER] {
            let slot = slot_of(&topic.info);
            let waited = graph.node(slot).is_some() && graph.waits_for(role, slot);
            if waited || slot == role {
                let records = bus.reader(topic, Role::Supervisor)?;
                slots.push(SlotReader { role: slot, records });
            }
        }
        Ok(Self {
            bus,
            executor,
            graph,
            neighbours,
            slots,
            clock: LatestPort::open(bus, ServiceKind::Clock)?,
            progress: bus.open_writer(ServiceKind::Progress(seat))?,
            listener: WakeListener::open(bus, seat)?,
            marks: SeatMarks::default(),
            stop,
            seat,
            pid: std::process::id(),
            leave_ns: u64::MAX,
            timed_out: false,
        })
    }

    /// Tells the supervisor that all ports are open.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn say_hello(&self) -> Result<IpcSink<Hello>, PortError> {
        let mut hello = self.bus.open_writer::<Hello>(ServiceKind::Hello)?;
        hello.send(Hello {
            state_layout: state_layout::<S>(),
            period_ns: self.executor.node().rate.period_ns(),
            pid: self.pid,
            generation: self.executor.place().generation,
            role: self.seat.role,
            seat: self.seat.index,
        });
        Ok(hello)
    }

    /// Waits to be told where in the flight to begin, and from what state.
    ///
    /// # Errors
    /// Nothing came, or the state does not fit this build.
    pub fn take_over(&mut self) -> Result<(), ProcessError> {
        let kind = ServiceKind::Handover(self.seat);
        let mut port = StateSubscriber::open(self.bus, kind)?;
        let deadline_ns = mono_now_ns() + HANDOVER_LIMIT_NS;
        let mut outcome = None;
        while outcome.is_none() {
            while port.receive(|header, bytes| {
                if header.generation == self.executor.place().generation {
                    outcome = Some(begin(&mut self.executor, bytes));
                }
            }) {}
            if self.stop.stop() || mono_now_ns() > deadline_ns {
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
                _ => self.wait(WAIT_LIMIT),
            }
        };
        self.look_around();
        self.publish_progress();
        let ending = if record.mode == ClockMode::Lockstep {
            self.run_lockstep()
        } else {
            self.run_realtime(WallMap::new(&record))
        };
        self.executor.finish();
        if ending == Ending::Finished {
            // Nothing will ever follow: whoever still waits for this process need not.
            self.announce(self.executor.mark_ns(), u64::MAX);
            while self.stop_requested().is_none() && !self.read_clock().may_leave.is_set() {
                self.wait(WAIT_LIMIT);
            }
        }
        ending
    }

    fn run_lockstep(&mut self) -> Ending {
        let mut clock = self.read_clock();
        let mut moved = Roles::ALL;
        loop {
            if let Some(ending) = self.stop_requested() {
                return ending;
            }
            let before_ns = self.executor.mark_ns();
            // Time never ends before what was once allowed, so an older word is as good until then.
            if before_ns >= clock.allowed_ns.min(clock.end_ns) || self.timed_out {
                clock = self.read_clock();
                // Whatever was decided before time was allowed is known from here on.
                self.look_around();
            }
            if before_ns >= self.leave_ns {
                self.announce(before_ns, u64::MAX);
                return Ending::Retired;
            }
            // Marks first, samples second: what a mark promises is then certainly here.
            self.read_marks(&mut moved);
            self.executor.inputs.receive_if_moved(moved);
            moved = Roles::default();
            let allowed_ns = clock.allowed_ns.min(clock.end_ns).min(self.leave_ns);
            let node = self.executor.node();
            let open_until_ns = self.graph.open_until_ns(node, &self.marks, allowed_ns);
            while self.executor.mark_ns() < open_until_ns {
                let release_mono_ns = mono_now_ns();
                self.executor.run_step(StepStamps { release_mono_ns, now_mono_ns: mono_now_ns });
            }
            let after_ns = self.executor.mark_ns();
            if after_ns >= clock.end_ns {
                return Ending::Finished;
            }
            if after_ns > before_ns {
                if core::mem::take(&mut self.timed_out) {
                    self.executor.count_rescued_wait();
                }
                self.serve_and_send(after_ns);
                self.wake_lockstep(before_ns, after_ns);
            } else {
                self.wait(WAIT_LIMIT);
                if self.timed_out {
                    moved = Roles::ALL;
                }
            }
        }
    }

    fn run_realtime(&mut self, wall: WallMap) -> Ending {
        // Connections take a millisecond: they are made in the countdown, not in the first step.
        self.read_marks(&mut Roles::default());
        self.executor.inputs.receive();
        loop {
            if let Some(ending) = self.stop_requested() {
                return ending;
            }
            let end_ns = self.read_clock().end_ns;
            self.look_around();
            let before_ns = self.executor.mark_ns();
            if before_ns >= self.leave_ns {
                self.announce(before_ns, u64::MAX);
                return Ending::Retired;
            }
            if before_ns >= end_ns {
                return Ending::Finished;
            }
            let due_mono_ns = self.due_mono_ns(&wall);
            if self.is_timed() && mono_now_ns() < due_mono_ns {
                // Wakes at least every limit, to see a stop request or an earlier end.
                sleep_until(due_mono_ns.min(mono_now_ns() + 20_000_000));
                continue;
            }
            if !self.inputs_decided(&wall) {
                continue;
            }
            if mono_now_ns() < due_mono_ns {
                // Final before it is due: a release between two releases of the producer.
                sleep_until(due_mono_ns.min(mono_now_ns() + 20_000_000));
                continue;
            }
            self.executor.apply_miss_policy(wall.logical_ns(mono_now_ns()));
            if self.executor.mark_ns() == before_ns {
                self.count_missing_inputs();
                let stamps = StepStamps { release_mono_ns: due_mono_ns, now_mono_ns: mono_now_ns };
                self.executor.run_step(stamps);
            }
            // A release that was skipped is final too; the one it was skipped for has its own wait.
            self.announce(before_ns, self.executor.mark_ns());
        }
    }

    /// Host instant from which the next release may run \[ns\].
    fn due_mono_ns(&self, wall: &WallMap) -> u64 {
        wall.mono_ns(self.executor.mark_ns().saturating_sub(self.executor.node().lead_ns))
    }

    /// True if the loop's own clock starts its steps; otherwise its inputs do.
    fn is_timed(&self) -> bool {
        let role = self.executor.node().role;
        role == Role::Plant || !self.graph.edges().iter().any(|e| e.to == role && e.deadline_ns > 0)
    }

    /// True once each input that the next release waits for is final or past its deadline; false
    /// after a wait: look around and try again.
    fn inputs_decided(&mut self, wall: &WallMap) -> bool {
        self.read_marks(&mut Roles::default());
        self.executor.inputs.receive();
        let t_ns = self.executor.mark_ns();
        let lead_ns = self.executor.node().lead_ns;
        let role = self.executor.node().role;
        let missing = missing(&self.graph, &self.marks, role, t_ns);
        let deadline_ns = missing.map(|e| e.deadline_ns).max();
        let Some(deadline_ns) = deadline_ns else { return true };
        // A deadline is an instant of logical time: a slower clock stretches it with the flight.
        let until_mono_ns = wall.mono_ns(t_ns.saturating_add(deadline_ns).saturating_sub(lead_ns));
        let now_ns = mono_now_ns();
        if now_ns < until_mono_ns {
            self.wait(Duration::from_nanos(until_mono_ns - now_ns).min(WAIT_LIMIT));
        }
        now_ns >= until_mono_ns
    }

    fn count_missing_inputs(&mut self) {
        let (role, t_ns) = (self.executor.node().role, self.executor.mark_ns());
        let mut missing = missing(&self.graph, &self.marks, role, t_ns).peekable();
        if missing.peek().is_some() {
            self.executor.count_input_deadline_miss(missing);
        }
    }

    fn read_clock(&mut self) -> ClockRecord {
        self.clock.latest().copied().unwrap_or_default()
    }

    /// Learns who has come and gone, and who owns which slot from when.
    fn look_around(&mut self) {
        let (marks, neighbours) = (&mut self.marks, &mut self.neighbours);
        let mut somebody_came = false;
        // Without a roll nobody would be heard, so the ports could not have been opened.
        let _ = self.bus.look_at_roll(|entries| {
            marks.learn_roll(entries);
            for neighbour in neighbours {
                let Seat { role, index } = neighbour.seat;
                let of_seat = |entry: &&RollEntry| (entry.role, entry.seat) == (role, index);
                let entry = entries.iter().rev().find(of_seat).filter(|e| e.present.is_set());
                let present = entry.map(|entry| (entry.generation, entry.period_ns));
                somebody_came |= present.is_some() && present != neighbour.present;
                neighbour.present = present;
            }
        });
        let done_ns = self.executor.previous_ns().unwrap_or(0);
        for slot in &mut self.slots {
            if let Some(book) = self.marks.book(slot.role) {
                while let Some(record) = slot.records.receive() {
                    book.learn(&record);
                }
                book.forget_before(done_ns);
                if slot.role == self.seat.role {
                    self.leave_ns = book.released_ns(self.seat.index).unwrap_or(u64::MAX);
                }
            }
        }
        if somebody_came {
            // Its ports are open and empty.
            self.executor.serve_late_joiners();
            self.progress.serve_late_joiners();
        }
    }

    /// Reads the marks and adds whoever has moved its own.
    fn read_marks(&mut self, moved: &mut Roles) {
        for neighbour in &mut self.neighbours {
            let Seat { role, index } = neighbour.seat;
            if let Some(progress) = &mut neighbour.progress
                && self.marks.concerns(role, index)
            {
                // A restarted producer starts again below what its predecessor finished, and the
                // words of both may be waiting here in any order.
                let marks = &mut self.marks;
                progress.for_each_new(|p| {
                    marks.advance(role, index, p.generation, p.mark_ns);
                    moved.insert(role);
                });
            }
        }
    }

    /// Publishes the mark and wakes those whose next release it may unblock.
    fn announce(&mut self, before_ns: u64, after_ns: u64) {
        self.serve_and_send(after_ns);
        self.wake_whom(|graph, from| graph.wakes(from, before_ns, after_ns).collect());
    }

    fn wake_lockstep(&self, before_ns: u64, after_ns: u64) {
        self.wake_whom(|graph, from| graph.lockstep_wakes(from, before_ns, after_ns).collect());
    }

    /// Wakes the processes of some roles. Nobody waits for a shadow; and whoever runs at another rate
    /// than the graph's is always worth waking.
    fn wake_whom(&self, whom: impl Fn(&Graph, Role) -> Roles) {
        let Seat { role, index } = self.seat;
        if !self.marks.concerns(role, index) {
            return;
        }
        let roles = whom(&self.graph, role);
        for neighbour in &self.neighbours {
            let Some((_, period_ns)) = neighbour.present else { continue };
            let role = neighbour.seat.role;
            let usual = self.graph.node(role).is_some_and(|n| n.rate.period_ns() == period_ns);
            if let Some(wake) = &neighbour.wake
                && (roles.contains(role) || !usual)
            {
                wake.wake();
            }
        }
    }

    /// Publishes the mark and wakes every neighbour: after a start or a take-over nobody knows
    /// what the predecessor had already announced.
    fn publish_progress(&mut self) {
        self.serve_and_send(self.executor.mark_ns());
        let present = self.neighbours.iter().filter(|n| n.present.is_some());
        present.filter_map(|n| n.wake.as_ref()).for_each(WakeNotifier::wake);
    }

    /// A reader that has just joined must not learn of the mark before it has the history of
    /// topics that were not sent in this interval.
    fn serve_and_send(&mut self, mark_ns: u64) {
        self.executor.serve_late_joiners();
        self.progress.send(Progress {
            mark_ns,
            steps: self.executor.steps(),
            publish_mono_ns: mono_now_ns(),
            generation: self.executor.place().generation,
            pid: self.pid,
        });
    }

    fn wait(&mut self, limit: Duration) {
        self.timed_out = !self.listener.wait(limit);
        if self.timed_out {
            // Idle long enough to look after peers that have just (re)joined.
            self.executor.serve_late_joiners();
            self.progress.serve_late_joiners();
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

/// Edges that `role` waits for at `t_ns` and that are not final yet.
fn missing<'a>(
    graph: &'a Graph,
    marks: &'a SeatMarks,
    role: Role,
    t_ns: u64,
) -> impl Iterator<Item = &'a Edge> {
    graph
        .edges()
        .iter()
        .filter(move |e| e.to == role && e.deadline_ns > 0 && !e.permits(t_ns, marks.of(e)))
}

/// Begins where a hand-over says.
fn begin<S: Service>(executor: &mut Executor<S>, bytes: &[u8]) -> Result<(), RestoreError> {
    let expected = Handover::PACKED_SIZE;
    if bytes.len() < expected {
        return Err(RestoreError::Size { actual: bytes.len(), expected });
    }
    let (order, state) = bytes.split_at(expected);
    executor.begin(&Handover::unpack(order), state)
}

/// The slot that owner records on a topic are about.
fn slot_of(topic: &TopicInfo) -> Role {
    if topic.name == topics::ATTITUDE_OWNER.info.name { Role::Attitude } else { Role::Position }
}
