//! A lockstep flight that waits for its test: it does not go beyond an instant until the test releases it.
//!
//! On a busy machine a test may get no processor for longer than a whole flight takes. What is to happen within the
//! flight would then come after its end.

use super::misdeeds::{config, rogue};
use super::processes::{Running, kill, make_executable};
use super::time::pause_at_least;
use super::{Flown, fly};
use rustix::process::Signal;
use std::fs::File;
use std::io::Write as _;
use std::process::Command;
use tempfile::TempDir;

/// A candidate for the attitude slot whose process sends nothing until it is released. Logical time waits for it.
struct Candidate {
    _folder: TempDir,
    swap: String,
    release: File,
}

impl Candidate {
    /// For a flight that waits at an instant such as "7s".
    fn new(at: &str) -> Self {
        let folder = TempDir::new().expect("a folder");
        let script = folder.path().join("held");
        let content = format!("#!/bin/sh\nread -r _ <\"$0.pipe\"\nexec '{}' \"$@\"\n", rogue());
        make_executable(&script, content.as_bytes());
        let pipe = folder.path().join("held.pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().expect("it starts").success());
        // Opened for both, it waits for no reader, and keeps what is written until one comes.
        let release = File::options().read(true).write(true).open(&pipe).expect("a pipe");
        let config = config(&folder, "nothing", 0.0, 0.0);
        let how = format!("shadow=400ms,no-rehearsal,config={config}");
        Self { swap: format!("attitude={}@{at},{how}", script.display()), _folder: folder, release }
    }

    /// Each process of it reads a line, and one that dies is started again.
    fn release(&mut self) {
        self.release.write_all(&[b'\n'; 8]).expect("the pipe is open");
    }
}

/// A running flight that waits at an instant until it is released.
pub(crate) struct Held {
    pub(crate) running: Running,
    candidate: Candidate,
}

impl Held {
    /// Starts it; it flies to the instant `at` and waits there.
    pub(crate) fn start(flight: &[&str], at: &str) -> Self {
        let candidate = Candidate::new(at);
        let running =
            Running::start_and_fly(&[flight, &["--swap", candidate.swap.as_str()]].concat());
        Self { running, candidate }
    }

    /// The candidate joins while the launcher is stopped, for so long at least \[s\]. What is asserted must hold for any
    /// longer time too: no test may need this to be short.
    pub(crate) fn release_while_the_launcher_is_stopped(mut self, stopped_s: f64) -> Flown {
        assert!(kill(self.running.launcher_pid(), Signal::STOP), "it had gone");
        self.candidate.release();
        pause_at_least(stopped_s);
        assert!(kill(self.running.launcher_pid(), Signal::CONT), "it had gone");
        self.running.wait()
    }

    /// Has it go on to its end, and waits for that.
    pub(crate) fn release(mut self) -> Flown {
        self.candidate.release();
        self.running.wait()
    }
}

/// The flight of a [`Held`] that has been released from the beginning.
pub(crate) fn fly_released(flight: &[&str], at: &str) -> Flown {
    let mut candidate = Candidate::new(at);
    candidate.release();
    fly(&[flight, &["--swap", candidate.swap.as_str()]].concat())
}
