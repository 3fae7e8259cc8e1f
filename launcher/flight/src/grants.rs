//! What the system grants the loops of a realtime flight, asked before the flight starts.

use host::Flight;
use host::realtime::{Setup, Shortfall, allowed_processors};
use runtime::priority::Schedule;
use scenario::Scenario;
use shared_types::Role;
use simulate::setup::RunError;

/// What the loops ask for, and what they will not get.
#[derive(Debug, Default)]
pub(super) struct Grants {
    setups: Vec<Setup>,
    lacking: Vec<Shortfall>,
}

impl Grants {
    /// Asks on behalf of every loop; nothing in lockstep.
    ///
    /// # Errors
    /// A processor that is not there, or, if the scenario is strict, whatever is not granted.
    pub(super) fn ask(scenario: &Scenario, flight: &Flight) -> Result<Self, RunError> {
        let setups =
            Role::STEPPING.into_iter().filter_map(|role| Some((role, flight.setup(role)?)));
        let setups: Vec<_> = setups.collect();
        let allowed = allowed_processors();
        for (role, setup) in &setups {
            if let Some(cpu) = setup.cpus.iter().find(|cpu| !allowed.contains(cpu)) {
                let of_loop = scenario.settings().realtime.of(*role);
                let own = of_loop.is_some_and(|own| own.cpus.is_some());
                let section = scenario::wiring::section(*role);
                let key = if own {
                    format!("realtime.{section}.cpus")
                } else {
                    "realtime.cpus".to_owned()
                };
                let allowed = allowed.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
                return Err(RunError::NoSuchProcessor { key, cpu: *cpu, allowed });
            }
        }
        let setups: Vec<_> = setups.into_iter().map(|(_, setup)| setup).collect();
        let mut lacking: Vec<Shortfall> = Vec::new();
        for shortfall in setups.iter().flat_map(Setup::shortfalls) {
            // Of several priorities the highest is the one to ask for.
            match (lacking.iter_mut().find(|l| same_kind(**l, shortfall)), shortfall) {
                (Some(Shortfall::Fifo(most)), Shortfall::Fifo(priority)) => {
                    *most = (*most).max(priority);
                }
                (Some(_), _) => {}
                (None, shortfall) => lacking.push(shortfall),
            }
        }
        match lacking.first() {
            Some(shortfall) if flight.is_strict() => Err(RunError::NotGranted(*shortfall)),
            _ => Ok(Self { setups, lacking }),
        }
    }

    /// What all loops were granted, in a line; none in lockstep or if something is lacking.
    pub(super) fn granted(&self) -> Option<String> {
        let first = self.setups.first().filter(|_| self.lacking.is_empty())?;
        let mut parts = vec![self.schedule()];
        parts.extend(first.lock_memory.then(|| "memory locked".to_owned()));
        let slack_us = first.timer_slack_ns as f64 * 1e-3;
        parts.extend((slack_us > 0.0).then(|| format!("timer slack {slack_us} us")));
        if self.setups.iter().any(|setup| !setup.cpus.is_empty()) {
            parts.push("processors as in the scenario".to_owned());
        }
        Some(format!("realtime: {}", parts.join(", ")))
    }

    /// What is lacking and how to get it, in a line.
    pub(super) fn lacking(&self) -> Option<String> {
        let lacking: Vec<_> = self.lacking.iter().map(ToString::to_string).collect();
        (!lacking.is_empty()).then(|| {
            let lacking = lacking.join("; ");
            format!("realtime: {lacking}. The loops fly without and may miss more; `morphquad doctor` shows what else is in the way")
        })
    }

    fn schedule(&self) -> String {
        let fifo = |setup: &Setup| match setup.schedule {
            Some(Schedule::Fifo(priority)) => Some(priority),
            _ => None,
        };
        let priorities = self.setups.iter().filter_map(fifo);
        let has_deadline =
            |setup: &Setup| matches!(setup.schedule, Some(Schedule::Deadline { .. }));
        match (priorities.clone().min(), priorities.max()) {
            (Some(least), Some(most)) if least < most => {
                format!("SCHED_FIFO {least} to {most} by rate")
            }
            (Some(priority), _) => format!("SCHED_FIFO {priority}"),
            _ if self.setups.iter().any(has_deadline) => "SCHED_DEADLINE".to_owned(),
            _ => "no priority asked for".to_owned(),
        }
    }
}

fn same_kind(a: Shortfall, b: Shortfall) -> bool {
    core::mem::discriminant(&a) == core::mem::discriminant(&b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::Override;

    fn ask(set: &[&str]) -> Result<Grants, RunError> {
        let mut overrides: Vec<_> = set.iter().map(|set| Override::set(set).unwrap()).collect();
        overrides.push(Override::clock("realtime"));
        let scenario = Scenario::load("hover", &overrides).unwrap();
        Grants::ask(&scenario, &scenario.flight().unwrap())
    }

    #[test]
    fn a_processor_that_is_not_there_is_refused_by_its_key() {
        for (set, key) in [
            ("realtime.cpus=[1023]", "realtime.cpus"),
            ("realtime.attitude_mpc.cpus=[1023]", "realtime.attitude_mpc.cpus"),
        ] {
            let error = ask(&[set]).unwrap_err().to_string();
            assert!(error.contains(key) && error.contains("1023"), "{error}");
        }
    }

    #[test]
    fn what_needs_no_right_is_granted_and_reported() {
        let set = ["realtime.policy=other", "realtime.lock_memory=false", "realtime.strict=true"];
        let grants = ask(&set).unwrap();
        let text = grants.granted().unwrap();
        assert_eq!(text, "realtime: no priority asked for, timer slack 1 us");
        assert_eq!(grants.lacking(), None);
    }

    #[test]
    fn everything_that_is_lacking_is_reported_once() {
        let lacking = vec![Shortfall::Memory, Shortfall::Fifo(13)];
        let grants = Grants { setups: Vec::new(), lacking };
        let text = grants.lacking().unwrap();
        assert_eq!(text.matches("ulimit -l").count(), 1, "{text}");
        assert!(text.contains("ulimit -r") && text.contains("13"), "{text}");
        assert_eq!(grants.granted(), None);
    }
}
