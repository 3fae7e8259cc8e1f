//! Who does what the slots want done: the supervisor of processes, or a flight in one process.

use super::watch::{Seen, SlotWatch};
use crate::rehearse::{RehearsalSpec, Snapshot, Verdict};
use crate::run::child::ChildSpec;
use crate::run::rehearser::Rehearser;
use crate::run::supervisor::{FlightError, PostEvent, Supervisor};
use crate::run::tap::Tap;
use runtime::ipc::Bus;
use scenario::orders::Sent;
use shared_types::{Handover, OwnerRecord, Seat as Place, Seating};
use std::path::Path;

/// Starts, ends and hears those who sit in slots.
pub(crate) trait Posts {
    /// Starts somebody on a seat that is free; it will be told where to begin.
    fn spawn(&mut self, place: Place, spec: ChildSpec) -> Result<(), FlightError>;
    /// Starts whoever had a seat again; it will be told where to begin.
    fn restart(&mut self, place: Place) -> Result<(), FlightError>;
    /// Tells everybody who owns a slot from when.
    fn announce(&mut self, record: OwnerRecord);
    /// Lets somebody begin who has been started in flight.
    fn hand_over(&mut self, place: Place, order: Handover, state: &[u8])
    -> Result<(), FlightError>;
    /// The last state published from a seat, and the generation of whoever did.
    fn last_state(&mut self, place: Place) -> Option<(u32, Vec<u8>)>;
    /// Ends somebody; that is told as an event.
    fn kill(&mut self, place: Place);
    /// Ends somebody before time goes on; that is told as an event.
    fn kill_at_once(&mut self, place: Place);
    /// Stops somebody without ending it, and lets nobody wait for it any more.
    fn stop(&mut self, place: Place);
    /// What a process has said on its standard error until now, for the end of a sentence.
    fn words_so_far(&self, place: Place) -> String;
    /// Seat of a process of this name.
    fn seat_of(&self, name: &str) -> Option<Place>;
    /// How many have had a seat before the one that has it, or had it last.
    fn generation(&self, place: Place) -> Option<u32>;
    /// Who has come and gone since the last time.
    fn take_events(&mut self) -> Vec<PostEvent>;
    /// What the vehicle knows of itself at an instant; `None` before it knows anything.
    fn snapshot(&self, at_ns: u64) -> Option<Snapshot>;
    /// Distance from the estimate to the reference at an instant \[m\]; `None` without either.
    fn tracking_error_m(&self, at_ns: u64) -> Option<f64>;
    /// Begins to fly a candidate ahead, for at most `wall_max_s`; why not, if it cannot be.
    fn rehearse(
        &mut self,
        place: Place,
        spec: RehearsalSpec,
        wall_max_s: f64,
    ) -> Result<(), String>;
    /// Ends a rehearsal whose verdict is no longer wanted.
    fn end_rehearsal(&mut self, place: Place);
    /// Verdicts that have come since the last time.
    fn take_rehearsed(&mut self) -> Vec<(Place, Verdict)>;
    /// What has been seen of the slots since the last time.
    fn take_seen(&mut self) -> Vec<Seen>;
    /// Has it recorded who takes a seat, and what configures it alone.
    fn tell_seating(&mut self, seating: &Seating, config: Option<&Path>);
    /// Tells pilot or injector what has been ordered.
    fn send_order(&mut self, sent: &Sent);
}

/// Processes under a supervisor.
pub(in crate::run) struct Processes<'a> {
    pub(in crate::run) bus: &'a Bus,
    pub(in crate::run) supervisor: &'a mut Supervisor,
    pub(in crate::run) tap: &'a mut Tap,
    pub(in crate::run) rehearser: &'a mut Rehearser,
    pub(in crate::run) now_mono_ns: u64,
}

impl Posts for Processes<'_> {
    fn spawn(&mut self, place: Place, spec: ChildSpec) -> Result<(), FlightError> {
        self.supervisor.spawn(self.bus, place, spec)
    }
    fn restart(&mut self, place: Place) -> Result<(), FlightError> {
        self.supervisor.restart(place, self.now_mono_ns)
    }
    fn announce(&mut self, record: OwnerRecord) {
        self.supervisor.announce(record, self.tap);
    }
    fn hand_over(
        &mut self,
        place: Place,
        order: Handover,
        state: &[u8],
    ) -> Result<(), FlightError> {
        self.supervisor.hand_over(place, order, state);
        Ok(())
    }
    fn last_state(&mut self, place: Place) -> Option<(u32, Vec<u8>)> {
        self.tap.last_state_of(place).map(|(generation, bytes)| (generation, bytes.to_vec()))
    }
    fn kill(&mut self, place: Place) {
        self.supervisor.kill(place);
    }
    fn kill_at_once(&mut self, place: Place) {
        self.supervisor.kill_at_once(place);
    }
    fn stop(&mut self, place: Place) {
        self.supervisor.stop(place, self.tap);
    }
    fn words_so_far(&self, place: Place) -> String {
        self.supervisor.words_so_far(place)
    }
    fn seat_of(&self, name: &str) -> Option<Place> {
        self.supervisor.seat_of(name)
    }
    fn generation(&self, place: Place) -> Option<u32> {
        self.supervisor.generation(place)
    }
    fn take_events(&mut self) -> Vec<PostEvent> {
        self.supervisor.take_events()
    }
    fn take_seen(&mut self) -> Vec<Seen> {
        self.tap.consumers.slot_watch.as_mut().map(SlotWatch::take).unwrap_or_default()
    }
    fn snapshot(&self, at_ns: u64) -> Option<Snapshot> {
        self.tap.consumers.slot_watch.as_ref()?.snapshot(at_ns)
    }
    fn tracking_error_m(&self, at_ns: u64) -> Option<f64> {
        self.tap.consumers.slot_watch.as_ref()?.tracking_error_m(at_ns)
    }
    fn rehearse(
        &mut self,
        place: Place,
        spec: RehearsalSpec,
        wall_max_s: f64,
    ) -> Result<(), String> {
        let begun = self.rehearser.begin(place, &spec, (self.now_mono_ns, wall_max_s));
        begun.map_err(|error| format!("its process cannot be started: {error}"))
    }
    fn end_rehearsal(&mut self, place: Place) {
        self.rehearser.end(place);
    }
    fn take_rehearsed(&mut self) -> Vec<(Place, Verdict)> {
        self.rehearser.take(self.now_mono_ns)
    }
    fn send_order(&mut self, sent: &Sent) {
        self.supervisor.send_order(sent);
    }
    fn tell_seating(&mut self, seating: &Seating, config: Option<&Path>) {
        self.tap.consumers.tell_seating(seating, self.now_mono_ns);
        // What cannot be read any more, the process could not read either.
        if let Some(text) = config.and_then(|path| std::fs::read_to_string(path).ok()) {
            self.tap.consumers.attach_config(seating, &text);
        }
    }
}
