//! Where measurements run: scheduling policy, priority and processors, as far as the machine permits.

use super::BenchError;
use runtime::priority::Schedule;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::{Deserialize, Serialize};

/// How the system shares out processors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Policy {
    /// By turns with all other programs
    Other,
    /// Ahead of other programs
    Fifo,
}

impl Policy {
    /// As it is written.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Other => "other",
            Self::Fifo => "fifo",
        }
    }
}

/// Where everything that is measured runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// In effect.
    pub policy: Policy,
    /// In effect; 0 unless FIFO.
    pub priority: u8,
    /// Processors that it may run on.
    pub cpus: Vec<usize>,
    /// What was asked for and not granted, and what would grant it.
    pub fell_back: Option<String>,
}

impl Place {
    /// Takes the processors for this process and all that it starts, and finds out whether the policy is
    /// permitted. No processors mean all.
    ///
    /// # Errors
    /// A processor that this process may not run on.
    pub fn take(policy: Policy, priority: u8, cpus: &[usize]) -> Result<Self, BenchError> {
        let allowed = allowed()?;
        if let Some(cpu) = cpus.iter().find(|cpu| !allowed.contains(cpu)) {
            let allowed = allowed.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
            return Err(BenchError::NoSuchCpu { cpu: *cpu, allowed });
        }
        if !cpus.is_empty() {
            let mut set = CpuSet::new();
            for cpu in cpus {
                set.set(*cpu);
            }
            sched_setaffinity(None, &set).map_err(|error| BenchError::System {
                action: "stay on the processors of --cpus".to_owned(),
                source: error.into(),
            })?;
        }
        let mut taken = if cpus.is_empty() { allowed } else { cpus.to_vec() };
        taken.sort_unstable();
        taken.dedup();
        Ok(Self::granted(policy, priority, taken, |priority| Schedule::Fifo(priority).is_allowed()))
    }

    fn granted(policy: Policy, priority: u8, cpus: Vec<usize>, may: impl Fn(u8) -> bool) -> Self {
        let other = Self { policy: Policy::Other, priority: 0, cpus, fell_back: None };
        if policy == Policy::Other || priority == 0 {
            return other;
        }
        if may(priority) {
            return Self { policy, priority, ..other };
        }
        let text = format!(
            "no right to SCHED_FIFO {priority}: measured with the policy other instead; raise \
             `ulimit -r` to {priority} or give cap_sys_nice, or ask for --policy other"
        );
        Self { fell_back: Some(text), ..other }
    }

    /// Priority for a thread that is to run like the loops.
    #[must_use]
    pub fn fifo(&self) -> Option<u8> {
        (self.policy == Policy::Fifo).then_some(self.priority)
    }

    /// In a short text.
    #[must_use]
    pub fn to_line(&self) -> String {
        let cpus = self.cpus.iter().map(usize::to_string).collect::<Vec<_>>().join(",");
        match self.policy {
            Policy::Other => format!("policy other, processors {cpus}"),
            Policy::Fifo => format!("policy fifo {}, processors {cpus}", self.priority),
        }
    }
}

/// Processors that this process may run on.
fn allowed() -> Result<Vec<usize>, BenchError> {
    let set = sched_getaffinity(None).map_err(|error| BenchError::System {
        action: "look at the processors".to_owned(),
        source: error.into(),
    })?;
    Ok((0..CpuSet::MAX_CPU).filter(|cpu| set.is_set(*cpu)).collect())
}

/// A list of processors: `0,1` or `0-3`.
///
/// # Errors
/// What of it is none.
pub fn cpus(text: &str) -> Result<Vec<usize>, String> {
    let number = |text: &str| text.trim().parse::<usize>().ok().filter(|n| *n < CpuSet::MAX_CPU);
    let mut cpus = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        match (number(first), number(last)) {
            (Some(first), Some(last)) if first <= last => cpus.extend(first..=last),
            _ => return Err(format!("`{part}` is no processor: write 0, 0,2 or 0-3")),
        }
    }
    Ok(cpus)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processors_are_a_list_with_ranges_and_nothing_else() {
        assert_eq!(cpus("0,2-4"), Ok(vec![0, 2, 3, 4]));
        for bad in ["", "x", "1-", "3-1", "99999", "-1", "0,,1"] {
            assert!(cpus(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_processor_that_is_not_there_is_named_with_those_that_are() {
        let error = Place::take(Policy::Other, 0, &[1000]).unwrap_err();
        assert!(error.to_string().contains("1000"), "{error}");
    }

    #[test]
    fn a_policy_that_is_not_granted_falls_back_to_another_and_is_reported() {
        let place = Place::granted(Policy::Fifo, 10, vec![0], |_| false);
        assert_eq!((place.policy, place.fifo()), (Policy::Other, None));
        assert!(place.fell_back.is_some_and(|text| text.contains("ulimit -r")));
        let place = Place::granted(Policy::Fifo, 10, vec![0], |_| true);
        assert_eq!((place.fifo(), place.fell_back), (Some(10), None));
        assert_eq!(Place::granted(Policy::Other, 10, vec![0], |_| true).fifo(), None);
    }
}
