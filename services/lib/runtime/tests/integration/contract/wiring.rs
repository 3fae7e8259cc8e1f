//! What the graph permits, refuses and wakes.

use proptest::prelude::*;
use runtime::graph::{Edge, ROLES};
use runtime::{Graph, GraphError, MissPolicy, Node, Rate};
use shared_types::{Role, topics};

fn node(role: Role, hz: f64, lead_ns: u64) -> Node {
    let rate = Rate::from_hz(hz).expect("a possible rate");
    Node { role, rate, lead_ns, input_deadline_ns: 0, miss_policy: MissPolicy::CatchUp }
}

fn nodes() -> Vec<Node> {
    vec![
        node(Role::Plant, 1000.0, 0),
        node(Role::Estimator, 1000.0, 0),
        node(Role::Position, 150.0, 0),
        node(Role::Attitude, 500.0, 0),
        node(Role::Disturbance, 200.0, 5_000_000),
        node(Role::Pilot, 100.0, 200_000_000),
    ]
}

#[test]
fn a_loop_without_delay_is_refused_by_the_names_on_it_and_no_others() {
    let error = Graph::new(nodes(), &|_| 0).unwrap_err();
    let GraphError::ZeroLatencyLoop(path) = &error else { panic!("{error}") };
    assert!(
        ["position -> attitude -> position", "attitude -> position -> attitude"]
            .contains(&path.as_str()),
        "{path}"
    );
    assert!(error.to_string().contains("attitude_setpoint_s"), "{error}");
}

#[test]
fn one_delay_on_the_loop_or_no_position_loop_is_enough() {
    for delayed in ["attitude_setpoint", "applied_setpoint"] {
        Graph::new(nodes(), &|t| u64::from(t.name == delayed)).unwrap();
    }
    let rig: Vec<_> = nodes().into_iter().filter(|n| n.role != Role::Position).collect();
    let graph = Graph::new(rig, &|_| 0).unwrap();
    let setpoint = graph.edge(&topics::ATTITUDE_SETPOINT.info, Role::Attitude).unwrap();
    assert_eq!(setpoint.from, Role::Pilot);
    assert!(graph.edge(&topics::STATE_ESTIMATE.info, Role::Position).is_none());
}

/// In lockstep it would wait for each of its steps to come back.
#[test]
fn the_plant_takes_in_what_is_made_of_its_own_samples_later_than_controllers() {
    let graph = Graph::new(nodes(), &|_| 1_000_000).unwrap();
    let latencies_ms = |topic, to| {
        let edge = graph.edge(topic, to).unwrap();
        (edge.latency_ns / 1_000_000, edge.held_back_ns / 1_000_000)
    };
    let estimate = &topics::STATE_ESTIMATE.info;
    assert_eq!(latencies_ms(estimate, Role::Attitude), (0, 0));
    assert_eq!(latencies_ms(estimate, Role::Plant), (20, 20));
    assert_eq!(latencies_ms(&topics::REFERENCE.info, Role::Plant), (0, 0));
    assert_eq!(latencies_ms(&topics::WRENCH_COMMAND.info, Role::Plant), (1, 0));
    assert_eq!(graph.latency_ns(estimate), 0, "what a sample names");
}

#[test]
fn a_latency_or_a_lead_that_overflows_a_reader_is_refused_by_name() {
    let late = Graph::new(
        nodes()
            .into_iter()
            .map(|n| if n.role == Role::Attitude { node(n.role, 10_000.0, 0) } else { n })
            .collect(),
        &|t| if t.name == "wrench_command" { 200_000_000 } else { 1_000_000 },
    );
    let Err(GraphError::BufferTooSmall { topic, producer, consumer, needed, capacity }) = late
    else {
        panic!("accepted")
    };
    assert_eq!((topic, producer, consumer), ("wrench_command", "attitude", "plant"));
    assert!(needed > capacity);
    let eager = nodes()
        .into_iter()
        .map(|n| if n.role == Role::Pilot { node(n.role, 5_000.0, 240_000_000) } else { n });
    let error = Graph::new(eager.collect(), &|_| 1_000_000).unwrap_err();
    assert!(matches!(error, GraphError::BufferTooSmall { producer: "pilot", .. }), "{error}");
}

#[test]
fn the_plant_starts_alone_even_without_any_latency() {
    let rig: Vec<_> = nodes().into_iter().filter(|n| n.role != Role::Position).collect();
    let graph = Graph::new(rig, &|_| 0).unwrap();
    let plant = graph.node(Role::Plant).unwrap();
    assert!(graph.runnable(plant, 0, &[0; ROLES], 1));
    assert!(!graph.runnable(plant, 1_000_000, &[0; ROLES], u64::MAX));
    assert!(!graph.runnable(plant, 0, &[0; ROLES], 0), "nothing is allowed yet");
}

#[test]
fn a_source_stays_within_its_lead_of_the_plant() {
    let graph = Graph::new(nodes(), &|_| 1_000_000).unwrap();
    let pilot = graph.node(Role::Pilot).unwrap();
    let mut marks = [0; ROLES];
    assert!(graph.runnable(pilot, 200_000_000, &marks, u64::MAX));
    assert!(!graph.runnable(pilot, 210_000_000, &marks, u64::MAX));
    marks[Role::Plant.index()] = 10_000_000;
    assert!(graph.runnable(pilot, 210_000_000, &marks, u64::MAX));
}

/// The estimator's mark cannot pass an instant before the plant's has, so the plant need not wake the
/// controllers; nothing ties the position loop's mark to the plant's.
#[test]
fn lockstep_leaves_out_a_wake_up_that_another_is_sure_to_follow() {
    let graph = Graph::new(nodes(), &|_| 1_000_000).unwrap();
    let woken = |from, new_ns| {
        let all: Vec<Role> = graph.wakes(from, 0, new_ns).collect();
        let enough: Vec<Role> = graph.lockstep_wakes(from, 0, new_ns, |_| 0).collect();
        assert!(enough.iter().all(|role| all.contains(role)), "{from:?}: {enough:?} of {all:?}");
        (all, enough)
    };
    let (all, enough) = woken(Role::Plant, 2_000_000);
    assert!(all.contains(&Role::Attitude), "{all:?}");
    assert_eq!(enough, [Role::Estimator]);
    let (_, enough) = woken(Role::Estimator, 2_000_000);
    assert_eq!(enough, [Role::Position, Role::Attitude]);
    let (_, enough) = woken(Role::Position, 20_000_000);
    assert!(enough.contains(&Role::Attitude), "{enough:?}");
    let (_, enough) = woken(Role::Plant, u64::MAX);
    assert!(enough.contains(&Role::Attitude), "a mark of ever answers for all that follows");
}

#[test]
fn a_loop_is_quiet_no_further_ahead_than_histories_allow_a_restart() {
    let limits_ms = |plant_hz| {
        let monitor = node(Role::Monitor, 100.0, 0);
        let fast = |n: Node| if n.role == Role::Plant { node(n.role, plant_hz, 0) } else { n };
        let all = nodes().into_iter().map(fast).chain([monitor]).collect();
        let graph = Graph::new(all, &|_| 1_000_000).unwrap();
        let edges = graph.edges().iter().filter(|e| e.to == Role::Monitor);
        assert!(edges.clone().all(|e| graph.most_waiting(e, 1) <= e.topic.history as u64));
        [Role::Monitor, Role::Attitude].map(|role| graph.quiet_limit_ns(role) / 1_000_000)
    };
    assert_eq!(limits_ms(1000.0), [80, 0], "only the monitor is quiet at most of its steps");
    assert_eq!(limits_ms(4000.0), [20, 0]);
}

/// A loop that is quiet is woken for the releases of its turn, and for all before the end of the flight.
#[test]
fn a_quiet_loop_is_not_woken_for_releases_before_its_turn() {
    let monitor = node(Role::Monitor, 100.0, 0);
    let all = nodes().into_iter().chain([monitor]).collect();
    let graph = Graph::new(all, &|_| 1_000_000).unwrap();
    let is_woken = |old_ns, new_ns, woken_from_ns: u64| {
        let woken = |node: &Node| if node.role == Role::Monitor { woken_from_ns } else { 0 };
        graph.lockstep_wakes(Role::Estimator, old_ns, new_ns, woken).any(|r| r == Role::Monitor)
    };
    assert!(is_woken(10_000_000, 11_000_000, 0));
    assert!(!is_woken(10_000_000, 11_000_000, 40_000_000));
    assert!(is_woken(40_000_000, 41_000_000, 40_000_000));
    assert!(is_woken(8_000_000, 50_000_000, 40_000_000), "a whole interval at once");
    assert!(
        is_woken(8_000_000, u64::MAX, 40_000_000),
        "a mark of ever answers for all that follows"
    );
    assert!(!is_woken(8_000_000, u64::MAX, u64::MAX), "it has finished");
}

proptest! {
    /// Unblocking is the difference of two permissions, over every release of the consumer.
    #[test]
    fn a_wake_up_is_sent_exactly_if_a_release_becomes_permitted(
        millihertz in 1_000..10_000_000_u32, latency_ns in 0..20_000_000_u64, strict: bool,
        k in 0..1_000_u64, old_off_ns in 0..4_u64, step_ns in prop_oneof![0..4_u64, 0..30_000_000_u64],
    ) {
        let consumer = Rate::from_hz(f64::from(millihertz) / 1e3).unwrap();
        let topic = &topics::WRENCH_COMMAND.info;
        let (from, to) = (Role::Attitude, Role::Plant);
        let edge = Edge { from, latency_ns, strict, ..Edge::unwaited(topic, to) };
        // Marks close to where a permission changes, and any distance from there.
        let old_ns = (consumer.release_ns(k) + old_off_ns).saturating_sub(latency_ns + 2);
        let new_ns = old_ns + step_ns;
        // No release outside this window can change.
        let first = consumer.first_at_or_after(old_ns).saturating_sub(1);
        let last = consumer.first_at_or_after(new_ns + latency_ns + 2) + 1;
        let becomes_permitted = (first..=last).map(|k| consumer.release_ns(k)).any(|t_ns| {
            edge.permits(t_ns, new_ns) && !edge.permits(t_ns, old_ns)
        });
        prop_assert_eq!(edge.unblocks(consumer, old_ns, new_ns), becomes_permitted);
    }

    /// What a permitted step needs is final, and one nanosecond less would not do.
    #[test]
    fn permission_is_given_exactly_when_nothing_in_effect_can_still_come(
        latency_ns in 0..50_u64, declared_ns in 0..50_u64, strict: bool, t_ns in 0..100_u64,
        mark_ns in 0..100_u64,
    ) {
        let topic = &topics::WRENCH_COMMAND.info;
        let (from, to) = (Role::Attitude, Role::Plant);
        let declared_ns = declared_ns.min(latency_ns);
        let held_back_ns = latency_ns - declared_ns;
        let edge = Edge { from, latency_ns, held_back_ns, strict, ..Edge::unwaited(topic, to) };
        // Anything still to come is released at or after the mark, and names the latency of its topic.
        let may_come = edge.in_effect(mark_ns + declared_ns, t_ns);
        prop_assert_eq!(edge.permits(t_ns, mark_ns), !may_come);
    }
}
