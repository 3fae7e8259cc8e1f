//! The core contract, in one process: a network of services wired by the real graph over the real
//! topic table, each run by the real executor, under a scheduler that may do anything a machine
//! may do.

mod flight;
mod plans;
mod seat;
mod toys;
mod transport;

use flight::{Dice, Kill, fly_in_random_order, fly_in_textbook_order};
use plans::{Wiring, wirings};
use proptest::prelude::*;
use runtime::GraphError;
use shared_types::{Role, topics};

/// The roles that may be restarted in flight.
const RESTARTABLE: [Role; 5] =
    [Role::Estimator, Role::Position, Role::Attitude, Role::Disturbance, Role::Monitor];

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn any_interleaving_flies_the_textbook_flight(wiring in wirings(), seed: u64) {
        let Some(plan) = wiring.plan(1) else { return Ok(()) };
        let expected = fly_in_textbook_order(&plan);
        prop_assert_eq!(expected.complaints(&expected), Vec::<String>::new());
        for round in 0..3 {
            let flown = fly_in_random_order(&plan, seed.wrapping_add(round), &[]);
            prop_assert_eq!(flown.complaints(&expected), Vec::<String>::new());
        }
    }

    #[test]
    fn no_reader_ever_holds_more_than_the_graph_predicts(wiring in wirings(), seed: u64) {
        let Some(plan) = wiring.plan(1) else { return Ok(()) };
        let flown = fly_in_random_order(&plan, seed, &[]);
        for edge in plan.graph.edges() {
            let peak = flown.log.peaks[&(edge.topic.name, edge.to.index())];
            let bound = plan.graph.most_waiting(edge, 1);
            prop_assert!(peak <= bound, "{} at {:?}: {peak} > {bound}", edge.topic.name, edge.to);
        }
    }

    #[test]
    fn a_killed_process_resumes_and_the_flight_stays_the_same(
        wiring in wirings(), seed: u64, which in 0..RESTARTABLE.len(), state_every in 1..20_u64,
        at in 0.0..0.9_f64,
    ) {
        let Some(plan) = wiring.plan(state_every) else { return Ok(()) };
        let role = RESTARTABLE[which];
        if plan.graph.node(role).is_none()
            || plan.graph.too_short_history(role, state_every, &|_| None).is_some()
        {
            return Ok(());
        }
        let expected = fly_in_textbook_order(&plan);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let kill = Kill { role, at_ns: (at * plan.end_ns as f64) as u64 };
        let flown = fly_in_random_order(&plan, seed, &[kill]);
        prop_assert_eq!(flown.complaints(&expected), Vec::<String>::new());
    }
}

#[test]
fn ten_deaths_in_one_flight_change_nothing() {
    let wiring = Wiring::default();
    let plan = wiring.plan(1).unwrap();
    let expected = fly_in_textbook_order(&plan);
    // Not the monitor's, which may be behind by so much that what it needs has died with another process.
    let mut dice = Dice(5);
    for seed in 0..20 {
        let kills: Vec<_> = (0..10)
            .map(|n| Kill {
                role: RESTARTABLE[usize::try_from(dice.below(4)).unwrap()],
                at_ns: n * 28_000_000 + dice.below(8_000_000),
            })
            .collect();
        let flown = fly_in_random_order(&plan, seed, &kills);
        assert_eq!(flown.complaints(&expected), Vec::<String>::new(), "{kills:?}");
        assert_eq!(flown.log.restarts, 10, "seed {seed}");
    }
}

#[test]
fn a_command_latency_far_above_every_period_is_part_of_the_bound() {
    // All others may run 150 ms ahead of the position loop and of the monitor, so that estimates pile up at the position
    // loop although no period is longer than 10 ms.
    let wiring = Wiring {
        setpoint_latency_ns: 150_000_000,
        trip_latency_ns: 150_000_000,
        ..Wiring::default()
    };
    let plan = wiring.plan(1).unwrap();
    let expected = fly_in_textbook_order(&plan);
    let estimate = plan.graph.edge(&topics::STATE_ESTIMATE.info, Role::Position).unwrap();
    let mut highest = 0;
    for seed in 0..20 {
        let flown = fly_in_random_order(&plan, seed, &[]);
        assert_eq!(flown.complaints(&expected), Vec::<String>::new());
        highest = highest.max(flown.log.peaks[&("state_estimate", Role::Position.index())]);
    }
    let bound = plan.graph.most_waiting(estimate, 1);
    assert!(highest > 120 && highest <= bound, "{highest} of {bound}");
    let too_fast =
        Wiring { rates_hz: [1000.0, 8000.0, 100.0, 500.0, 200.0, 100.0, 100.0], ..wiring };
    assert!(matches!(
        too_fast.graph(),
        Err(GraphError::BufferTooSmall { topic: "state_estimate", consumer: "position", .. })
    ));
}

#[test]
fn a_history_that_is_too_short_is_foreseen() {
    // A pilot at 500 Hz publishes 200 ms ahead, 100 samples, of which the topic keeps 32.
    let rates_hz = [1000.0, 1000.0, 100.0, 500.0, 200.0, 500.0, 100.0];
    let plan = Wiring { rates_hz, ..Wiring::default() }.plan(1).unwrap();
    let (edge, needed) = plan.graph.too_short_history(Role::Position, 1, &|_| None).unwrap();
    assert_eq!(edge.topic.name, "reference");
    assert!(needed > 100);
    let expected = fly_in_textbook_order(&plan);
    let kill = Kill { role: Role::Position, at_ns: 150_000_000 };
    let flights = (0..10).map(|seed| fly_in_random_order(&plan, seed, &[kill]));
    assert!(flights.into_iter().any(|f| !f.complaints(&expected).is_empty()));
    // At 100 Hz the same lead fits.
    let plan = Wiring::default().plan(1).unwrap();
    for role in RESTARTABLE {
        let missing = plan.graph.too_short_history(role, 1, &|_| None);
        assert_eq!(missing.map(|(e, n)| (e.topic.name, n)), None);
    }
}

#[test]
fn the_flight_notices_one_sample_in_the_wrong_step() {
    // The other tests compare hashes: this one makes sure that they would see a shift of one tick.
    let right = fly_in_textbook_order(&Wiring::default().plan(1).unwrap());
    let shifted = Wiring { wrench_latency_ns: 1_000_001, ..Wiring::default() };
    let wrong = fly_in_textbook_order(&shifted.plan(1).unwrap());
    let complaints = wrong.complaints(&right);
    assert!(complaints.iter().any(|c| c.starts_with("truth differs from #")), "{complaints:?}");
}
