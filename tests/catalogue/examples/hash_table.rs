//! Swaps each entry of the catalogue into the same flight several times in processes and once in one process, and compares
//! the hashes: whatever a candidate does, if it follows from its inputs, so does the flight.
//!
//! `hash_table [attitude|position] [FLIGHTS] [ENTRY...]`: 5 flights in processes by default. Each `ENTRY` selects the
//! entries with this text in their names. Run it after `cargo build --release --workspace --examples --bins`. It ends
//! with 1 if an entry has two hashes, was not flown, or is not there.
#![expect(clippy::print_stdout, reason = "its table is for people")]

use catalogue::swapped::config_of;
use catalogue::{Entry, entries, patient_entries};
use serde_json::Value;
use shared_types::Slot;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Long enough for faults that begin after rehearsal and rollback window.
const DURATION: &str = "9s";

/// What is compared: the hash of the flight, none if it was not flown, and how its swap ended.
type Outcome = (Option<String>, String);

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let flights: usize = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(5);
    let only = arguments.iter().find_map(|argument| Slot::named(argument));
    let is_name =
        |argument: &&String| argument.parse::<u64>().is_err() && Slot::named(argument).is_none();
    let named: Vec<&String> = arguments.iter().filter(is_name).collect();
    let slots = Slot::ALL.into_iter().filter(|slot| only.is_none_or(|only| only == *slot));
    let all = slots.flat_map(|slot| {
        let every = entries(slot).into_iter().chain(patient_entries(slot));
        every.map(move |entry| (slot, entry))
    });
    let is_wanted = |(_, entry): &(Slot, Entry)| {
        named.is_empty() || named.iter().any(|part| entry.name().contains(part.as_str()))
    };
    let all: Vec<(Slot, Entry)> = all.filter(is_wanted).collect();
    let (next, differing) = (AtomicUsize::new(0), Mutex::new(0));
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some((slot, entry)) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let found = outcomes(*slot, entry, flights);
                    let name = format!("{} {}", slot.label(), entry.name());
                    let mut differing = differing.lock().expect("no panic");
                    let result = match found.first() {
                        Some((Some(hash), ended)) if found.len() == 1 => format!("{ended}, {hash}"),
                        _ => {
                            *differing += 1;
                            format!("DIFFERS: {found:?}")
                        }
                    };
                    println!("{name}: {result}");
                }
            });
        }
    });
    let differing = differing.into_inner().expect("no panic");
    println!(
        "{} entries, {flights} times in processes and once in one: {differing} with more than one hash",
        all.len()
    );
    ExitCode::from(u8::from(differing > 0 || all.is_empty()))
}

/// The different outcomes of the flights of one entry.
fn outcomes(slot: Slot, entry: &Entry, flights: usize) -> BTreeSet<Outcome> {
    let folder = tempfile::TempDir::new().expect("a folder");
    let config = folder.path().join("entry.toml");
    std::fs::write(&config, config_of(entry)).expect("a file");
    let hows = (0..flights).map(|_| None).chain([Some("--in-process")]);
    hows.map(|how| fly(slot, &config, how)).collect()
}

fn fly(slot: Slot, config: &Path, how: Option<&str>) -> Outcome {
    let built = built();
    let swap = format!(
        "{}={}@1.5s,shadow=1s,config={}",
        slot.label(),
        built.join("catalogue").display(),
        config.display()
    );
    let flags = ["run", "figure8-morph", "--for", DURATION, "--no-record", "--format", "json"];
    // A busy machine must not decide about a flight in lockstep.
    let limits = ["stall_timeout_s", "startup_timeout_s"].map(|key| format!("launcher.{key}=600"));
    let limits = limits.iter().map(String::as_str).chain(["rehearsal.wall_max_s=600"]);
    let output = Command::new(built.join("morphquad"))
        .args(flags)
        .args(["--swap", &swap])
        .args(limits.flat_map(|limit| ["--set", limit]))
        .args(how)
        .output()
        .expect("the executable of this build");
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    let text = |value: &Value| value.as_str().map(str::to_owned);
    (text(&summary["hash"]), text(&summary["swaps"][0]["ended"]).unwrap_or_default())
}

/// The folder with the executables of this build.
fn built() -> PathBuf {
    let own = std::env::current_exe().expect("the own executable");
    own.parent().and_then(Path::parent).expect("a target folder").to_owned()
}
