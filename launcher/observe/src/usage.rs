//! What processes take of the machine and what happens to them, as the system counts it.

use rustix::param::{clock_ticks_per_second, page_size};
use serde::{Deserialize, Serialize};
use std::fs;
use std::path::Path;

/// Totals of one process, or of one thread, since its start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Usage {
    /// Processor time \[ns\].
    pub cpu_ns: u64,
    /// Resident memory, with what is shared \[bytes\].
    pub rss_bytes: u64,
    /// Page faults answered from memory.
    pub minor_faults: u64,
    /// Page faults answered from the disk.
    pub major_faults: u64,
    /// Times the loop's thread gave the processor back by itself.
    pub voluntary_switches: u64,
    /// Times it was taken away.
    pub involuntary_switches: u64,
}

impl Usage {
    /// Of a process; none if it is gone.
    #[must_use]
    pub fn of_process(pid: u32) -> Option<Self> {
        Self::read(Path::new(&format!("/proc/{pid}")))
    }

    fn read(folder: &Path) -> Option<Self> {
        let stat = fs::read_to_string(folder.join("stat")).ok()?;
        let status = fs::read_to_string(folder.join("status")).ok()?;
        let usage = Self::parse(&stat, &status, clock_ticks_per_second(), page_size() as u64)?;
        // Ticks miss a thread that sleeps when they come, as loops do that wake by a timer.
        Some(Self { cpu_ns: run_time_ns(folder).unwrap_or(usage.cpu_ns), ..usage })
    }

    /// From the texts of `stat` and `status`.
    fn parse(stat: &str, status: &str, ticks_per_s: u64, page_bytes: u64) -> Option<Self> {
        // The name before it may hold anything; the field after it is the third.
        let (_, rest) = stat.rsplit_once(')')?;
        let fields: Vec<&str> = rest.split_whitespace().collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<u64>().ok();
        let line = |name: &str| {
            let value = status.lines().find_map(|line| line.strip_prefix(name))?;
            value.trim_start_matches(':').trim().parse::<u64>().ok()
        };
        Some(Self {
            cpu_ns: (field(14)? + field(15)?) * (1_000_000_000 / ticks_per_s.max(1)),
            rss_bytes: field(24)? * page_bytes,
            minor_faults: field(10)?,
            major_faults: field(12)?,
            voluntary_switches: line("voluntary_ctxt_switches")?,
            involuntary_switches: line("nonvoluntary_ctxt_switches")?,
        })
    }

    /// What has come since `before`; memory is as it is now.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        Self {
            cpu_ns: self.cpu_ns.saturating_sub(before.cpu_ns),
            rss_bytes: self.rss_bytes,
            minor_faults: self.minor_faults.saturating_sub(before.minor_faults),
            major_faults: self.major_faults.saturating_sub(before.major_faults),
            voluntary_switches: self.voluntary_switches.saturating_sub(before.voluntary_switches),
            involuntary_switches: self
                .involuntary_switches
                .saturating_sub(before.involuntary_switches),
        }
    }

    /// Both; memory is the larger.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self {
            cpu_ns: self.cpu_ns + other.cpu_ns,
            rss_bytes: self.rss_bytes.max(other.rss_bytes),
            minor_faults: self.minor_faults + other.minor_faults,
            major_faults: self.major_faults + other.major_faults,
            voluntary_switches: self.voluntary_switches + other.voluntary_switches,
            involuntary_switches: self.involuntary_switches + other.involuntary_switches,
        }
    }
}

/// Time that the scheduler has given a process with all its threads, or one thread; none where it does
/// not keep count \[ns\].
fn run_time_ns(folder: &Path) -> Option<u64> {
    let of_thread = |folder: &Path| -> Option<u64> {
        let text = fs::read_to_string(folder.join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse().ok()
    };
    match fs::read_dir(folder.join("task")) {
        Ok(tasks) => tasks.flatten().map(|task| of_thread(&task.path())).sum(),
        Err(_) => of_thread(folder),
    }
}

/// Time of all processors of this machine, in the system's ticks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MachineTime {
    /// All of it.
    pub total: u64,
    /// What other machines on the same host took.
    pub stolen: u64,
}

impl MachineTime {
    /// Since the machine was started; nothing where the system does not report it.
    #[must_use]
    pub fn read() -> Self {
        Self::parse(&fs::read_to_string("/proc/stat").unwrap_or_default()).unwrap_or_default()
    }

    fn parse(stat: &str) -> Option<Self> {
        let line = stat.lines().find_map(|line| line.strip_prefix("cpu "))?;
        // Guests are counted among users already.
        let ticks: Vec<u64> = line.split_whitespace().take(8).flat_map(str::parse).collect();
        Some(Self { total: ticks.iter().sum(), stolen: ticks.get(7).copied()? })
    }

    /// Share that was stolen since `before` \[%\].
    #[must_use]
    pub fn stolen_percent_since(&self, before: &Self) -> f64 {
        let total = self.total.saturating_sub(before.total).max(1);
        100.0 * self.stolen.saturating_sub(before.stolen) as f64 / total as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_systems_lines_are_read_whatever_the_process_is_called() {
        let stat = "7 (a) R b) S 1 7 7 0 -1 4194560 99 0 3 0 150 50 0 0 20 0 1 0 9000 1 256 0";
        let status = "Name:\tx\nvoluntary_ctxt_switches:\t12\nnonvoluntary_ctxt_switches:\t5\n";
        let usage = Usage::parse(stat, status, 100, 4096).unwrap();
        let expected = Usage {
            cpu_ns: 2_000_000_000,
            rss_bytes: 1 << 20,
            minor_faults: 99,
            major_faults: 3,
            voluntary_switches: 12,
            involuntary_switches: 5,
        };
        assert_eq!(usage, expected);
        let earlier = Usage { cpu_ns: 500_000_000, minor_faults: 90, ..Usage::default() };
        let since = usage.since(&earlier);
        assert_eq!(
            (since.cpu_ns, since.minor_faults, since.rss_bytes),
            (1_500_000_000, 9, 1 << 20)
        );
        assert_eq!(Usage::parse("", status, 100, 4096), None);
        assert_eq!(Usage::parse(stat, "", 100, 4096), None);
    }

    #[test]
    fn stolen_time_is_the_eighth_number_of_all_processors() {
        let before = MachineTime::parse("cpu  10 0 10 70 0 0 0 10 5 5\ncpu0 1 1").unwrap();
        assert_eq!(before, MachineTime { total: 100, stolen: 10 });
        let after = MachineTime { total: 300, stolen: 20 };
        assert!((after.stolen_percent_since(&before) - 5.0).abs() < 1e-12);
    }

    #[test]
    fn this_process_is_there_and_one_of_no_number_is_not() {
        assert!(Usage::of_process(std::process::id()).is_some_and(|u| u.rss_bytes > 1 << 18));
        assert_eq!(Usage::of_process(u32::MAX), None);
    }
}
