//! Frees what dead processes have left in the transport while the launcher goes on.
//!
//! Freeing takes tenths of a second, for which the next death would not be seen and no successor started. In simulated
//! time the launcher waits for it: what a successor finds must not depend on how fast that is.

use runtime::ipc::{Bus, Sweeper};
use runtime::namespace::remove_incomplete_objects;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Builder, JoinHandle};

/// How long freeing may take before the transport is taken to wait for an object that a process has left empty \[ns\].
const STUCK_NS: u64 = 1_000_000_000;

/// What is being freed, and what is left for after it.
#[derive(Debug)]
pub(crate) struct Sweep {
    sweeper: Sweeper,
    running: Option<Running>,
    /// More processes have died since it began.
    is_due: bool,
}

/// A thread that frees.
#[derive(Debug)]
struct Running {
    thread: JoinHandle<()>,
    /// It knows which processes are dead, and waits until what they have sent has been received.
    asks: Receiver<()>,
    received: Sender<()>,
    unstuck_ns: u64,
}

impl Sweep {
    pub(super) fn of(bus: &Bus) -> Self {
        Self::with(bus.sweeper())
    }

    pub(crate) fn with(sweeper: Sweeper) -> Self {
        Self { sweeper, running: None, is_due: false }
    }

    /// A process has died.
    pub(crate) fn order(&mut self) {
        self.is_due = true;
    }

    /// Begins what is due; `drain` receives what dead processes have sent.
    pub(crate) fn look(&mut self, folder: &Path, drain: &mut dyn FnMut(), now_ns: u64) {
        if self.running.as_ref().is_some_and(|running| running.thread.is_finished()) {
            self.running = None;
        }
        match &mut self.running {
            Some(running) => {
                if running.asks.try_recv().is_ok() {
                    drain();
                    let _ = running.received.send(());
                }
                if now_ns.saturating_sub(running.unstuck_ns) > STUCK_NS {
                    remove_incomplete_objects(folder);
                    running.unstuck_ns = now_ns;
                }
            }
            // Without a thread for it now there may be one at the next look.
            None if self.is_due => {
                self.running = Running::begin(&self.sweeper, now_ns);
                self.is_due = self.running.is_none();
            }
            None => {}
        }
    }

    /// True if all that has been ordered has been freed.
    pub(crate) fn is_done(&self) -> bool {
        !self.is_due && self.running.is_none()
    }

    /// Waits for the end of what has begun. All processes are gone, and no object is empty.
    pub(crate) fn finish(&mut self) {
        if let Some(Running { thread, received, .. }) = self.running.take() {
            // It no longer waits for a drain.
            drop(received);
            let _ = thread.join();
        }
    }
}

impl Running {
    fn begin(sweeper: &Sweeper, now_ns: u64) -> Option<Self> {
        let sweeper = sweeper.clone();
        let ((ask, asks), (received, answer)) = (channel(), channel());
        let free = move || {
            sweeper.sweep(&mut || {
                // Both fail only if the flight is over, and then nothing is received any more.
                let _ = ask.send(());
                let _ = answer.recv();
            });
        };
        let thread = Builder::new().name("sweep".to_owned()).spawn(free).ok()?;
        Some(Self { thread, asks, received, unstuck_ns: now_ns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use runtime::namespace::Membership;
    use std::thread::yield_now;

    #[test]
    fn a_sweep_asks_once_for_what_has_been_sent_and_its_end_waits_for_none() {
        let run = Membership::found(&format!("sweep{:x}", std::process::id())).unwrap();
        let bus = Bus::join(&run.ipc_config(), "sweep").unwrap();
        let (mut sweep, mut drained) = (Sweep::of(&bus), 0);
        let look = |sweep: &mut Sweep, drained: &mut u32| {
            sweep.look(run.folder(), &mut || *drained += 1, 0);
            yield_now();
        };
        look(&mut sweep, &mut drained);
        assert!(sweep.running.is_none(), "no process has died");
        for before in 0..2 {
            sweep.order();
            while sweep.is_due || sweep.running.is_some() {
                look(&mut sweep, &mut drained);
            }
            assert_eq!(drained, before + 1);
        }
        sweep.order();
        while sweep.running.is_none() {
            look(&mut sweep, &mut drained);
        }
        sweep.finish();
        assert!(sweep.running.is_none() && drained == 2);
    }
}
