//! Stop requests from outside: signals, and the death of the launcher.

use crate::clock::mono_now_ns;
use crate::leader::{Leader, process_start};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use shared_types::time::ns_from_s;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

/// Longest wait between two looks for a new launcher \[ns\].
const LOOK_EVERY_NS: u64 = 50_000_000;

/// What has happened to the launcher.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LauncherNews {
    /// It has died.
    Died,
    /// Another one has taken over.
    Succeeded {
        /// Its process.
        pid: u32,
    },
    /// None has taken over in time: this process leaves.
    Abandoned,
}

/// A launcher and how to see it die.
struct Watched {
    leader: Leader,
    pidfd: OwnedFd,
}

impl Watched {
    /// A living process; none if there is no such.
    fn open(pid: u32) -> Option<Self> {
        let raw = i32::try_from(pid).ok().and_then(Pid::from_raw)?;
        let pidfd = pidfd_open(raw, PidfdFlags::empty()).ok()?;
        // Read after the process has been caught: a process id that was reused is recognised by it.
        Some(Self { leader: Leader { pid, started: process_start(pid)? }, pidfd })
    }
}

/// Waits for another launcher than the one that has died.
fn await_successor(folder: &Path, dead: Leader, limit_s: f64) -> Option<Watched> {
    let deadline_ns = mono_now_ns().saturating_add(ns_from_s(limit_s));
    loop {
        let named = Leader::of_run(folder).filter(|leader| *leader != dead);
        let found = named.and_then(|leader| {
            Watched::open(leader.pid).filter(|watched| watched.leader == leader)
        });
        let now_ns = mono_now_ns();
        if found.is_some() || now_ns >= deadline_ns {
            return found;
        }
        let wait = core::time::Duration::from_nanos(LOOK_EVERY_NS.min(deadline_ns - now_ns));
        let limit = Timespec::try_from(wait).unwrap_or_default();
        // Nothing is polled for: this is a plain wait on the thread whose only job it is.
        let _ = poll(&mut [], Some(&limit));
    }
}

/// Flags that a process looks at between steps.
#[derive(Debug, Clone, Default)]
pub struct StopFlags {
    signalled: Arc<AtomicBool>,
    launcher_gone: Arc<AtomicBool>,
    grace_over: Arc<AtomicBool>,
}

impl StopFlags {
    /// Watches SIGINT, SIGTERM and SIGQUIT, and SIGHUP unless it is ignored: a user who starts a flight
    /// under `nohup` wants it to outlive the terminal.
    ///
    /// # Errors
    /// The handlers cannot be installed.
    pub fn watch_signals() -> io::Result<Self> {
        let flags = Self::default();
        for signal in [SIGINT, SIGTERM, SIGQUIT, SIGHUP] {
            if signal != SIGHUP || !is_ignored(signal) {
                signal_hook::flag::register(signal, Arc::clone(&flags.signalled))?;
            }
        }
        Ok(flags)
    }

    /// Watches the launcher of the run in `folder` from a thread of its own and passes what happens
    /// to it to `notify`. On its death `notify` returns for how long another may take over \[s\]:
    /// if none has, the flight must end.
    ///
    /// # Errors
    /// The process is already gone, or cannot be watched.
    pub fn watch_launcher(
        &self,
        folder: &Path,
        pid: u32,
        notify: impl FnMut(LauncherNews) -> f64 + Send + 'static,
    ) -> io::Result<()> {
        let flags = self.clone();
        let launcher = Watched::open(pid).ok_or(io::ErrorKind::NotFound)?;
        let folder = folder.to_path_buf();
        let watch = move || flags.follow(&folder, launcher, notify);
        thread::Builder::new().name("watch".to_owned()).spawn(watch)?;
        Ok(())
    }

    fn follow(
        &self,
        folder: &Path,
        mut launcher: Watched,
        mut notify: impl FnMut(LauncherNews) -> f64,
    ) {
        loop {
            while !readable(&launcher.pidfd, None) {}
            self.launcher_gone.store(true, Ordering::Release);
            let limit_s = notify(LauncherNews::Died).clamp(0.0, 1e6);
            let Some(successor) = await_successor(folder, launcher.leader, limit_s) else {
                self.grace_over.store(true, Ordering::Release);
                notify(LauncherNews::Abandoned);
                return;
            };
            launcher = successor;
            self.launcher_gone.store(false, Ordering::Release);
            notify(LauncherNews::Succeeded { pid: launcher.leader.pid });
        }
    }

    /// A signal asked this process to stop.
    #[must_use]
    pub fn signalled(&self) -> bool {
        self.signalled.load(Ordering::Acquire)
    }

    /// The launcher has died, and no other has taken over yet.
    #[must_use]
    pub fn launcher_gone(&self) -> bool {
        self.launcher_gone.load(Ordering::Acquire)
    }

    /// The launcher died and no other has taken over in time.
    #[must_use]
    pub fn grace_over(&self) -> bool {
        self.grace_over.load(Ordering::Acquire)
    }

    /// This process should stop now.
    #[must_use]
    pub fn stop(&self) -> bool {
        self.signalled() || self.grace_over()
    }

    /// Asks a thread that holds these flags to stop, as a signal would.
    pub fn request(&self) {
        self.signalled.store(true, Ordering::Release);
    }

    /// Clears a signal that has been handled, so that a second one can be distinguished from it.
    #[must_use]
    pub fn take_signal(&self) -> bool {
        self.signalled.swap(false, Ordering::AcqRel)
    }
}

/// True if this process ignored a signal already when it was started.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|hex| u64::from_str_radix(hex.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal - 1) & 1 == 1
}

fn readable(fd: &OwnedFd, limit: Option<&Timespec>) -> bool {
    let mut fds = [PollFd::new(fd, PollFlags::IN)];
    poll(&mut fds, limit).is_ok_and(|ready| ready > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::process::{Child, Command};
    use std::sync::Mutex;

    fn idler() -> Child {
        Command::new("sleep").arg("60").spawn().unwrap()
    }

    fn reap(mut child: Child) {
        child.kill().unwrap();
        child.wait().unwrap();
    }

    /// Waits as long as it takes.
    fn await_that(done: impl Fn() -> bool) {
        while !done() {
            crate::clock::sleep_until(mono_now_ns() + 1_000_000);
        }
    }

    #[test]
    fn a_launcher_succeeded_in_time_is_no_loss_and_one_that_is_not_ends_the_flight() {
        let folder = std::env::temp_dir().join(format!("watch-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let received = Arc::new(Mutex::new(Vec::new()));
        let (first, second) = (idler(), idler());
        let flags = StopFlags::default();
        let notify = |limit_s| {
            let received = Arc::clone(&received);
            move |news| {
                received.lock().unwrap().push(news);
                limit_s
            }
        };
        // However late this thread names the successor, it is in time.
        flags.watch_launcher(&folder, first.id(), notify(600.0)).unwrap();
        assert!(!flags.launcher_gone());
        reap(first);
        await_that(|| flags.launcher_gone());
        let pid = second.id();
        let line = format!("{pid} {}\n", process_start(pid).unwrap());
        fs::write(folder.join("launcher.lock"), line).unwrap();
        await_that(|| !flags.launcher_gone());
        assert!(!flags.stop(), "it was in time");
        let expected = [LauncherNews::Died, LauncherNews::Succeeded { pid }];
        assert_eq!(*received.lock().unwrap(), expected);
        let flags = StopFlags::default();
        received.lock().unwrap().clear();
        flags.watch_launcher(&folder, pid, notify(0.1)).unwrap();
        reap(second);
        await_that(|| flags.grace_over());
        assert!(flags.launcher_gone() && flags.stop(), "the dead one in the file is no successor");
        // Both watches have seen it die, and one of them waits for longer.
        await_that(|| received.lock().unwrap().len() == 3);
        let mut received = received.lock().unwrap();
        received.sort_by_key(|news| *news == LauncherNews::Abandoned);
        let expected = [LauncherNews::Died, LauncherNews::Died, LauncherNews::Abandoned];
        assert_eq!(*received, expected);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_process_that_is_gone_before_the_watch_begins_cannot_be_watched() {
        let child = idler();
        let pid = child.id();
        reap(child);
        let flags = StopFlags::default();
        assert!(flags.watch_launcher(Path::new("/nowhere"), pid, |_| 1.0).is_err());
    }
}
