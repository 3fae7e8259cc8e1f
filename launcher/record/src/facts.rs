//! Where a recording comes from: run, build and machine.

use crate::build::{self, Build};
use core::fmt;
use std::collections::BTreeMap;
use std::fs;
use vehicle::VehicleParameters;

/// How logical time maps to the time stamps in the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Clock {
    /// Stamps are logical time.
    Lockstep,
    /// Stamps are host time; `speed` is logical seconds per wall second.
    Realtime {
        /// Logical seconds per wall second, above zero.
        speed: f64,
    },
}

impl Clock {
    /// Unix time that stands for a logical instant, if `epoch_unix_ns` stands for 0 \[ns\].
    #[must_use]
    pub fn unix_ns(self, epoch_unix_ns: u64, logical_ns: u64) -> u64 {
        let since_start_ns = match self {
            Self::Lockstep => logical_ns,
            Self::Realtime { speed } => wall_ns(logical_ns, speed),
        };
        epoch_unix_ns.saturating_add(since_start_ns)
    }
}

/// Wall time that `logical_ns` takes at `speed`.
fn wall_ns(logical_ns: u64, speed: f64) -> u64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a stamp for display; the cast saturates"
    )]
    let wall_ns = (logical_ns as f64 / speed) as u64;
    wall_ns
}

/// What a reader must know to judge or repeat a flight.
#[derive(Debug, Clone)]
pub struct Facts {
    /// Name of the run.
    pub run_id: String,
    /// Name of the scenario.
    pub scenario_name: String,
    /// Text of the scenario with every override in it.
    pub scenario_toml: String,
    /// Seed of every noise source.
    pub seed: u64,
    /// Clock of the flight.
    pub clock: Clock,
    /// Unix time that stands for logical time 0 \[ns\].
    pub epoch_unix_ns: u64,
    /// Machine of the launcher.
    pub machine: Machine,
    /// The real vehicle, as viewers are to draw it.
    pub vehicle: VehicleParameters,
    /// Where the scenario begins to hold; none if at the start.
    pub branch: Option<Branched>,
    /// What this file goes on from; none if it begins with the flight.
    pub continues: Option<Continued>,
}

/// Of a flight that another launcher has led until it died.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Continued {
    /// Name of the file before.
    pub file: String,
    /// Instant from which on this file has the flight \[ns\].
    pub from_ns: u64,
}

impl Continued {
    /// Of the metadata `run`.
    #[must_use]
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<Self> {
        let file = metadata.get("continues")?.clone();
        let from_ns = metadata.get("continues_from_ns").and_then(|text| text.parse().ok());
        Some(Self { file, from_ns: from_ns.unwrap_or(u64::MAX) })
    }
}

impl fmt::Display for Continued {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, from_ns } = self;
        write!(f, "from {} s on, a continuation of {file}", *from_ns as f64 / 1e9)
    }
}

/// Of a flight that was taken up in the middle with something changed: what came before was flown
/// with another scenario.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Branched {
    /// Name of the run that it was taken up from.
    pub parent_run: String,
    /// Instant from which on the change holds \[ns\].
    pub at_ns: u64,
    /// The change, as flags of `morphquad replay --branch`.
    pub changes: String,
}

impl Branched {
    /// Metadata `branch` of the file.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let entries = [
            ("parent_run", self.parent_run.clone()),
            ("at_ns", self.at_ns.to_string()),
            ("changes", self.changes.clone()),
        ];
        entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }

    /// The same read back; what is not there is empty, and an instant that is no number the end of
    /// time.
    #[must_use]
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Self {
        let entry = |key: &str| metadata.get(key).cloned().unwrap_or_default();
        Self {
            parent_run: entry("parent_run"),
            at_ns: entry("at_ns").parse().unwrap_or(u64::MAX),
            changes: entry("changes"),
        }
    }
}

impl fmt::Display for Branched {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { parent_run, at_ns, changes } = self;
        let at_s = *at_ns as f64 / 1e9;
        write!(f, "a branch of run {parent_run} at {at_s} s, flown from there on with {changes}")
    }
}

/// The machine, as far as it matters for timing; its name stays out of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Machine {
    /// Release of the kernel.
    pub kernel: String,
    /// Model of the first processor.
    pub cpu_model: String,
}

const UNKNOWN: &str = "unknown";

impl Machine {
    /// Reads `/proc`; what it does not show is "unknown".
    #[must_use]
    pub fn read() -> Self {
        let kernel = fs::read_to_string("/proc/sys/kernel/osrelease").ok();
        let processors = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            kernel: kernel.map_or_else(|| UNKNOWN.to_owned(), |text| text.trim().to_owned()),
            cpu_model: cpu_model(&processors).unwrap_or(UNKNOWN).to_owned(),
        }
    }
}

fn cpu_model(processors: &str) -> Option<&str> {
    let line = processors.lines().find(|line| line.starts_with("model name"))?;
    line.split_once(':').map(|(_, model)| model.trim())
}

impl Facts {
    /// Metadata `run` of the file.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let (clock, speed) = match self.clock {
            Clock::Lockstep => ("lockstep", None),
            Clock::Realtime { speed } => ("realtime", Some(speed)),
        };
        let Build { git, rustc, crates } = build::declared();
        let mut entries = vec![
            ("run_id", self.run_id.clone()),
            ("scenario", self.scenario_name.clone()),
            ("seed", self.seed.to_string()),
            ("clock", clock.to_owned()),
            ("epoch_unix_ns", self.epoch_unix_ns.to_string()),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("git", git.to_owned()),
            ("crates", crates.to_owned()),
            ("rustc", rustc.to_owned()),
            ("kernel", self.machine.kernel.clone()),
            ("cpu_model", self.machine.cpu_model.clone()),
        ];
        entries.extend(speed.map(|speed| ("speed", speed.to_string())));
        if let Some(Continued { file, from_ns }) = &self.continues {
            entries.push(("continues", file.clone()));
            entries.push(("continues_from_ns", from_ns.to_string()));
        }
        entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Machine, cpu_model};

    #[test]
    fn the_processor_is_named_by_its_first_entry() {
        let text = "processor\t: 0\nmodel name\t: Some CPU @ 2.0GHz\n\nmodel name\t: Other\n";
        assert_eq!(cpu_model(text), Some("Some CPU @ 2.0GHz"));
        assert_eq!(cpu_model("processor\t: 0\n"), None);
    }

    #[test]
    fn the_kernel_release_is_one_word() {
        let kernel = Machine::read().kernel;
        assert!(!kernel.is_empty() && !kernel.contains(char::is_whitespace), "{kernel:?}");
    }
}
