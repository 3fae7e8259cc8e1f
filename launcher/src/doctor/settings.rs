//! What the kernel and the machine are set to, by the files that tell it.

use super::{Finding, Machine};
use std::fs;

/// Free memory below which flights get into trouble \[kB\].
const LEAST_MEMORY_KB: u64 = 200 * 1024;
/// Free memory that leaves room for recordings' pages \[kB\].
const ENOUGH_MEMORY_KB: u64 = 512 * 1024;
/// Share of time that a host may take away before loops feel it \[%\].
const STEAL_PERCENT: f64 = 1.0;
/// Way out of an idle state that shows in a hop \[us\].
const LONG_EXIT_US: i64 = 50;

pub(super) fn checks(machine: &Machine) -> Vec<Finding> {
    let checks: [fn(&Machine) -> Finding; 21] = [
        kernel,
        preemption,
        processors,
        virtual_machine,
        load,
        isolated,
        nohz_full,
        governor,
        idle_states,
        throttled,
        rt_throttling,
        timer_migration,
        irq_affinity,
        watchdog,
        huge_pages,
        swap,
        memory,
        cpu_quota,
        fair_quota,
        map_count,
        psi,
    ];
    checks.into_iter().map(|check| check(machine)).collect()
}

fn kernel(machine: &Machine) -> Finding {
    let name = "kernel";
    let Some(release) = machine.read("proc/sys/kernel/osrelease") else {
        return Finding::warn(name, "unknown", "mount /proc");
    };
    let mut parts = release.split(['.', '-']).map(|part| part.parse::<u32>().unwrap_or(0));
    let version = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
    if version < (5, 4) {
        // Processes watch their launcher by pidfd_open and waitid.
        return Finding::fail(name, format!("Linux {release}"), "use Linux 5.4 or later");
    }
    Finding::ok(name, format!("Linux {release}"))
}

fn preemption(machine: &Machine) -> Finding {
    let name = "preemption";
    let version = machine.read("proc/sys/kernel/version").unwrap_or_default();
    let dynamic = machine.read("sys/kernel/debug/sched/preempt").unwrap_or_default();
    let chosen = dynamic.split(['(', ')']).nth(1).unwrap_or_default();
    let realtime = machine.number("sys/kernel/realtime") == Some(1);
    let remedy = "boot with preempt=full, or a PREEMPT_RT kernel";
    if realtime || version.contains("PREEMPT_RT") {
        Finding::ok(name, "PREEMPT_RT")
    } else if version.contains("PREEMPT_DYNAMIC") {
        let weak = matches!(chosen, "none" | "voluntary");
        let told = if chosen.is_empty() { "as booted" } else { chosen };
        Finding::warn_if(weak, name, format!("PREEMPT_DYNAMIC, {told}"), remedy)
    } else {
        let told = if version.contains("PREEMPT") { "PREEMPT" } else { "none" };
        Finding::warn_if(told == "none", name, told, remedy)
    }
}

fn processors(_: &Machine) -> Finding {
    let name = "processors";
    let allowed = host::realtime::allowed_processors().len();
    let found = format!("{allowed} to run on");
    Finding::warn_if(
        allowed < 2,
        name,
        found,
        "allow two or more: loops and recorder then do not share",
    )
}

fn virtual_machine(machine: &Machine) -> Finding {
    let cpuinfo = machine.read("proc/cpuinfo").unwrap_or_default();
    let is_virtual = cpuinfo.lines().any(|l| l.starts_with("flags") && l.contains(" hypervisor"));
    let found =
        if is_virtual { "virtual machine: its host can stop it" } else { "no virtual machine" };
    let remedy = "measure on the machine that is to fly; watch the check steal";
    Finding::warn_if(is_virtual, "hypervisor", found, remedy)
}

fn load(machine: &Machine) -> Finding {
    let loads = machine.read("proc/loadavg").unwrap_or_default();
    let load: f64 = loads.split(' ').next().and_then(|l| l.parse().ok()).unwrap_or(0.0);
    let cores = host::realtime::allowed_processors().len() as f64;
    let found = format!("{load:.2} on {cores} processors over the last minute");
    Finding::warn_if(
        load > 0.7 * cores,
        "load",
        found,
        "end other programs, or fly slower with --speed",
    )
}

/// Processors as the kernel writes them; none if the file is empty.
fn list(machine: &Machine, path: &str) -> Option<String> {
    machine.read(path).filter(|list| !list.is_empty() && list != "(null)")
}

fn isolated(machine: &Machine) -> Finding {
    match list(machine, "sys/devices/system/cpu/isolated") {
        Some(list) => {
            Finding::ok("isolcpus", format!("{list} kept for loops: name them in realtime.cpus"))
        }
        None => Finding::warn(
            "isolcpus",
            "no processor is kept free of other programs",
            "boot with isolcpus=N and set realtime.cpus = [N], where p99.9 matters",
        ),
    }
}

fn nohz_full(machine: &Machine) -> Finding {
    match list(machine, "sys/devices/system/cpu/nohz_full") {
        Some(list) => Finding::ok("nohz_full", format!("no tick on {list}")),
        None => Finding::warn(
            "nohz_full",
            "the scheduler's tick interrupts every processor",
            "boot with nohz_full=N for the processors of isolcpus",
        ),
    }
}

/// Contents of a file of each processor.
fn of_each_processor(machine: &Machine, file: &str) -> Vec<String> {
    let numbered = (0..1024).map(|cpu| format!("sys/devices/system/cpu/cpu{cpu}"));
    let there = numbered.take_while(|path| machine.root.join(path).is_dir());
    there.filter_map(|path| machine.read(&format!("{path}/{file}"))).collect()
}

fn governor(machine: &Machine) -> Finding {
    let name = "governor";
    let mut governors = of_each_processor(machine, "cpufreq/scaling_governor");
    governors.sort();
    governors.dedup();
    if governors.is_empty() {
        return Finding::ok(name, "none: the clock rate is not this system's to choose");
    }
    let slow = governors != ["performance"];
    let remedy = "`cpupower frequency-set -g performance`";
    Finding::warn_if(slow, name, governors.join(", "), remedy)
}

fn idle_states(machine: &Machine) -> Finding {
    let name = "idle states";
    let longest = (0..16)
        .filter(|state| {
            let disabled = format!("sys/devices/system/cpu/cpu0/cpuidle/state{state}/disable");
            machine.number(&disabled) == Some(0)
        })
        .filter_map(|state| {
            machine.number(&format!("sys/devices/system/cpu/cpu0/cpuidle/state{state}/latency"))
        })
        .max();
    let Some(longest) = longest else {
        return Finding::ok(name, "none that this system chooses");
    };
    let found = format!("the deepest takes {longest} us to leave");
    Finding::warn_if(longest > LONG_EXIT_US, name, found, "`cpupower idle-set -D 50`")
}

fn throttled(machine: &Machine) -> Finding {
    let counts = of_each_processor(machine, "thermal_throttle/core_throttle_count");
    let count: u64 = counts.iter().filter_map(|count| count.parse::<u64>().ok()).sum();
    let found = format!("slowed down by heat {count} times since the start");
    Finding::warn_if(count > 0, "heat", found, "cool it, or limit its clock rate")
}

fn rt_throttling(machine: &Machine) -> Finding {
    let name = "rt throttling";
    let path = "proc/sys/kernel/sched_rt_runtime_us";
    let period_us = machine.number("proc/sys/kernel/sched_rt_period_us").unwrap_or(1_000_000);
    let Some(runtime_us) = machine.number(path) else {
        return Finding::ok(name, "the kernel has none");
    };
    let remedy = "`sysctl kernel.sched_rt_runtime_us=950000`";
    let found = format!("loops may have {runtime_us} of {period_us} us");
    match runtime_us {
        -1 => Finding::ok(name, "off"),
        0 => Finding::fail(name, "no time for realtime loops", remedy),
        us => Finding::warn_if(us * 10 < period_us * 9, name, found, remedy),
    }
}

fn timer_migration(machine: &Machine) -> Finding {
    let on = machine.number("proc/sys/kernel/timer_migration") == Some(1);
    let isolated = list(machine, "sys/devices/system/cpu/isolated").is_some();
    let found = if on { "on: idle processors hand their timers over" } else { "off" };
    let remedy = "`sysctl kernel.timer_migration=0`";
    // Without processors of their own, loops go where their timers are anyway.
    Finding::warn_if(on && isolated, "timer migration", found, remedy)
}

/// Processors of a mask or list like `0-3,6`.
fn numbers(list: &str) -> Vec<usize> {
    list.split(',')
        .filter_map(|range| {
            let (from, to) = range.split_once('-').unwrap_or((range, range));
            Some(from.trim().parse::<usize>().ok()?..=to.trim().parse::<usize>().ok()?)
        })
        .flatten()
        .collect()
}

fn irq_affinity(machine: &Machine) -> Finding {
    let name = "irq affinity";
    let isolated = numbers(&list(machine, "sys/devices/system/cpu/isolated").unwrap_or_default());
    if isolated.is_empty() {
        return Finding::ok(name, "any processor, as none is isolated");
    }
    let interrupts = fs::read_dir(machine.root.join("proc/irq")).into_iter().flatten().flatten();
    let there = interrupts.filter(|entry| {
        let list = fs::read_to_string(entry.path().join("effective_affinity_list"));
        numbers(list.unwrap_or_default().trim()).iter().any(|cpu| isolated.contains(cpu))
    });
    let count = there.count();
    let found = format!("{count} interrupts go to isolated processors");
    let remedy = "write other processors into /proc/irq/*/smp_affinity_list";
    Finding::warn_if(count > 0, name, found, remedy)
}

fn watchdog(machine: &Machine) -> Finding {
    let on = machine.number("proc/sys/kernel/nmi_watchdog") == Some(1);
    let found = if on { "on: it interrupts each processor" } else { "off" };
    Finding::warn_if(on, "nmi watchdog", found, "`sysctl kernel.nmi_watchdog=0`")
}

fn huge_pages(machine: &Machine) -> Finding {
    let name = "huge pages";
    let text = machine.read("sys/kernel/mm/transparent_hugepage/enabled").unwrap_or_default();
    let chosen = text.split(['[', ']']).nth(1).unwrap_or("none");
    let remedy = "`echo madvise > /sys/kernel/mm/transparent_hugepage/enabled`";
    let found = format!("transparent ones: {chosen}");
    Finding::warn_if(chosen == "always", name, found, remedy)
}

fn swap(machine: &Machine) -> Finding {
    let areas = machine.read("proc/swaps").unwrap_or_default().lines().count().saturating_sub(1);
    let locked = host::realtime::may_lock_memory();
    let found = match areas {
        0 => "none".to_owned(),
        _ if locked => format!("{areas} areas; loops lock their memory"),
        _ => format!("{areas} areas, and loops may not lock their memory"),
    };
    Finding::warn_if(areas > 0 && !locked, "swap", found, "`swapoff -a`, or see memory lock")
}

fn memory(machine: &Machine) -> Finding {
    let name = "memory";
    let info = machine.read("proc/meminfo").unwrap_or_default();
    let line = info.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let available = line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok());
    let Some(available) = available else {
        return Finding::warn(name, "unknown", "mount /proc");
    };
    let found = format!("{} MB available", available >> 10);
    let remedy = "end other programs";
    if available < LEAST_MEMORY_KB {
        return Finding::fail(name, found, remedy);
    }
    Finding::warn_if(available < ENOUGH_MEMORY_KB, name, found, remedy)
}

/// Folder of this process's group in one of the kernel's two hierarchies.
fn group(machine: &Machine, is_it: impl Fn(&str) -> bool) -> Option<String> {
    let groups = machine.read("proc/self/cgroup")?;
    let line = groups.lines().find(|line| line.split(':').nth(1).is_some_and(&is_it))?;
    line.split(':').nth(2).map(str::to_owned)
}

fn cpu_quota(machine: &Machine) -> Finding {
    let name = "cpu quota";
    let folder = group(machine, str::is_empty).unwrap_or_default();
    let read = |base: &str| machine.read(&format!("sys/fs/cgroup/{base}{folder}/cpu.max"));
    let Some(quota) = read("").or_else(|| read("unified")) else {
        return Finding::ok(name, "none set by a group of version 2");
    };
    let mut words = quota.split(' ').map(str::parse::<f64>);
    match (words.next(), words.next()) {
        (Some(Ok(quota)), Some(Ok(period))) => {
            let found = format!("{:.2} processors", quota / period);
            let remedy = "raise cpu.max, e.g. `--cpus` of the container";
            if quota < period {
                Finding::fail(name, found, remedy)
            } else {
                Finding::warn(name, found, remedy)
            }
        }
        _ => Finding::ok(name, "no limit"),
    }
}

fn fair_quota(machine: &Machine) -> Finding {
    let name = "cpu quota, v1";
    let is_cpu = |controllers: &str| controllers.split(',').any(|one| one == "cpu");
    let Some(folder) = group(machine, is_cpu) else {
        return Finding::ok(name, "no group of version 1");
    };
    let read = |file: &str| machine.number(&format!("sys/fs/cgroup/cpu{folder}/{file}"));
    match (read("cpu.cfs_quota_us"), read("cpu.cfs_period_us")) {
        (Some(quota), Some(period)) if quota > 0 => {
            let found = format!("{:.2} processors", quota as f64 / period as f64);
            let remedy = "raise cpu.cfs_quota_us";
            if quota < period {
                Finding::fail(name, found, remedy)
            } else {
                Finding::warn(name, found, remedy)
            }
        }
        _ => Finding::ok(name, "no limit"),
    }
}

fn map_count(machine: &Machine) -> Finding {
    let count = machine.number("proc/sys/vm/max_map_count").unwrap_or(i64::MAX);
    // A process maps a segment for each writer of each topic that it reads: some hundred.
    let found = if count == i64::MAX { "no limit".to_owned() } else { format!("{count} allowed") };
    Finding::warn_if(count < 4096, "memory maps", found, "`sysctl vm.max_map_count=65530`")
}

fn psi(machine: &Machine) -> Finding {
    let name = "pressure";
    let Some(text) = machine.read("proc/pressure/cpu") else {
        return Finding::ok(name, "the kernel does not tell");
    };
    let share = text.split_whitespace().find_map(|word| word.strip_prefix("avg10="));
    let share: f64 = share.and_then(|share| share.parse().ok()).unwrap_or(0.0);
    let found = format!("somebody waited for a processor {share} % of the last 10 s");
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
    use super::*;
    use tempfile::TempDir;

    type Check = fn(&Machine) -> Finding;

    /// A machine with these files alone.
    fn machine(files: &[(&str, &str)]) -> (TempDir, Machine) {
        let folder = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let root = folder.path().to_path_buf();
        (folder, Machine { root })
    }

    fn verdict(check: Check, files: &[(&str, &str)]) -> Verdict {
        let (_folder, machine) = machine(files);
        let finding = check(&machine);
        assert_eq!(finding.verdict == Verdict::Ok, finding.remedy.is_empty(), "{finding:?}");
        finding.verdict
    }

    #[test]
    fn a_machine_that_tells_nothing_is_examined_all_the_same() {
        let (_folder, machine) = machine(&[]);
        assert!(checks(&machine).len() >= 20);
    }

    #[test]
    fn each_setting_is_judged_by_what_its_file_says() {
        use Verdict::{Fail, Ok, Warn};
        let governor_file = "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor";
        let cases: [(Check, &str, &str, Verdict); 18] = [
            (kernel, "proc/sys/kernel/osrelease", "4.19.0-x", Fail),
            (kernel, "proc/sys/kernel/osrelease", "6.1.2", Ok),
            (preemption, "proc/sys/kernel/version", "#1 SMP PREEMPT_RT Mon", Ok),
            (preemption, "proc/sys/kernel/version", "#1 SMP Mon", Warn),
            (governor, governor_file, "powersave", Warn),
            (governor, governor_file, "performance", Ok),
            (rt_throttling, "proc/sys/kernel/sched_rt_runtime_us", "0", Fail),
            (rt_throttling, "proc/sys/kernel/sched_rt_runtime_us", "-1", Ok),
            (rt_throttling, "proc/sys/kernel/sched_rt_runtime_us", "500000", Warn),
            (huge_pages, "sys/kernel/mm/transparent_hugepage/enabled", "[always] never", Warn),
            (huge_pages, "sys/kernel/mm/transparent_hugepage/enabled", "always [never]", Ok),
            (memory, "proc/meminfo", "MemAvailable:   1000 kB", Fail),
            (memory, "proc/meminfo", "MemAvailable:   9000000 kB", Ok),
            (isolated, "sys/devices/system/cpu/isolated", "2-3\n", Ok),
            (isolated, "sys/devices/system/cpu/isolated", "\n", Warn),
            (watchdog, "proc/sys/kernel/nmi_watchdog", "1", Warn),
            (virtual_machine, "proc/cpuinfo", "flags\t: fpu hypervisor", Warn),
            (map_count, "proc/sys/vm/max_map_count", "100", Warn),
        ];
        for (check, path, text, expected) in cases {
            assert_eq!(verdict(check, &[(path, text)]), expected, "{path}: {text}");
        }
    }

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
    fn interrupts_on_isolated_processors_are_counted() {
        let isolated = ("sys/devices/system/cpu/isolated", "2-3");
        let there = [isolated, ("proc/irq/5/effective_affinity_list", "3\n")];
        assert_eq!(verdict(irq_affinity, &there), Verdict::Warn);
        let elsewhere = [isolated, ("proc/irq/5/effective_affinity_list", "0-1\n")];
        assert_eq!(verdict(irq_affinity, &elsewhere), Verdict::Ok);
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
