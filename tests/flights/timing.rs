//! `[[timing]]`: loops that begin late, take their time or are stopped, and samples that are late or lost, to the last bit.
//!
//! `MORPHQUAD_ROUNDS=500 cargo test --release --test flights timing::every` flies as many scripts by chance.

mod processes;

use crate::common::{Flown, fly, morphquad, rounds};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde_json::Value;
use std::path::Path;

/// Flies in one process with these scripts.
fn timed(flags: &[&str], scripts: &[&str]) -> Flown {
    in_processes(&[flags, &["--in-process"]].concat(), scripts)
}

/// Flies with these scripts, in processes unless the flags select otherwise.
fn in_processes(flags: &[&str], scripts: &[&str]) -> Flown {
    let scripts = scripts.iter().flat_map(|script| ["--timing", *script]);
    let flags: Vec<&str> = flags.iter().copied().chain(scripts).collect();
    fly(&flags)
}

/// What a flight reports apart from the time that it took.
fn reported(flown: &Flown) -> Vec<Value> {
    let counts = ["hash", "verdict", "misses", "missed_ticks", "late_samples", "unseen_samples"];
    let others =
        ["safe_mode_episodes", "dropped_samples", "flown_ns", "swaps", "recovered_crashes"];
    let reported = counts.iter().chain(&others).map(|key| flown.summary()[key].clone());
    reported.chain([Value::from(flown.code)]).collect()
}

/// A number of the summary that counts.
fn count(flown: &Flown, key: &str) -> u64 {
    flown.summary()[key].as_u64().unwrap_or_else(|| panic!("no {key}: {}", flown.output_text()))
}

/// What was missed of a kind on the way to a loop: how often, and first and last when \[s\].
fn missed(flown: &Flown, kind: &str, topic: Option<&str>, to: &str) -> Option<(u64, f64, f64)> {
    let meant =
        |miss: &&Value| miss["kind"] == kind && miss["topic"].as_str() == topic && miss["to"] == to;
    let miss = flown.misses().iter().find(meant)?;
    let number = |key: &str| miss[key].as_f64().expect("a number");
    Some((miss["count"].as_u64()?, number("first_s"), number("last_s")))
}

fn identical(recording: &Path) -> bool {
    let output =
        morphquad(["replay"]).arg(recording).args(["--verify", "--format", "json"]).output();
    let report: Value =
        serde_json::from_slice(&output.expect("it starts").stdout).unwrap_or(Value::Null);
    report["verify"]["identical"] == true
}

#[test]
fn a_script_that_takes_no_time_changes_no_bit() {
    let flags = ["figure8-morph", "--for", "3s", "--no-record"];
    let plain = fly(&[&flags[..], &["--in-process"]].concat());
    let still = ["attitude:step=0s", "plant:start-late=0s", "imu:late=0s", "imu:duplicated"];
    let flown = timed(&flags, &still);
    assert_eq!(flown.hash(), plain.hash());
    flown.assert_clean();
}

/// 100 Hz, and steps of 12 ms from 5.0 s on: the loop falls behind by 2 ms in each, and at 5.06 s the release of 5.05 s
/// and that of 5.06 s have both passed.
#[test]
fn each_miss_policy_does_with_an_overrun_what_it_promises() {
    for (policy, skipped, late) in [
        ("skip", Some((1, 5.06, 5.06)), 10),
        // It runs the release that is a whole period behind too, and the two after the window late.
        ("catch-up", None, 11),
        // It leaves that of 5.06 s out as well.
        ("hold", Some((2, 5.07, 5.07)), 9),
    ] {
        let policy = format!("realtime.attitude_mpc.miss_policy={policy:?}");
        let flags = ["hover", "--for", "6s", "--no-record", "--set", &policy];
        let flown = timed(&flags, &["attitude:step=12ms@5s..5.1s"]);
        assert_eq!(missed(&flown, "skipped", None, "attitude"), skipped, "{policy}");
        let commands = missed(&flown, "late", Some("wrench_command"), "plant").expect("late ones");
        assert_eq!((commands.0, commands.1), (late, 5.012), "{policy}");
        let expected = skipped.map_or(0, |(count, ..)| count);
        assert_eq!(count(&flown, "missed_ticks"), expected);
    }
}

/// 300 ms: its readers step without it at each of their releases, and get all of its estimates at the end, those up to
/// their last step late.
#[test]
fn what_a_stopped_estimator_makes_its_readers_miss_is_counted_located_and_named() {
    let flown = timed(&["hover", "--for", "4s"], &["estimator:stopped@2s..2.3s"]);
    let estimate = Some("state_estimate");
    for (to, period_ms) in [("attitude", 10), ("monitor", 10), ("position", 20)] {
        let last_ms = 300 - period_ms;
        let last_s = f64::from(2000 + last_ms) / 1e3;
        let steps = u64::from(300_u32 / period_ms);
        let late = u64::from(last_ms) + 1;
        assert_eq!(missed(&flown, "not final", estimate, to), Some((steps, 2.0, last_s)), "{to}");
        assert_eq!(missed(&flown, "late", estimate, to), Some((late, 2.3, 2.3)), "{to}");
    }
    // The plant does not wait, takes in an estimate 20 ms after its release, and steps before the estimator at 2.3 s.
    assert_eq!(missed(&flown, "not final", estimate, "plant"), None);
    assert_eq!(missed(&flown, "late", estimate, "plant"), Some((280, 2.301, 2.301)));
    assert_eq!(count(&flown, "late_samples"), 863 + 280);
    assert_eq!((flown.verdict(), flown.code), ("PASSED", Some(0)), "{}", flown.output_text());
    assert!(identical(&flown.recording_path()));
    let events = morphquad(["topic", "echo", "events"]).arg(flown.recording_path()).output();
    let events = String::from_utf8_lossy(&events.expect("it starts").stdout).into_owned();
    let expected =
        "2.000000 s  info  launcher: fault: estimator is stopped from 2.000 s to 2.300 s";
    assert!(events.contains(expected), "{events}");
    let page = flown.recording_path().with_extension("html");
    let view = morphquad(["view"]).arg(flown.recording_path()).arg("--out").arg(&page).output();
    assert!(view.expect("it starts").status.success());
    let page = std::fs::read_to_string(page).expect("the page");
    assert!(page.contains("\"until_s\":2.3"), "the page has no window");
}

#[test]
fn a_loop_whose_wake_ups_are_lost_begins_when_its_wait_is_over() {
    let flown = timed(&["hover", "--for", "2s"], &["attitude:wake-missed@1s..1.5s"]);
    flown.assert_clean();
    let stamps = ["header.release_ns", "header.start_mono_ns", "header.release_mono_ns"];
    let late_ns = |row: &[f64]| row[1] - row[2];
    for row in flown.recording().series("wrench_command", &stamps) {
        let is_missed = (1e9..1.5e9).contains(&row.values[0]);
        let expected_ns = if is_missed { 500_000.0 } else { 0.0 };
        assert!((late_ns(&row.values) - expected_ns).abs() < 512.0, "{:?}", row.values);
    }
}

#[test]
fn a_lost_sample_is_recorded_and_missed_by_its_readers_alone() {
    let flown = timed(&["hover", "--for", "2s"], &["wrench_command:lost@1s"]);
    assert_eq!(count(&flown, "unseen_samples"), 1, "{}", flown.output_text());
    assert_eq!(count(&flown, "dropped_samples"), 0);
    let commands = flown.recording().series("wrench_command", &["header.release_ns"]);
    assert_eq!(commands.len(), 200);
    assert!(identical(&flown.recording_path()));
}

/// A sample is waited for as a loop is: readers of an estimate wait 0.5 ms for it, and what comes then is in time.
#[test]
fn a_late_sample_or_producer_holds_its_reader_up_until_the_deadline() {
    for (script, misses) in [
        ("state_estimate:late=0.5ms@1s..1.5s", 0),
        ("state_estimate:late=0.51ms@1s..1.5s", 50),
        ("estimator:step=0.5ms@1s..1.5s", 0),
        ("estimator:step=0.51ms@1s..1.5s", 50),
    ] {
        let flown = timed(&["hover", "--for", "2s", "--no-record"], &[script]);
        let found = missed(&flown, "not final", Some("state_estimate"), "attitude");
        assert_eq!(
            found.map_or(0, |(count, ..)| count),
            misses,
            "{script}: {}",
            flown.output_text()
        );
    }
}

/// The plant publishes nothing for 1 ms, and so does the estimator.
#[test]
fn a_loop_waits_as_long_as_the_longest_deadline_of_what_is_missing() {
    let flags = ["hover", "--for", "2s", "--no-record"];
    for (deadline_s, steps) in [("0.0005", Some((1, 1.0, 1.0))), ("0.002", None)] {
        let deadline = format!("realtime.attitude_mpc.deadline.state_estimate_s={deadline_s}");
        let flags = [&flags[..], &["--set", &deadline]].concat();
        let flown = timed(&flags, &["plant:stopped@1s..1.001s"]);
        for topic in ["state_estimate", "applied_command"] {
            let found = missed(&flown, "not final", Some(topic), "attitude");
            assert_eq!(found, steps, "{topic}, {deadline_s} s: {}", flown.output_text());
        }
    }
}

/// Begins and times of a step each, of a loop at 100 Hz: after the first, which takes 12 ms, it is behind.
#[test]
fn a_loop_that_is_behind_begins_late_and_not_amid_a_stop_too() {
    let begins_ms = |scripts: &[&str]| -> Vec<f64> {
        let flown = timed(&["hover", "--for", "600ms"], scripts);
        let stamps = ["header.release_ns", "header.start_mono_ns", "header.release_mono_ns"];
        let commands = flown.recording().series("wrench_command", &stamps);
        let commands = commands.iter().filter(|row| (5e8..5.3e8).contains(&row.values[0]));
        commands.map(|row| ((row.values[1] - row.values[2]) * 1e-4).round() / 1e2).collect()
    };
    let overrun = "attitude:step=12ms@0.5s..0.501s";
    assert_eq!(begins_ms(&[overrun]), [0.0, 2.0, 0.0]);
    // The second has its reason to begin when the first has been published.
    assert_eq!(begins_ms(&[overrun, "attitude:start-late=5ms@0.505s..0.515s"]), [0.0, 7.0, 0.0]);
    assert_eq!(begins_ms(&[overrun, "attitude:stopped@0.512s..0.516s"]), [0.0, 6.0, 0.0]);
}

#[test]
fn the_one_sample_of_a_time_is_the_next_of_a_sensor_that_is_slower_than_the_plant() {
    for at in ["1s", "1.003s"] {
        let flown =
            timed(&["hover", "--for", "2s", "--no-record"], &[&format!("pose_fix:lost@{at}")]);
        assert_eq!(count(&flown, "unseen_samples"), 1, "{at}: {}", flown.output_text());
    }
}

/// 3 ms of computation and what is sent takes effect at once: 3 ms after its release, and not after its latency.
#[test]
fn an_asap_edge_takes_effect_when_the_step_is_over() {
    let asap = ["hover", "--for", "1s", "--set", "realtime.asap=[\"wrench_command\"]"];
    let flown = timed(&asap, &["attitude:step=3ms"]);
    let stamps = ["header.release_ns", "header.valid_ns"];
    for row in flown.recording().series("wrench_command", &stamps) {
        assert_eq!((row.values[1] - row.values[0]).to_bits(), 3e6_f64.to_bits());
    }
    assert!(identical(&flown.recording_path()));
}

/// A stop is a fault that the script declares, and an overrun is none: see `verdict`.
#[test]
fn a_scripted_stop_explains_the_safe_mode_episode_that_it_causes() {
    let flags = ["hover", "--for", "6s", "--no-record"];
    for (script, verdict) in [("stopped", "PASSED"), ("start-late=80ms", "FAILED")] {
        let script = format!("attitude:{script}@1s..1.08s");
        let strict = ["--set", "verdict.safe_mode_max=0"];
        let flown = timed(&[&flags[..], &strict].concat(), &[&script]);
        assert_eq!(
            (flown.verdict(), count(&flown, "safe_mode_episodes")),
            (verdict, 1),
            "{script}"
        );
    }
}

const SWAP: [&str; 2] = ["--swap", "attitude=attitude-pid@1s,shadow=300ms,rollback=400ms"];

#[test]
fn a_swap_is_that_of_the_lockstep_flight_while_loops_that_take_time_are_on_time() {
    let flags = [&["figure8-morph", "--for", "3s", "--no-record"][..], &SWAP].concat();
    let plain = fly(&[&flags[..], &["--in-process"]].concat());
    for script in ["attitude:step=0s", "attitude:step=2ms", "position:step=9ms"] {
        let flown = timed(&flags, &[script]);
        assert_eq!((flown.hash(), flown.code), (plain.hash(), Some(0)), "{script}");
        assert_eq!(flown.summary()["swaps"], plain.summary()["swaps"], "{script}");
    }
}

#[test]
fn orders_faults_and_standbys_are_those_of_lockstep_if_nothing_takes_time() {
    for script in [
        ["--goto", "1,0,2@800ms"],
        ["--morph", "120@700ms,over=500ms"],
        ["--fault", "kill:attitude-mpc@1s"],
        ["--fault", "stop:position-mpc@1s"],
        ["--standby", "attitude=attitude-pid"],
    ] {
        let flags = [&["hover", "--for", "2s", "--no-record"][..], &script].concat();
        let plain = fly(&[&flags[..], &["--in-process"]].concat());
        let flown = timed(&flags, &["attitude:step=0s"]);
        assert_eq!((flown.hash(), flown.code), (plain.hash(), plain.code), "{script:?}");
    }
}

/// Its steps of 12 ms fall behind by 2 ms each, which makes a release of 10 ms in five steps, and the admission check allows
/// none.
#[test]
fn a_candidate_that_misses_its_deadlines_is_refused() {
    let flags = [&["figure8-morph", "--for", "3s"][..], &SWAP].concat();
    let flown = timed(&flags, &["attitude-pid:step=12ms"]);
    let outcome = flown.summary()["swaps"][0].to_string();
    assert!(outcome.contains("it missed 3 deadlines, the first at 1.100000 s"), "{outcome}");
    assert_eq!((flown.code, flown.verdict()), (Some(5), "PASSED"), "{}", flown.output_text());
    assert!(identical(&flown.recording_path()));
}

/// The actuation guard takes the old owner, which stays warm for 400 ms, before it has to hold or level.
#[test]
fn an_owner_that_is_stopped_after_its_swap_is_followed_without_a_safe_mode_episode() {
    for stop in ["attitude-pid:stopped@1.35s..1.5s", "attitude-pid:stopped@1.6s..1.69s"] {
        let flown = timed(&[&["figure8-morph", "--for", "3s"][..], &SWAP].concat(), &[stop]);
        assert_eq!(count(&flown, "safe_mode_episodes"), 0, "{stop}: {}", flown.output_text());
        assert_eq!(
            (flown.code, flown.verdict()),
            (Some(5), "PASSED"),
            "{stop}: {}",
            flown.output_text()
        );
        assert!(
            flown.stderr.contains("attitude-mpc@0 takes over"),
            "{stop}: {}",
            flown.output_text()
        );
        assert!(identical(&flown.recording_path()), "{stop}");
    }
}

/// The recording of a flight with every kind of lateness has the instant and duration of each step, and with that alone
/// it is the same flight.
#[test]
fn a_flight_by_the_recorded_time_of_another_is_that_one() {
    let scripts = [
        "attitude:step=3ms..14ms@0.5s..1s",
        "position:start-late=0ms..15ms",
        "estimator:stopped@1.1s..1.15s",
        "plant:stopped@1.3s..1.32s",
        "attitude:wake-missed@1.5s..2s",
        "attitude:start-late=0ms..8ms@0.5s..1s",
        "attitude:stopped@0.63s..0.66s",
        "pilot:stopped@0.3s..0.8s",
        "disturbance:step=2ms..4ms",
    ];
    let flags = ["figure8-morph", "--for", "2s"];
    let flown = timed(&flags, &scripts);
    let recording = flown.recording_path();
    let again = timed(&flags, &[recording.to_str().expect("a path")]);
    // The monitor publishes nothing while all is well, so that nothing shows when it stepped.
    let of_others = |flown: &Flown| -> Vec<Value> {
        flown.misses().iter().filter(|miss| miss["to"] != "monitor").cloned().collect()
    };
    assert_eq!(of_others(&again), of_others(&flown));
    assert!(count(&flown, "missed_ticks") > 50, "{}", flown.output_text());
    assert_eq!(again.hash(), flown.hash());
    let of_processes = in_processes(&flags, &[recording.to_str().expect("a path")]);
    assert_eq!(reported(&of_processes), reported(&again));

    let whole = std::fs::read(&recording).expect("the recording");
    let cut = recording.with_file_name("cut.mcap");
    std::fs::write(&cut, &whole[..whole.len() / 2]).expect("room");
    let of_a_part = morphquad(["check", "--timing"]).arg(&cut).output();
    let stderr = String::from_utf8_lossy(&of_a_part.expect("it starts").stderr).into_owned();
    assert!(stderr.contains("it is incomplete"), "{stderr}");

    let plain = fly(&[&flags[..], &["--in-process"]].concat());
    let of_lockstep = morphquad(["check", "--timing"]).arg(plain.recording_path()).output();
    let stderr = String::from_utf8_lossy(&of_lockstep.expect("it starts").stderr).into_owned();
    assert!(stderr.contains("it was flown in lockstep"), "{stderr}");
    let rate = morphquad(["check", "--rate", "attitude=200", "--timing"]).arg(&recording).output();
    let stderr = String::from_utf8_lossy(&rate.expect("it starts").stderr).into_owned();
    assert!(stderr.contains("was recorded at 100 Hz, and the loop is at 200 Hz"), "{stderr}");
}

/// One script by chance.
fn by_chance(rng: &mut ChaCha8Rng) -> String {
    let mut below = |n: u32| rng.next_u32() % n;
    let loops = ["plant", "estimator", "position", "attitude", "disturbance", "pilot", "monitor"];
    let topics =
        ["imu", "pose_fix", "state_estimate", "wrench_command", "attitude_setpoint", "reference"];
    let longest_ms = [300, 300, 300, 4000][below(4) as usize];
    let (from_ms, long_ms) = (below(1500), 1 + below(longest_ms));
    let window = format!("@{from_ms}ms..{}ms", from_ms + long_ms);
    let us = [below(3000), below(30_000)];
    let time = format!("{}us..{}us", us[0].min(us[1]), us[0].max(us[1]));
    let of_loop = loops[below(7) as usize];
    let of_topic = topics[below(6) as usize];
    match below(7) {
        0 => format!("{of_loop}:start-late={time}{window}"),
        1 | 2 => format!("{of_loop}:step={time}{window}"),
        3 => format!("{of_loop}:stopped{window}"),
        4 => format!("attitude:wake-missed{window}"),
        5 => format!("{of_topic}:late={time}{window}"),
        _ => format!("{of_topic}:{}{window}", ["lost", "duplicated"][below(2) as usize]),
    }
}

#[test]
fn every_script_flies_to_the_same_bits_accounts_for_its_releases_and_is_verified() {
    for seed in 0..rounds(5) as u64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let entries = 1 + rng.next_u32() % 5;
        let scripts: Vec<String> = (0..entries).map(|_| by_chance(&mut rng)).collect();
        let scripts: Vec<&str> = scripts.iter().map(String::as_str).collect();
        let done: &[&str] = match rng.next_u32() % 8 {
            0..4 => &[],
            4 => &SWAP,
            5 => &["--fault", "kill:attitude-mpc@1.2s"],
            6 => &["--standby", "attitude=attitude-pid", "--fault", "kill:attitude-mpc@1.2s"],
            _ => &["--goto", "1,0,2@800ms", "--fault", "stop:position-mpc@0.7s"],
        };
        let flags = [&["figure8-morph", "--for", "2s"], done].concat();
        let flown = timed(&flags, &scripts);
        let of_processes = in_processes(&flags, &scripts);
        assert_eq!(reported(&of_processes), reported(&flown), "{seed}: {done:?} {scripts:?}");
        assert!(identical(&of_processes.recording_path()), "{seed}: {done:?} {scripts:?}");
        assert_eq!(flown.hash(), timed(&flags, &scripts).hash(), "{seed}: {done:?} {scripts:?}");
        assert_eq!(
            (count(&flown, "dropped_samples"), count(&flown, "flown_ns")),
            (0, 2_000_000_000),
            "{seed}: {done:?} {scripts:?}"
        );
        assert!(identical(&flown.recording_path()), "{seed}: {done:?} {scripts:?}");
        // A loop that is stopped beyond the end finds more releases in the past than the flight had.
        let end_ms = |script: &&str| script.rsplit("..").next()?.strip_suffix("ms")?.parse().ok();
        if !done.is_empty() || scripts.iter().filter_map(end_ms).any(|end_ms: u32| end_ms > 1900) {
            continue;
        }
        // Each release was run or left out.
        let totals = flown.recording().series("loop_stats", &["role", "steps", "skipped"]);
        for (role, releases) in [(0.0_f64, 2000), (1.0, 2000), (2.0, 100), (3.0, 200)] {
            let of_role = totals.iter().rfind(|row| row.values[0].to_bits() == role.to_bits());
            let [_, steps, skipped] = of_role.expect("totals").values[..] else { panic!() };
            assert_eq!(
                (steps + skipped).to_bits(),
                f64::from(releases).to_bits(),
                "{seed}: {done:?} {scripts:?}"
            );
        }
    }
}

#[test]
fn what_cannot_be_timed_is_refused_with_a_remedy() {
    for (flags, what, remedy) in [
        (
            &["--timing", "attitude:late=1ms"][..],
            "no loop of this flight reads a topic called `attitude`",
            "attitude_setpoint",
        ),
        (
            &["--timing", "attitud:step=1ms"],
            "no loop of this flight is called `attitud`",
            "attitude",
        ),
        (&["--timing", "plant:wake-missed"], "goes by its own clock", "start late"),
        (
            &["--timing", "attitude:step"],
            "lacks what happens",
            "--timing attitude:step=12ms@2s..3s",
        ),
        (&["--timing", "attitude:stopped@3s..2s"], "is not after from_s", "later"),
        (&["--timing", "attitude:stopped@30s..40s"], "past the end of the flight", "earlier"),
        (&["--timing", "attitude:step=3ms..1ms"], "the first is longer", "shorter time first"),
        (
            &["--timing", "attitude:stopped@1s..2s", "--clock", "realtime"],
            "by the wall clock a loop can begin late and take its time, and nothing else",
            "lockstep",
        ),
        (&["--timing", "imu:lost", "--clock", "realtime"], "by the wall clock", "lockstep"),
        (
            &["--timing", "attitude-pid:step=1ms"],
            "does not fly in this flight",
            "name attitude-mpc, or attitude for any",
        ),
        (
            &["--timing", "attitude:step=1ms", "--swap", "attitude=/bin/true@1s"],
            "/bin/true is a process",
            "leave either",
        ),
        (
            &[
                "--set",
                "timing=[{ loop = \"attitude\", step_s = { values_s = [1, 2], weights = [1] } }]",
            ],
            "weight",
            "as many weights",
        ),
        (
            &["--set", "timing=[{ loop = \"attitude\", step_s = 1, stopped = true }]"],
            "exactly one of",
            "one entry for each",
        ),
        (&["--set", "timing=[{ topic = \"imu\", step_s = 1 }]"], "are about a loop", "name a loop"),
    ] {
        let output = morphquad(["check", "hover"]).args(flags).output().expect("it starts");
        let stderr = String::from_utf8_lossy(&output.stderr)
            .replace("\n  │ ", " ")
            .replace("\n        ", " ");
        assert_eq!(output.status.code(), Some(2), "{flags:?}: {stderr}");
        assert!(stderr.contains(what) && stderr.contains(remedy), "{flags:?}: {stderr}");
    }
}
