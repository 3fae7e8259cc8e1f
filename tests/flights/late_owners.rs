//! Owners of slots that fall silent, and candidates beside loops that take their time, to the last bit: what
//! `tests/flights/adopt.rs` and `storms.rs` show of it by the wall clock.

use crate::common::recording::Row;
use crate::common::{Flown, controllers, fly};
use shared_types::Slot;

/// Flies in one process with these scripts.
fn timed(flags: &[&str], scripts: &[&str]) -> Flown {
    let scripts = scripts.iter().flat_map(|script| ["--timing", *script]);
    let flags: Vec<&str> = flags.iter().copied().chain(["--in-process"]).chain(scripts).collect();
    fly(&flags)
}

/// Instants after `from_s` at which the plant begins to apply the commands of another seat, or another mode of its own:
/// when \[ms\], seat and mode.
#[expect(clippy::cast_possible_truncation, reason = "small whole numbers")]
fn changes(flown: &Flown, from_s: f64) -> Vec<(i64, i64, i64)> {
    let rows = flown.recording().series("applied_command", &["seat", "mode"]);
    let of = |row: &Row| (row.values[0].to_bits(), row.values[1].to_bits());
    let changed =
        rows.windows(2).filter(|pair| pair[1].t_s > from_s && of(&pair[0]) != of(&pair[1]));
    let whole = |value: f64| value.round() as i64;
    let entry = |row: &Row| (whole(row.t_s * 1e3), whole(row.values[0]), whole(row.values[1]));
    changed.map(|pair| entry(&pair[1])).collect()
}

/// The command of 2.99 s is in effect from 2.991 s on. That of 3 s, due at 3.001 s, does not come, nor by the next release.
#[test]
fn a_standby_follows_an_owner_that_is_stopped_or_dies_without_a_safe_mode_episode() {
    let standby = ["hover", "--for", "4s", "--standby", "attitude=attitude-pid"];
    let stopped = timed(&standby, &["attitude-mpc:stopped@3s..3.5s"]);
    let killed = timed(
        &[&standby[..], &["--fault", "kill:attitude-mpc@3s"]].concat(),
        &["attitude-mpc:step=0s"],
    );
    for flown in [&stopped, &killed] {
        assert_eq!(flown.verdict(), "PASSED", "{}", flown.output_text());
        assert_eq!(flown.number("safe_mode_episodes").to_bits(), 0.0_f64.to_bits());
        assert!(flown.number("position_max_m") < 0.005, "{}", flown.output_text());
    }
    let standby_commands = [(3012, 1, 0)];
    assert_eq!(changes(&stopped, 2.9), standby_commands);
    assert_eq!(changes(&killed, 2.9), standby_commands);
}

/// The gate holds for 20 ms and levels from then on, until the successor has tracked for 100 ms.
#[test]
fn an_owner_without_a_standby_is_started_again_while_the_gate_holds_and_levels() {
    let flown = timed(&["hover", "--for", "4s"], &["attitude:stopped@2s..3s"]);
    assert_eq!(flown.verdict(), "PASSED", "{}", flown.output_text());
    assert_eq!(flown.summary()["recovered_crashes"], 1, "{}", flown.output_text());
    assert!(flown.number("position_max_m") < 0.02, "{}", flown.output_text());
    let (hold, level) = ((2012, 0, 1), (2032, 0, 2));
    assert_eq!(changes(&flown, 1.9), [hold, level, (3002, 0, 0)]);
}

/// For as long as a process takes to be started again, and longer.
#[test]
fn a_loop_that_is_stopped_leaves_the_vehicle_in_its_place() {
    for name in ["estimator", "position", "attitude", "disturbance", "monitor", "plant"] {
        for (until, limit_m) in [("2.05", 0.02), ("2.1", 0.02), ("2.5", 0.15)] {
            for scenario in ["hover", "figure8-morph"] {
                let script = format!("{name}:stopped@2s..{until}s");
                let flown = timed(&[scenario, "--for", "5s", "--no-record"], &[&script]);
                let away_m = flown.number("position_max_m");
                assert!(away_m < limit_m, "{script}: {}", flown.output_text());
                assert_eq!(flown.verdict(), "PASSED", "{script}: {}", flown.output_text());
            }
        }
    }
}

/// While nothing commands the position slot, a law in the attitude controller follows the reference; with the last tilt
/// held the vehicle was more than four metres away after three seconds, and with one that faded two.
#[test]
fn a_vehicle_without_set_points_stays_on_its_path_under_every_attitude_controller() {
    let goto = ["hover", "--goto", "1,0.5,1.5@1.6s"];
    let fast_and_windy = ["figure8-morph", "--set", "pilot.period_s=5"];
    for owner in controllers(Slot::Attitude) {
        let assignment = format!("attitude={owner}");
        for (scenario, limit_m) in [(&goto[..], 0.05), (&fast_and_windy[..], 0.2)] {
            let flags = ["--for", "7s", "--no-record", "--controller", &assignment];
            let flown = timed(&[scenario, &flags[..]].concat(), &["position:stopped@2s..5s"]);
            assert_eq!(flown.verdict(), "PASSED", "{}", flown.output_text());
            assert!(flown.number("position_max_m") < limit_m, "{}", flown.output_text());
        }
    }
}

/// While nothing commands the attitude slot, the gate follows the reference; level it was 1.2 m away after one and a half
/// seconds. It makes no difference whether the position slot is silent too, or estimates end.
#[test]
fn a_vehicle_that_no_controller_commands_stays_on_its_path() {
    let stopped =
        ["attitude", "position", "estimator"].map(|name| format!("{name}:stopped@2s..3.5s"));
    let [attitude, position, estimator] = stopped.each_ref().map(String::as_str);
    for silent in [&[attitude][..], &[attitude, position], &[estimator]] {
        for scenario in [&["figure8-morph"][..], &["hover", "--goto", "1,0.5,1.5@1.6s"]] {
            let flown = timed(&[scenario, &["--for", "7s"]].concat(), silent);
            assert_eq!(flown.verdict(), "PASSED", "{}", flown.output_text());
            assert!(flown.number("position_max_m") < 0.1, "{}", flown.output_text());
        }
    }
}

/// Times of a small computer under load, all within the deadlines: each candidate is admitted, and nothing is missed.
#[test]
fn every_controller_may_take_over_from_every_other_on_a_loaded_computer() {
    let loaded = [
        "plant:start-late=0us..150us",
        "estimator:step=20us..250us",
        "position:start-late=0us..500us",
        "position:step=0.2ms..6ms",
        "attitude:start-late=0us..150us",
        "attitude:step=0.1ms..1.2ms",
    ];
    for slot in Slot::ALL {
        for (owner, to) in controllers(slot)
            .into_iter()
            .flat_map(|owner| controllers(slot).into_iter().map(move |to| (owner, to)))
        {
            let assignment = format!("{}={owner}", slot.label());
            let swap = format!("{}={to}@1s", slot.label());
            for scenario in ["hover", "figure8-morph"] {
                let flags = [scenario, "--for", "5s", "--no-record", "--controller", &assignment];
                let flown = timed(&[&flags[..], &["--swap", &swap]].concat(), &loaded);
                let report = &flown.summary()["swaps"][0];
                assert_eq!(
                    report["done"],
                    true,
                    "{scenario} {owner} {swap}: {}",
                    flown.output_text()
                );
                assert_eq!(
                    (flown.code, flown.misses().len()),
                    (Some(0), 0),
                    "{}",
                    flown.output_text()
                );
            }
        }
    }
}
