//! Only tests of the soak decide by the clock.

use super::docs::sources;
use std::fs;
use std::path::Path;

/// What reads a clock or pauses.
const CLOCKS: [&str; 6] = [
    "mono_now_ns",
    "sleep_until",
    "Instant::now",
    "SystemTime",
    "thread::sleep",
    "std::time::Instant",
];
/// Of the module that may do so, what only the soak may call.
const FOR_THE_SOAK: [&str; 2] = ["pause_ms(", "host_s("];
/// Files that may: the module itself, this one, processes that misbehave, what stamps the samples that it offers
/// a recorder, and what runs the soak.
const EXEMPT: [&str; 6] = [
    "common/time.rs",
    "sources/time.rs",
    "common/rogue/",
    "catalogue/src/spoiled.rs",
    "burst/",
    "soak/src/",
];
/// Functions that tests of the soak alone call.
const HELPERS: [&str; 2] = ["stopped_fourteen_times", "fly_orders"];

/// What a test of the soak is marked with, written so that this file has no such test.
fn soak_mark() -> String {
    ["#[", "ignore = \"soak: "].concat()
}

/// Name of the function around each place in which a text has `word`, with the attributes before it.
fn functions_with<'a>(text: &'a str, word: &str) -> Vec<(&'a str, &'a str)> {
    let functions: Vec<usize> = text.match_indices("fn ").map(|(at, _)| at).collect();
    let around = text.match_indices(word).filter_map(|(at, _)| {
        let begin = *functions.iter().rev().find(|begin| {
            // Of a function in a file: at the beginning of a line, whatever its visibility.
            let line = text[..**begin].rsplit('\n').next().unwrap_or("");
            **begin < at && (line.is_empty() || line.starts_with("pub"))
        })?;
        let name = text[begin + 3..].split(['(', '<']).next()?;
        let before = text[..begin].rsplit("\n}").next()?;
        Some((name, before))
    });
    around.collect()
}

#[test]
fn only_tests_of_the_soak_pause_or_read_the_clock() {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let mut paused = 0;
    for path in sources(&tests) {
        let name = path.strip_prefix(&tests).expect("inside").to_string_lossy().into_owned();
        if EXEMPT.iter().any(|exempt| name.starts_with(exempt)) {
            continue;
        }
        let text = fs::read_to_string(&path).expect("text");
        for clock in CLOCKS {
            assert!(!text.contains(clock), "{name}: {clock} belongs into tests/common/time.rs");
        }
        for word in FOR_THE_SOAK {
            for (function, attributes) in functions_with(&text, word) {
                let is_soak = attributes.contains(&soak_mark());
                assert!(is_soak || HELPERS.contains(&function), "{name}: {function} calls {word})");
                paused += 1;
            }
        }
    }
    assert!(paused > 3, "{paused} places");
}

#[test]
fn a_pause_is_found_with_the_test_around_it() {
    let soak = soak_mark();
    let text = format!(
        "#[test]\nfn one() {{\n    pause_ms(3);\n}}\n\n#[test]\n{soak}it\"]\nfn two() {{\n    pause_ms(4);\n}}\n"
    );
    let found = functions_with(&text, "pause_ms(");
    let of = |index: usize| (found[index].0, found[index].1.contains(&soak));
    assert_eq!((of(0), of(1)), (("one", false), ("two", true)));
}
