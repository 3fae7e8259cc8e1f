//! Distinguishes a process that hangs from one that the machine does not let run.

use std::fs;

/// Processor time with which a process that lives would have stepped \[ticks of 10 ms\].
const ENOUGH_TICKS: u64 = 50;

/// How a process stood when it was first found without progress.
#[derive(Debug, Clone, Copy)]
pub struct Standstill {
    mark_ns: u64,
    ticks: u64,
}

impl Standstill {
    /// True if a process that has not moved on from `mark_ns` hangs. One that waits for a processor,
    /// and has had little of it since it was first found there, is only starved.
    pub fn is_hang(found: &mut Option<Self>, pid: u32, mark_ns: u64) -> bool {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let Some(ticks) = ticks_of_runnable(&stat) else { return true };
        let same = found.filter(|first| first.mark_ns == mark_ns);
        let first = same.unwrap_or(Self { mark_ns, ticks });
        *found = Some(first);
        ticks.saturating_sub(first.ticks) >= ENOUGH_TICKS
    }
}

/// Processor time of a process that runs or could; `None` if it sleeps, is stopped or has gone.
fn ticks_of_runnable(stat: &str) -> Option<u64> {
    // The name before it may hold anything.
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace();
    fields.next().filter(|state| *state == "R")?;
    let mut times = fields.skip(10).map_while(|field| field.parse::<u64>().ok());
    Some(times.next()? + times.next()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_runnable_process_has_an_excuse() {
        let stat =
            |state| format!("7 (a b) c) {state} 1 7 7 0 -1 4194560 99 0 0 0 150 25 0 0 20 0");
        assert_eq!(ticks_of_runnable(&stat("R")), Some(175));
        for state in ["S", "T", "D", "Z"] {
            assert_eq!(ticks_of_runnable(&stat(state)), None);
        }
        assert_eq!(ticks_of_runnable(""), None);
    }

    #[test]
    fn a_process_that_has_gone_needs_no_second_look() {
        assert!(Standstill::is_hang(&mut None, u32::MAX, 0));
    }
}
