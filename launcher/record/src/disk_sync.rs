//! Gets what has been written onto the disk, so that it survives a power cut, from a thread of its own: a
//! disk takes its time, for which the writer's batches have no room.

use std::io::{self, ErrorKind};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::{Builder, JoinHandle};

/// It only waits and calls the system.
const STACK_BYTES: usize = 64 << 10;

pub(super) struct DiskSync {
    /// `None` once it is to leave.
    request: Option<SyncSender<()>>,
    thread: Option<JoinHandle<()>>,
    failure: Arc<OnceLock<io::Error>>,
}

impl DiskSync {
    /// `sync` waits until everything written is on the disk.
    pub(super) fn of(sync: impl Fn() -> io::Result<()> + Send + 'static) -> io::Result<Self> {
        let (request, requests) = sync_channel(1);
        let failure = Arc::<OnceLock<io::Error>>::default();
        let reported = Arc::clone(&failure);
        let sync_on_request = move || {
            while requests.recv().is_ok() {
                match sync() {
                    Ok(()) => {}
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    // A file that is on no disk cannot be synced.
                    Err(error) if error.kind() == ErrorKind::InvalidInput => return,
                    Err(error) => {
                        let _ = reported.set(error);
                        return;
                    }
                }
            }
        };
        let thread = Builder::new()
            .name("disk_sync".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(sync_on_request)?;
        Ok(Self { request: Some(request), thread: Some(thread), failure })
    }

    /// More has been written. Never waits.
    ///
    /// # Errors
    /// The error of the disk.
    pub(super) fn request(&self) -> io::Result<()> {
        self.failed()?;
        if let Some(request) = &self.request {
            // If it has not got to the last one yet, it will do both at once.
            let _ = request.try_send(());
        }
        Ok(())
    }

    /// Waits until everything is on the disk.
    ///
    /// # Errors
    /// As [`request`](Self::request).
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.request()?;
        self.leave();
        self.failed()
    }

    fn failed(&self) -> io::Result<()> {
        let again = |error: &io::Error| Err(io::Error::new(error.kind(), error.to_string()));
        self.failure.get().map_or(Ok(()), again)
    }

    fn leave(&mut self) {
        self.request = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for DiskSync {
    fn drop(&mut self) {
        self.leave();
    }
}

#[cfg(test)]
mod tests {
    use super::DiskSync;
    use std::io;
    use std::sync::mpsc::channel;
    use std::sync::{Arc, Mutex};

    #[test]
    fn a_slow_disk_is_never_waited_for_and_the_last_message_is_kept() {
        let (let_go, gate) = channel();
        let synced = Arc::new(Mutex::new(0));
        let (counts, gate) = (Arc::clone(&synced), Mutex::new(gate));
        let disk_sync = DiskSync::of(move || {
            let gate = gate.lock().expect("no thread has panicked");
            let _ = gate.recv();
            *counts.lock().expect("no thread has panicked") += 1;
            Ok(())
        });
        let disk_sync = disk_sync.expect("a thread");
        for _ in 0..100 {
            disk_sync.request().expect("nothing has failed");
        }
        // The first, and one for all that came meanwhile.
        let_go.send(()).expect("it waits");
        let_go.send(()).expect("it waits");
        drop(let_go);
        drop(disk_sync);
        let synced = *synced.lock().expect("no thread has panicked");
        assert!((1..=2).contains(&synced), "{synced}");
    }

    #[test]
    fn what_the_disk_refuses_is_reported_and_what_is_no_disk_is_left_alone() {
        for (kind, is_reported) in
            [(io::ErrorKind::StorageFull, true), (io::ErrorKind::InvalidInput, false)]
        {
            let (done, wait) = channel::<()>();
            let disk_sync = DiskSync::of(move || {
                let _ = &done;
                Err(io::Error::from(kind))
            });
            let disk_sync = disk_sync.expect("a thread");
            let _ = disk_sync.request();
            // It leaves with the first error, and hangs up.
            let _ = wait.recv();
            assert_eq!(disk_sync.request().is_err(), is_reported, "{kind}");
        }
    }
}
