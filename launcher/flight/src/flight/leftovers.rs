//! What a dead launcher has left in shared memory. Freeing it takes tenths of a second, in which nothing that has died
//! could be led on: so the flight goes first as long as there is room for what is left, and else both go at once.

use crate::supervisor::sweep::Sweep;
use runtime::ipc::{Bus, Sweeper};
use scenario::needs::MemoryNeed;
use std::path::Path;
use std::thread::{self, JoinHandle};

/// For how long the flight has been led before it begins \[ns\].
const AFTER_NS: u64 = 1_000_000_000;

/// Frees it on a thread of its own.
#[derive(Debug)]
pub(super) enum Leftovers {
    /// Not yet.
    Later(Sweeper),
    /// From before the flight is led: as a rule nothing that is dead by then has sent anything to it.
    Before(JoinHandle<()>),
    /// While it is led: of what has died meanwhile all that it has sent is received first.
    Meanwhile(Sweep),
}

impl Leftovers {
    /// Left for later, unless another launcher has left some as well, or memory is too short for a second flight.
    pub(super) fn of(bus: &Bus, are_several: bool, takes_all: bool) -> Self {
        let second = if takes_all { MemoryNeed::RESERVED } else { MemoryNeed::LOCKSTEP };
        let later = Self::Later(bus.sweeper());
        if !are_several && second.look(0).is_ok() {
            return later;
        }
        let sweeper = bus.sweeper();
        let free = move || sweeper.sweep(&mut || ());
        // Without a thread for it now there may be one later.
        thread::Builder::new().name("sweep".to_owned()).spawn(free).map_or(later, Self::Before)
    }

    /// Begins when it is time, the flight having been led for `led_ns`, and goes on; `drain` receives what dead
    /// processes have sent. True once all is free.
    pub(super) fn are_freed(
        &mut self,
        led_ns: u64,
        folder: &Path,
        drain: &mut dyn FnMut(),
        now_ns: u64,
    ) -> bool {
        match self {
            Self::Later(_) if led_ns < AFTER_NS => false,
            Self::Later(sweeper) => {
                let mut sweep = Sweep::with(sweeper.clone());
                sweep.order();
                sweep.look(folder, drain, now_ns);
                *self = Self::Meanwhile(sweep);
                false
            }
            Self::Before(thread) => thread.is_finished(),
            Self::Meanwhile(sweep) => {
                sweep.look(folder, drain, now_ns);
                sweep.is_done()
            }
        }
    }

    /// Waits for the end of what has begun. All processes are gone, and no object is empty.
    pub(super) fn finish(self) {
        match self {
            Self::Later(_) => {}
            Self::Before(thread) => drop(thread.join()),
            Self::Meanwhile(mut sweep) => sweep.finish(),
        }
    }
}
