//! What the tests share: the real executable, its summary, its recording, its processes.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
#![allow(dead_code, reason = "every test file uses its own part of this")]

pub(crate) mod held;
pub(crate) mod misdeeds;
pub(crate) mod processes;
pub(crate) mod recording;
pub(crate) mod spectator;
pub(crate) mod time;

use recording::Recording;
use scenario::services::names_for;
use serde_json::Value;
use shared_types::Slot;
use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;
use time::start_stopwatch;

/// Exit code of a flight that passed, but with a swap of its script that was refused or taken back.
pub(crate) const SWAP_FAILED: i32 = 5;

/// One of the files whose locks make tests wait for one another, whichever executable they are in.
fn lock_file(name: &str) -> File {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    File::create(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// One of two places for concurrent flights of a kind, across all test processes: more of them keep each other waiting.
/// [`fly`] and [`processes::Running`] hold one for as long as they fly; a test that held two could wait for ever.
pub(crate) struct Place {
    _lock: File,
    nth: usize,
}

impl Place {
    /// For a flight by the wall clock.
    pub(crate) fn for_realtime() -> Self {
        Self::wait("realtime")
    }

    /// For a flight that goes as fast as the machine can.
    fn for_lockstep() -> Self {
        Self::wait("lockstep")
    }

    /// One waiter at a time looks, the others wait at the door.
    fn wait(kind: &str) -> Self {
        let [door, first, second] =
            ["door", "first", "second"].map(|part| lock_file(&format!("{kind}-{part}.lock")));
        door.lock().expect("a lock");
        let mut locks = vec![first, second];
        let nth = time::wait_for_others(|| locks.iter().position(|lock| lock.try_lock().is_ok()));
        Self { _lock: locks.swap_remove(nth), nth }
    }

    /// A processor that the flight in the other place does not have, as far as there are two.
    fn processor(&self) -> String {
        let allowed = simulate::setup::allowed_processors().expect("the processors");
        allowed[self.nth % allowed.len()].to_string()
    }
}

/// How often to repeat what must hold every time.
pub(crate) fn rounds(default: usize) -> usize {
    std::env::var("MORPHQUAD_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// The executable under test, with every signal as a shell would have it: a test process started under
/// `nohup` ignores SIGHUP, and so would the executable.
pub(crate) fn morphquad<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    start_stopwatch();
    let mut command = Command::new("env");
    command.arg("--default-signal=HUP").arg(env!("CARGO_BIN_EXE_morphquad"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// A run that has ended.
pub(crate) struct Flown {
    pub(crate) code: Option<i32>,
    pub(crate) stderr: String,
    summary: Value,
    /// Holds the recording.
    folder: TempDir,
}

impl Flown {
    /// It was flown to its end. By the wall clock, a busy machine may have a scripted swap refused or delayed until the
    /// next is asked for.
    pub(crate) fn assert_flown(&self, clock: &str) {
        let may_fail = clock == "realtime" && self.code == Some(SWAP_FAILED);
        assert!(self.code == Some(0) || may_fail, "{}", self.output_text());
    }

    pub(crate) fn new(output: &Output, folder: TempDir) -> Self {
        let summary = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        Self { code: output.status.code(), stderr, summary, folder }
    }

    /// The whole summary.
    pub(crate) fn summary(&self) -> &Value {
        &self.summary
    }

    /// A number of the summary.
    pub(crate) fn number(&self, key: &str) -> f64 {
        let number = self.summary[key].as_f64();
        number.unwrap_or_else(|| panic!("no {key} in {}, {}", self.summary, self.stderr))
    }

    /// A text of the summary.
    pub(crate) fn text(&self, key: &str) -> &str {
        let text = self.summary[key].as_str();
        text.unwrap_or_else(|| panic!("no {key} in {}, {}", self.summary, self.stderr))
    }

    pub(crate) fn hash(&self) -> &str {
        self.text("hash")
    }

    /// The verdict: PASSED, INCOMPLETE, FAILED, LOST or CRASHED.
    pub(crate) fn verdict(&self) -> &str {
        let verdict = self.summary["verdict"]["verdict"].as_str();
        verdict.unwrap_or_else(|| panic!("no verdict in {}, {}", self.summary, self.stderr))
    }

    /// The first reason of the verdict.
    pub(crate) fn reason(&self) -> &str {
        let reason = self.summary["verdict"]["reasons"][0]["text"].as_str();
        reason.unwrap_or_else(|| panic!("no reason in {}, {}", self.summary, self.stderr))
    }

    /// What was missed, place by place.
    pub(crate) fn misses(&self) -> &[Value] {
        let misses = self.summary["misses"].as_array();
        misses.unwrap_or_else(|| panic!("no misses in {}, {}", self.summary, self.stderr))
    }

    /// The summary from stdout, and stderr.
    pub(crate) fn output_text(&self) -> String {
        format!("{}\n{}", self.summary, self.stderr)
    }

    pub(crate) fn recording_path(&self) -> PathBuf {
        self.text("recording").into()
    }

    pub(crate) fn recording(&self) -> Recording {
        Recording::read(&self.recording_path())
    }

    /// Exit code 0, nothing lost, nothing late, no bound violated.
    pub(crate) fn assert_clean(&self) {
        assert_eq!(self.code, Some(0), "{}", self.output_text());
        self.assert_undisturbed();
    }

    /// A flight that was interrupted is the same as one that is as short by itself.
    pub(crate) fn assert_is_the_shorter(&self, scenario: &str) {
        let flown_s = format!("{}s", self.number("flown_s"));
        let short = fly(&[scenario, "--for", &flown_s, "--no-record"]);
        assert_eq!(self.hash(), short.hash(), "{}", self.output_text());
    }

    /// Nothing lost, nothing late, no bound violated.
    pub(crate) fn assert_undisturbed(&self) {
        for key in [
            "dropped_samples",
            "late_samples",
            "missed_ticks",
            "unseen_samples",
            "constraint_violations",
            "safe_mode_episodes",
            "recovered_crashes",
        ] {
            assert!(self.number(key) == 0.0, "{key}: {}", self.output_text());
        }
    }
}

/// Names of the built-in controllers of a slot, the one first that flies it if no other is asked for.
pub(crate) fn controllers(slot: Slot) -> Vec<&'static str> {
    names_for(slot.role()).collect()
}

/// Flies with a recording, from start to end.
pub(crate) fn fly(arguments: &[&str]) -> Flown {
    fly_beside(|| (), &[], arguments)
}

/// What the verdict asks of flying well, and how soon the gate gives a vehicle up, for flights by the wall clock that a
/// busy machine may disturb. That a promise was broken fails them all the same.
const UNDISTURBED: [&str; 19] = [
    "plant.gate.level_max_s=60.0",
    "plant.gate.tip_over_s=10.0",
    "verdict.attitude_end_max_rad=3.0",
    "verdict.clipped_max_s=60.0",
    "verdict.clipped_max_share=1.0",
    "verdict.contact_max_s=60.0",
    "verdict.heading_max_rad=3.2",
    "verdict.late_max_share=100.0",
    "verdict.lost_m=1000.0",
    "verdict.lost_rad=10.0",
    "verdict.missed_max_share=1.0",
    "verdict.recovery_max_m=100.0",
    "verdict.safe_mode_max=1000",
    "verdict.safe_mode_max_s=60.0",
    "verdict.tilt_max_rad=3.0",
    "verdict.tracking_max_m=100.0",
    "verdict.tracking_rms_max_m=100.0",
    "verdict.tracking_sustained_max_m=100.0",
    "verdict.unsolved_max_share=1.0",
];

/// The limits of wall time within which the launcher expects processes to start, to step and to be
/// rehearsed, as long as they can be set. On a busy machine a healthy process exceeds the shipped limits,
/// so only a flight with a process that really hangs sets one of them.
const UNHURRIED: [&str; 6] = [
    "launcher.lag_timeout_s=600",
    "launcher.restart_backoff_max_s=0.1",
    "launcher.restart_limit=1000",
    "launcher.stall_timeout_s=600",
    "launcher.startup_timeout_s=600",
    "rehearsal.wall_max_s=600",
];

/// Settings that go with the arguments of a flight. No limit of wall time that the flight does not set
/// itself ends a process. By the wall clock only tests of the verdict, which set something of it, judge a
/// flight by how well it was flown.
pub(crate) fn judged(arguments: &[&str]) -> Vec<&'static str> {
    let by_wall_clock = arguments.contains(&"realtime");
    let is_about_it = arguments.iter().any(|argument| argument.starts_with("verdict."));
    let undisturbed = UNDISTURBED.iter().filter(|_| by_wall_clock && !is_about_it);
    let is_unset = |setting: &&&str| {
        let key = setting.split_inclusive('=').next().expect("a key");
        !arguments.iter().any(|argument| argument.starts_with(key))
    };
    let settings = undisturbed.chain(UNHURRIED.iter().filter(is_unset));
    settings.flat_map(|setting| ["--set", setting]).collect()
}

/// As [`fly`], through another command such as `nice`, beside what `start` starts, which is dropped after it.
pub(crate) fn fly_beside<T>(
    start: impl FnOnce() -> T,
    through: &[&str],
    arguments: &[&str],
) -> Flown {
    let folder = TempDir::new().expect("a folder for the recording");
    let executable = env!("CARGO_BIN_EXE_morphquad");
    let mut command_line = through.iter().copied().chain([executable]);
    let mut command = Command::new(command_line.next().expect("the executable at least"));
    command.args(command_line).arg("run").args(arguments).args(judged(arguments));
    command.args(["--format", "json"]);
    if !arguments.contains(&"--no-record") {
        command.arg("--record").arg(folder.path());
    }
    start_stopwatch();
    // A flight at a pace waits by itself.
    let paced = arguments.iter().any(|argument| ["--speed", "realtime"].contains(argument));
    let _realtime = arguments.contains(&"realtime").then(Place::for_realtime);
    let lockstep = (!paced).then(Place::for_lockstep);
    let is_pinned = arguments.iter().any(|argument| argument.starts_with("--pin"));
    if let Some(place) = lockstep.as_ref().filter(|_| !is_pinned) {
        command.args(["--pin", &place.processor()]);
    }
    let _beside = start();
    let output = command.stdin(Stdio::null()).output().expect("the executable starts");
    Flown::new(&output, folder)
}

/// Roll, pitch and yaw of a Hamilton quaternion (w, x, y, z), intrinsic z-y-x.
pub(crate) fn euler_rad(q: &[f64]) -> [f64; 3] {
    let [w, x, y, z] = *q else { panic!("four numbers, not {q:?}") };
    [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ]
}

/// Euclidean distance of two points.
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
