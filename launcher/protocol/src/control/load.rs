//! What a process takes of the machine, as the system counts it.

use rustix::param::{clock_ticks_per_second, page_size};
use rustix::time::{ClockId, clock_gettime};
use std::fs;

/// Processor and memory of one process.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Processor time since its start \[s\].
    pub used_s: f64,
    /// Processor time over the time since its start \[% of one processor\].
    pub cpu_percent: f64,
    /// Resident memory, with what it shares with others \[bytes\].
    pub rss_bytes: u64,
}

impl Load {
    /// Of a process that is there.
    #[must_use]
    pub fn of(pid: u32) -> Option<Self> {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let now = clock_gettime(ClockId::Boottime);
        let up_s = now.tv_sec as f64 + now.tv_nsec as f64 / 1e9;
        Self::parse(&stat, up_s, clock_ticks_per_second() as f64, page_size() as u64)
    }

    /// From a line of `/proc/PID/stat`, read `up_s` after the machine was started.
    fn parse(stat: &str, up_s: f64, ticks_per_s: f64, page_bytes: u64) -> Option<Self> {
        // The name before it may hold anything; the field after it is the third.
        let (_, rest) = stat.rsplit_once(')')?;
        let fields: Vec<&str> = rest.split_whitespace().collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<u64>().ok();
        let used_s = (field(14)? + field(15)?) as f64 / ticks_per_s;
        let alive_s = up_s - field(22)? as f64 / ticks_per_s;
        let cpu_percent = if alive_s > 0.0 { 100.0 * used_s / alive_s } else { 0.0 };
        Some(Self { used_s, cpu_percent, rss_bytes: field(24)? * page_bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_the_system_is_read_whatever_the_process_is_called() {
        let stat = "7 (a b) R) S 1 7 7 0 -1 4194560 99 0 0 0 150 50 0 0 20 0 1 0 9000 1 256 0";
        // 2 s of processor in the 10 s from 90 s to 100 s, and 256 pages.
        let load = Load::parse(stat, 100.0, 100.0, 4096);
        assert_eq!(load, Some(Load { used_s: 2.0, cpu_percent: 20.0, rss_bytes: 1 << 20 }));
        assert_eq!(Load::parse("", 1.0, 100.0, 4096), None);
        assert_eq!(Load::parse("7 (x) S 1", 1.0, 100.0, 4096), None);
    }

    #[test]
    fn this_process_takes_memory_and_one_that_is_not_there_has_no_load() {
        assert!(Load::of(std::process::id()).is_some_and(|load| load.rss_bytes > 1 << 18));
        assert_eq!(Load::of(u32::MAX), None);
    }
}
