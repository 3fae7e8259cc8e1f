//! Stop requests from outside: signals, and the death of the launcher.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::io;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

/// Flags that a process looks at between steps.
#[derive(Debug, Clone, Default)]
pub struct StopFlags {
    signalled: Arc<AtomicBool>,
    launcher_gone: Arc<AtomicBool>,
    grace_over: Arc<AtomicBool>,
}

impl StopFlags {
    /// Watches SIGINT, SIGTERM and SIGQUIT, and SIGHUP unless it is ignored: whoever starts a flight
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

    /// Watches a process from a thread of its own: calls `on_death` when it is gone, and `grace_s`
    /// later the flight must end.
    ///
    /// # Errors
    /// The process is already gone, or cannot be watched.
    pub fn watch_launcher(
        &self,
        pid: u32,
        grace_s: f64,
        on_death: impl FnOnce() + Send + 'static,
    ) -> io::Result<()> {
        let pid =
            i32::try_from(pid).ok().and_then(Pid::from_raw).ok_or(io::ErrorKind::InvalidInput)?;
        let launcher = pidfd_open(pid, PidfdFlags::empty())?;
        let flags = self.clone();
        thread::Builder::new()
            .name("watch".to_owned())
            .spawn(move || flags.wait_for_death(&launcher, grace_s, on_death))?;
        Ok(())
    }

    fn wait_for_death(&self, launcher: &OwnedFd, grace_s: f64, on_death: impl FnOnce()) {
        while !readable(launcher, None) {}
        self.launcher_gone.store(true, Ordering::Release);
        on_death();
        let grace =
            Timespec::try_from(core::time::Duration::from_secs_f64(grace_s.clamp(0.0, 1e6)))
                .unwrap_or(Timespec { tv_sec: 0, tv_nsec: 0 });
        // Nothing is polled for: this is a plain wait on the thread whose only job it is.
        let _ = poll(&mut [], Some(&grace));
        self.grace_over.store(true, Ordering::Release);
    }

    /// A signal asked this process to stop.
    #[must_use]
    pub fn signalled(&self) -> bool {
        self.signalled.load(Ordering::Acquire)
    }

    /// The launcher has died.
    #[must_use]
    pub fn launcher_gone(&self) -> bool {
        self.launcher_gone.load(Ordering::Acquire)
    }

    /// The launcher died and nobody has taken over in time.
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

    /// Clears a signal that has been handled, so that a second one can be told from it.
    #[must_use]
    pub fn take_signal(&self) -> bool {
        self.signalled.swap(false, Ordering::AcqRel)
    }
}

/// True if this process was told to ignore a signal when it was started.
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
