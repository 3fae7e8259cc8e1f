//! What is noted for the next launcher, and how that one goes on from there.

use super::deaths::PLANT_GONE;
use super::started_first::{Expected, StartedFirst};
use super::sweep::Sweep;
use super::{Notice, RestartPolicy, Supervisor};
use crate::checkpoint::{Checkpoint, CheckpointWriter};
use crate::tap::Tap;
use runtime::SeatMarks;
use runtime::clock::WallMap;
use runtime::ipc::{Bus, PortError};
use shared_types::{ClockRecord, OwnerRecord, Role, Seat};
use std::path::{Path, PathBuf};
use swap::child::RunningChild;
use swap::post::Post;
use swap::{FlightError, OrderSinks, PostNote, RegistryWriter, SlotOwner};

impl Supervisor {
    /// Takes over from a launcher that has died: the processes that live are held, with those that were `started` first,
    /// and the others are counted as gone.
    pub(crate) fn take_over(
        bus: &Bus,
        folder: PathBuf,
        (checkpoint, started): (&Checkpoint, &mut StartedFirst),
        policy: RestartPolicy,
        checkpoint_writer: CheckpointWriter,
    ) -> Result<Self, PortError> {
        let posts = checkpoint.posts.iter().map(|note| taken_over(bus, note, started));
        let mut supervisor = Self {
            folder,
            policy,
            posts: posts.collect::<Result<_, _>>()?,
            registry: RegistryWriter::open(bus)?,
            slots: SlotOwner::open_all(bus)?,
            orders: OrderSinks::open(bus)?,
            events: Vec::new(),
            checkpoint_writer,
            wall: Some(WallMap::new(&checkpoint.clock.0)),
            joined_mono_ns: 0,
            notices: Vec::new(),
            recovered: 0,
            put_off: Vec::new(),
            expected: Vec::new(),
            sweep: policy.frees_meanwhile.then(|| Sweep::of(bus)),
            hello: started.take_hellos(bus)?,
        };
        // What is noted from here on must hold for the next launcher, should this one die.
        for slot in &mut supervisor.slots {
            for record in records_of(checkpoint, slot.role) {
                slot.take(*record, &mut SeatMarks::default());
            }
        }
        supervisor.orders.go_on(&checkpoint.guidance.0, &checkpoint.disturbance.0);
        let entries: Vec<_> = checkpoint.registry.iter().map(|entry| entry.0).collect();
        supervisor.registry.go_on(&entries);
        let gone = supervisor.posts.iter().filter(|post| post.child.is_none());
        let gone: Vec<Seat> = gone.map(|post| post.seat).collect();
        for seat in gone {
            supervisor.registry.leave(seat);
        }
        for index in 0..supervisor.posts.len() {
            let post = &mut supervisor.posts[index];
            let Some(child) = started.take(post.seat) else { continue };
            post.hold(child, true);
            if post.seat.role.is_slot() {
                // Where it begins is for its slot to decide.
                post.goes_on = false;
                let seat = post.seat;
                supervisor.expected.push(Expected { seat, joined: None });
            } else {
                supervisor.report_restart(index);
            }
        }
        Ok(supervisor)
    }

    fn report_restart(&mut self, index: usize) {
        let source = self.posts[index].spec.name.clone();
        let text = format!(
            "{source} has died while the flight had no launcher: starting it anew, without its state"
        );
        self.notices.push(Notice { source, text });
        self.recovered += 1;
    }

    /// Starts a process again that was not in a slot, is gone, and could not be started first.
    pub(crate) fn start_gone(&mut self, now_ns: u64) {
        if self.is_plant_gone() {
            return;
        }
        // A launcher after this one must take no generation that was started here for one of its own.
        self.note();
        for index in 0..self.posts.len() {
            let post = &self.posts[index];
            if post.child.is_some() || post.finished || post.seat.role.seats() > 1 {
                continue;
            }
            self.report_restart(index);
            // One that cannot be started is tried again as any other.
            let _put_off = self.start_again(index, false, now_ns);
            self.note();
        }
    }

    fn is_plant_gone(&self) -> bool {
        let mut plant = self.posts.iter().filter(|post| post.seat.role == Role::Plant);
        plant.any(|post| post.child.is_none() && !post.finished)
    }

    /// Publishes again which process sits where and which commands, as the launcher before has published it last.
    ///
    /// # Errors
    /// Nothing is left to fly.
    pub(crate) fn go_on(
        &mut self,
        checkpoint: &Checkpoint,
        tap: &mut Tap,
    ) -> Result<(), FlightError> {
        self.registry.publish();
        tap.marks.learn_registry(self.registry.entries());
        for slot in &mut self.slots {
            for record in records_of(checkpoint, slot.role) {
                slot.take(*record, &mut tap.marks);
            }
            if slot.epoch() > 0 {
                tap.record_owner(slot.before());
                slot.publish();
            }
        }
        if self.is_plant_gone() {
            return Err(FlightError::Lost {
                name: Role::Plant.label().to_owned(),
                how: "died while the flight had no launcher".to_owned(),
                last_stderr: String::new(),
                reason: PLANT_GONE.to_owned(),
            });
        }
        self.note();
        Ok(())
    }

    /// Folder of the run.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Seats whose processes live, with layout and period of each \[ns\].
    pub(crate) fn living(&self) -> impl Iterator<Item = (Seat, u64, u64)> {
        let living = self.posts.iter().filter(|post| post.child.is_some() && post.ready);
        living.map(|post| (post.seat, post.layout, post.period_ns))
    }

    /// Notes that what other launchers have left is free.
    pub(crate) fn note_swept(&mut self) {
        self.checkpoint_writer.swept();
        self.note();
    }

    /// Notes how time runs.
    pub(crate) fn note_clock(&mut self, record: &ClockRecord) {
        self.checkpoint_writer.clock(record);
        self.note();
    }

    /// Notes which processes there are and which command.
    pub(super) fn note(&mut self) {
        let posts = self.posts.iter().map(|post| PostNote {
            role: post.seat.role.label().to_owned(),
            seat: post.seat.index,
            generation: post.generation,
            spec: post.spec.clone(),
            process: post.child.as_ref().map(|child| (child.pid(), post.started)),
            pipes: post.child.as_ref().map(RunningChild::pipes).unwrap_or_default(),
            ready: post.ready,
            finished: post.finished,
            layout: post.layout,
            period_ns: post.period_ns,
        });
        let (guidance, disturbance) = self.orders.last();
        self.checkpoint_writer.orders(guidance, disturbance);
        self.checkpoint_writer.write(
            self.registry.entries(),
            self.slots.iter().map(|slot| [slot.before(), slot.last()]),
            posts,
        );
        if let Some(text) = self.checkpoint_writer.take_trouble() {
            self.notices.push(Notice { source: "launcher".to_owned(), text });
        }
    }
}

/// What was published about the owner of a slot: the record before the last one, and that one.
fn records_of(checkpoint: &Checkpoint, slot: Role) -> impl Iterator<Item = &OwnerRecord> {
    let records = checkpoint.owners_before.iter().chain(&checkpoint.owners);
    records.map(|record| &record.0).filter(move |record| record.slot == slot)
}

fn taken_over(bus: &Bus, note: &PostNote, started: &StartedFirst) -> Result<Post, PortError> {
    let mut post = Post::open(bus, note.place(), note.spec.clone())?;
    if started.has(post.seat) {
        // Its process comes to it once all others are there.
        (post.generation, post.layout, post.period_ns) =
            (note.generation, note.layout, note.period_ns);
        return Ok(post);
    }
    let take_over =
        |(pid, started)| RunningChild::take_over(pid, started, &note.spec.name, note.pipes);
    let mut living = note.process.and_then(take_over);
    // It waits for a message that its launcher can no longer send.
    if let Some(waits) = living.take_if(|_| !note.ready) {
        waits.end();
    }
    post.started = note.process.map_or(0, |(_, started)| started);
    // A process may have been started here that no launcher has noted.
    post.generation = note.generation + u32::from(living.is_none());
    post.ready = living.is_some();
    post.finished = note.finished;
    post.child = living;
    post.layout = note.layout;
    post.period_ns = note.period_ns;
    Ok(post)
}
