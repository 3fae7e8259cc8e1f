//! Latencies as the executable measures them: structure, arithmetic and refusals, and no duration.

use crate::common::{Place, judged, morphquad};
use serde_json::Value;
use std::process::Output;

const RANKS: [&str; 5] = ["p50_us", "p90_us", "p99_us", "p999_us", "max_us"];

fn bench(arguments: &[&str]) -> Output {
    morphquad(["bench"].iter().chain(arguments)).output().expect("the executable starts")
}

fn result(output: &Output) -> Value {
    let stderr = String::from_utf8_lossy(&output.stderr);
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {stderr}"))
}

/// On a busy machine no loop then falls so far behind that its slot is given to another process, which opens ports in what
/// counts as steady flight.
const SLOWLY: [&str; 2] = ["--set", "scenario.speed=0.2"];

/// A flight in which every loop has run. A busy machine may keep one of them so long that it is started
/// again, which changes the values and not what is reported.
fn flown(arguments: &[&str], code: i32) -> Value {
    let output = bench(&[arguments, &judged(&["realtime"])[..], &["--format", "json"]].concat());
    let stderr = String::from_utf8_lossy(&output.stderr);
    let json = result(&output);
    let report = &json["report"];
    let loops = report["loops"].as_array().expect("loops");
    assert_eq!(loops.len(), 6, "{report}");
    assert!(loops.iter().all(|one| one["counts"]["steps"].as_u64() > Some(0)), "{report}");
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    json
}

/// Something was measured, and its quantiles are in order.
fn assert_measured(distribution: &Value) {
    assert!(distribution["n"].as_u64() > Some(0), "{distribution}");
    let at: Vec<f64> =
        RANKS.iter().map(|rank| distribution[rank].as_f64().expect("a number")).collect();
    assert!(at[0] >= 0.0 && at.is_sorted(), "{distribution}");
}

/// Each ratio is the quantile over that of the floor.
fn assert_ratios(distribution: &Value, floor: &Value, ratios: &Value) {
    for (rank, ratio) in RANKS.iter().zip(["p50", "p90", "p99", "p999", "max"]) {
        let (value, floor) = (distribution[rank].as_f64(), floor[rank].as_f64());
        if let Some(ratio) = ratios[ratio].as_f64() {
            let expected = value.expect("a value") / floor.expect("a floor");
            assert!((ratio / expected - 1.0).abs() < 1e-9, "{ratio} is not {expected}");
        } else {
            assert_eq!(floor, Some(0.0), "{ratios}");
        }
    }
}

#[test]
fn a_hop_is_measured_polled_and_blocking_beside_the_bare_transport() {
    let _place = Place::for_realtime();
    let output = bench(&["hop", "--for", "200ms", "--policy", "other", "--format", "json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report = result(&output);
    let cells = report["cells"].as_array().expect("cells");
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    assert_eq!(cells.len(), if cpus > 1 { 4 } else { 2 }, "{report}");
    for cell in cells {
        let (ports, bare) = (&cell["ports"], &cell["bare"]);
        assert_measured(ports);
        assert_measured(bare);
        assert_eq!(ports["n"], bare["n"], "carriers take turns");
        assert_ratios(ports, bare, &cell["ratio"]);
        assert_eq!(cell["bare_pipe"].is_null(), cell["waiting"] == "polled", "{cell}");
    }
    let no_better_than_nothing = bench(&["hop", "--for", "100ms", "--max-ratio", "0.000001"]);
    assert_eq!(no_better_than_nothing.status.code(), Some(1));
}

/// Each way from sensor to motor adds up, and stands beside its floor.
fn assert_paths(report: &Value, hold_us: f64) {
    let paths = report["paths"].as_array().expect("paths");
    assert_eq!(paths.len(), 2, "{report}");
    for path in paths {
        assert_measured(&path["total"]["flown"]);
        assert_ratios(&path["total"]["flown"], &path["total"]["floor"], &path["total"]["ratio"]);
        let links = path["links"].as_array().expect("links");
        for link in links {
            assert_measured(&link["took"]);
        }
        assert_eq!(path["untraced"], 0, "{path}");
        assert!((path["hold_us"].as_f64().expect("a time") - hold_us).abs() < 1e-9);
        // Nothing is in effect before it is there.
        let median = |total: &Value| total["flown"]["p50_us"].as_f64().expect("a time");
        assert!(median(&path["until_effect"]) >= median(&path["total"]), "{path}");
        // The floor is the sum of its parts.
        let parts = path["floor_parts"].as_array().expect("parts").iter();
        let sum: f64 = parts.map(|part| part["took"]["p50_us"].as_f64().expect("a time")).sum();
        let floor = path["total"]["floor"]["p50_us"].as_f64().expect("a time");
        assert!((sum / floor - 1.0).abs() < 1e-9, "{path}");
    }
}

#[test]
fn with_asap_edges_nothing_holds_a_command_and_a_warm_loop_allocates_nothing() {
    let _place = Place::for_realtime();
    let flight = ["loops", "hover", "--asap", "--for", "1500ms", "--policy", "other"];
    let report = &flown(&[&flight[..], &SLOWLY].concat(), 0)["report"];
    assert_paths(report, 0.0);
    let loops = report["loops"].as_array().expect("loops").iter().filter(|one| has_run(one));
    let mut measured = 0;
    for one in loops {
        measured += 1;
        let cost = &one["cost"];
        assert_eq!(cost["allocations"], 0, "{one}");
        // Of which the transport has one for each sample.
        assert!(cost["transport_allocations"].as_u64() > Some(0), "{one}");
    }
    assert!(measured > 0, "{report}");
    assert!(report["launcher"]["cpu_percent"].as_f64() > Some(0.0), "{report}");
}

/// Whether a loop had steps before its warm-up ended and after it: beside other work it may get no processor for as long.
fn has_run(one: &Value) -> bool {
    let counts = [&one["counts"]["steps"], &one["warm_up_steps"]].map(Value::as_u64);
    let [Some(steps), Some(warm_up)] = counts else { panic!("{one}: {counts:?}") };
    steps > 0 && warm_up > 0
}

#[test]
fn the_loops_and_paths_of_a_flight_are_measured_beside_their_floor() {
    let _place = Place::for_realtime();
    let folder = tempfile::TempDir::new().expect("a folder");
    let saved = folder.path().join("saved.json");
    let saved = saved.to_str().expect("a path");
    let flight = ["loops", "hover", "--for", "2s", "--policy", "other", SLOWLY[0], SLOWLY[1]];
    let json = flown(&[&flight[..], &["--save", saved]].concat(), 0);
    let report = &json["report"];
    let mut measured = 0;
    for one in report["loops"].as_array().expect("loops") {
        let name = &one["name"];
        if !has_run(one) {
            continue;
        }
        measured += 1;
        let figures = one["figures"].as_object().expect("figures");
        for figure in ["lateness", "period", "compute"] {
            assert!(figures.contains_key(figure), "{name}: {figures:?}");
        }
        // The floor of its steps is the same flight in one thread, of which none is left out.
        let alone = &figures["compute"]["floor"]["n"];
        assert_eq!(alone.as_f64(), one["rate_hz"].as_f64().map(|hz| hz * 2.0), "{name}");
        for (figure, values) in figures {
            assert_measured(&values["flown"]);
            if figure != "wait" && figure != "hop" {
                assert_measured(&values["floor"]);
            }
            if !values["floor"].is_null() {
                assert_ratios(&values["flown"], &values["floor"], &values["ratio"]);
            }
        }
        // There is no cost of a flight in which a process was restarted between any two looks at it.
        let cost = &one["cost"];
        assert!(cost.is_null() || cost["rss_mb"].as_f64() > Some(1.0), "{one}");
    }
    assert!(measured > 0, "{report}");
    assert_paths(report, 1000.0);
    let written = std::fs::read_to_string(saved).expect("it was saved");
    let written: Value = serde_json::from_str(&written).expect("it is JSON");
    assert_eq!(&written, report);

    // Another rate.
    let compare = ["--compare", saved];
    let other = bench(&[&flight[..], &["--rate", "attitude=200"], &compare].concat());
    let stderr = String::from_utf8_lossy(&other.stderr);
    assert_eq!(other.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("200 Hz"), "{stderr}");
    let limits = ["--gate", "lateness.max:0us", "--gate", "p99:+100000000%"];
    let judged = flown(&[&flight[..], &compare, &limits].concat(), 1);
    let failed = judged["failed"].as_array().expect("failures");
    assert!(failed.iter().all(|f| f.as_str().is_some_and(|f| f.contains("lateness max"))));
    assert!(!judged["comparison"]["rows"].as_array().expect("rows").is_empty(), "{judged}");
}

#[test]
fn what_cannot_be_measured_is_refused_with_the_reason() {
    for (arguments, code, named) in [
        (&["hop", "--cpus", "999"][..], 2, "999"),
        (&["hop", "--cpus", "zero"], 2, "zero"),
        (&["hop", "--priority", "0"], 2, "--priority"),
        (&["hop", "--for", "soon"], 2, "soon"),
        (&["loops", "hoover"], 2, "hoover"),
        (&["loops", "hover", "--rate", "rotor=5"], 2, "rotor"),
        (&["loops", "hover", "--cpus", "999"], 2, "999"),
        (&["loops", "hover", "--gate", "p99:+10%"], 2, "--compare"),
        (&["loops", "hover", "--gate", "p77:+10%"], 2, "p77"),
        (&["loops", "hover", "--compare", "nowhere.json"], 2, "nowhere.json"),
        (&["loops", "hover", "--compare", "Cargo.toml"], 2, "Cargo.toml"),
    ] {
        let output = bench(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
        assert!(stderr.contains(named) && output.stdout.is_empty(), "{arguments:?}: {stderr}");
    }
}
