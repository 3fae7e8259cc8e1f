//! Rules for `[realtime]`: which edges have a deadline, how long it may be, and which may do without a
//! latency.

use super::settings::{RealtimeSettings, topic_of};
use super::wiring;
use document::{Complaint, suggestion};
use runtime::graph::Edge;
use runtime::{Graph, MissPolicy};
use shared_types::{Role, topics};

/// Longest deadline of an edge \[s\].
const MAX_DEADLINE_S: f64 = 1.0;

/// Deadlines of edges that do not exist, or out of range.
pub(super) fn of_unknown_edges(settings: &RealtimeSettings) -> Vec<Complaint> {
    let mut complaints = Vec::new();
    for role in Role::STEPPING {
        let known: Vec<String> = topics::all()
            .into_iter()
            .filter(|topic| topic.to.contains(&role) && topic.from != Role::Supervisor)
            .map(|topic| format!("{}_s", topic.name))
            .collect();
        let deadlines = settings.of(role).into_iter().flat_map(|own| &own.deadline);
        for (name, deadline_s) in deadlines {
            let key = format!("realtime.{}.deadline.{name}", wiring::section(role));
            if !known.contains(name) {
                let given = topic_of(name).unwrap_or(name);
                let what = format!("no edge carries `{given}` to {}", role.label());
                let remedy = if known.is_empty() {
                    "leave it out: this loop reads nothing".to_owned()
                } else {
                    suggestion(name, known.iter().map(String::as_str))
                };
                complaints.push((key, what, remedy));
            } else if !(0.0..=MAX_DEADLINE_S).contains(deadline_s) {
                let remedy = format!("write a number of seconds from 0 to {MAX_DEADLINE_S}");
                complaints.push((key, format!("{deadline_s} s is not a valid deadline"), remedy));
            }
        }
    }
    complaints
}

/// Topics that cannot take effect when they are published, because no loop waits for their latency.
pub(super) fn of_unhurried(settings: &RealtimeSettings) -> Vec<Complaint> {
    let delayed: Vec<&str> = wiring::delayed_topics().collect();
    let unknown = settings.asap.iter().filter(|name| !delayed.contains(&name.as_str()));
    unknown
        .map(|name| {
            let what = format!("`{name}` is no topic with a latency of its own");
            let remedy = suggestion(name, delayed.iter().copied());
            ("realtime.asap".to_owned(), what, remedy)
        })
        .collect()
}

/// A loop that leaves out what it is late for would wait for each release until it may no longer
/// run it.
pub(super) fn beyond_the_period(settings: &RealtimeSettings, graph: &Graph) -> Vec<Complaint> {
    let mut complaints = Vec::new();
    for node in graph.nodes().iter().filter(|n| n.miss_policy != MissPolicy::CatchUp) {
        let section = wiring::section(node.role);
        let too_long = |e: &&Edge| e.to == node.role && e.deadline_ns >= node.rate.period_ns();
        let Some(edge) = graph.edges().iter().find(too_long) else { continue };
        let name = edge.topic.name;
        let key = match settings.deadline_s(node.role, name) {
            Some(_) => format!("realtime.{section}.deadline.{name}_s"),
            None => format!("realtime.{section}.input_deadline_s"),
        };
        let what = format!(
            "{} s is not shorter than the loop's period, {} s: it would skip each release that it waited for",
            edge.deadline_ns as f64 * 1e-9,
            node.rate.period_ns() as f64 * 1e-9
        );
        let remedy = format!("wait less, or set realtime.{section}.miss_policy = \"catch-up\"");
        complaints.push((key, what, remedy));
    }
    complaints
}

#[cfg(test)]
mod tests {
    use crate::{Problem, Scenario};
    use shared_types::Role;

    fn problem(text: &str) -> Problem {
        let error = Scenario::from_text("bad.toml", text, &[]).unwrap_err();
        error.problems().next().unwrap().clone()
    }

    #[test]
    fn each_edge_has_the_deadline_that_the_scenario_gives_it_and_no_other_changes() {
        let text = "[realtime.attitude_mpc.deadline]\nstate_estimate_s = 0.002\n\
                    [realtime.plant.deadline]\nwrench_command_s = 0.0001\n\
                    [realtime.position_mpc]\ninput_deadline_s = 0.003\n";
        let graph = Scenario::from_text("good.toml", text, &[]).unwrap().graph().unwrap();
        let usual = Scenario::from_text("usual.toml", "", &[]).unwrap().graph().unwrap();
        for (edge, before) in graph.edges().iter().zip(usual.edges()) {
            let expected_ns = match (edge.topic.name, edge.to) {
                ("state_estimate", Role::Attitude) => 2_000_000,
                ("wrench_command", _) => 100_000,
                // It waits for what has no latency, and not for the set point in force.
                (name, Role::Position) if name != "applied_setpoint" => 3_000_000,
                _ => before.deadline_ns,
            };
            assert_eq!(edge.deadline_ns, expected_ns, "{} to {:?}", edge.topic.name, edge.to);
        }
    }

    #[test]
    fn only_a_topic_with_a_latency_can_do_without_and_only_by_the_wall_clock() {
        for name in ["imu", "wrench_comand", "loop_stats"] {
            let message = problem(&format!("[realtime]\nasap = [\"{name}\"]\n")).to_string();
            assert!(message.contains("realtime.asap") && message.contains(name), "{message}");
        }
        let text = |clock: &str| {
            format!("[scenario]\nclock = \"{clock}\"\n[realtime]\nasap = [\"wrench_command\"]\n")
        };
        for (clock, expected) in [("realtime", true), ("lockstep", false)] {
            let scenario = Scenario::from_text("good.toml", &text(clock), &[]).unwrap();
            let graph = scenario.graph().unwrap();
            for edge in graph.edges() {
                let asap = expected && edge.topic.name == "wrench_command";
                assert_eq!(edge.asap, asap, "{} by {clock}", edge.topic.name);
            }
        }
    }

    #[test]
    fn a_deadline_of_an_edge_that_is_not_there_names_those_that_are() {
        for (section, key, remedy) in [
            ("attitude_mpc", "state_estmate_s", "did you mean `state_estimate_s`?"),
            ("attitude_mpc", "imu_s", "`state_estimate_s`"),
            ("attitude_mpc", "state_estimate_ms", "write `state_estimate_s`"),
            ("pilot", "imu_s", "reads nothing"),
        ] {
            let problem = problem(&format!("[realtime.{section}.deadline]\n{key} = 0.001\n"));
            assert_eq!(problem.key(), format!("realtime.{section}.deadline.{key}"));
            assert_eq!(problem.line(), Some(2));
            assert!(problem.remedy().contains(remedy), "{problem:?}");
        }
    }

    #[test]
    fn a_deadline_out_of_range_is_refused() {
        for deadline_s in ["-0.001", "1.5"] {
            let key = "[realtime.estimator.deadline]\nimu_s";
            let problem = problem(&format!("{key} = {deadline_s}\n"));
            assert_eq!(problem.key(), "realtime.estimator.deadline.imu_s");
            assert!(problem.remedy().contains("from 0 to 1"), "{problem:?}");
        }
    }

    #[test]
    fn a_loop_that_skips_must_not_wait_for_longer_than_its_period() {
        let text = "[realtime.attitude_mpc.deadline]\nstate_estimate_s = 0.01\n";
        let own = problem(text);
        assert_eq!(own.key(), "realtime.attitude_mpc.deadline.state_estimate_s");
        assert!(own.remedy().contains("catch-up"), "{own:?}");
        let loop_wide = problem("[realtime.position_mpc]\ninput_deadline_s = 0.02\n");
        assert_eq!(loop_wide.key(), "realtime.position_mpc.input_deadline_s");
        let patient = format!("[realtime.attitude_mpc]\nmiss_policy = \"catch-up\"\n{text}");
        assert!(Scenario::from_text("good.toml", &patient, &[]).is_ok());
    }
}
