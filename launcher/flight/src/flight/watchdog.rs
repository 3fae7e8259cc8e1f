//! The watchdog of the launcher's loop, which lets it go on if the transport waits without an end: for an object that a
//! process has made, and left empty since it was killed. The loop removes such objects when it finds that a process has died,
//! but one that dies while it receives, or in simulated time frees what another one has left, blocks it before it can find
//! out.

use core::time::Duration;
use runtime::clock::mono_now_ns;
use runtime::namespace::remove_incomplete_objects;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{Builder, JoinHandle};

/// How long the loop may stand still \[ns\]: longer than it takes for one death. A process that is stopped for longer
/// between making an object and giving it its size loses the object.
const STANDS_STILL_NS: u64 = 1_000_000_000;
/// How often that is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Watches the loop on a thread of its own for as long as this lives.
#[derive(Debug)]
pub(super) struct Watchdog {
    /// When the loop went round last \[ns\].
    kicked_ns: Arc<AtomicU64>,
    /// None once it is over.
    until: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Watchdog {
    /// For the loop of the launcher whose run is in a folder.
    pub(super) fn of(folder: PathBuf) -> Self {
        let kicked_ns = Arc::new(AtomicU64::new(mono_now_ns()));
        let (until, over) = channel();
        let kicked = Arc::clone(&kicked_ns);
        let watch = move || {
            while over.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                let still_ns = mono_now_ns().saturating_sub(kicked.load(Ordering::Relaxed));
                if still_ns > STANDS_STILL_NS {
                    remove_incomplete_objects(&folder);
                }
            }
        };
        // Without a thread the flight is as it was.
        let thread = Builder::new().name("watchdog".to_owned()).spawn(watch).ok();
        Self { kicked_ns, until: Some(until), thread }
    }

    /// The loop goes round.
    pub(super) fn kick(&self, now_ns: u64) {
        self.kicked_ns.store(now_ns, Ordering::Relaxed);
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.until = None;
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
