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
        })
    }
}

/// One way to fly, and how fast it is.
#[derive(Debug)]
pub(crate) struct Flown {
    pub(crate) plan: Plan,
    pub(crate) records: bool,
    pub(crate) pin: &'static str,
    /// Logical seconds per wall second.
    pub(crate) factor: Rounds,
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
                for pin in ["auto", "none"] {
                    let [factor, cpu_us, sleeps, displaced] = [const { Rounds(Vec::new()) }; 4];
                    all.push(Self { plan, records, pin, factor, cpu_us, sleeps, displaced });
                }
            }
        }
        all
    }

    pub(crate) fn measure(&mut self, seconds: u64) -> Result<()> {
        // A short flight costs the start of all processes and little else.
        let (_, short) = self.fly("100ms")?;
        let (factor, long) = self.fly(&format!("{seconds}s"))?;
        let per_ms = |long: f64, short: f64| (long - short) / (seconds as f64 * 1e3 - 100.0);
        self.factor.add(factor);
        self.cpu_us.add(1e6 * per_ms(long.cpu_s, short.cpu_s));
        self.sleeps.add(per_ms(long.sleeps, short.sleeps));
        self.displaced.add(per_ms(long.displaced, short.displaced));
        Ok(())
    }

    fn fly(&self, duration: &str) -> Result<(f64, Usage)> {
        let folder = TempDir::new()?;
        let before = Usage::of_children()?;
        let output = self.command(duration, folder.path()).output()?;
        let after = Usage::of_children()?;
        let summary: serde_json::Value =
            serde_json::from_slice(&output.stdout).map_err(|error| {
                format!("no summary ({error}): {}", String::from_utf8_lossy(&output.stderr))
            })?;
        let factor = summary["real_time_factor"].as_f64().ok_or("a summary without a factor")?;
        let usage = Usage {
            cpu_s: after.cpu_s - before.cpu_s,
            sleeps: after.sleeps - before.sleeps,
            displaced: after.displaced - before.displaced,
        };
        Ok((factor, usage))
    }

    fn command(&self, duration: &str, folder: &Path) -> Command {
        let mut command = morphquad();
        command.args(["run", SCENARIO, "--for", duration, "--format", "json"]);
        command.args(["--pin", self.pin]);
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
