//! The description of a key is what the parser does with it.

use super::{Key, sections};
use crate::{Override, Scenario};
use serde_json::Value;
use std::collections::BTreeSet;

/// A scenario in which keys of `kind` have a place.
fn base(key: &Key) -> String {
    let kind = key.name.starts_with("pilot.").then(|| key.kind.unwrap_or("hover"));
    kind.map_or(String::new(), |kind| {
        let rows = if kind == "trajectory" { "\nsamples = [[0.0, 0.0, 0.0, 1.5]]" } else { "" };
        let points = "\npoints = [{ t_s = 0.0, position_w_m = [0.0, 0.0, 1.5] }]";
        let points = if kind == "waypoints" { points } else { "" };
        format!("[pilot]\nkind = \"{kind}\"{rows}{points}\n")
    })
}

fn loaded(key: &Key, value: &str) -> Result<Scenario, String> {
    let edit = Override::set(&format!("{}={value}", key.name)).unwrap();
    Scenario::from_text("test.toml", &base(key), &[edit]).map_err(|error| format!("{error:?}"))
}

fn keys() -> impl Iterator<Item = Key> {
    sections().into_iter().flat_map(|section| section.keys)
}

/// Keys that one edit can reach.
fn settable() -> impl Iterator<Item = Key> {
    keys().filter(|key| !key.name.contains("[]"))
}

#[test]
fn every_section_that_the_parser_knows_has_keys_and_a_meaning() {
    let listed: Vec<&str> = sections().iter().map(|section| section.name).collect();
    let mut known = crate::settings::SECTIONS.to_vec();
    known.sort_unstable();
    assert_eq!(listed, known);
    for section in sections() {
        assert!(!section.keys.is_empty() && !section.meaning.is_empty(), "{}", section.name);
        for key in &section.keys {
            assert!(!key.meaning.is_empty() && key.takes != "value", "{key:?}");
        }
    }
}

#[test]
fn every_kind_that_the_parser_knows_has_keys() {
    for (list, known) in [
        ("pilot.", &::pilot::settings::KINDS[..]),
        ("disturbance_injector.script[].", crate::typed::EVENT_KINDS),
    ] {
        let of_kinds: Vec<Key> =
            keys().filter(|key| key.name.starts_with(list) && key.kind.is_some()).collect();
        let listed: BTreeSet<&str> = of_kinds.iter().filter_map(|key| key.kind).collect();
        assert_eq!(listed, known.iter().copied().collect());
    }
}

#[test]
fn every_documented_default_is_the_one_that_counts() {
    let mut tried = 0;
    for key in settable() {
        // A trajectory needs one of its two kinds of rows.
        let Some(default) = key.default.as_ref().filter(|_| key.name != "pilot.samples") else {
            continue;
        };
        // JSON and TOML write these alike.
        let set =
            loaded(&key, &default.to_string()).unwrap_or_else(|error| panic!("{key:?}: {error}"));
        let is_same = |edits: &[Override]| {
            let unset = Scenario::from_text("test.toml", &base(&key), edits).unwrap();
            format!("{:?}", set.settings()) == format!("{:?}", unset.settings())
        };
        // Of a table that may be missing as a whole the defaults count once it is there.
        let (table, _) = key.name.rsplit_once('.').expect("a dotted key");
        let with_table = || is_same(&[Override::set(&format!("{table}={{}}")).unwrap()]);
        assert!(is_same(&[]) || with_table(), "{key:?}");
        tried += 1;
    }
    assert!(tried > 150, "{tried}");
}

#[test]
fn every_documented_range_is_the_one_that_is_kept() {
    let mut tried = 0;
    for key in settable().filter(|key| ["number", "whole number"].contains(&key.takes.as_str())) {
        let whole = key.takes == "whole number";
        let [least, most] = key.range;
        let least = least.filter(|least| !whole || *least >= 1.0).map(|least| least - 1.0);
        let most = most.filter(|most| *most < 1e9).map(|most| most + 1.0);
        for beyond in [least, most].into_iter().flatten() {
            let value = if whole { format!("{beyond:.0}") } else { format!("{beyond:?}") };
            let error = loaded(&key, &value).expect_err(&format!("{key:?} {value}"));
            assert!(error.contains(&key.name), "{key:?}: {error}");
            tried += 1;
        }
    }
    assert!(tried > 200, "{tried}");
}

#[test]
fn a_number_without_a_documented_range_has_none() {
    for key in settable().filter(|key| key.takes == "number" && key.range == [None, None]) {
        let error = loaded(&key, "1e300").err().unwrap_or_default();
        assert!(!error.contains(&format!("key: \"{}\"", key.name)), "{key:?}: {error}");
    }
}

#[test]
fn every_documented_value_is_known_and_no_other() {
    for key in settable().filter(|key| key.takes.contains(" | ") && key.name != "pilot.kind") {
        for word in key.takes.split(" | ") {
            let value = if ["true", "false"].contains(&word) {
                word.to_owned()
            } else {
                format!("{word:?}")
            };
            // A word may not suit the rest, but it is one.
            let error = loaded(&key, &value).err().unwrap_or_default();
            assert!(!error.contains("none of the known words"), "{key:?} {word}: {error}");
        }
        let error = loaded(&key, "\"nonsense\"").expect_err("a word that there is not");
        assert!(error.contains(&key.name), "{key:?}: {error}");
    }
}

#[test]
fn a_key_has_its_form_its_unit_and_the_place_where_it_stands() {
    let find = |name: &str, kind: Option<&str>| {
        keys().find(|key| key.name == name && key.kind == kind).unwrap_or_else(|| panic!("{name}"))
    };
    let rate = find("plant.rate_hz", None);
    assert_eq!((rate.takes.as_str(), rate.range), ("number", [Some(1.0), Some(10_000.0)]));
    assert_eq!(rate.default, Some(Value::from(1000.0)));
    assert!(rate.meaning.starts_with("Loop rate [Hz]."), "{}", rate.meaning);
    let gate = find("plant.gate.hold_max_s", None);
    assert_eq!(gate.range, [Some(0.0), Some(1.0)]);
    let place = find("start.position_w_m", None);
    assert_eq!(
        (place.takes.as_str(), place.range),
        ("[number; 3]", [Some(-10_000.0), Some(10_000.0)])
    );
    let clock = find("scenario.clock", None);
    assert_eq!(
        (clock.takes.as_str(), clock.default),
        ("lockstep | realtime", Some("lockstep".into()))
    );
    assert_eq!(find("pilot.period_s", Some("figure8")).default, Some(Value::from(8.0)));
    assert!(find("pilot.points[].t_s", Some("waypoints")).is_required);
    assert!(find("disturbance_injector.script[].mean_w_m_s", Some("wind")).takes.starts_with('['));
    assert!(find("swap[].at_s", None).is_required);
}
