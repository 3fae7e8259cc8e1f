//! Gates and comparisons against results made up for it.

use super::*;
use crate::facts::BenchFacts;
use crate::place::{Place, Policy};
use crate::report::{Counts, FloorReport, LoopReport};
use crate::series::{Quantiles, Series};
use std::collections::BTreeMap;

fn quantiles(us: u64) -> Quantiles {
    [us * 1000; 10].into_iter().collect::<Series>().quantiles().unwrap()
}

/// One loop with this lateness over a floor of 10 us.
fn report(lateness_us: u64) -> LoopsReport {
    let lateness = Figure::new(quantiles(lateness_us), Some(quantiles(10)), None);
    LoopsReport {
        format: FORMAT.to_owned(),
        format_version: FORMAT_VERSION,
        terms: Terms {
            facts: BenchFacts::read(),
            scenario: "hover".to_owned(),
            scenario_hash: "00".to_owned(),
            rates_hz: BTreeMap::from([("plant".to_owned(), 1000.0)]),
            place: Place { policy: Policy::Fifo, priority: 10, cpus: vec![0, 1], fell_back: None },
            load: "none".to_owned(),
        },
        duration_s: 2.0,
        warm_up_s: 0.5,
        loops: vec![LoopReport {
            name: "plant".to_owned(),
            role: "plant".to_owned(),
            seat: 0,
            timed: true,
            rate_hz: 1000.0,
            achieved_hz: Some(1000.0),
            holds: true,
            warm_up_steps: 500,
            figures: BTreeMap::from([("lateness".to_owned(), lateness)]),
            counts: Counts { steps: 1500, ..Counts::default() },
            cost: None,
        }],
        launcher: None,
        paths: Vec::new(),
        floor: FloorReport { timers: Vec::new(), pings: Vec::new(), steal_percent: 0.0 },
        notices: Vec::new(),
    }
}

fn judged(gate: &str, now: &LoopsReport, before: Option<&LoopsReport>) -> usize {
    Gate::parse(gate).unwrap().judge(now, before).len()
}

#[test]
fn growth_is_judged_against_the_earlier_result_and_clock_ticks_are_not() {
    let (before, now) = (report(100), report(120));
    assert_eq!(judged("p99:+10%", &now, Some(&before)), 1);
    assert_eq!(judged("lateness.p50:+10%", &now, Some(&before)), 1);
    assert_eq!(judged("compute.p99:+10%", &now, Some(&before)), 1, "neither has it");
    assert_eq!(judged("p99:+25%", &now, Some(&before)), 0);
    assert_eq!(judged("p99:+10%", &before, Some(&now)), 0);
    // Twice as long, and less than a microsecond more.
    let short = |ns: u64| {
        let mut report = report(1);
        let figure =
            Figure::new([ns].into_iter().collect::<Series>().quantiles().unwrap(), None, None);
        report.loops[0].figures.insert("lateness".to_owned(), figure);
        report
    };
    assert_eq!(judged("p99:+10%", &short(600), Some(&short(300))), 0);
}

#[test]
fn limits_in_time_and_over_the_floor_need_no_earlier_result() {
    let now = report(15);
    for (gate, failures) in [
        ("lateness.max:14us", 1),
        ("p50:0.02ms", 0),
        ("lateness.p99:1.2x", 1),
        ("p99:1.6x", 0),
        ("held", 0),
    ] {
        let parsed = Gate::parse(gate).unwrap();
        assert!(!parsed.needs_earlier());
        assert_eq!(parsed.judge(&now, None).len(), failures, "{gate}");
    }
    let mut overtaxed = report(15);
    overtaxed.loops[0].holds = false;
    assert_eq!(judged("held", &overtaxed, None), 1);
}

#[test]
fn what_was_not_measured_passes_no_gate() {
    let before = report(10);
    let mut still = report(10);
    still.loops[0].counts = Counts { skipped: 1500, ..Counts::default() };
    still.loops[0].figures.clear();
    still.loops[0].holds = false;
    let failed = |gate| Gate::parse(gate).unwrap().judge(&still, Some(&before));
    let ran_none = "plant ran no step after the warm-up";
    assert_eq!(failed("p99:+10%"), [ran_none, "plant lateness was not measured"]);
    assert_eq!(failed("lateness.p99:9ms"), [ran_none, "no lateness was measured"]);
    assert_eq!(failed("p99:2x"), [ran_none, "no figure was measured beside a floor"]);
    assert_eq!(failed("held"), ["plant misses 100.00 % of its releases at 1000 Hz"]);
    assert_eq!(judged("path.p99:1x", &before, None), 1, "no path was found");
}

#[test]
fn a_limit_over_the_floor_fails_where_there_is_no_floor() {
    let mut bare = report(10);
    let of = |gate: &str, report: &LoopsReport| Gate::parse(gate).unwrap().judge(report, None);
    let wait = Figure::new(quantiles(10), None, None);
    bare.loops[0].figures.insert("wait".to_owned(), wait);
    assert_eq!(of("wait.p99:9x", &bare), ["plant wait has no floor"]);
    assert!(of("lateness.p99:9x", &bare).is_empty());
    // Of all figures those count that have one.
    assert!(of("p99:9x", &bare).is_empty());
    bare.loops[0].figures.remove("lateness");
    assert_eq!(of("p99:9x", &bare), ["no figure was measured beside a floor"]);
}

#[test]
fn what_is_no_gate_is_refused_with_the_form() {
    for bad in [
        "",
        "p99",
        "p98:+1%",
        "p99:10%",
        "p99:+x%",
        "p99:-1us",
        "speed.p99:1x",
        "p99:NaNus",
        "p99:",
    ] {
        let error = Gate::parse(bad).unwrap_err();
        assert!(error.contains("for example"), "{bad}: {error}");
    }
}

#[test]
fn every_difference_that_matters_is_named() {
    type Change = fn(&mut Terms);
    let changes: [(&str, Change); 9] = [
        ("machine", |r| r.facts.machine = "other".to_owned()),
        ("kernel", |r| r.facts.kernel = "6.0".to_owned()),
        ("version", |r| r.facts.version = "0.0.1".to_owned()),
        ("fifo 20", |r| r.place.priority = 20),
        ("processors 0", |r| r.place.cpus = vec![0]),
        ("load", |r| r.load = "cpu".to_owned()),
        ("500 Hz", |r| *r.rates_hz.entry("plant".to_owned()).or_default() = 500.0),
        ("scenario is", |r| r.scenario = "disturbance".to_owned()),
        ("settings", |r| r.scenario_hash = "01".to_owned()),
    ];
    let now = report(10);
    let path = Path::new("before.json");
    let same = |before: &LoopsReport| now.terms.require_same(before, path);
    assert!(same(&report(20)).is_ok());
    let comparison = compare(&now, &report(20));
    let halved = |row: &CompareRow| row.ratio.is_some_and(|ratio| (ratio - 0.5).abs() < 1e-3);
    assert!(comparison.rows.len() == 2 && comparison.rows.iter().all(halved), "{comparison:?}");
    for (named, change) in changes {
        let mut before = report(20);
        change(&mut before.terms);
        let error = same(&before).unwrap_err().to_string();
        assert!(error.contains("before.json") && error.contains(named), "{named}: {error}");
    }
    let mut before = report(20);
    before.terms.facts.git = "another commit".to_owned();
    assert!(same(&before).is_ok(), "what a comparison is for");
}

#[test]
fn a_file_is_read_back_and_one_that_was_tampered_with_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("saved.json");
    let saved = serde_json::to_string(&report(15)).unwrap();
    fs::write(&path, &saved).unwrap();
    assert_eq!(read(&path).unwrap(), report(15));
    let half = saved[..saved.len() / 2].to_owned();
    let version = |number: u32| format!("\"format_version\":{number}");
    let tampered = [
        half,
        String::new(),
        "[1]".to_owned(),
        saved.replace(FORMAT, "another program"),
        saved.replace(&version(FORMAT_VERSION), &version(FORMAT_VERSION - 1)),
        saved.replace("\"p50_us\":15.", "\"p50_us\":99."),
        saved.replace("\"p50\":1.", "\"p50\":0."),
        saved.replace("\"load\":\"none\"", "\"load\":\"none\",\"surplus\":1"),
    ];
    for text in tampered {
        assert_ne!(text, saved);
        fs::write(&path, &text).unwrap();
        let error = read(&path).unwrap_err();
        assert!(matches!(error, CompareError::Foreign { .. }), "{text}: {error}");
    }
    let missing = read(&folder.path().join("none.json")).unwrap_err();
    assert!(matches!(missing, CompareError::Read { .. }));
}
