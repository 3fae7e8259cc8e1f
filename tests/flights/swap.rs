//! Controllers change hands in flight: to the same kind without a trace, to another without a bump, and
//! after a death without a pause. All in lockstep, where a flight follows from its script alone.
//!
//! `MORPHQUAD_SWAPS=1000 cargo test --release --test flights null -- --nocapture` and
//! `MORPHQUAD_SWAPS=10000 cargo test --release --test flights storm -- --nocapture` are the full proofs; with
//! `MORPHQUAD_REHEARSE=1` every candidate is flown ahead, a null swap's too.

use crate::common::misdeeds::{config, rogue};
use crate::common::processes::make_executable;
use crate::common::{Flown, SWAP_FAILED, controllers, fly};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use shared_types::Slot;
use tempfile::TempDir;

/// Swaps to make in all.
fn swaps(default: usize) -> usize {
    std::env::var("MORPHQUAD_SWAPS").ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// What one flight's swaps came to.
fn reports(flown: &Flown) -> &[Value] {
    flown.summary()["swaps"].as_array().map_or(&[], Vec::as_slice)
}

fn done(flown: &Flown) -> usize {
    reports(flown).iter().filter(|report| report["done"] == true).count()
}

/// A number from 0 to `end` - 1.
fn below(random: &mut ChaCha8Rng, end: u64) -> u64 {
    random.next_u64() % end
}

fn pick<'a>(random: &mut ChaCha8Rng, names: &[&'a str]) -> &'a str {
    names[usize::try_from(below(random, names.len() as u64)).unwrap_or(0)]
}

/// Swaps of one slot at random instants of 20 s, as close as their windows allow.
fn script(
    random: &mut ChaCha8Rng,
    slot: &str,
    names: &[&str],
    windows_ms: [u64; 2],
) -> Vec<String> {
    let [shadow, rollback] = windows_ms;
    let mut flags = Vec::new();
    let mut at_ms = 300 + below(random, 200);
    while at_ms + shadow + rollback < 19_000 {
        let name = pick(random, names);
        flags.push(format!("{slot}={name}@{at_ms}ms,shadow={shadow}ms,rollback={rollback}ms"));
        // Windows, the way to the flip, and the old owner's way out.
        at_ms += shadow + rollback + 120 + below(random, 200);
    }
    flags
}

/// Both slots' swaps by turns, at most `most` of them.
fn by_turns(a: Vec<String>, b: Vec<String>, most: usize) -> Vec<String> {
    a.into_iter().zip(b).flat_map(|(a, b)| [a, b]).take(most).collect()
}

fn fly_scripted(scenario: &[&str], swaps: &[String], faults: &[String]) -> Flown {
    let swaps = swaps.iter().flat_map(|swap| ["--swap", swap.as_str()]);
    let faults = faults.iter().flat_map(|fault| ["--fault", fault.as_str()]);
    let arguments: Vec<&str> = scenario.iter().copied().chain(swaps).chain(faults).collect();
    fly(&arguments)
}

#[test]
fn null_swaps_of_both_slots_while_morphing_in_gusts_change_no_bit_of_the_flight() {
    let wanted = swaps(30);
    let scenario = ["figure8-morph", "--no-record"];
    let expected = fly(&scenario);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut made = 0;
    while made < wanted {
        let attitude = script(&mut random, "attitude", &["attitude-mpc"], [120, 60]);
        let position = script(&mut random, "position", &["position-mpc"], [240, 60]);
        let mut plan = by_turns(attitude, position, wanted - made);
        // The same kind and build needs no rehearsal; one that is forced must leave no trace either.
        let every = if std::env::var_os("MORPHQUAD_REHEARSE").is_some() { 1 } else { 20 };
        plan.iter_mut().step_by(every).for_each(|swap| swap.push_str(",rehearse"));
        let flown = fly_scripted(&scenario, &plan, &[]);
        flown.assert_clean();
        assert_eq!(done(&flown), plan.len(), "{}", flown.output_text());
        assert_eq!(flown.hash(), expected.hash(), "{}", flown.output_text());
        for report in reports(&flown) {
            assert_eq!(report["same_kind"], true, "{report}");
            assert_eq!(report["bump"].as_f64(), Some(0.0), "{report}");
        }
        made += plan.len();
        println!("{made} null swaps, hash {}", flown.hash());
    }
}

/// What is to happen in one flight.
#[derive(Default)]
struct Plan {
    swaps: Vec<String>,
    faults: Vec<String>,
    /// Controllers that turn to garbage.
    spoilt: usize,
}

/// Swaps of one slot and, at any step of some of them or soon after, the death, stop or garbage of a controller
/// that flies there: the old one, the new one or the standby. After it the slot has time to get another
/// fallback warm.
fn storm(
    random: &mut ChaCha8Rng,
    slot: &str,
    names: &[&str],
    windows_ms: [u64; 2],
    configs: Option<&TempDir>,
    plan: &mut Plan,
) {
    let [shadow, rollback] = windows_ms;
    let mut at_ms = 1_500 + below(random, 200);
    let mut owner_turns_to_garbage = false;
    while at_ms + shadow + rollback < 18_500 {
        let mut name = pick(random, names);
        let over = shadow + rollback + 120;
        let mut option = String::new();
        let fate = if owner_turns_to_garbage { 6 } else { below(random, 6) };
        let pain_ms = at_ms + below(random, over);
        let mut recovery_ms = if owner_turns_to_garbage { 1_800 } else { 0 };
        owner_turns_to_garbage = false;
        match configs {
            Some(folder) if fate == 0 => {
                name = rogue();
                // As candidate or new owner, or as old owner while the next one comes.
                owner_turns_to_garbage = below(random, 2) == 0;
                let from_ms = if owner_turns_to_garbage { pain_ms + over } else { pain_ms };
                recovery_ms = if owner_turns_to_garbage { 0 } else { 1_800 };
                let what = pick(random, &["not-a-number", "beyond-bounds"]);
                option = format!(",config={}", config(folder, what, from_ms as f64 * 1e-3, 0.0));
                plan.spoilt += 1;
            }
            _ if fate < 3 => {
                let victim = pick(random, &[names[0], name]);
                let kind = pick(random, &["kill", "stop"]);
                plan.faults.push(format!("{kind}:{victim}@{pain_ms}ms"));
                recovery_ms = 1_800;
            }
            _ => {}
        }
        plan.swaps.push(format!(
            "{slot}={name}@{at_ms}ms,shadow={shadow}ms,rollback={rollback}ms{option}"
        ));
        at_ms += over + recovery_ms + below(random, 200);
    }
}

/// `MORPHQUAD_REHEARSE=1` has every candidate of another kind flown ahead, which takes a third of a second
/// of each swap.
fn rehearsal() -> [&'static str; 2] {
    let rehearses = std::env::var_os("MORPHQUAD_REHEARSE").is_some();
    ["--set", if rehearses { "rehearsal.enabled=true" } else { "rehearsal.enabled=false" }]
}

/// Both slots have a warm fallback throughout, whichever other process comes, dies, stops or writes garbage.
#[test]
fn a_storm_of_swaps_between_kinds_and_deaths_leaves_the_vehicle_in_its_tube() {
    let folder = TempDir::new().expect("a folder");
    let wanted = swaps(30);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let (mut made, mut flipped, mut worst_bump, mut furthest_m) = (0, 0, 0.0_f64, 0.0_f64);
    let (mut ticks, mut hurt, mut spoilt) = (0.0, 0, 0);
    while made < wanted {
        let mut plan = Plan::default();
        let [attitude, position] = Slot::ALL.map(controllers);
        storm(&mut random, "attitude", &attitude, [400, 200], Some(&folder), &mut plan);
        storm(&mut random, "position", &position, [600, 200], None, &mut plan);
        let standbys = ["--standby", "attitude=attitude-mpc", "--standby", "position=position-mpc"];
        let scenario: Vec<&str> = ["figure8-morph", "--no-record"]
            .into_iter()
            .chain(standbys)
            .chain(rehearsal())
            .collect();
        let flown = fly_scripted(&scenario, &plan.swaps, &plan.faults);
        let scripted = format!("{:?} {:?}", plan.swaps, plan.faults);
        let has_failed =
            |report: &&Value| report["ended"] == "refused" || report["ended"] == "taken-back";
        let code =
            if reports(&flown).iter().any(|report| has_failed(&report)) { SWAP_FAILED } else { 0 };
        assert_eq!(flown.code, Some(code), "{scripted}\n{}", flown.output_text());
        for report in reports(&flown).iter().filter(|report| !report["flipped_s"].is_null()) {
            let limit = if report["same_kind"] == true { 0.01 } else { 0.10 };
            let bump = report["bump"].as_f64().unwrap_or(0.0);
            assert!(bump <= limit, "{report}");
            worst_bump = worst_bump.max(bump);
            flipped += 1;
        }
        for none in ["unguided_ticks", "duplicated_ticks", "wrong_owner_ticks"] {
            assert_eq!(flown.summary()[none], 0, "{none}: {scripted}\n{}", flown.output_text());
        }
        ticks += flown.number("flown_s") * 1e3;
        hurt += plan.faults.len();
        spoilt += plan.spoilt;
        furthest_m = furthest_m.max(flown.number("position_max_m"));
        assert!(furthest_m <= 0.5, "{}", flown.output_text());
        made += plan.swaps.len();
        println!(
            "{made} swaps asked for, {flipped} made, {hurt} deaths and stops, {spoilt} made to write \
             garbage; of {ticks} ticks 0 missed, 0 duplicated, 0 of a wrong owner; bump at most \
             {:.2} %, {:.0} mm from the path",
            100.0 * worst_bump,
            1e3 * furthest_m
        );
    }
    assert!(flipped > 0);
}

#[test]
fn owner_and_fallback_killed_together_leave_no_command_and_the_vehicle_in_its_tube() {
    let standbys = ["--standby", "attitude=attitude-pid", "--standby", "position=position-pid"];
    for [owner, fallback] in [["attitude-mpc", "attitude-pid"], ["position-mpc", "position-pid"]] {
        let scenario: Vec<&str> =
            ["figure8-morph", "--for", "8s"].into_iter().chain(standbys).collect();
        let together = [owner, fallback].map(|name| format!("kill:{name}@2500ms"));
        let flown = fly_scripted(&scenario, &[], &together);
        assert_eq!(flown.code, Some(0), "{}", flown.output_text());
        assert_eq!(flown.summary()["wrong_owner_ticks"], 0, "{}", flown.output_text());
        assert_eq!(flown.summary()["duplicated_ticks"], 0, "{}", flown.output_text());
        if owner == "attitude-mpc" {
            // Two periods of the last command, and the rest of the way to the new one's first.
            let unguided = flown.number("unguided_ticks");
            assert!((1.0..=150.0).contains(&unguided), "{}", flown.output_text());
        }
        assert!(flown.number("position_max_m") <= 0.5, "{}", flown.output_text());
        assert!(flown.number("position_last_second_m") < 0.05, "{}", flown.output_text());
    }
}

#[test]
fn a_killed_owner_with_a_warm_fallback_is_followed_within_two_periods() {
    // After the flip at 1.4 s the old owner stays warm until 6.4 s.
    let swap = ["attitude=attitude-mpc@1s,shadow=400ms,rollback=5s".to_owned()];
    for kind in ["kill", "stop"] {
        let faults = [format!("{kind}:attitude-mpc@2500ms")];
        let flown = fly_scripted(&["figure8-morph", "--for", "8s"], &swap, &faults);
        assert_eq!(flown.code, Some(0), "{}", flown.output_text());
        assert!(flown.number("unguided_ticks") < 1.0, "{}", flown.output_text());
        assert!(flown.number("position_max_m") < 0.05, "{}", flown.output_text());
    }
}

#[test]
fn a_killed_owner_without_a_fallback_is_started_again_and_the_vehicle_comes_back() {
    for slot in ["attitude-mpc", "position-mpc"] {
        let faults = [format!("kill:{slot}@2500ms")];
        let flown = fly_scripted(&["figure8-morph", "--for", "9s"], &[], &faults);
        assert_eq!(flown.code, Some(0), "{}", flown.output_text());
        assert!(flown.number("unguided_ticks") <= 150.0, "{}", flown.output_text());
        assert!(flown.number("position_last_second_m") < 0.05, "{}", flown.output_text());
    }
}

#[test]
fn a_failed_candidate_without_a_fallback_makes_room_for_the_initial_controller() {
    let folder = TempDir::new().expect("a folder");
    // What is no number leaves the vehicle to itself for so long that the flight has not passed.
    let cases = [("crash", 500.0, 0.5, SWAP_FAILED), ("not-a-number", 900.0, 1.0, 1)];
    for (what, unguided, furthest_m, code) in cases {
        let config = config(&folder, what, 4.0, 0.0);
        let swap = format!("attitude={}@1s,shadow=1s,rollback=300ms,config={config}", rogue());
        let scenario = ["figure8-morph", "--for", "10s", "--set", "monitor.fallback=none"];
        let flown = fly_scripted(&scenario, &[swap], &[]);
        assert_eq!(flown.code, Some(code), "{}", flown.output_text());
        assert!(flown.stderr.contains("what the flight began with"), "{}", flown.output_text());
        assert!(
            (1.0..=unguided).contains(&flown.number("unguided_ticks")),
            "{}",
            flown.output_text()
        );
        assert!(flown.number("position_max_m") <= furthest_m, "{}", flown.output_text());
        assert!(flown.number("position_last_second_m") < 0.05, "{}", flown.output_text());
    }
}

#[test]
fn an_untrusted_owner_that_fails_after_its_window_falls_back_to_the_last_proven_one() {
    let folder = TempDir::new().expect("a folder");
    for what in ["crash", "not-a-number"] {
        let config = config(&folder, what, 4.0, 0.0);
        let swap = format!("attitude={}@1s,shadow=1s,rollback=300ms,config={config}", rogue());
        let flown = fly_scripted(&["figure8-morph", "--for", "8s"], &[swap], &[]);
        assert_eq!(flown.code, Some(SWAP_FAILED), "{}", flown.output_text());
        assert!(flown.number("unguided_ticks") <= 20.0, "{}", flown.output_text());
        assert!(flown.number("position_max_m") <= 0.1, "{}", flown.output_text());
    }
}

/// Nothing but the death of the owner has made it one, and no window or order names it.
#[test]
fn a_standby_of_a_user_is_watched_once_it_commands_and_has_a_fallback() {
    let folder = TempDir::new().expect("a folder");
    let turns = config(&folder, "gain", 8.0, -1.0);
    let standby = folder.path().join("brought");
    let content = format!("#!/bin/sh\nexec '{}' \"$@\" --config '{turns}'\n", rogue());
    make_executable(&standby, content.as_bytes());
    let standby = format!("attitude={}", standby.display());
    let faults = ["--fault", "kill:attitude-mpc@4s"];
    let flown = fly(&[&["hover", "--for", "10s", "--standby", &standby][..], &faults].concat());
    let output_text = flown.output_text();
    let owners = flown.recording().series("attitude_owner", &["owner", "fallback", "watched"]);
    let at = |t_s: f64| owners.iter().rev().find(|row| row.t_s <= t_s).expect("a record");
    assert_eq!(at(7.9).values, [1.0, 0.0, 1.0], "{output_text}");
    let tripped = flown.recording().series("trip", &["instance"]);
    assert_eq!(tripped[0].values, [1.0], "{output_text}");
    let no_seat = f64::from(shared_types::NO_SEAT);
    assert_eq!(at(9.9).values, [0.0, no_seat, 0.0], "{output_text}");
    assert!(flown.number("position_max_m") < 0.5, "{output_text}");
}

/// A trip is known before the successor is confirmed, for which a flight may be too short.
#[test]
fn a_swap_whose_owner_trips_just_before_the_end_is_taken_back() {
    let folder = TempDir::new().expect("a folder");
    let turns = config(&folder, "gain", 3.0, -1.0);
    for rollback in ["100ms", "3s"] {
        let how = format!("shadow=400ms,rollback={rollback},no-rehearsal,config={turns}");
        let swap = format!("attitude={}@1s,{how}", rogue());
        let fly_for = |duration: &str| {
            fly(&["figure8-morph", "--in-process", "--for", duration, "--swap", &swap])
        };
        let flown = fly_for("4s");
        let tripped = flown.recording().series("trip", &["header.valid_ns"]);
        let tripped_ms = tripped[0].values[0] / 1e6;
        let mut unconfirmed = 0;
        for ends_ms in [1.0, 2.0, 4.0, 8.0, 16.0, 32.0].map(|after_ms| tripped_ms + after_ms) {
            let flown = fly_for(&format!("{ends_ms}ms"));
            let has_tripped = !flown.recording().series("trip", &["epoch"]).is_empty();
            assert!(has_tripped, "{}", flown.output_text());
            let report = &reports(&flown)[0];
            assert_eq!(report["ended"], "taken-back", "{ends_ms} ms: {report}");
            unconfirmed += usize::from(report["outcome"].to_string().contains("the flight ended"));
            assert_eq!(flown.code, Some(SWAP_FAILED), "{}", flown.output_text());
        }
        assert!(unconfirmed > 0, "each trip was confirmed before the end");
    }
}
