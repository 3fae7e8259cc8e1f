//! The slots' hold on processes under a supervisor.

use super::rehearser::Rehearser;
use super::supervisor::Supervisor;
use super::tap::Tap;
use rehearsal::{Snapshot, Verdict};
use runtime::ipc::Bus;
use scenario::orders::Sent;
use shared_types::{Handover, OwnerRecord, Seat as Place, Seating};
use std::path::Path;
use swap::child::ChildSpec;
use swap::{FlightError, PostEvent, Posts, RehearsalSpec, Seen, SlotWatch};

/// Processes under a supervisor.
pub(super) struct Processes<'a> {
    pub(super) bus: &'a Bus,
    pub(super) supervisor: &'a mut Supervisor,
    pub(super) tap: &'a mut Tap,
    pub(super) rehearser: &'a mut Rehearser,
    pub(super) now_mono_ns: u64,
}

impl Posts for Processes<'_> {
    fn spawn(&mut self, place: Place, spec: ChildSpec) {
        self.supervisor.spawn(self.bus, place, spec);
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
        self.supervisor.hand_over(place, order, state, self.tap);
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
    fn stderr_so_far(&self, place: Place) -> String {
        self.supervisor.stderr_so_far(place)
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
        self.tap.sinks.slot_watch.as_mut().map(SlotWatch::take).unwrap_or_default()
    }
    fn snapshot(&self, at_ns: u64) -> Option<Snapshot> {
        self.tap.sinks.slot_watch.as_ref()?.snapshot(at_ns)
    }
    fn tracking_error_m(&self, at_ns: u64) -> Option<f64> {
        self.tap.sinks.slot_watch.as_ref()?.tracking_error_m(at_ns)
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
    fn record_seating(&mut self, seating: &Seating, config: Option<&Path>) {
        if seating.has_state.is_set() {
            let from = Place { role: seating.role, index: seating.state_seat };
            self.tap.keep_state_of(from, self.now_mono_ns);
        }
        self.tap.sinks.record_seating(seating, self.now_mono_ns);
        // What cannot be read any more, the process could not read either.
        if let Some(text) = config.and_then(|path| std::fs::read_to_string(path).ok()) {
            self.tap.sinks.attach_config(seating, &text);
        }
    }
}
