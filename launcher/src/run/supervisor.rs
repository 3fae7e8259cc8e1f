//! Keeps the processes of a flight alive: ready, owners, restarts, stalls, obituaries.

use super::child::{ChildSpec, RunningChild, describe};
use super::standstill::Standstill;
use super::tap::LastState;
use runtime::Graph;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::graph::Marks;
use runtime::ipc::{Bus, IpcSink, IpcSource, PortError, ServiceKind, StatePublisher, TopicFactory};
use runtime::namespace::remove_unborn_objects;
use runtime::{Sink as _, Source as _, StateSink as _};
use shared_types::{Author, Header, Hello, OwnerRecord, Role, topics};
use std::path::PathBuf;
use thiserror::Error;

/// Restarts older than this no longer count against a process \[ns\].
const RESTART_WINDOW_NS: u64 = 60_000_000_000;

/// What to do about crashes.
#[derive(Debug, Clone, Copy)]
pub(super) struct RestartPolicy {
    /// Pause before the first restart; doubles with every further one \[ns\].
    pub(super) backoff_ns: u64,
    /// Longest pause \[ns\].
    pub(super) backoff_max_ns: u64,
    /// Restarts of one process within a minute before the flight is given up.
    pub(super) limit: usize,
}

/// Why a flight cannot go on.
#[derive(Debug, Error)]
pub(super) enum FlightError {
    #[error("cannot start {name}: {source}")]
    Start { name: &'static str, source: std::io::Error },
    #[error("{name} ended before it was ready ({how}){words}")]
    NotReady { name: &'static str, how: String, words: String },
    #[error(
        "{names} not ready within {limit_s} s: raise launcher.startup_timeout_s or free the machine"
    )]
    StartupTimeout { names: String, limit_s: f64 },
    #[error("{name} {how}{words}; {reason}")]
    Lost { name: &'static str, how: String, words: String, reason: String },
    #[error(transparent)]
    Port(#[from] PortError),
}

/// A line for the log of the flight.
#[derive(Debug, Clone)]
pub(super) struct Notice {
    pub(super) source: &'static str,
    pub(super) text: String,
}

/// One supervised seat.
struct Seat {
    role: Role,
    spec: ChildSpec,
    child: Option<RunningChild>,
    generation: u32,
    ready: bool,
    finished: bool,
    /// Instant of each restart \[ns\].
    restarts: Vec<u64>,
    /// When to start the successor \[ns\].
    restart_at_ns: Option<u64>,
    restored: bool,
    standstill: Option<Standstill>,
    handover: StatePublisher,
}

/// A seat as others see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Member {
    pub(super) role: Role,
    pub(super) name: &'static str,
    pub(super) pid: Option<u32>,
    pub(super) generation: u32,
    pub(super) ready: bool,
    pub(super) finished: bool,
}

/// Supervises all processes of one flight.
pub(super) struct Supervisor {
    folder: PathBuf,
    policy: RestartPolicy,
    seats: Vec<Seat>,
    hello: IpcSource<Hello>,
    owners: Vec<Slot>,
    pub(super) notices: Vec<Notice>,
    pub(super) recovered: u64,
}

/// A slot with its owner records.
struct Slot {
    role: Role,
    epoch: u64,
    sink: IpcSink<OwnerRecord>,
}

/// A successor that may go on, and from where.
struct Joined {
    seat: usize,
    author: Author,
}

impl Supervisor {
    /// Prepares the seats; nothing is started yet.
    pub(super) fn new(
        bus: &Bus,
        folder: PathBuf,
        specs: Vec<(Role, ChildSpec)>,
        hello: &TopicFactory<Hello>,
        policy: RestartPolicy,
    ) -> Result<Self, PortError> {
        let seats = specs
            .into_iter()
            .map(|(role, spec)| {
                let kind = ServiceKind::Handover(role);
                Ok(Seat {
                    role,
                    spec,
                    child: None,
                    generation: 0,
                    ready: false,
                    finished: false,
                    restarts: Vec::new(),
                    restart_at_ns: None,
                    restored: false,
                    standstill: None,
                    handover: StatePublisher::open(bus, kind, HANDOVER_CAPACITY)?,
                })
            })
            .collect::<Result<_, PortError>>()?;
        let owners = vec![
            Slot { role: Role::Attitude, epoch: 0, sink: bus.writer(&topics::ATTITUDE_OWNER)? },
            Slot { role: Role::Position, epoch: 0, sink: bus.writer(&topics::POSITION_OWNER)? },
        ];
        Ok(Self {
            folder,
            policy,
            seats,
            hello: IpcSource::with_capacity(hello, 64)?,
            owners,
            notices: Vec::new(),
            recovered: 0,
        })
    }

    /// Starts every process.
    pub(super) fn start_all(&mut self) -> Result<(), FlightError> {
        for seat in &mut self.seats {
            if seat.spec.pause_ns > 0 {
                sleep_until(mono_now_ns() + seat.spec.pause_ns);
            }
            start(seat, &self.folder, false)?;
        }
        Ok(())
    }

    /// Takes in who has become ready. True once everybody is, and every slot has an owner.
    pub(super) fn await_ready(&mut self, graph: &Graph) -> Result<bool, FlightError> {
        for seat in &mut self.seats {
            if let Some(status) = seat.child.as_mut().and_then(RunningChild::exited) {
                return Err(FlightError::NotReady {
                    name: seat.spec.name,
                    how: describe(status),
                    words: words(seat),
                });
            }
        }
        for joined in self.take_hellos(true) {
            self.own(graph, &joined, 0);
        }
        // A reader that joined after the record was written has it only now.
        self.serve_late_joiners();
        Ok(self.seats.iter().all(|s| s.ready) && self.owners_known(graph))
    }

    /// Lets processes that have just joined see owners and states.
    fn serve_late_joiners(&mut self) {
        for seat in &mut self.seats {
            seat.handover.serve_late_joiners();
        }
        for slot in &mut self.owners {
            slot.sink.serve_late_joiners();
        }
    }

    /// Names of those who are not ready.
    pub(super) fn not_ready(&self) -> String {
        let names: Vec<_> = self.seats.iter().filter(|s| !s.ready).map(|s| s.spec.name).collect();
        if names.is_empty() { "pilot".to_owned() } else { names.join(", ") }
    }

    fn owners_known(&self, graph: &Graph) -> bool {
        self.owners.iter().all(|slot| slot.epoch > 0 || owner_role(graph, slot.role).is_none())
    }

    /// Looks after deaths and successors; call often. `last_states` is by role.
    pub(super) fn look_after(
        &mut self,
        bus: &Bus,
        graph: &Graph,
        last_states: &[LastState],
        now_ns: u64,
    ) -> Result<(), FlightError> {
        for index in 0..self.seats.len() {
            self.bury_the_dead(bus, index, now_ns)?;
            let seat = &mut self.seats[index];
            if seat.restart_at_ns.is_some_and(|at| now_ns >= at) {
                seat.restart_at_ns = None;
                seat.restored = !last_states[seat.role.index()].bytes.is_empty();
                seat.generation += 1;
                let restored = seat.restored;
                start(seat, &self.folder, restored)?;
            }
        }
        for joined in self.take_hellos(false) {
            self.let_continue(graph, last_states, &joined);
        }
        self.serve_late_joiners();
        Ok(())
    }

    fn bury_the_dead(&mut self, bus: &Bus, index: usize, now_ns: u64) -> Result<(), FlightError> {
        let seat = &mut self.seats[index];
        let Some(status) = seat.child.as_mut().and_then(RunningChild::exited) else {
            return Ok(());
        };
        if status.success() {
            seat.finished = true;
            seat.child = None;
            return Ok(());
        }
        let name = seat.spec.name;
        let how = describe(status);
        let words = words(seat);
        seat.child = None;
        remove_unborn_objects(&self.folder);
        bus.sweep_dead_processes();
        let lost = |reason: String| {
            Err(FlightError::Lost { name, how: how.clone(), words: words.clone(), reason })
        };
        if seat.role == Role::Plant {
            return lost("the plant is the world and cannot be restarted: the flight ends".into());
        }
        seat.restarts.retain(|at| at + RESTART_WINDOW_NS > now_ns);
        let count = seat.restarts.len();
        if count >= self.policy.limit {
            return lost(format!("restarted {count} times within a minute: the flight ends"));
        }
        let delay_ns = (self.policy.backoff_ns << count.min(20)).min(self.policy.backoff_max_ns);
        seat.restarts.push(now_ns);
        seat.restart_at_ns = Some(now_ns + delay_ns);
        seat.ready = false;
        self.recovered += 1;
        let text = format!("{name} {how}{words}; restarting it from its last state");
        self.notices.push(Notice { source: name, text });
        Ok(())
    }

    fn take_hellos(&mut self, starting: bool) -> Vec<Joined> {
        let mut joined = Vec::new();
        while let Some(stamped) = self.hello.receive() {
            let hello = stamped.sample;
            if let Some(seat) = self.seats.iter().position(|s| {
                s.role == hello.role
                    && s.generation == hello.generation
                    && s.child.as_ref().is_some_and(|c| c.pid() == hello.pid)
            }) {
                self.seats[seat].ready = true;
                joined.push(Joined { seat, author: hello.command_author });
            } else if hello.role == Role::Pilot && starting {
                self.own_as_pilot(hello.command_author);
            }
        }
        joined
    }

    /// The pilot holds the position slot of a rig flight.
    fn own_as_pilot(&mut self, author: Author) {
        if author != Author::default() {
            self.publish_owner(Role::Position, author, 0, 0);
        }
    }

    fn own(&mut self, graph: &Graph, joined: &Joined, effective_ns: u64) {
        let role = self.seats[joined.seat].role;
        let period_ns = graph.node(role).map_or(0, |n| n.rate.period_ns());
        if joined.author != Author::default() {
            self.publish_owner(role, joined.author, effective_ns, period_ns);
        }
    }

    fn publish_owner(&mut self, role: Role, owner: Author, effective_ns: u64, period_ns: u64) {
        let Some(slot) = self.owners.iter_mut().find(|s| s.role == role) else { return };
        slot.epoch += 1;
        let header = Header {
            sequence: slot.epoch,
            release_ns: effective_ns,
            valid_ns: effective_ns,
            ..Header::default()
        };
        let epoch = slot.epoch;
        slot.sink.send(OwnerRecord {
            header,
            epoch,
            owner,
            period_ns,
            slot: role,
            ..OwnerRecord::default()
        });
    }

    /// A successor is ready: first its ownership, then the state from which it goes on, so that
    /// nobody sees a command of it before knowing that it may command.
    fn let_continue(&mut self, graph: &Graph, last_states: &[LastState], joined: &Joined) {
        let role = self.seats[joined.seat].role;
        let last = &last_states[role.index()];
        let effective_ns = match (last.header(), graph.node(role)) {
            (Some(header), Some(node)) if self.seats[joined.seat].restored => {
                // Its first command takes effect a latency after its first release.
                node.rate.release_ns(header.release_index + 1) + command_latency_ns(graph, role)
            }
            _ => 0,
        };
        self.own(graph, joined, effective_ns);
        let seat = &mut self.seats[joined.seat];
        if seat.restored {
            let header = Header { generation: seat.generation, ..Header::default() };
            seat.handover.send(&header, &last.bytes);
        }
    }

    /// Kills a process that has permission to step and does not, unless it only waits for a processor.
    pub(super) fn kill_stalled(&mut self, roles: &[Role], marks: &Marks) {
        for seat in &mut self.seats {
            let mark_ns = marks[seat.role.index()];
            if roles.contains(&seat.role)
                && let Some(child) = &mut seat.child
                && seat.ready
                && Standstill::is_hang(&mut seat.standstill, child.pid(), mark_ns)
            {
                let text =
                    format!("{} made no progress although it could, killing it", seat.spec.name);
                self.notices.push(Notice { source: seat.spec.name, text });
                child.kill();
            }
        }
    }

    /// Who fills which seat now, for those who ask.
    pub(super) fn crew(&self) -> impl Iterator<Item = Member> {
        self.seats.iter().map(|seat| Member {
            role: seat.role,
            name: seat.spec.name,
            pid: seat.child.as_ref().map(RunningChild::pid),
            generation: seat.generation,
            ready: seat.ready,
            finished: seat.finished,
        })
    }

    /// Epoch of each slot; 0 before its first owner.
    pub(super) fn epochs(&self) -> impl Iterator<Item = (Role, u64)> {
        self.owners.iter().map(|slot| (slot.role, slot.epoch))
    }

    /// Kills everybody, now.
    pub(super) fn kill_all(&mut self) {
        for seat in &mut self.seats {
            seat.restart_at_ns = None;
            seat.child = None;
        }
    }

    /// True once every process has finished its flight.
    pub(super) fn all_finished(&self) -> bool {
        self.seats.iter().all(|s| s.finished)
    }

    /// Names of processes still running.
    pub(super) fn unfinished(&self) -> Vec<&'static str> {
        self.seats.iter().filter(|s| !s.finished).map(|s| s.spec.name).collect()
    }
}

/// Largest state that can be handed over \[bytes\].
const HANDOVER_CAPACITY: usize = 64 * 1024;

/// Latency of the command by which a role fills its slot; 0 for roles without one \[ns\].
fn command_latency_ns(graph: &Graph, role: Role) -> u64 {
    match role {
        Role::Attitude => graph.latency_ns(&topics::WRENCH_COMMAND.info),
        Role::Position => graph.latency_ns(&topics::ATTITUDE_SETPOINT.info),
        _ => 0,
    }
}

/// Who commands a slot in this flight.
pub(super) fn owner_role(graph: &Graph, slot: Role) -> Option<Role> {
    if graph.node(slot).is_some() {
        Some(slot)
    } else {
        (slot == Role::Position).then_some(Role::Pilot)
    }
}

fn start(seat: &mut Seat, folder: &std::path::Path, restore: bool) -> Result<(), FlightError> {
    let name = seat.spec.name;
    let child = RunningChild::start(&seat.spec, folder, seat.generation, restore)
        .map_err(|source| FlightError::Start { name, source })?;
    seat.child = Some(child);
    seat.ready = false;
    seat.standstill = None;
    Ok(())
}

fn words(seat: &mut Seat) -> String {
    let words = seat.child.as_mut().map(RunningChild::last_words).unwrap_or_default();
    if words.is_empty() { String::new() } else { format!(", its last words:\n{words}\n") }
}
