//! Processes that are started again before anything is opened that they do not need, while the vehicle flies without them.

use super::HELLOS;
use super::registration::Joined;
use crate::checkpoint::Checkpoint;
use runtime::Place;
use runtime::ipc::{Bus, IpcSource, PortError, ServiceKind};
use runtime::leader::process_start;
use scenario::needs::MemoryNeed;
use shared_types::{Hello, OwnerRecord, Role, Seat};
use std::path::Path;
use swap::PostNote;
use swap::child::{Launch, RunningChild};

/// What a launcher that takes over has started before its supervisor is there.
pub(crate) struct StartedFirst {
    children: Vec<(Seat, RunningChild)>,
    /// Receives their hellos meanwhile; none if the service is not there, as when another program has freed it.
    hello: Option<IpcSource<Hello>>,
}

impl StartedFirst {
    /// Starts what has died while no launcher led, and notes it in the run's folder: what was in no slot, and the owner of
    /// a slot in which nothing lives that could command in its place. What cannot be started is left to the supervisor.
    pub(crate) fn of(
        checkpoint: &mut Checkpoint,
        folder: &Path,
        bus: &Bus,
        room: MemoryNeed,
    ) -> Self {
        let hello = hellos(bus).ok();
        let due = if hello.is_some() { due(checkpoint) } else { Vec::new() };
        let mut started = Self { children: Vec::new(), hello };
        // A launcher after this one must take no generation that was started here for one of its own.
        for &index in &due {
            checkpoint.posts[index].generation += 1;
        }
        if due.is_empty() || checkpoint.save(folder).is_err() {
            return started;
        }
        for index in due {
            let note = &mut checkpoint.posts[index];
            let place = Place { seat: note.seat, generation: note.generation + 1 };
            let child = room
                .look(0)
                .ok()
                .and_then(|()| RunningChild::start(&note.spec, folder, place, true).ok());
            let Some(child) = child else { continue };
            note.generation = place.generation;
            note.process = Some((child.pid(), process_start(child.pid()).unwrap_or(0)));
            (note.pipes, note.ready) = (child.pipes(), false);
            started.children.push((note.place(), child));
        }
        // If it cannot be written now, the supervisor reports it as soon as it writes.
        let _ = checkpoint.save(folder);
        started
    }

    pub(super) fn has(&self, seat: Seat) -> bool {
        self.children.iter().any(|(own, _)| *own == seat)
    }

    pub(super) fn take_hellos(&mut self, bus: &Bus) -> Result<IpcSource<Hello>, PortError> {
        self.hello.take().map_or_else(|| hellos(bus), Ok)
    }

    pub(super) fn take(&mut self, seat: Seat) -> Option<RunningChild> {
        let index = self.children.iter().position(|(own, _)| *own == seat)?;
        Some(self.children.swap_remove(index).1)
    }
}

fn hellos(bus: &Bus) -> Result<IpcSource<Hello>, PortError> {
    IpcSource::with_capacity(&bus.open_service::<Hello>(ServiceKind::Hello)?, HELLOS)
}

/// A process of a slot that was started first, until its slot asks for it.
#[derive(Debug)]
pub(super) struct Expected {
    pub(super) seat: Seat,
    /// Its hello, if that has arrived by then.
    pub(super) joined: Option<Joined>,
}

/// Which of the noted processes are to be started; none without a plant, of which nothing goes on.
fn due(checkpoint: &Checkpoint) -> Vec<usize> {
    let notes = &checkpoint.posts;
    let lives = |note: &PostNote| {
        note.process.is_some_and(|(pid, started)| process_start(pid) == Some(started))
    };
    let is_gone = |note: &PostNote| !note.finished && !lives(note);
    if notes.iter().any(|note| note.place().role == Role::Plant && is_gone(note)) {
        return Vec::new();
    }
    let owns =
        |record: &OwnerRecord, seat: Seat| record.slot == seat.role && record.owner == seat.index;
    let is_due = |note: &PostNote| {
        let seat = note.place();
        let is_missed = seat.role.seats() == 1
            || checkpoint.owners.iter().any(|record| owns(&record.0, seat))
                && !notes.iter().any(|other| other.place().role == seat.role && lives(other));
        // A program of a user may have been written without regard to what is not there yet.
        is_missed && is_gone(note) && matches!(note.spec.launch, Launch::Service { .. })
    };
    let due = notes.iter().enumerate().filter(|(_, note)| is_due(note));
    due.map(|(index, _)| index).collect()
}
