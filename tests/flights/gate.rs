//! The gate, on the controllers that are shipped: each may take over from each, in quiet and in rough
//! flight, after short shadows and long ones. `tests/flights/refusals.rs` has those that may not.

use crate::common::misdeeds::{config, rogue};
use crate::common::processes::{Running, kill};
use crate::common::time::{wait_for, wait_until};
use crate::common::{controllers, fly, morphquad};
use rustix::process::Signal;
use serde_json::Value;
use shared_types::Slot;
use tempfile::TempDir;

/// Every owner and every candidate of each slot.
fn pairs() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    let of = |slot: Slot| {
        let owners = controllers(slot).into_iter();
        owners.flat_map(move |owner| {
            controllers(slot).into_iter().map(move |to| (slot.label(), owner, to))
        })
    };
    Slot::ALL.into_iter().flat_map(of)
}

/// Flies with a swap, which must come about.
fn swap(scenario: &[&str], (slot, owner, to): (&str, &str, &str), how: &str) -> Value {
    let (assignment, swap) = (format!("{slot}={owner}"), format!("{slot}={to}@{how}"));
    let flags = ["--no-record", "--controller", &assignment, "--swap", &swap];
    // Those that hover change hands between processes; one process flies the others with the same bits.
    let alone = scenario[0] != "hover";
    let alone: &[&str] = if alone || how.ends_with("shadow=30s") { &["--in-process"] } else { &[] };
    let flown = fly(&[scenario, &flags, alone].concat());
    let report = flown.summary()["swaps"][0].clone();
    assert_eq!(
        report["done"],
        true,
        "{} {swap} from {owner}: {}",
        scenario[0],
        flown.output_text()
    );
    assert_eq!(flown.code, Some(0), "{}", flown.output_text());
    report
}

#[test]
fn every_controller_may_take_over_from_every_other_in_lockstep() {
    for pair in pairs() {
        for scenario in [["hover", "--for", "5s"], ["figure8-morph", "--for", "10s"]] {
            for how in ["1s", "3s,shadow=500ms"] {
                let report = swap(&scenario, pair, if scenario[0] == "hover" { "1s" } else { how });
                let limit = if pair.1 == pair.2 { 0.0 } else { 0.1 };
                assert!(report["bump"].as_f64() <= Some(limit), "{report}");
                if scenario[0] == "hover" {
                    break;
                }
            }
        }
        if pair.0 == "attitude" {
            // The rig, once the pulse of torque is over.
            swap(&["disturbance", "--for", "5s"], pair, "1.2s");
        }
    }
}

#[test]
fn a_shadow_of_half_a_minute_and_one_at_another_rate_may_take_over() {
    for to in controllers(Slot::Attitude) {
        let pair = ("attitude", "attitude-mpc", to);
        swap(&["hover", "--for", "33s"], pair, "1s,shadow=30s");
        swap(&["figure8-morph", "--for", "8s", "--rate", "attitude-mpc=500"], pair, "3s");
    }
    for to in controllers(Slot::Position) {
        swap(&["hover", "--for", "33s"], ("position", "position-mpc", to), "1s,shadow=30s");
    }
}

fn run_command(arguments: &[&str], run: &Running) -> (Option<i32>, String) {
    let output = morphquad(arguments).args(["--run", run.id()]).output();
    let output = output.expect("the executable starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout) + &text(&output.stderr))
}

fn owner(run: &Running) -> String {
    let (_, table) = run_command(&["ps", "--format", "json"], run);
    let status: Value = serde_json::from_str(&table).unwrap_or_default();
    let mut slots = status["slots"].as_array().into_iter().flatten();
    let slot = slots.find(|slot| slot["slot"] == "attitude");
    slot.map_or(String::new(), |slot| slot["owner"].to_string())
}

#[test]
fn a_standby_of_another_kind_shadows_takes_over_and_goes_back_when_ordered() {
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "15"]);
    let standby = ["standby", "attitude", "attitude-lqr", "--shadow", "20s"];
    let (code, output_text) = run_command(&standby, &running);
    assert_eq!(code, Some(0), "{output_text}");
    // There it is, and it has been running free since.
    let swap =
        ["swap", "attitude", "--to", "attitude-lqr@1", "--shadow", "5s", "--rollback", "60s"];
    let mut first = morphquad(swap).args(["--run", running.id()]).spawn().expect("it starts");
    wait_until("the change", || owner(&running).contains("attitude-lqr"));
    let (code, output_text) = run_command(&["rollback", "attitude"], &running);
    assert_eq!(code, Some(0), "{output_text}");
    assert_eq!(first.wait().expect("it ends").code(), Some(1));
    assert!(owner(&running).contains("attitude-mpc"));
    let (code, output_text) = run_command(&["retire", "attitude-mpc@0"], &running);
    assert_eq!(code, Some(2), "who commands does not leave: {output_text}");
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
}

/// A flight by the wall clock whose attitude slot has an owner that is watched.
fn watched(folder: &TempDir, more: &[&str]) -> Running {
    let behaves = config(folder, "nothing", 0.0, 0.0);
    let flight = ["hover", "--clock", "realtime", "--for", "600s"];
    let running = Running::start_and_fly(&[&flight[..], more].concat());
    let swap = ["swap", "attitude", "--to", rogue(), "--config", &behaves, "--shadow", "400ms"];
    let how = ["--rollback", "100ms", "--no-rehearsal", "--force"];
    wait_for("a swap", || {
        let (code, output_text) = run_command(&[&swap[..], &how].concat(), &running);
        if code == Some(0) { Ok(()) } else { Err(output_text) }
    });
    running
}

#[test]
fn while_the_monitor_does_not_step_no_swap_is_accepted() {
    let folder = TempDir::new().expect("a folder");
    let mut running = watched(&folder, &[]);
    running.signal("monitor", Signal::STOP);
    // However busy the machine is, nothing else refuses it.
    let swap =
        ["swap", "position", "--to", "position-pid", "--dry-run", "--force", "--no-rehearsal"];
    wait_for("a refusal", || {
        let (code, output_text) = run_command(&swap, &running);
        let is_refused = code == Some(3) && output_text.contains("the monitor has not stepped for");
        if is_refused { Ok(()) } else { Err(output_text) }
    });
    running.signal("monitor", Signal::CONT);
    wait_for("the swap", || {
        let (code, output_text) = run_command(&swap, &running);
        if code == Some(0) { Ok(()) } else { Err(output_text) }
    });
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
}

/// At a tenth of its speed, so that no owner falls silent before on a busy machine.
#[test]
fn a_watched_owner_is_replaced_when_the_monitor_hangs() {
    let folder = TempDir::new().expect("a folder");
    let slowly = ["--speed", "0.1", "--set", "launcher.lag_timeout_s=0.5"];
    let mut running = watched(&folder, &slowly);
    running.signal("monitor", Signal::STOP);
    wait_until("the proven owner commands", || owner(&running).contains("attitude-mpc"));
    assert!(kill(running.launcher_pid(), Signal::INT));
    let flown = running.wait();
    assert_eq!(flown.code, Some(130), "{}", flown.output_text());
    let expected = "the monitor hangs, and nothing watches it";
    assert!(flown.stderr.contains(expected), "{}", flown.output_text());
}
