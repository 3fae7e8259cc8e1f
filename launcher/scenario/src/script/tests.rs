//! Scripts that are refused, with what is named for it.

use super::*;
use crate::{Override, Problem, Scenario};

const FLIGHT: &str = "[scenario]\nduration_s = 10.0\n";

fn flown(script: &str) -> Scenario {
    Scenario::from_text("x.toml", &format!("{FLIGHT}{script}"), &[]).unwrap()
}

/// Line and key of the one problem, and its message with the remedy.
fn problem(script: &str) -> (usize, String, String) {
    let text = format!("{FLIGHT}{script}");
    let error = Scenario::from_text("x.toml", &text, &[]).and_then(|scenario| {
        scenario.require_candidates()?;
        Ok(scenario)
    });
    let error = error.unwrap_err();
    let problems: Vec<&Problem> = error.problems().collect();
    let [problem] = problems[..] else { panic!("{problems:?}") };
    let message = format!("{problem}: {}", problem.remedy());
    (problem.line().unwrap(), problem.key().to_owned(), message)
}

#[track_caller]
fn assert_refused(script: &str, line: usize, key: &str, expected: &str) {
    let (at, named, message) = problem(script);
    assert_eq!((at, named.as_str()), (line, key), "{message}");
    assert!(message.contains(expected), "{message}");
}

fn swap(rest: &str) -> String {
    format!("[[swap]]\nslot = \"attitude\"\nto = \"attitude-mpc\"\n{rest}\n")
}

#[test]
fn a_swap_needs_slot_controller_and_time_and_the_rest_has_defaults() {
    let scenario = flown(&swap("at_s = 4.2"));
    let [swap] = &scenario.settings().swap[..] else { panic!("one swap") };
    assert_eq!((swap.slot, swap.to.as_str()), (Slot::Attitude, "attitude-mpc"));
    let times = [swap.at_s, swap.shadow_s, swap.rollback_s].map(f64::to_bits);
    assert_eq!(times, [4.2, 1.0, 0.5].map(f64::to_bits));
    assert_eq!((swap.max_bump, swap.force), (None, false));
    assert!(scenario.require_candidates().is_ok());
}

#[test]
fn flags_add_to_what_the_file_holds() {
    let file = format!("{FLIGHT}{}", swap("at_s = 1.0\nshadow_s = 0.5\nrollback_s = 0.25"));
    let flags = [
        Override::swap("position=position-mpc@4.2s").unwrap(),
        Override::swap(
            "attitude=./a=b@c@3s,shadow=500ms,rollback=0s,max-bump=5%,no-rehearsal,force",
        )
        .unwrap(),
        Override::fault("kill:attitude-mpc@2500ms").unwrap(),
        Override::fault("stop:estimator@3s").unwrap(),
    ];
    let scenario = Scenario::from_text("x.toml", &file, &flags).unwrap();
    let text = |s: &SwapSettings| {
        let SwapSettings {
            slot, to, at_s, shadow_s, rollback_s, max_bump, force, rehearse, ..
        } = s;
        let slot = slot.label();
        format!("{slot} {to} {at_s} {shadow_s} {rollback_s} {max_bump:?} {force} {rehearse:?}")
    };
    let swaps: Vec<String> = scenario.settings().swap.iter().map(text).collect();
    assert_eq!(
        swaps,
        [
            "attitude attitude-mpc 1 0.5 0.25 None false None",
            "position position-mpc 4.2 1 0.5 None false None",
            "attitude ./a=b@c 3 0.5 0 Some(0.05) true Some(false)",
        ]
    );
    let faults = scenario.settings().fault.iter();
    let faults: Vec<_> =
        faults.map(|f| (f.kind.label(), f.name.as_str(), f.at_s.to_bits())).collect();
    let (killed, stopped) = (2.5_f64.to_bits(), 3.0_f64.to_bits());
    assert_eq!(faults, [("kill", "attitude-mpc", killed), ("stop", "estimator", stopped)]);
    // The processes of the flight read the same.
    let again = Scenario::from_text("again.toml", scenario.to_toml(), &[]).unwrap();
    assert_eq!(format!("{:?}", scenario.settings()), format!("{:?}", again.settings()));
}

#[test]
fn unknown_slots_controllers_kinds_and_processes_are_refused_at_their_line() {
    let text = swap("at_s = 1.0").replace("\"attitude\"", "\"altitude\"");
    assert_refused(&text, 4, "swap[0].slot", "did you mean `attitude`?");
    let text = swap("at_s = 1.0").replace("attitude-mpc", "attitude-mpq");
    assert_refused(&text, 5, "swap[0].to", "did you mean `attitude-mpc`?");
    let text = swap("at_s = 1.0").replace("attitude-mpc", "position-mpc");
    assert_refused(&text, 5, "swap[0].to", "fills position, not attitude");
    let text = swap("at_s = 1.0").replace("attitude-mpc", "./nowhere/controller");
    assert_refused(&text, 5, "swap[0].to", "cannot be started");
    let fault =
        |kind, name| format!("[[fault]]\nkind = \"{kind}\"\nname = \"{name}\"\nat_s = 1.0\n");
    assert_refused(&fault("maim", "plant"), 4, "fault[0].kind", "`kill`, `stop`");
    assert_refused(&fault("kill", "plent"), 5, "fault[0].name", "did you mean `plant`?");
    assert_refused(&fault("kill", "launcher"), 5, "fault[0].name", "no process");
    assert_refused("swap = 3\n", 3, "scenario.swap", "no such key");
    assert_refused("[swap]\nslot = 3\n", 3, "swap", "[[swap]]");
    assert_refused(
        "[[swap]]\nslot = \"attitude\"\nto = \"x\"\n",
        3,
        "swap[0]",
        "add the missing key",
    );
}

#[test]
fn what_would_happen_after_the_end_is_refused() {
    assert_refused(&swap("at_s = 9.0"), 6, "swap[0].at_s", "flight ends at 10 s");
    assert_refused(&swap("at_s = 0.0"), 6, "swap[0].at_s", "at least");
    flown(&swap("at_s = 9.0\nshadow_s = 0.9"));
    let fault = |at_s| format!("[[fault]]\nkind = \"stop\"\nname = \"plant\"\nat_s = {at_s}\n");
    assert_refused(&fault("10.0"), 6, "fault[0].at_s", "past the end");
    flown(&fault("9.999"));
}

#[test]
fn swaps_of_one_slot_may_not_overlap_and_those_of_two_may() {
    let pair = |second: &str| swap("at_s = 1.0") + &swap(second);
    // Over at 1 s + 1 s + 0.5 s + three periods of 10 ms.
    assert_refused(&pair("at_s = 2.529"), 10, "swap[1].at_s", "busy until 2.530 s");
    flown(&pair("at_s = 2.531"));
    // Whatever the order in the file.
    assert_refused(&(swap("at_s = 2.0") + &swap("at_s = 1.0")), 6, "swap[0].at_s", "at 1 s");
    assert_refused(&pair("at_s = 1.0"), 10, "swap[1].at_s", "busy");
    let other = swap("at_s = 1.0").replace("attitude", "position");
    flown(&(swap("at_s = 1.0") + &other));
}

#[test]
fn a_slot_keeps_one_standby_that_exists_and_joins_in_time() {
    let standby =
        |rest: &str| format!("[[standby]]\nslot = \"attitude\"\nname = \"attitude-pid\"\n{rest}\n");
    let scenario = flown(&standby(""));
    let [one] = &scenario.settings().standby[..] else { panic!("one standby") };
    assert_eq!([one.at_s, one.shadow_s].map(f64::to_bits), [0.1, 0.5].map(f64::to_bits));
    assert_refused(&standby("at_s = 10.0"), 6, "standby[0].at_s", "past the end");
    let two = standby("") + &standby("at_s = 2.0");
    assert_refused(&two, 8, "standby[1].slot", "has a standby already");
    let text = standby("").replace("attitude-pid", "attitude-pit");
    assert_refused(&text, 5, "standby[0].name", "did you mean `attitude-pid`?");
    let flag = Override::standby("position=position-pid@2s,shadow=500ms").unwrap();
    let scenario = Scenario::from_text("x.toml", FLIGHT, &[flag]).unwrap();
    let [one] = &scenario.settings().standby[..] else { panic!("one standby") };
    assert_eq!((one.slot, one.name.as_str()), (Slot::Position, "position-pid"));
    assert_eq!([one.at_s, one.shadow_s].map(f64::to_bits), [2.0, 0.5].map(f64::to_bits));
    let soon = Override::standby("position=position-pid").unwrap();
    assert!(Scenario::from_text("x.toml", FLIGHT, &[soon]).is_ok());
    for bad in ["", "attitude", "attitude=x@soon", "attitude=attitude-pid,force"] {
        let error = Override::standby(bad).unwrap_err();
        let problem = error.problems().next().unwrap();
        assert!(problem.remedy().contains("--standby SLOT=NAME"), "{bad}");
    }
}

#[test]
fn a_flight_without_a_position_loop_swaps_no_position_controller() {
    let rig = "[pilot]\nkind = \"attitude_step\"\n[[swap]]\nslot = \"position\"\nto = \"position-mpc\"\nat_s = 1.0\n";
    let error = Scenario::from_text("x.toml", rig, &[]).unwrap_err();
    assert!(error.problems().any(|p| p.key() == "swap[0].slot"), "{error}");
}

#[test]
fn flags_that_are_no_swap_and_no_fault_are_refused_with_how_to_write_one() {
    for bad in ["", "attitude", "attitude=attitude-mpc", "attitude=attitude-mpc@soon"] {
        let error = Override::swap(bad).unwrap_err();
        let problem = error.problems().next().unwrap();
        assert_eq!((problem.key(), problem.file()), ("--swap", Some("command line")));
        assert!(problem.remedy().contains("--swap SLOT=NAME@TIME"));
    }
    for part in ["shadow=long", "max-bump=-1%", "force=yes", "quietly"] {
        let error = Override::swap(&format!("attitude=attitude-mpc@1s,{part}")).unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
    }
    for bad in ["", "kill", "kill:plant", "kill:plant@", "kill@1s"] {
        let error = Override::fault(bad).unwrap_err();
        assert!(error.problems().next().unwrap().remedy().contains("--fault kill:NAME@TIME"));
    }
    let edit = Override::swap("altitude=attitude-mpc@1s").unwrap();
    let error = Scenario::load("hover", &[edit]).unwrap_err();
    let problem = error.problems().next().unwrap();
    assert_eq!((problem.file(), problem.key()), (Some("command line"), "swap[0].slot"));
}

#[test]
fn a_configuration_that_a_candidate_could_not_read_is_refused_beforehand() {
    let with = |config: &str| swap(&format!("at_s = 2.0\nconfig = {config:?}"));
    assert_refused(&with("/proc"), 7, "swap[0].config", "is not a file");
    assert_refused(&with(file!()), 7, "swap[0].config", "cannot be read");
    assert_refused(&with("/proc/version"), 7, "swap[0].config", "is no scenario");
}
