//! Flights of processes by a script: the same as in one process, whatever comes to the processes from outside.

use super::{identical, in_processes, reported, timed};
use crate::common::misdeeds::rogue;
use crate::common::processes::{Running, kill};
use crate::common::{morphquad, rounds};
use rustix::process::Signal;

/// The ports of its process have room for a second of the sensors' samples.
#[test]
fn a_loop_that_is_stopped_for_longer_than_its_ports_have_room_loses_nothing() {
    let flags = ["hover", "--for", "3s", "--no-record"];
    for script in ["estimator:stopped@0.5s..2.5s", "position:stopped@0.5s..2.9s"] {
        let flown = timed(&flags, &[script]);
        assert_eq!(reported(&in_processes(&flags, &[script])), reported(&flown), "{script}");
    }
}

/// Time waits for a process that hangs, and for the one that is started in the place of a dead one, which begins what that
/// one had begun. The estimator publishes its state every tenth step alone, so that its successor is behind.
#[test]
fn a_process_that_dies_or_hangs_in_a_flight_by_a_script_changes_no_bit() {
    let scripts = [
        "attitude:step=1ms..3ms",
        "attitude:start-late=0ms..2ms",
        "estimator:step=50us..300us",
        "position:start-late=3ms",
    ];
    let flags = ["hover", "--for", "4s"];
    let undisturbed = in_processes(&flags, &scripts);
    let scripts: Vec<&str> = scripts.iter().flat_map(|script| ["--timing", *script]).collect();
    let paced = ["--speed", "2", "--set", "launcher.stall_timeout_s=2"];
    let paced = [&flags[..], &scripts, &paced].concat();
    for (name, signal) in [
        ("estimator", Signal::KILL),
        ("attitude-mpc", Signal::KILL),
        ("pilot", Signal::KILL),
        ("position-mpc", Signal::STOP),
    ] {
        for _ in 0..rounds(1) {
            let mut running = Running::start_and_fly(&paced);
            running.signal(name, signal);
            let flown = running.wait();
            assert!(flown.number("recovered_crashes") >= 1.0, "{name}: {}", flown.output_text());
            assert_eq!(flown.hash(), undisturbed.hash(), "{name}: {}", flown.output_text());
            assert_eq!(flown.misses(), undisturbed.misses(), "{name}");
        }
    }
}

/// The old owner of the position slot leaves at the last release but one, or at the last.
#[test]
fn an_owner_that_leaves_at_the_end_of_a_flight_by_a_script_leaves_at_once() {
    for rollback_ms in [660, 675, 690] {
        let swap = format!("position=position-pid@1s,shadow=300ms,rollback={rollback_ms}ms");
        let flags = ["hover", "--for", "2s", "--no-record", "--swap", &swap];
        let script = ["attitude:step=1ms"];
        assert_eq!(
            reported(&in_processes(&flags, &script)),
            reported(&timed(&flags, &script)),
            "{swap}"
        );
    }
}

#[test]
fn a_flight_by_a_script_ends_in_order_when_it_is_interrupted_and_takes_orders() {
    let script = ["--timing", "estimator:step=0.2ms", "--timing", "attitude:step=8ms"];
    let flags = [&["hover", "--for", "600s"][..], &script].concat();
    // As fast as it can be: between two stretches as well as amid one.
    for _ in 0..rounds(1) {
        let mut running = Running::start_and_fly(&flags);
        assert!(kill(running.launcher_pid(), Signal::INT));
        let flown = running.wait();
        assert_eq!(
            (flown.code, flown.verdict()),
            (Some(130), "INCOMPLETE"),
            "{}",
            flown.output_text()
        );
        assert!(identical(&flown.recording_path()), "{}", flown.output_text());
    }

    let flags = ["hover", "--for", "600s", "--speed", "1", "--timing", "estimator:step=0.2ms"];
    let mut running = Running::start_and_fly(&flags);
    let mut swap = morphquad(["swap", "--run", running.id()]);
    let output = swap.args(["--to", "attitude-pid", "attitude"]).output().expect("it starts");
    let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && stdout.contains("rollback window is over"), "{stdout}");
    let mut swap = morphquad(["swap", "--run", running.id()]);
    let output = swap.args(["--to", rogue(), "attitude"]).output().expect("it starts");
    let stderr = String::from_utf8_lossy(&output.stderr).replace("\n  │", "");
    assert!(stderr.contains("takes no turns in a flight by [[timing]]"), "{stderr}");
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!((flown.code, flown.verdict()), (Some(130), "INCOMPLETE"), "{}", flown.output_text());
    assert!(identical(&flown.recording_path()), "{}", flown.output_text());
}

/// A process that is to be started again when it is killed once more is started, and is not taken for one that dies.
#[test]
fn an_owner_that_is_killed_when_it_is_about_to_be_started_again_is_started() {
    let flags = ["figure8-morph", "--for", "2s", "--fault", "kill:attitude-mpc@1.2s"];
    let flags = [&flags[..], &["--no-record"]].concat();
    let scripts =
        ["plant:step=1288us..29422us@812ms..2677ms", "estimator:step=2ms..12ms@339ms..1772ms"];
    assert_eq!(reported(&in_processes(&flags, &scripts)), reported(&timed(&flags, &scripts)));
}

/// By the wall clock it waits as long as it is configured to, whatever the machine does besides.
#[test]
fn a_loop_takes_its_time_by_the_wall_clock_too() {
    let scripts = ["attitude:step=3ms", "position:start-late=4ms"];
    let flags = ["hover", "--clock", "realtime", "--for", "1s", "--speed", "0.5"];
    let flown = in_processes(&flags, &scripts);
    assert!(matches!(flown.code, Some(0 | 1)), "{}", flown.output_text());
    let times = ["header.release_mono_ns", "header.start_mono_ns", "header.publish_mono_ns"];
    let [commands, set_points] =
        flown.recording().several([("wrench_command", &times), ("attitude_setpoint", &times)]);
    assert!(commands.len() > 10 && set_points.len() > 5, "{}", flown.output_text());
    // Twice as long at half the speed.
    for row in commands {
        assert!(row.values[2] - row.values[1] >= 5.99e6, "{:?}", row.values);
    }
    for row in set_points {
        assert!(row.values[1] - row.values[0] >= 7.99e6, "{:?}", row.values);
    }
    let events = morphquad(["topic", "echo", "events"]).arg(flown.recording_path()).output();
    let events = String::from_utf8_lossy(&events.expect("it starts").stdout).into_owned();
    assert!(events.contains("fault: attitude takes 3 ms for a step from 0.000 s on"), "{events}");
}
