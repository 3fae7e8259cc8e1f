//! The documents name what the code has, no more and no less.

use observe::{FACTS, Fact};
use scenario::needs::{self, MemoryNeed};
use scenario::services;
use scenario::{Override, Scenario, shipped};
use shared_types::{Edge, Role, TopicInfo, topics};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

const ARCHITECTURE: &str = include_str!("../../ARCHITECTURE.md");
const README: &str = include_str!("../../README.md");
const TOPICS: &str = include_str!("../../launcher/docs/topics.md");
const VERDICT: &str = include_str!("../../launcher/docs/verdict.md");

#[test]
fn the_readme_names_what_a_flight_needs_of_the_machine() {
    let (lockstep, locked) = (MemoryNeed::LOCKSTEP, MemoryNeed::LOCKED);
    let text = README.split_whitespace().collect::<Vec<_>>().join(" ");
    for said in [
        format!("({} MB free, and {} for one in real time", lockstep.shared_mb, locked.shared_mb),
        format!("{} to {} MB of memory beside it", lockstep.own_mb, locked.own_mb),
        format!("{} file descriptors", needs::DESCRIPTORS),
        format!("{} processes and threads", needs::TASKS),
    ] {
        assert!(text.contains(&said), "{said}");
    }
}

/// First cells of the rows of the first table behind a heading, without quotes.
fn first_cells(document: &'static str, heading: &str) -> Vec<&'static str> {
    let (_, section) = document.split_once(heading).expect("the section is there");
    let rows = section.lines().skip_while(|line| !line.starts_with("| `"));
    rows.take_while(|line| line.starts_with("| `"))
        .filter_map(|row| row.split('`').nth(1))
        .collect()
}

fn row(topic: &TopicInfo) -> String {
    let to: Vec<_> = topic.to.iter().map(|role| role.label()).collect();
    let to = if to.is_empty() { "recorder only".to_owned() } else { to.join(", ") };
    let edge = match topic.edge {
        Edge::ZeroLatency => "zero latency",
        Edge::Delayed => "delayed",
        Edge::RecordOnly => "none",
    };
    let TopicInfo { name, from, history, summary, .. } = topic;
    let hashed = if topic.in_flight_hash { "yes" } else { "" };
    let from = from.label();
    format!("| `{name}` | {from} | {to} | {edge} | {history} | {hashed} | {summary} |")
}

#[test]
fn the_table_of_topics_is_the_one_of_the_code() {
    let rows: Vec<_> = topics::all().into_iter().map(row).collect();
    let missing: Vec<_> = rows.iter().filter(|row| !TOPICS.contains(*row)).collect();
    assert!(missing.is_empty(), "topics.md lacks these rows:\n{missing:#?}");
    assert_eq!(first_cells(TOPICS, "# Topics"), topics::all().map(|topic| topic.name));
}

#[test]
fn the_process_table_of_the_architecture_names_every_service_and_its_role() {
    assert_eq!(first_cells(ARCHITECTURE, "## Processes"), services::names().collect::<Vec<_>>());
    for name in services::names() {
        let role = services::role_of(name).map_or("none", Role::label);
        assert!(ARCHITECTURE.contains(&format!("| `{name}` | {role} |")), "{name} fills {role}");
    }
}

#[test]
fn the_page_of_the_verdict_explains_every_limit_that_a_scenario_can_set() {
    let thresholds = Scenario::load("hover", &[]).expect("it ships").thresholds();
    let mut settable = 0;
    for (key, _) in thresholds.iter() {
        let edit = Override::set(&format!("verdict.{key}=1")).expect("a setting");
        if Scenario::load("hover", &[edit]).is_ok() {
            settable += 1;
            assert!(VERDICT.contains(&format!("`{key}`")), "verdict.md lacks {key}");
        }
    }
    assert!(settable > 10, "{settable}");
}

#[test]
fn the_table_of_the_numbers_of_a_flight_is_the_one_of_the_code() {
    let row = |fact: &Fact| {
        let unit = if fact.key.ends_with("_share") { "1" } else { fact.unit.symbol() };
        let check = fact.check.map_or_else(String::new, |key| format!("`{key}`"));
        format!("| `{}` | {} | {unit} | {check} |", fact.key, fact.name)
    };
    let (_, section) = VERDICT.split_once("## The numbers of a flight").expect("there");
    let rows = section.lines().skip_while(|line| !line.starts_with("| `"));
    let rows: Vec<_> = rows.take_while(|line| line.starts_with("| `")).collect();
    assert_eq!(rows, FACTS.iter().map(row).collect::<Vec<_>>());
}

/// Every section and key of a scenario, as the types that read them describe them.
fn scenario_reference() -> String {
    let mut text = "# Scenario reference\n\n\
        Every section of a scenario with its keys, made of the types that read them. `morphquad scenario keys` shows the\n\
        same at a prompt, and `morphquad check SCENARIO --format toml` writes a whole scenario, keys that were left\n\
        out with their defaults.\n"
        .to_owned();
    for section in scenario::keys::sections() {
        let heading = "| key | takes | default | meaning |\n|---|---|---|---|\n";
        // Writing to a string cannot fail.
        let _ = write!(text, "\n## `[{}]`\n\n{}\n\n{heading}", section.name, section.meaning);
        for key in &section.keys {
            let takes = key.takes.replace(" | ", " or ") + &key.range_text();
            let default = key.default_in_toml().map(|value| format!("`{value}`"));
            let required = if key.is_required { "required" } else { "" };
            let default = default.unwrap_or_else(|| required.to_owned());
            let kind = key.kind.map(|kind| format!("Of `{kind}`: ")).unwrap_or_default();
            let meaning = key.meaning.replace('|', "\\|");
            let _ = writeln!(text, "| `{}` | {takes} | {default} | {kind}{meaning} |", key.name);
        }
    }
    text
}

#[test]
fn the_scenario_reference_is_the_one_of_the_code() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("launcher/docs/scenario.md");
    let made = scenario_reference();
    if std::env::var_os("MORPHQUAD_WRITE_DOCS").is_some() {
        fs::write(&path, &made).expect("room");
    }
    let written = fs::read_to_string(&path).unwrap_or_default();
    let differ = written.lines().zip(made.lines()).find(|(written, made)| written != made);
    assert!(!written.is_empty(), "launcher/docs/scenario.md is not there");
    assert!(
        written == made,
        "launcher/docs/scenario.md differs, at {differ:?}: MORPHQUAD_WRITE_DOCS=1 cargo test --release --test sources"
    );
}

#[test]
fn the_readme_names_every_shipped_scenario() {
    for name in shipped::names() {
        assert!(README.contains(&format!("`{name}`")), "{name}");
    }
}

/// Every Rust file below a folder.
pub(super) fn sources(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path());
    let found = entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] });
    found.filter(|path| path.extension().is_some_and(|extension| extension == "rs")).collect()
}

/// The executable of a test in `tests/EXECUTABLE.rs` or `tests/EXECUTABLE/MODULE.rs`, and its name there.
fn path_of_test(source: &Path, name: &str) -> (String, String) {
    let source = source.with_extension("").to_string_lossy().into_owned();
    let (_, inside) = source.rsplit_once("/tests/").expect("integration tests only");
    let (executable, module) = inside.split_once('/').unwrap_or((inside, ""));
    let module = if module.is_empty() { String::new() } else { module.replace('/', "::") + "::" };
    (executable.to_owned(), format!("{module}{name}"))
}

#[test]
fn every_test_that_is_ignored_has_a_reason_and_is_listed_for_the_soak() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mark, reason) = (["#[", "ignore"].concat(), " = \"soak: ");
    let mut ignored = BTreeSet::new();
    for folder in ["benches", "launcher", "services", "shared-types", "tests"] {
        for path in sources(&root.join(folder)) {
            let text = fs::read_to_string(&path).expect("a source");
            for (_, after) in text.match_indices(&mark).map(|(at, _)| text.split_at(at)) {
                let after = &after[mark.len()..];
                assert!(after.starts_with(reason), "{}: {after:.80}", path.display());
                let (_, name) = after.split_once("\nfn ").expect("a function");
                let name = name.split('(').next().expect("a name");
                ignored.insert(path_of_test(&path, name));
            }
        }
    }
    let listed = fs::read_to_string(root.join("tests/soak.toml")).expect("a list");
    let listed: toml::Table = listed.parse().expect("TOML");
    let mut names = BTreeSet::new();
    for test in listed["test"].as_array().expect("tests") {
        let executable = test["executable"].as_str().expect("a name");
        for name in test["names"].as_array().expect("names") {
            let name = name.as_str().expect("a name");
            assert!(names.insert((executable.to_owned(), name.to_owned())), "{name} comes twice");
        }
    }
    assert_eq!(ignored, names);
}

/// The documents at the root and the pages.
fn documents() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = ["", "launcher/docs", "launcher/docs/decisions"].map(|folder| root.join(folder));
    let entries = folders.iter().flat_map(|folder| fs::read_dir(folder).expect("a folder"));
    let paths = entries.flatten().map(|entry| entry.path());
    let documents = paths.filter(|path| path.extension().is_some_and(|kind| kind == "md"));
    documents.map(|path| (path.clone(), fs::read_to_string(path).expect("text"))).collect()
}

/// Of a heading, as the usual viewers of Markdown name it.
fn anchor_of(heading: &str) -> String {
    let kept = |letter: &char| letter.is_alphanumeric() || [' ', '-', '_'].contains(letter);
    let text: String = heading.trim_start_matches('#').trim().chars().filter(kept).collect();
    text.to_lowercase().replace(' ', "-")
}

#[test]
fn every_link_of_a_document_leads_somewhere() {
    let mut links = 0;
    for (document, text) in documents() {
        let folder = document.parent().expect("a folder");
        for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if target.contains("://") {
                continue;
            }
            let (path, anchor) = target.split_once('#').unwrap_or((target, ""));
            let found = if path.is_empty() { document.clone() } else { folder.join(path) };
            assert!(found.exists(), "{} links to {path}", document.display());
            let headings = || fs::read_to_string(&found).expect("text");
            let is_there = anchor.is_empty()
                || headings()
                    .lines()
                    .any(|line| line.starts_with('#') && anchor_of(line) == anchor);
            assert!(is_there, "{} links to {target}", document.display());
            links += 1;
        }
    }
    assert!(links > 20, "{links} links");
}

#[test]
fn every_path_that_a_document_names_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = ["benches/", "launcher/", "services/", "shared-types/", "tests/"];
    let mut named = 0;
    for (document, text) in documents() {
        // Every other piece stands between two marks of code.
        for path in text.split('`').skip(1).step_by(2) {
            // Names in capitals stand for any.
            let is_path = folders.iter().any(|folder| path.starts_with(folder))
                && !path.contains(|letter: char| letter.is_ascii_uppercase() || letter == ' ');
            if is_path {
                named += 1;
                assert!(root.join(path).exists(), "{} names {path}", document.display());
            }
        }
    }
    assert!(named > 20, "{named} paths");
}
