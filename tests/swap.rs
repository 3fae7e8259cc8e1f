//! Controllers change hands in flight: to the same kind without a trace, to another without a bump, and
//! after a death without a pause. All in lockstep, where a flight follows from its script alone.
//!
//! `MORPHQUAD_SWAPS=1000 cargo test --release --test swap null -- --nocapture` is the full proof.

mod common;

use common::{Flown, fly, turn};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;

/// Swaps to make in all.
fn swaps(default: usize) -> usize {
    std::env::var("MORPHQUAD_SWAPS").ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// What one flight's swaps came to.
fn reports(flown: &Flown) -> &[Value] {
    flown.summary()["swaps"].as_array().map_or(&[], Vec::as_slice)
}

#[track_caller]
fn assert_all_done(flown: &Flown, count: usize) {
    assert_eq!(flown.code, Some(0), "{}", flown.said());
    let done = reports(flown).iter().filter(|report| report["done"] == true).count();
    assert_eq!(done, count, "{}", flown.said());
}

/// A swap script for one slot: instants drawn between 0.3 s and `until_s`, as close as a window of
/// 120 ms and a rollback of 60 ms allow, each to one of `names`.
fn script(random: &mut ChaCha8Rng, slot: &str, names: &[&str], until_s: f64) -> Vec<String> {
    let mut flags = Vec::new();
    let mut at_ms = 300 + random.next_u64() % 100;
    while (at_ms as f64) < until_s * 1e3 - 900.0 {
        let name = names[usize::try_from(random.next_u64()).unwrap_or(0) % names.len()];
        flags.push(format!("{slot}={name}@{at_ms}ms,shadow=120ms,rollback=60ms"));
        // Shadow, rollback, three periods, and the old owner's way out.
        at_ms += 300 + random.next_u64() % 150;
    }
    flags
}

fn fly_scripted(scenario: &[&str], script: &[String]) -> Flown {
    let swaps = script.iter().flat_map(|swap| ["--swap", swap.as_str()]);
    let arguments: Vec<&str> = scenario.iter().copied().chain(swaps).collect();
    fly(&arguments)
}

#[test]
fn null_swaps_of_both_slots_while_morphing_in_gusts_leave_every_bit_of_the_flight_as_it_was() {
    let _turn = turn();
    let wanted = swaps(40);
    let scenario = ["figure8-morph"];
    let expected = fly(&scenario);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut made = 0;
    while made < wanted {
        let mut plan = script(&mut random, "attitude", &["attitude-mpc"], 20.0);
        plan.extend(script(&mut random, "position", &["position-mpc"], 20.0));
        plan.truncate(wanted - made);
        let flown = fly_scripted(&scenario, &plan);
        assert_all_done(&flown, plan.len());
        assert_eq!(flown.hash(), expected.hash(), "{}", flown.said());
        for report in reports(&flown) {
            assert_eq!(report["same_kind"], true, "{report}");
            assert_eq!(report["bump"].as_f64(), Some(0.0), "{report}");
        }
        made += plan.len();
        println!("{made} null swaps, hash {}", flown.hash());
    }
}
