//! What a flight may have of the machine: memory, processor time, by the files that report it.

use super::{Finding, Machine};
use host::quota::Quota;
use scenario::needs::{Available, MemoryNeed};

/// Share of time that a host may take away before loops feel it \[%\].
const STEAL_PERCENT: f64 = 1.0;

pub(super) fn swap(machine: &Machine) -> Finding {
    let areas = machine.read("proc/swaps").unwrap_or_default().lines().count().saturating_sub(1);
    let locked = host::realtime::may_lock_memory();
    let found = match areas {
        0 => "none".to_owned(),
        _ if locked => format!("{areas} areas; loops lock their memory"),
        _ => format!("{areas} areas, and loops may not lock their memory"),
    };
    Finding::warn_if(areas > 0 && !locked, "swap", found, "`swapoff -a`, or see memory lock")
}

pub(super) fn memory(machine: &Machine) -> Finding {
    let name = "memory";
    let Some(Available { mb, by }) = Available::below(&machine.root) else {
        return Finding::warn(name, "unknown", "mount /proc");
    };
    let locks = host::realtime::may_lock_memory();
    let realtime = if locks { MemoryNeed::LOCKED } else { MemoryNeed::LOCKSTEP };
    let [lockstep_mb, realtime_mb] =
        [MemoryNeed::LOCKSTEP, realtime].map(|need| need.shared_mb + need.own_mb);
    let found = format!(
        "{mb} MB available by {}; a flight may need {lockstep_mb} MB, and in realtime {realtime_mb} MB",
        by.display()
    );
    let remedy = "end other programs, or raise the limit, as by `--memory` of a container";
    if mb < lockstep_mb {
        return Finding::fail(name, found, remedy);
    }
    let remedy = format!("{remedy}, or fly with `--set realtime.lock_memory=false`");
    Finding::warn_if(mb < realtime_mb, name, found, remedy)
}

pub(super) fn cpu_quota(machine: &Machine) -> Finding {
    let name = "cpu quota";
    let Some(Quota { processors, by }) = Quota::below(&machine.root) else {
        return Finding::ok(name, "no limit");
    };
    let found = format!("{processors:.2} processors by {}", by.display());
    let remedy = "raise it, as by `--cpus` of a container";
    if processors < 1.0 {
        return Finding::fail(name, found, remedy);
    }
    Finding::warn(name, found, remedy)
}

pub(super) fn map_count(machine: &Machine) -> Finding {
    let count = machine.number("proc/sys/vm/max_map_count").unwrap_or(i64::MAX);
    // A process maps a segment for each writer of each topic that it reads: some hundred.
    let found = if count == i64::MAX { "no limit".to_owned() } else { format!("{count} allowed") };
    Finding::warn_if(count < 4096, "memory maps", found, "`sysctl vm.max_map_count=65530`")
}

pub(super) fn psi(machine: &Machine) -> Finding {
    let name = "pressure";
    let Some(text) = machine.read("proc/pressure/cpu") else {
        return Finding::ok(name, "the kernel does not show it");
    };
    let share = text.split_whitespace().find_map(|word| word.strip_prefix("avg10="));
    let share: f64 = share.and_then(|share| share.parse().ok()).unwrap_or(0.0);
    let found = format!("processes waited for a processor {share} % of the last 10 s");
    Finding::warn_if(share > 20.0, name, found, "end other programs, or fly slower with --speed")
}

/// Processor time of all, and what a host has taken of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stolen {
    all: u64,
    stolen: u64,
}

impl Stolen {
    pub(super) fn look(machine: &Machine) -> Self {
        let stat = machine.read("proc/stat").unwrap_or_default();
        let line = stat.lines().next().unwrap_or_default();
        let ticks = line.split_whitespace().skip(1).filter_map(|word| word.parse::<u64>().ok());
        let ticks: Vec<_> = ticks.take(8).collect();
        Self { all: ticks.iter().sum(), stolen: ticks.get(7).copied().unwrap_or(0) }
    }

    /// Of the time since then, or since the start if that was short.
    pub(super) fn since(self, machine: &Machine) -> Finding {
        let now = Self::look(machine);
        let share = |stolen: u64, all: u64| 100.0 * stolen as f64 / all.max(1) as f64;
        let lately =
            share(now.stolen.saturating_sub(self.stolen), now.all.saturating_sub(self.all));
        let ever = share(now.stolen, now.all);
        let found = format!("{lately:.1} % now, {ever:.2} % since the start");
        let remedy = "ask for processors of your own, or fly when the host is quiet";
        Finding::warn_if(lately.max(ever) > STEAL_PERCENT, "steal", found, remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::tests::{machine, verdict};
    use super::*;

    #[test]
    fn a_quota_below_one_processor_fails_and_a_larger_one_warns() {
        let group = ("proc/self/cgroup", "0::/box\n");
        for (quota, expected) in [
            ("50000 100000", Verdict::Fail),
            ("150000 100000", Verdict::Warn),
            ("max 100000", Verdict::Ok),
        ] {
            let files = [group, ("sys/fs/cgroup/box/cpu.max", quota)];
            assert_eq!(verdict(cpu_quota, &files), expected, "{quota}");
        }
    }

    #[test]
    fn stolen_time_is_a_share_of_all_time() {
        let (_folder, before) = machine(&[("proc/stat", "cpu 100 0 0 900 0 0 0 0 0 0\n")]);
        let (_other, after) = machine(&[("proc/stat", "cpu 150 0 0 940 0 0 0 10 0 0\n")]);
        let finding = Stolen::look(&before).since(&after);
        assert!(finding.found.starts_with("10.0 %"), "{}", finding.found);
        assert_eq!(finding.verdict, Verdict::Warn);
    }
}
