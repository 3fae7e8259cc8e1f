//! The loop of a real process: waits for permission, runs whole intervals, says how far it got.

use crate::clock::{WallMap, mono_now_ns, sleep_until};
use crate::executor::{Executor, StepStamps};
use crate::graph::{Edge, Graph, Marks, ROLES, Roles};
use crate::input::InputSet as _;
use crate::ipc::{
    Bus, IpcSink, LatestPort, PortError, ServiceKind, StatePublisher, StateSubscriber,
    WakeListener, WakeNotifier,
};
use crate::output::Sink as _;
use crate::service::{RestoreError, Service, state_layout, state_size};
use crate::watch::StopFlags;
use core::time::Duration;
use shared_types::{Author, ClockMode, ClockRecord, Hello, Progress, Role};
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

/// How far a neighbour has got, and how to wake it.
struct Neighbour {
    role: Role,
    progress: Option<LatestPort<Progress>>,
    wake: Option<WakeNotifier>,
}

/// A component in its process, with every port open.
pub struct Process<S: Service> {
    executor: Executor<S>,
    graph: Graph,
    neighbours: Vec<Neighbour>,
    clock: LatestPort<ClockRecord>,
    progress: IpcSink<Progress>,
    listener: WakeListener,
    marks: [u64; ROLES],
    stop: StopFlags,
    generation: u32,
    pid: u32,
    timed_out: bool,
}

impl<S: Service> core::fmt::Debug for Process<S> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Process").field("executor", &self.executor).finish_non_exhaustive()
    }
}

impl<S: Service> Process<S> {
    /// Opens what every process needs besides its topics: clock, progress, wake-ups and state.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(
        bus: &Bus,
        mut executor: Executor<S>,
        graph: Graph,
        stop: StopFlags,
        generation: u32,
    ) -> Result<Self, PortError> {
        let role = executor.node().role;
        let state = StatePublisher::open(bus, ServiceKind::State(role), state_size::<S>())?;
        executor.connect_state(Box::new(state));
        let mut neighbours = Vec::new();
        for node in graph.nodes().iter().filter(|n| n.role != role) {
            let upstream = graph.waits_for(role, node.role);
            let downstream = graph.waits_for(node.role, role);
            let progress = upstream
                .then(|| LatestPort::open(bus, ServiceKind::Progress(node.role)))
                .transpose()?;
            let wake = downstream.then(|| WakeNotifier::open(bus, node.role)).transpose()?;
            neighbours.push(Neighbour { role: node.role, progress, wake });
        }
        Ok(Self {
            executor,
            graph,
            neighbours,
            clock: LatestPort::open(bus, ServiceKind::Clock)?,
            progress: bus.open_writer(ServiceKind::Progress(role))?,
            listener: WakeListener::open(bus, role)?,
            marks: [0; ROLES],
            stop,
            generation,
            pid: std::process::id(),
            timed_out: false,
        })
    }

    /// Tells the supervisor that all ports are open.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn say_hello(
        &self,
        bus: &Bus,
        command_author: Author,
    ) -> Result<IpcSink<Hello>, PortError> {
        let mut hello = bus.open_writer::<Hello>(ServiceKind::Hello)?;
        hello.send(Hello {
            command_author,
            state_layout: state_layout::<S>(),
            pid: self.pid,
            generation: self.generation,
            role: self.executor.node().role,
            reserved: 0,
        });
        Ok(hello)
    }

    /// Waits for the predecessor's last state and continues from it.
    ///
    /// # Errors
    /// No state came, or it does not fit this build.
    pub fn take_over(&mut self, bus: &Bus) -> Result<(), ProcessError> {
        let role = self.executor.node().role;
        let mut handover = StateSubscriber::open(bus, ServiceKind::Handover(role))?;
        let deadline_ns = mono_now_ns() + HANDOVER_LIMIT_NS;
        let mut outcome = None;
        while outcome.is_none() {
            while handover.receive(|header, state, _| {
                if header.generation == self.generation {
                    outcome = Some(self.executor.restore(state));
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
            }
            // Marks first, samples second: what a mark promises is then certainly here.
            self.read_marks(&mut moved);
            self.executor.inputs.receive_if_moved(moved);
            moved = Roles::default();
            let allowed_ns = clock.allowed_ns.min(clock.end_ns);
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
                let role = self.executor.node().role;
                self.wake(self.graph.lockstep_wakes(role, before_ns, after_ns));
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
            let before_ns = self.executor.mark_ns();
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

    /// Reads the marks and adds whoever has moved its own.
    fn read_marks(&mut self, moved: &mut Roles) {
        for neighbour in &mut self.neighbours {
            if let Some(progress) = &mut neighbour.progress {
                // A restarted producer starts again below what its predecessor finished, and the
                // words of both may be waiting here in any order.
                let mark = &mut self.marks[neighbour.role.index()];
                progress.for_each_new(|p| {
                    *mark = p.mark_ns.max(*mark);
                    moved.insert(neighbour.role);
                });
            }
        }
    }

    /// Publishes the mark and wakes those whose next release it may unblock.
    fn announce(&mut self, before_ns: u64, after_ns: u64) {
        self.serve_and_send(after_ns);
        let role = self.executor.node().role;
        self.wake(self.graph.wakes(role, before_ns, after_ns));
    }

    /// Publishes the mark and wakes every neighbour: after a start or a take-over nobody knows
    /// what the predecessor had already announced.
    fn publish_progress(&mut self) {
        self.serve_and_send(self.executor.mark_ns());
        self.wake(self.neighbours.iter().map(|n| n.role));
    }

    fn wake(&self, roles: impl Iterator<Item = Role>) {
        for role in roles {
            let neighbour = self.neighbours.iter().find(|n| n.role == role);
            if let Some(wake) = neighbour.and_then(|n| n.wake.as_ref()) {
                wake.wake();
            }
        }
    }

    /// A reader that has just joined must not learn of the mark before it has the history of
    /// topics that were not sent in this interval.
    fn serve_and_send(&mut self, mark_ns: u64) {
        self.executor.serve_late_joiners();
        self.progress.send(Progress {
            mark_ns,
            steps: self.executor.steps(),
            publish_mono_ns: mono_now_ns(),
            generation: self.generation,
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
    marks: &'a Marks,
    role: Role,
    t_ns: u64,
) -> impl Iterator<Item = &'a Edge> {
    graph.edges().iter().filter(move |e| {
        e.to == role && e.deadline_ns > 0 && !e.permits(t_ns, marks[e.from.index()])
    })
}
