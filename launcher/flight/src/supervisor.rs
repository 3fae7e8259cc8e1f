//! Keeps the processes of a flight alive: ready, owners, restarts, stalls, exit reasons.
//!
//! `registration.rs` has how they come, `deaths.rs` how they go, `participants.rs` which loops fly, `take_over.rs` how
//! the next launcher goes on.

mod deaths;
mod participants;
mod registration;
mod started_first;
pub(crate) mod sweep;
mod take_over;

use registration::Joined;
use started_first::Expected;
pub(super) use started_first::StartedFirst;
use sweep::Sweep;

use super::checkpoint::CheckpointWriter;
use super::tap::Tap;
use runtime::clock::{WallMap, mono_now_ns, sleep_until};
use runtime::ipc::{Bus, IpcSource, PortError, TopicFactory};
use runtime::{Graph, StateHeader};
use scenario::needs::MemoryNeed;
use scenario::orders::Sent;
use shared_types::{Flag, Handover, Hello, OwnerRecord, RegistryEntry, Role, Seat};
use std::path::PathBuf;
use swap::child::{ChildSpec, RunningChild, describe_unready};
use swap::post::Post;
use swap::{FlightError, OrderSinks, PostEvent, RegistryWriter, SlotOwner};

/// Most hellos of joining processes that are kept.
const HELLOS: usize = 64;
/// How long what is to happen waits for all processes to look after their readers \[ns\].
const SERVE_LIMIT_NS: u64 = 1_000_000_000;

/// What to do about crashes.
#[derive(Debug, Clone, Copy)]
pub(super) struct RestartPolicy {
    /// Pause before the first restart; doubles with every further one \[ns\].
    pub(super) backoff_ns: u64,
    /// Longest pause \[ns\].
    pub(super) backoff_max_ns: u64,
    /// Restarts of one process within a minute before the flight is given up.
    pub(super) limit: usize,
    /// Memory that must be free before a process is started in flight.
    pub(super) room: MemoryNeed,
    /// Whether successors are started while what the dead have left is still being freed.
    pub(super) frees_meanwhile: bool,
}

/// From one attempt to start a process again that cannot be started to the next \[ns\].
const PUT_OFF_NS: u64 = 20_000_000;
/// For how long this is tried before the flight goes on, or ends, without it \[ns\].
const PUT_OFF_LIMIT_NS: u64 = 10_000_000_000;

/// A line for the log of the flight.
#[derive(Debug, Clone)]
pub(super) struct Notice {
    pub(super) source: String,
    pub(super) text: String,
}

/// A process as others see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Member<'a> {
    pub(super) seat: Seat,
    pub(super) name: &'a str,
    pub(super) pid: Option<u32>,
    pub(super) generation: u32,
    pub(super) ready: bool,
    pub(super) finished: bool,
}

/// Supervises all processes of one flight.
pub(super) struct Supervisor {
    folder: PathBuf,
    policy: RestartPolicy,
    posts: Vec<Post>,
    hello: IpcSource<Hello>,
    registry: RegistryWriter,
    slots: Vec<SlotOwner>,
    orders: OrderSinks,
    events: Vec<PostEvent>,
    checkpoint_writer: CheckpointWriter,
    /// Logical time of a flight that was taken over.
    wall: Option<WallMap>,
    /// When a process joined last, by `CLOCK_MONOTONIC` \[ns\].
    joined_mono_ns: u64,
    pub(super) notices: Vec<Notice>,
    pub(super) recovered: u64,
    /// Seats whose processes cannot be started again yet, which has been reported, and since when \[ns\].
    put_off: Vec<(Seat, u64)>,
    /// Processes of slots that are there before their slots have asked for them.
    expected: Vec<Expected>,
    /// None if the launcher waits for it.
    sweep: Option<Sweep>,
}

impl Supervisor {
    /// Prepares the posts; nothing is started yet.
    pub(super) fn new(
        bus: &Bus,
        folder: PathBuf,
        specs: Vec<(Role, ChildSpec)>,
        hello: &TopicFactory<Hello>,
        policy: RestartPolicy,
        checkpoint_writer: CheckpointWriter,
    ) -> Result<Self, PortError> {
        let posts = specs.into_iter().map(|(role, spec)| Post::open(bus, Seat::first(role), spec));
        Ok(Self {
            folder,
            policy,
            posts: posts.collect::<Result<_, _>>()?,
            hello: IpcSource::with_capacity(hello, HELLOS)?,
            registry: RegistryWriter::open(bus)?,
            slots: SlotOwner::open_all(bus)?,
            orders: OrderSinks::open(bus)?,
            events: Vec::new(),
            checkpoint_writer,
            wall: None,
            joined_mono_ns: 0,
            notices: Vec::new(),
            recovered: 0,
            put_off: Vec::new(),
            expected: Vec::new(),
            sweep: policy.frees_meanwhile.then(|| Sweep::of(bus)),
        })
    }

    /// Starts every process.
    pub(super) fn start_all(&mut self) -> Result<(), FlightError> {
        for post in &mut self.posts {
            if post.spec.pause_ns > 0 {
                sleep_until(mono_now_ns() + post.spec.pause_ns);
            }
            start(post, &self.folder, false)?;
        }
        self.note();
        Ok(())
    }

    /// Takes in the processes that have become ready. True once all are, and every slot has an owner.
    pub(super) fn await_ready(
        &mut self,
        bus: &Bus,
        graph: &Graph,
        tap: &mut Tap,
    ) -> Result<bool, FlightError> {
        for post in &mut self.posts {
            if let Some(status) = post.child.as_mut().and_then(RunningChild::exited) {
                return Err(FlightError::NotReady {
                    name: post.spec.name.clone(),
                    how: describe_unready(status),
                    last_stderr: post.last_stderr(),
                });
            }
        }
        for joined in self.take_hellos(bus, tap) {
            // The pilot holds the position slot of a rig flight.
            let role = joined.seat.role;
            let rigged = |slot: &&mut SlotOwner| {
                slot.role != role && graph.slot_holder(slot.role) == role && slot.epoch() == 0
            };
            if let Some(slot) = self.slots.iter_mut().find(rigged) {
                slot.begin(joined.period_ns, &mut tap.marks);
                slot.publish();
            }
            self.events.extend(joined.to_event());
        }
        // A reader that joined after the record was written has it only now.
        self.serve_late_joiners();
        let nodes = graph.nodes().iter();
        let seated = nodes.clone().all(|n| self.present().any(|e| e.role == n.role));
        Ok(seated)
    }

    /// True once every slot has an owner.
    pub(super) fn owners_known(&self) -> bool {
        self.slots.iter().all(|slot| slot.epoch() > 0)
    }

    /// Lets processes that have just joined see owners and states.
    fn serve_late_joiners(&mut self) {
        self.posts.iter_mut().for_each(Post::serve_late_joiners);
        self.slots.iter_mut().for_each(SlotOwner::serve_late_joiners);
        self.orders.serve_late_joiners();
        self.registry.serve_late_joiners();
    }

    /// Names of the processes that are not ready.
    pub(super) fn not_ready(&self) -> String {
        let waiting = self.posts.iter().filter(|post| !post.ready);
        let names: Vec<_> = waiting.map(|post| post.spec.name.as_str()).collect();
        names.join(", ")
    }

    /// The processes that take part now.
    pub(super) fn present(&self) -> impl Iterator<Item = &RegistryEntry> {
        self.registry.entries().iter().filter(|entry| entry.present.is_set())
    }

    /// Looks after deaths and successors; call often.
    pub(super) fn look_after(
        &mut self,
        bus: &Bus,
        tap: &mut Tap,
        keeps: &dyn Fn(Seat) -> bool,
        now_ns: u64,
    ) -> Result<(), FlightError> {
        for index in 0..self.posts.len() {
            self.reap_exited(bus, index, keeps, tap, now_ns)?;
            let is_due = self.posts[index].restart_at_ns.is_some_and(|at| now_ns >= at);
            let has_state = is_due && own_state(&self.posts[index], tap).is_some();
            if is_due && let Some(started) = self.start_again(index, has_state, now_ns) {
                let seat = self.posts[index].seat;
                match started {
                    Err(error) if seat.role.is_slot() => {
                        // Its file is gone, or no process can be had: which one commands now is for the slot to decide.
                        self.leave_registry(seat, tap);
                        self.never_started(seat, &error);
                    }
                    started => started?,
                }
                self.note();
            }
        }
        if let Some(sweep) = &mut self.sweep {
            let mut drain = || {
                tap.drain(now_ns);
            };
            sweep.look(&self.folder, &mut drain, now_ns);
        }
        let now_logical_ns = self.wall.map_or(0, |wall| wall.logical_ns(now_ns));
        for joined in self.take_hellos(bus, tap) {
            let seat = joined.seat;
            let post = self.posts.iter_mut().find(|post| post.seat == seat);
            let Some(post) = post.filter(|post| post.awaits_handover) else { continue };
            if post.goes_on {
                // It is in the registry before it can publish anything.
                let state = own_state(post, tap);
                let order = Handover {
                    has_state: Flag::from(state.is_some()),
                    join_ns: if state.is_some() { 0 } else { now_logical_ns },
                    ..Handover::default()
                };
                let state = state.unwrap_or_default();
                post.hand_over(tap.marks.name_writers(order, state), state);
            } else if let Some(expected) = self.expected.iter_mut().find(|own| own.seat == seat) {
                expected.joined = Some(joined);
            } else {
                self.events.extend(joined.to_event());
            }
        }
        self.serve_late_joiners();
        Ok(())
    }

    /// Starts a process that is due; none as long as it cannot be and is put off.
    fn start_again(
        &mut self,
        index: usize,
        has_state: bool,
        now_ns: u64,
    ) -> Option<Result<(), FlightError>> {
        let started = self.no_room_for(&self.posts[index].spec.name).map_or(Ok(()), Err);
        let started = started.and_then(|()| {
            let post = &mut self.posts[index];
            post.generation += 1;
            // Without a state a process begins with the flight, or now if that is long ago.
            let in_flight = has_state || !post.goes_on || self.wall.is_some();
            let started = start(post, &self.folder, in_flight);
            post.generation -= u32::from(started.is_err());
            started
        });
        match started {
            Err(error)
                if matches!(error, FlightError::NoRoom { .. })
                    || !self.posts[index].seat.role.is_slot() =>
            {
                self.put_off(index, error, now_ns)
            }
            started => {
                self.posts[index].restart_at_ns = None;
                let seat = self.posts[index].seat;
                self.put_off.retain(|(waiting, _)| *waiting != seat);
                Some(started)
            }
        }
    }

    /// What has happened in the slots since the last time.
    pub(super) fn take_events(&mut self) -> Vec<PostEvent> {
        core::mem::take(&mut self.events)
    }

    /// Starts a process on a seat of a slot that is free. One that cannot be started has gone at once, and the
    /// reason is reported: what is ordered in flight never ends the flight.
    pub(super) fn spawn(&mut self, bus: &Bus, seat: Seat, spec: ChildSpec) {
        self.expected.retain(|own| own.seat != seat);
        self.put_off.retain(|(waiting, _)| *waiting != seat);
        if let Some(no_room) = self.no_room_for(&spec.name) {
            return self.never_started(seat, &no_room);
        }
        let mut post = match Post::open(bus, seat, spec) {
            Ok(post) => post,
            Err(error) => return self.never_started(seat, &error.into()),
        };
        let before = self.posts.iter().position(|post| post.seat == seat);
        if let Some(before) = before {
            post.generation = self.posts.swap_remove(before).generation + 1;
        }
        post.goes_on = false;
        let started = start(&mut post, &self.folder, true);
        self.posts.push(post);
        self.note();
        if let Err(error) = started {
            self.never_started(seat, &error);
        }
    }

    /// Why a process cannot be started now, if memory is short.
    fn no_room_for(&self, name: &str) -> Option<FlightError> {
        let shortage = self.policy.room.look(0).err()?;
        Some(FlightError::NoRoom { name: name.to_owned(), shortage })
    }

    /// Lets a process be started again later that cannot be started now; the reason is reported once, and ends the
    /// waiting after some time.
    fn put_off(
        &mut self,
        index: usize,
        reason: FlightError,
        now_ns: u64,
    ) -> Option<Result<(), FlightError>> {
        let seat = self.posts[index].seat;
        let since_ns = self.put_off.iter().find(|(waiting, _)| *waiting == seat);
        let since_ns = since_ns.map_or(now_ns, |(_, since_ns)| *since_ns);
        self.put_off.retain(|(waiting, _)| *waiting != seat);
        if now_ns.saturating_sub(since_ns) > PUT_OFF_LIMIT_NS {
            self.posts[index].restart_at_ns = None;
            return Some(Err(reason));
        }
        if since_ns == now_ns {
            let source = self.posts[index].spec.name.clone();
            self.notices.push(Notice { source, text: reason.to_string() });
        }
        self.put_off.push((seat, since_ns));
        self.posts[index].restart_at_ns = Some(now_ns + PUT_OFF_NS);
        None
    }

    fn never_started(&mut self, place: Seat, why: &FlightError) {
        self.events.push(PostEvent::Gone { place, exit_reason: Some(why.to_string()) });
    }

    /// Starts the process of a seat again; it will be given where to begin.
    pub(super) fn restart(&mut self, seat: Seat, now_ns: u64) -> Result<(), FlightError> {
        let Some(index) = self.posts.iter().position(|post| post.seat == seat) else {
            return Ok(());
        };
        let pause_ns = self.pause_before_restart(index, now_ns).map_err(|reason| {
            let (how, last_stderr) = ("keeps dying".to_owned(), String::new());
            FlightError::Lost {
                name: self.posts[index].spec.name.clone(),
                how,
                last_stderr,
                reason,
            }
        })?;
        self.recovered += 1;
        if let Some(there) = self.expected.iter().position(|own| own.seat == seat) {
            let Expected { joined, .. } = self.expected.swap_remove(there);
            self.events.extend(joined.and_then(Joined::to_event));
            return Ok(());
        }
        let post = &mut self.posts[index];
        post.goes_on = false;
        post.restart_at_ns = Some(now_ns + pause_ns);
        Ok(())
    }

    /// Lets a process begin that has been started in flight.
    pub(super) fn hand_over(&mut self, seat: Seat, order: Handover, state: &[u8], tap: &Tap) {
        let order = tap.marks.name_writers(order, state);
        if let Some(post) = self.posts.iter_mut().find(|post| post.seat == seat) {
            post.hand_over(order, state);
        }
    }

    /// Publishes to all processes which seat owns a slot from when.
    pub(super) fn announce(&mut self, record: OwnerRecord, tap: &mut Tap) {
        let Some(slot) = self.slots.iter().position(|slot| slot.role == record.slot) else {
            return;
        };
        self.slots[slot].take(record, &mut tap.marks);
        // Noted before any process receives it: no launcher may find an epoch that it does not know.
        self.note();
        self.slots[slot].publish();
    }

    /// Sends pilot or injector an order.
    pub(super) fn send_order(&mut self, sent: &Sent) {
        self.orders.take(sent);
        self.note();
        self.orders.send(sent);
    }

    /// How many processes have had a seat before the one that has it, or had it last.
    pub(super) fn generation(&self, seat: Seat) -> Option<u32> {
        self.posts.iter().find(|post| post.seat == seat).map(|post| post.generation)
    }

    /// Seat of the process of this name that is not in a slot, or of the only one of its role.
    pub(super) fn seat_of(&self, name: &str) -> Option<Seat> {
        self.posts.iter().find(|post| post.spec.name == name).map(|post| post.seat)
    }

    /// True while a process on a seat is to be waited for at the end: it flies to the end.
    fn flies_on(post: &Post) -> bool {
        post.child.is_some() || post.restart_at_ns.is_some()
    }

    /// Which process fills which seat now, for clients that ask.
    pub(super) fn members(&self) -> impl Iterator<Item = Member<'_>> {
        // A process that has left its seat in a slot is not there any more.
        let there = |post: &&Post| post.seat.role.seats() == 1 || Self::flies_on(post);
        self.posts.iter().filter(there).map(|post| Member {
            seat: post.seat,
            name: &post.spec.name,
            pid: post.child.as_ref().map(RunningChild::pid),
            generation: post.generation,
            ready: post.ready,
            finished: post.finished,
        })
    }

    /// The last owner record of each slot, after its first.
    pub(super) fn owners(&self) -> impl Iterator<Item = &OwnerRecord> {
        self.slots.iter().map(SlotOwner::last).filter(|record| record.epoch > 0)
    }

    /// True once every process has finished its flight.
    pub(super) fn all_finished(&self) -> bool {
        self.posts.iter().all(|post| post.finished || !Self::flies_on(post))
    }

    /// When a process joined last, by `CLOCK_MONOTONIC` \[ns\].
    pub(super) fn joined_mono_ns(&self) -> u64 {
        self.joined_mono_ns
    }

    /// True while a process is starting, waits for its first orders, or is to be started again.
    pub(super) fn has_arrivals(&self) -> bool {
        let arrives = |post: &Post| {
            post.restart_at_ns.is_some()
                || post.child.is_some() && (!post.ready || post.awaits_handover)
        };
        self.posts.iter().any(arrives)
    }

    /// True while a process that has been restarted is not ready, for which it has a limit of its own.
    pub(super) fn is_restarting(&self) -> bool {
        let is_new = |post: &Post| post.child.is_some() && !post.ready;
        self.posts.iter().any(|post| is_new(post) && !post.restarts.is_empty())
    }

    /// Names of processes still running.
    pub(super) fn unfinished(&self) -> Vec<&str> {
        let running = self.posts.iter().filter(|post| Self::flies_on(post));
        running.map(|post| post.spec.name.as_str()).collect()
    }
}

fn start(
    post: &mut Post,
    folder: &std::path::Path,
    awaits_handover: bool,
) -> Result<(), FlightError> {
    let name = post.spec.name.clone();
    post.start(folder, awaits_handover).map_err(|source| FlightError::Start { name, source })
}

/// The last state published from a post, if it is of the kind that its process publishes: one that died before its
/// first state has left that of the process before it, perhaps of another program.
fn own_state<'a>(post: &Post, tap: &'a Tap) -> Option<&'a [u8]> {
    tap.last_state(post.seat).filter(|state| StateHeader::has_layout(state, post.layout))
}
