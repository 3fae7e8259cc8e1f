//! Which of a realtime flight's loops goes first: the faster one, unless the scenario sets its priority.

use super::settings::RealtimeSettings;
use host::flight::Claim;
use runtime::Graph;
use shared_types::Role;

/// Highest priority of `SCHED_FIFO`.
const HIGHEST: usize = 99;

/// What each loop asks for. Under `fifo` the slowest loops have the scenario's priority and each faster
/// rate one more: rate monotonic, which meets all deadlines that fixed priorities can meet (Liu and
/// Layland 1973).
pub(super) fn claims(settings: &RealtimeSettings, graph: &Graph) -> Vec<(Role, Claim)> {
    let mut periods: Vec<u64> = graph.nodes().iter().map(|node| node.rate.period_ns()).collect();
    periods.sort_unstable();
    periods.dedup();
    let claim = |role: Role, period_ns: u64| {
        let own = settings.of(role);
        let faster_than = periods.iter().rev().position(|p| *p == period_ns).unwrap_or(0);
        let by_rate = match settings.priority {
            0 => 0,
            base => u8::try_from((usize::from(base) + faster_than).min(HIGHEST)).unwrap_or(base),
        };
        Claim {
            priority: own.and_then(|own| own.priority).unwrap_or(by_rate),
            budget_share: own.and_then(|own| own.budget_share).unwrap_or(settings.budget_share),
            cpus: own.and_then(|own| own.cpus.clone()).unwrap_or_else(|| settings.cpus.clone()),
        }
    };
    let nodes = graph.nodes().iter();
    nodes.map(|node| (node.role, claim(node.role, node.rate.period_ns()))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Override, Scenario};

    fn claims_of(set: &[&str]) -> Vec<(Role, Claim)> {
        let set: Vec<_> = set.iter().map(|set| Override::set(set).unwrap()).collect();
        let scenario = Scenario::load("hover", &set).unwrap();
        claims(&scenario.settings().realtime, &scenario.graph().unwrap())
    }

    fn of(claims: &[(Role, Claim)], role: Role) -> &Claim {
        &claims.iter().find(|(of, _)| *of == role).unwrap().1
    }

    #[test]
    fn a_faster_loop_goes_first_and_equal_rates_have_equal_priority() {
        let claims = claims_of(&["attitude_mpc.rate_hz=500.0"]);
        let priority = |role| of(&claims, role).priority;
        assert_eq!(priority(Role::Position), 10);
        assert!(priority(Role::Attitude) > priority(Role::Disturbance));
        assert!(priority(Role::Plant) > priority(Role::Attitude));
        assert_eq!(priority(Role::Plant), priority(Role::Estimator));
    }

    #[test]
    fn what_the_scenario_sets_for_one_loop_holds_for_it_alone() {
        let set = ["realtime.cpus=[0]", "realtime.plant.cpus=[1]", "realtime.plant.priority=77"];
        let claims = claims_of(&set);
        assert_eq!(of(&claims, Role::Plant).cpus, [1]);
        assert_eq!(of(&claims, Role::Plant).priority, 77);
        assert_eq!(of(&claims, Role::Attitude).cpus, [0]);
        let none = claims_of(&["realtime.priority=0"]);
        assert!(none.iter().all(|(_, claim)| claim.priority == 0));
    }
}
