//! Clocks and timers, measured.

use super::Finding;
use core::hint::black_box;
use runtime::clock::{mono_now_ns, sleep_until};
use rustix::time::{ClockId, clock_getres};
use std::fs;

/// Reads of the clock in a row, and how many rows; the best one was not interrupted.
const READS: u64 = 500;
const ROWS: usize = 20;
/// A stamp that costs more is felt in a hop \[ns\].
const DEAR_NS: u64 = 100;
/// Naps, and how long each is \[ns\].
const NAPS: usize = 100;
const NAP_NS: u64 = 1_000_000;
/// Half of what a loop as shipped waits for its inputs \[us\].
const LATE_US: f64 = 250.0;

pub(super) fn checks() -> Vec<Finding> {
    vec![source(), cost(), resolution(), lateness()]
}

fn source() -> Finding {
    let path = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    let source =
        fs::read_to_string(path).map_or("unknown".to_owned(), |text| text.trim().to_owned());
    let slow = ["hpet", "acpi_pm", "jiffies", "refined-jiffies"].contains(&source.as_str());
    Finding::warn_if(slow, "clock source", source, "boot with clocksource=tsc tsc=reliable")
}

fn cost() -> Finding {
    let row = |_| {
        let start_ns = mono_now_ns();
        for _ in 0..READS {
            black_box(mono_now_ns());
        }
        (mono_now_ns() - start_ns) / READS
    };
    let each_ns = (0..ROWS).map(row).min().unwrap_or(0);
    let found = format!("{each_ns} ns for a stamp");
    let remedy = "use a clock source that the vdso reads, see clock source";
    Finding::warn_if(each_ns > DEAR_NS, "clock", found, remedy)
}

fn resolution() -> Finding {
    let resolution = clock_getres(ClockId::Monotonic);
    let coarse = resolution.tv_sec > 0 || resolution.tv_nsec > 1000;
    let found = format!("{} ns", resolution.tv_nsec);
    Finding::warn_if(coarse, "timer grain", found, "use a kernel with CONFIG_HIGH_RES_TIMERS")
}

/// How late an ordinary thread's timer is, as a first estimate of what `bench loops` measures at length.
fn lateness() -> Finding {
    let mut late_us: Vec<f64> = (0..NAPS)
        .map(|_| {
            let due_ns = mono_now_ns() + NAP_NS;
            sleep_until(due_ns);
            mono_now_ns().saturating_sub(due_ns) as f64 * 1e-3
        })
        .collect();
    late_us.sort_by(f64::total_cmp);
    let (half, most) = (late_us[NAPS / 2], late_us[NAPS * 99 / 100 - 1]);
    let found = format!("without priority {half:.0} us late (p50), {most:.0} us (p99)");
    let remedy = "end other programs; see fifo, steal, idle states and governor";
    Finding::warn_if(most > LATE_US, "timers", found, remedy)
}
