//! Does what the slots want done: the supervisor of processes, or a flight in one process.

use super::watch::Seen;
use crate::child::ChildSpec;
use crate::{FlightError, PostEvent, RehearsalSpec};
use rehearsal::{Snapshot, Verdict};
use scenario::orders::Sent;
use shared_types::{Handover, OwnerRecord, Seat as Place, Seating};
use std::path::Path;

/// Starts, ends and observes the processes that sit in slots.
pub trait Posts {
    /// Starts a process on a seat that is free; its hand-over gives where it begins. One that cannot be
    /// started is reported as one that has gone.
    fn spawn(&mut self, place: Place, spec: ChildSpec);
    /// Starts again the process that had a seat; its hand-over gives where it begins.
    ///
    /// # Errors
    /// [`FlightError`] if the process cannot be started.
    fn restart(&mut self, place: Place) -> Result<(), FlightError>;
    /// Publishes to all processes which seat owns a slot from when.
    fn announce(&mut self, record: OwnerRecord);
    /// Lets a process begin that has been started in flight.
    ///
    /// # Errors
    /// [`FlightError`] if it cannot begin from that state.
    fn hand_over(&mut self, place: Place, order: Handover, state: &[u8])
    -> Result<(), FlightError>;
    /// The last state published from a seat, and the generation of the process that did.
    fn last_state(&mut self, place: Place) -> Option<(u32, Vec<u8>)>;
    /// Ends a process; that is reported as an event.
    fn kill(&mut self, place: Place);
    /// Ends a process before time goes on; that is reported as an event.
    fn kill_at_once(&mut self, place: Place);
    /// Stops a process without ending it; in a slot no other waits for it any more.
    fn stop(&mut self, place: Place);
    /// What a process has written to its standard error until now, for the end of a sentence.
    fn stderr_so_far(&self, place: Place) -> String;
    /// Seat of a process of this name.
    fn seat_of(&self, name: &str) -> Option<Place>;
    /// How many processes have had a seat before the one that has it, or had it last.
    fn generation(&self, place: Place) -> Option<u32>;
    /// The processes that have come and gone since the last time.
    fn take_events(&mut self) -> Vec<PostEvent>;
    /// What the vehicle knows of itself at an instant; `None` before it knows anything.
    fn snapshot(&self, at_ns: u64) -> Option<Snapshot>;
    /// Distance from the estimate to the reference at an instant \[m\]; `None` without either.
    fn tracking_error_m(&self, at_ns: u64) -> Option<f64>;
    /// Begins to fly a candidate ahead, for at most `wall_max_s`; why not, if it cannot be.
    ///
    /// # Errors
    /// Why the candidate cannot be flown ahead.
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
    /// Records which process takes a seat, and what configures it alone.
    fn record_seating(&mut self, seating: &Seating, config: Option<&Path>);
    /// Sends pilot or injector an order.
    fn send_order(&mut self, sent: &Sent);
}
