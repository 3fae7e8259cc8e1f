//! What lets the launcher's loop go on if the transport waits without an end: for an object that a process has made, and
//! left empty since it was killed. The loop removes such objects when it finds that a process has died, but one that dies
//! while it frees what another one has left, or receives, blocks it before it can find out.

use core::time::Duration;
use runtime::clock::mono_now_ns;
use runtime::namespace::remove_incomplete_objects;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{Builder, JoinHandle};

/// How long the loop may stand still \[ns\]: longer than what it does for one death, and than most stops of a process, as
/// one that was stopped in the instant between making an object and giving it its size loses it.
const STANDS_STILL_NS: u64 = 1_000_000_000;
/// How often that is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Watches the loop on a thread of its own for as long as this lives.
#[derive(Debug)]
pub(super) struct Unblocker {
    /// When the loop went round last \[ns\].
    seen_ns: Arc<AtomicU64>,
    /// None once it is over.
    until: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Unblocker {
    /// For the loop of the launcher whose run is in a folder.
    pub(super) fn of(folder: PathBuf) -> Self {
        let seen_ns = Arc::new(AtomicU64::new(mono_now_ns()));
        let (until, over) = channel();
        let seen = Arc::clone(&seen_ns);
        let watch = move || {
            while over.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                let still_ns = mono_now_ns().saturating_sub(seen.load(Ordering::Relaxed));
                if still_ns > STANDS_STILL_NS {
                    remove_incomplete_objects(&folder);
                }
            }
        };
        // Without a thread the flight is as it was.
        let thread = Builder::new().name("unblock".to_owned()).spawn(watch).ok();
        Self { seen_ns, until: Some(until), thread }
    }

    /// The loop goes round.
    pub(super) fn see(&self, now_ns: u64) {
        self.seen_ns.store(now_ns, Ordering::Relaxed);
    }
}

impl Drop for Unblocker {
    fn drop(&mut self) {
        drop::<Option<Sender<()>>>(self.until.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
