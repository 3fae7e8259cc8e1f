//! What a dead launcher has left in shared memory. Freeing it takes tenths of a second, in which nothing that has died
//! could be led on: so the flight goes first as long as there is room for what is left, and else both go at once.

use runtime::ipc::{Bus, Sweeper};
use scenario::needs::MemoryNeed;
use std::thread::{self, JoinHandle};

/// For how long the flight has been led before it begins \[ns\].
const AFTER_NS: u64 = 1_000_000_000;

/// Frees it on a thread of its own.
#[derive(Debug)]
pub(super) struct Leftovers {
    sweeper: Sweeper,
    freeing: Option<JoinHandle<()>>,
}

impl Leftovers {
    /// Left for later, unless another launcher has left some as well, or memory is too short for a second flight.
    pub(super) fn of(bus: &Bus, are_several: bool, takes_all: bool) -> Self {
        let mut leftovers = Self { sweeper: bus.sweeper(), freeing: None };
        let second = if takes_all { MemoryNeed::RESERVED } else { MemoryNeed::LOCKSTEP };
        if are_several || second.look(0).is_err() {
            leftovers.begin();
        }
        leftovers
    }

    /// Begins when it is time, the flight having been led for `led_ns`; true once all is free.
    pub(super) fn are_freed(&mut self, led_ns: u64) -> bool {
        if self.freeing.is_none() && led_ns >= AFTER_NS {
            self.begin();
        }
        self.freeing.as_ref().is_some_and(JoinHandle::is_finished)
    }

    /// Waits for the end of what has begun. All processes are gone, and no object is empty.
    pub(super) fn finish(self) {
        let _ = self.freeing.map(JoinHandle::join);
    }

    fn begin(&mut self) {
        let sweeper = self.sweeper.clone();
        let free = move || sweeper.sweep(&mut || ());
        // Without a thread for it now there may be one at the next look.
        self.freeing = thread::Builder::new().name("sweep".to_owned()).spawn(free).ok();
    }
}
