//! Whole flights: the executable with its five processes, and all loops in one thread.

use crate::flown::morphquad;
use crate::{Plan, Result, Rounds};
use nix::sys::resource::{UsageWho, getrusage};
use observe::FlightHash;
use runtime::clock::mono_now_ns;
use scenario::{Override, Scenario};
use simulate::in_process::{self, StateSource};
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// The scenario of every flight.
const SCENARIO: &str = "figure8-morph";

/// All processes on one core, as a flight chooses by itself.
pub(crate) const PINNED: &str = "--pin=auto";
/// All loops in one thread.
const IN_PROCESS: &str = "--in-process";

/// A plan as a scenario of so many seconds.
pub(crate) fn scenario(plan: Plan, seconds: u64) -> Result<Scenario> {
    let mut overrides = vec![Override::set(&format!("scenario.duration_s={seconds}"))?];
    for (key, value) in plan.keys() {
        overrides.push(Override::set(&format!("{key}={value}"))?);
    }
    Ok(Scenario::load(SCENARIO, &overrides)?)
}

/// What the machine counted for the processes of some flights.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Usage {
    /// From the start of the executable to its end [s].
    pub(crate) wall_s: f64,
    /// Size of the recording.
    pub(crate) recorded_bytes: f64,
    /// Processor time of all processes [s].
    pub(crate) cpu_s: f64,
    /// Times that a process went to sleep.
    pub(crate) sleeps: f64,
    /// Times that a process was put aside for another.
    pub(crate) displaced: f64,
}

impl Usage {
    /// Of all children that have ended so far, and theirs.
    fn of_children() -> Result<Self> {
        let usage = getrusage(UsageWho::RUSAGE_CHILDREN)?;
        let seconds = |t: nix::sys::time::TimeVal| t.tv_sec() as f64 + t.tv_usec() as f64 * 1e-6;
        Ok(Self {
            cpu_s: seconds(usage.user_time()) + seconds(usage.system_time()),
            sleeps: usage.voluntary_context_switches() as f64,
            displaced: usage.involuntary_context_switches() as f64,
            ..Self::default()
        })
    }
}

/// One way to fly with the executable, and how fast it is.
#[derive(Debug)]
pub(crate) struct Flown {
    pub(crate) plan: Plan,
    pub(crate) records: bool,
    /// Where its loops are.
    pub(crate) flag: &'static str,
    /// Logical seconds per wall second.
    pub(crate) factor: Rounds,
    /// Bytes of its recording per logical second [MB].
    pub(crate) recorded_mb: Rounds,
    /// Per logical millisecond, start of the processes left out.
    pub(crate) cpu_us: Rounds,
    pub(crate) sleeps: Rounds,
    pub(crate) displaced: Rounds,
}

impl Flown {
    /// Every combination.
    pub(crate) fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for plan in Plan::ALL {
            for records in [true, false] {
                for flag in [PINNED, "--pin=none", IN_PROCESS] {
                    let [factor, recorded_mb, cpu_us, sleeps, displaced] =
                        [const { Rounds(Vec::new()) }; 5];
                    all.push(Self {
                        plan,
                        records,
                        flag,
                        factor,
                        recorded_mb,
                        cpu_us,
                        sleeps,
                        displaced,
                    });
                }
            }
        }
        all
    }

    pub(crate) fn measure(&mut self, seconds: u64) -> Result<()> {
        // A short flight costs the start of all processes, the end of the recording and little else.
        let short = self.fly("100ms")?;
        let long = self.fly(&format!("{seconds}s"))?;
        let flown_ms = seconds as f64 * 1e3 - 100.0;
        let per_ms = |long: f64, short: f64| (long - short) / flown_ms;
        self.factor.add(flown_ms * 1e-3 / (long.wall_s - short.wall_s));
        if self.records {
            self.recorded_mb.add(1e-3 * per_ms(long.recorded_bytes, short.recorded_bytes));
        }
        self.cpu_us.add(1e6 * per_ms(long.cpu_s, short.cpu_s));
        self.sleeps.add(per_ms(long.sleeps, short.sleeps));
        self.displaced.add(per_ms(long.displaced, short.displaced));
        Ok(())
    }

    fn fly(&self, duration: &str) -> Result<Usage> {
        let folder = TempDir::new()?;
        let before = Usage::of_children()?;
        let start_ns = mono_now_ns();
        let output = self.command(duration, folder.path()).output()?;
        let wall_s = mono_now_ns().saturating_sub(start_ns) as f64 * 1e-9;
        let after = Usage::of_children()?;
        if !output.status.success() {
            return Err(String::from_utf8_lossy(&output.stderr).into());
        }
        let files = std::fs::read_dir(folder.path())?;
        let sizes = files.map(|file| Ok(file?.metadata()?.len()));
        Ok(Usage {
            wall_s,
            recorded_bytes: sizes.sum::<std::io::Result<u64>>()? as f64,
            cpu_s: after.cpu_s - before.cpu_s,
            sleeps: after.sleeps - before.sleeps,
            displaced: after.displaced - before.displaced,
        })
    }

    fn command(&self, duration: &str, folder: &Path) -> Command {
        let mut command = morphquad();
        command.args(["run", SCENARIO, "--for", duration, "--format", "json", self.flag]);
        for (key, value) in self.plan.keys() {
            command.arg("--set").arg(format!("{key}={value}"));
        }
        if self.records {
            command.arg("--record").arg(folder);
        } else {
            command.arg("--no-record");
        }
        command.stdin(Stdio::null());
        command
    }
}

/// All loops in one thread, no recording.
#[derive(Debug)]
pub(crate) struct InProcess {
    pub(crate) plan: Plan,
    /// Whether the flight hash is computed on the way.
    pub(crate) hashes: bool,
    pub(crate) factor: Rounds,
}

impl InProcess {
    /// Every combination.
    pub(crate) fn all() -> Vec<Self> {
        let with =
            |plan| [false, true].map(|hashes| Self { plan, hashes, factor: Rounds::default() });
        Plan::ALL.into_iter().flat_map(with).collect()
    }

    /// One flight, from building its components to its end.
    pub(crate) fn measure(&mut self, seconds: u64) -> Result<()> {
        let scenario = scenario(self.plan, seconds)?;
        let start_ns = mono_now_ns();
        if self.hashes {
            in_process::fly(&scenario, StateSource::Estimator, FlightHash::default())?;
        } else {
            in_process::fly(&scenario, StateSource::Estimator, ())?;
        }
        self.factor.add(seconds as f64 * 1e9 / (mono_now_ns() - start_ns) as f64);
        Ok(())
    }
}
