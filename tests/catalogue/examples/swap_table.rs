//! The catalogue swapped into flights: with everything that guards a swap, with the watch alone, and with
//! nothing, judged by the truth beside the same flight without a swap.
//!
//! `swap_table [attitude|position] [all|watch|none] [good] [SEEDS] [ENTRY]`; `good` flies the shipped
//! controllers in place of each other. Run it after `cargo build --release -p catalogue`.
#![expect(clippy::print_stdout, reason = "its table is for people")]

use catalogue::swapped::{Guard, Plain, SITUATIONS, Situation, Swapped, config_of, plain, swapped};
use catalogue::{Entry, entries};
use launcher::candidate::Slot;
use launcher::components::names_for;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One flight to be flown.
struct Case {
    situation: &'static Situation,
    seed: u64,
    slot: Slot,
    /// Entry of the catalogue, or name of a shipped controller.
    what: Result<Entry, &'static str>,
    guard: Guard,
}

#[derive(Default)]
struct Row {
    flights: u32,
    lost: u32,
    flipped: u32,
    tripped: u32,
    excursion_m: f64,
    tilt_deg: f64,
}

/// By slot and entry, then by guard.
type Rows = BTreeMap<(&'static str, String), BTreeMap<&'static str, Row>>;

fn executable() -> PathBuf {
    let own = std::env::current_exe().expect("the own executable");
    own.parent().and_then(|examples| examples.parent()).expect("a target folder").join("catalogue")
}

#[expect(clippy::too_many_lines, reason = "what is flown, in one piece")]
fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let has = |word: &str| words.iter().any(|given| given == word);
    let only = words.iter().find_map(|word| Slot::named(word));
    let seeds: u64 = words.iter().find_map(|word| word.parse().ok()).unwrap_or(1);
    let named: Vec<&String> = words
        .iter()
        .filter(|w| {
            w.parse::<u64>().is_err()
                && Slot::named(w).is_none()
                && !["all", "watch", "none", "good"].contains(&w.as_str())
        })
        .collect();
    let chosen = ["all", "watch", "none"].iter().any(|word| has(word));
    let guards = [(Guard::All, "all"), (Guard::Watch, "watch"), (Guard::None, "none")];
    let guards = guards.into_iter().filter(|(_, word)| !chosen || has(word));
    let guards: Vec<Guard> = guards.map(|(guard, _)| guard).collect();
    let mut cases = Vec::new();
    for slot in Slot::ALL.into_iter().filter(|slot| only.is_none_or(|only| only == *slot)) {
        for situation in &SITUATIONS {
            for seed in 1..=seeds {
                let whats: Vec<Result<Entry, &'static str>> = if has("good") {
                    names_for(slot.role()).map(Err).collect()
                } else {
                    entries(slot).into_iter().map(Ok).collect()
                };
                for what in whats {
                    let name = what.as_ref().map_or_else(|name| (*name).to_owned(), Entry::name);
                    if !named.is_empty() && !named.iter().any(|word| name.contains(word.as_str())) {
                        continue;
                    }
                    for &guard in &guards {
                        if what.is_err() && guard != Guard::All {
                            continue;
                        }
                        cases.push(Case { situation, seed, slot, what: what.clone(), guard });
                    }
                }
            }
        }
    }
    let next = AtomicUsize::new(0);
    let rows: Mutex<Rows> = Mutex::default();
    let plains: Mutex<BTreeMap<(&str, u64), std::sync::Arc<Plain>>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let key = (case.situation.name, case.seed);
                    let known = plains.lock().expect("no panic").get(&key).cloned();
                    let unswapped = known.unwrap_or_else(|| {
                        let made = plain(case.situation, case.seed).expect("a flight");
                        let made = std::sync::Arc::new(made);
                        plains.lock().expect("no panic").insert(key, made.clone());
                        made
                    });
                    let flown = fly(case, &unswapped);
                    let mut rows = rows.lock().expect("no panic");
                    note(case, &flown, &mut rows);
                }
            });
        }
    });
    print(&rows.into_inner().expect("no panic"));
}

fn fly(case: &Case, unswapped: &Plain) -> Swapped {
    let Case { situation, seed, slot, what, guard } = case;
    let folder = tempfile::TempDir::new().expect("a folder");
    let flown = match what {
        Ok(entry) => {
            let config = folder.path().join("entry.toml");
            std::fs::write(&config, config_of(entry)).expect("a file");
            let to = executable().display().to_string();
            swapped((situation, *seed), *slot, (&to, Some(&config)), *guard, unswapped)
        }
        Err(name) => swapped((situation, *seed), *slot, (name, None), *guard, unswapped),
    };
    flown.unwrap_or_else(|error| Swapped {
        lost: Some(format!("not flown: {error}")),
        excursion_m: f64::INFINITY,
        tilt_deg: f64::INFINITY,
        flipped: false,
        tripped_s: None,
        outcome: String::new(),
    })
}

fn note(case: &Case, flown: &Swapped, rows: &mut Rows) {
    let name = case.what.as_ref().map_or_else(|name| format!("good {name}"), Entry::name);
    let row = rows.entry((case.slot.label(), name.clone())).or_default();
    let row = row.entry(case.guard.name()).or_default();
    row.flights += 1;
    row.lost += u32::from(flown.lost.is_some());
    row.flipped += u32::from(flown.flipped);
    row.tripped += u32::from(flown.tripped_s.is_some());
    row.excursion_m = row.excursion_m.max(flown.excursion_m);
    row.tilt_deg = row.tilt_deg.max(flown.tilt_deg);
    let told = case.guard != Guard::None
        && (flown.lost.is_some()
            || flown.excursion_m > 0.5
            || case.what.is_err() && !flown.flipped);
    if told {
        println!(
            "{} {name} {} seed {} {}: {}, {:.2} m, {:.0} deg, trip {:?}; {}",
            case.slot.label(),
            case.situation.name,
            case.seed,
            case.guard.name(),
            flown.lost.as_deref().unwrap_or("kept"),
            flown.excursion_m,
            flown.tilt_deg,
            flown.tripped_s,
            flown.outcome
        );
    }
}

fn print(rows: &Rows) {
    println!(
        "{:<9} {:<32} {:<12} {:>7} {:>5} {:>7} {:>7} {:>8} {:>6}",
        "slot", "controller", "guard", "flights", "lost", "flipped", "tripped", "at most", "tilt"
    );
    let mut sums: BTreeMap<&str, (u32, u32)> = BTreeMap::new();
    for ((slot, name), guards) in rows {
        for (guard, row) in guards {
            println!(
                "{slot:<9} {name:<32} {guard:<12} {:>7} {:>5} {:>7} {:>7} {:>6.2} m {:>4.0} d",
                row.flights, row.lost, row.flipped, row.tripped, row.excursion_m, row.tilt_deg
            );
            let sum = sums.entry(guard).or_default();
            *sum = (sum.0 + row.flights, sum.1 + row.lost);
        }
    }
    for (guard, (flights, lost)) in sums {
        // Clopper and Pearson's upper limit where none is lost, the normal one else.
        let (n, p) = (f64::from(flights), f64::from(lost) / f64::from(flights));
        let upper = if lost == 0 { 3.0 / n } else { p + 1.645 * (p * (1.0 - p) / n).sqrt() };
        println!("{guard}: {lost} of {flights} lost, at most {:.2} % at 95 %", 100.0 * upper);
    }
}
