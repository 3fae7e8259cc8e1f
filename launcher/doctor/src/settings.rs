//! What the kernel and the machine are set to, by the files that report it.

use super::means::{cpu_quota, map_count, memory, psi, swap};
use super::{Finding, Machine};
use std::fs;

/// Way out of an idle state that shows in a hop \[us\].
const LONG_EXIT_US: i64 = 50;

pub(super) fn checks(machine: &Machine) -> Vec<Finding> {
    let checks: [fn(&Machine) -> Finding; 20] = [
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
    let booted = machine.read("proc/cmdline").unwrap_or_default();
    let booted = booted.split_whitespace().find_map(|word| word.strip_prefix("preempt="));
    let chosen = dynamic.split(['(', ')']).nth(1).or(booted);
    let realtime = machine.number("sys/kernel/realtime") == Some(1);
    let remedy = "boot with preempt=full, or a PREEMPT_RT kernel";
    if realtime || version.contains("PREEMPT_RT") {
        Finding::ok(name, "PREEMPT_RT")
    } else if version.contains("PREEMPT_DYNAMIC") {
        let Some(mode) = chosen else {
            let remedy = "look as root, who may read it, or boot with preempt=full";
            return Finding::warn(name, "PREEMPT_DYNAMIC, of a mode that is not shown", remedy);
        };
        let weak = matches!(mode, "none" | "voluntary");
        Finding::warn_if(weak, name, format!("PREEMPT_DYNAMIC, {mode}"), remedy)
    } else {
        let model = if version.contains("PREEMPT") { "PREEMPT" } else { "none" };
        Finding::warn_if(model == "none", name, model, remedy)
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
    // Two processors of one core count the same.
    let count = counts.iter().filter_map(|count| count.parse::<u64>().ok()).max().unwrap_or(0);
    let found = format!("a core was slowed down by heat {count} times since the start");
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

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::tests::{Check, machine, verdict};
    use super::*;

    #[test]
    fn a_machine_that_shows_nothing_is_examined_all_the_same() {
        let (_folder, machine) = machine(&[]);
        assert!(checks(&machine).len() >= 20);
    }

    #[test]
    fn each_setting_is_judged_by_the_content_of_its_file() {
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
    fn interrupts_on_isolated_processors_are_counted() {
        let isolated = ("sys/devices/system/cpu/isolated", "2-3");
        let there = [isolated, ("proc/irq/5/effective_affinity_list", "3\n")];
        assert_eq!(verdict(irq_affinity, &there), Verdict::Warn);
        let elsewhere = [isolated, ("proc/irq/5/effective_affinity_list", "0-1\n")];
        assert_eq!(verdict(irq_affinity, &elsewhere), Verdict::Ok);
    }
}
