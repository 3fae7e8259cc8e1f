//! The only module of these tests that reads a clock or pauses.
//!
//! What decides by the clock fails on a busy machine although the program is right, so that [`pause_ms`] and [`host_s`]
//! are for tests of the soak alone; `tests/sources/time.rs` sees to that. All others wait for the event itself, or at
//! least as long as what must have no effect lasts.

use runtime::clock::{mono_now_ns, sleep_until};
use std::fs::File;
use std::io::Write as _;
use std::thread;

/// Longest that anything here may take before the test gives up.
const PATIENCE_S: f64 = 60.0;

/// Polls until `done` returns true, ever more seldom: a look may start a process.
pub(crate) fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    wait_for(what, || done().then_some(()).ok_or(String::new()));
}

/// As [`wait_until`], for something that is there at last; until then `look` returns what is there instead.
pub(crate) fn wait_for<T>(what: &str, mut look: impl FnMut() -> Result<T, String>) -> T {
    let begin_s = host_s();
    let mut pause = 3;
    loop {
        match look() {
            Ok(found) => return found,
            Err(instead) => {
                let is_patient = host_s() - begin_s < PATIENCE_S;
                assert!(is_patient, "waited in vain: {what} {instead}");
            }
        }
        pause_ms(pause);
        pause = (pause + 2).min(40);
    }
}

/// Waits for what another test holds, which may be of any length and has limits of its own.
pub(crate) fn wait_for_others<T>(mut look: impl FnMut() -> Option<T>) -> T {
    loop {
        if let Some(found) = look() {
            return found;
        }
        pause_ms(5);
    }
}

/// Waits for nothing in particular.
pub(crate) fn pause_ms(ms: u64) {
    sleep_until(mono_now_ns() + ms * 1_000_000);
}

/// Waits for nothing in particular, where a longer wait changes nothing.
pub(super) fn pause_at_least(s: f64) {
    let begin_s = host_s();
    while host_s() < begin_s + s {
        pause_ms(20);
    }
}

/// Seconds on the host's clock.
pub(crate) fn host_s() -> f64 {
    mono_now_ns() as f64 * 1e-9
}

/// Writes how long a test with flights took to the file that `MORPHQUAD_TEST_TIMES` names.
struct Stopwatch(f64);

impl Drop for Stopwatch {
    fn drop(&mut self) {
        let Some(path) = std::env::var_os("MORPHQUAD_TEST_TIMES") else { return };
        let file = File::options().create(true).append(true).open(path);
        let line =
            format!("{:.1}\t{}\n", host_s() - self.0, thread::current().name().unwrap_or("?"));
        // A test does not fail because its duration cannot be written.
        let _ = file.and_then(|mut file| file.write_all(line.as_bytes()));
    }
}

thread_local! {
    /// Runs from the first command of a test to its end: each test has a thread of its own.
    static STOPWATCH: Stopwatch = Stopwatch(host_s());
}

/// Has the test that this thread runs timed from now on, if it is not yet.
pub(crate) fn start_stopwatch() {
    STOPWATCH.with(|_| ());
}
