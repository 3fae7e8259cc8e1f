//! Swaps every shipped controller in place of every other, itself included, at instants all along `figure8-morph`, and
//! counts how many may fly.
//!
//! `instants [attitude|position] [INSTANTS] [SEEDS]`: 80 instants and 3 seeds, a quarter of a second from one to the next,
//! if nothing is given.
#![expect(clippy::print_stdout, reason = "its table is for people")]

use catalogue::swapped::{Plain, SITUATIONS, Situation, Swapped, plain, swapped_at};
use scenario::Override;
use scenario::services::names_for;
use shared_types::Slot;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The first instant, after the start \[s\].
const FIRST_S: f64 = 1.0;
/// Time over which the instants are spread \[s\].
const SPAN_S: f64 = 20.0;
/// Duration of a flight \[s\]: the last candidate has its shadow phase and its rollback window.
const FLIGHT_S: f64 = 26.0;

/// A slot, its owner and the candidate.
type Pair = (Slot, &'static str, &'static str);

/// What came of the swaps of one group.
#[derive(Default)]
struct Tally {
    swaps: u32,
    flipped: u32,
    tripped: u32,
    excursion_m: f64,
}

impl Tally {
    fn count(&mut self, flown: &Swapped) {
        self.swaps += 1;
        self.flipped += u32::from(flown.flipped);
        self.tripped += u32::from(flown.tripped_s.is_some());
        self.excursion_m = self.excursion_m.max(flown.excursion_m);
    }

    fn print(&self, name: &str) {
        let Self { swaps, flipped, tripped, excursion_m } = self;
        let share = 100.0 * f64::from(*flipped) / f64::from((*swaps).max(1));
        println!(
            "{name}: {flipped} of {swaps} may fly ({share:.1} %), {tripped} trips, at most {excursion_m:.2} m"
        );
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let only = arguments.iter().find_map(|argument| Slot::named(argument));
    let mut numbers = arguments.iter().filter_map(|argument| argument.parse::<u32>().ok());
    let instants = numbers.next().unwrap_or(80).max(1);
    let seeds = u64::from(numbers.next().unwrap_or(3));
    let situation = SITUATIONS.iter().find(|it| it.name == "figure8").expect("it is one of them");

    let slots = Slot::ALL.into_iter().filter(|slot| only.is_none_or(|only| only == *slot));
    let pairs: Vec<Pair> = slots
        .flat_map(|slot| {
            let names = move || names_for(slot.role());
            names().flat_map(move |owner| names().map(move |to| (slot, owner, to)))
        })
        .collect();
    let (mut by_pair, mut by_instant) = (BTreeMap::new(), BTreeMap::new());
    for pair in pairs {
        for seed in 1..=seeds {
            let flown = along(situation, seed, pair, instants);
            for (join_s, flown) in &flown {
                let instant = format!("at {join_s:5.2} s");
                by_instant.entry(instant).or_insert_with(Tally::default).count(flown);
                let name = format!("{} {} for {}", pair.0.label(), pair.2, pair.1);
                by_pair.entry(name.clone()).or_insert_with(Tally::default).count(flown);
                if !flown.flipped || flown.tripped_s.is_some() {
                    println!("{name}, seed {seed}, at {join_s:.2} s: {}", flown.outcome);
                }
            }
        }
    }
    let mut all = Tally::default();
    for (name, tally) in &by_pair {
        tally.print(name);
        all.swaps += tally.swaps;
        all.flipped += tally.flipped;
        all.tripped += tally.tripped;
        all.excursion_m = all.excursion_m.max(tally.excursion_m);
    }
    for (name, tally) in by_instant.iter().filter(|(_, it)| it.flipped < it.swaps) {
        tally.print(name);
    }
    all.print("all");
}

/// Flies one pair with one seed at each instant, on all processors.
fn along(
    situation: &Situation,
    seed: u64,
    (slot, owner, to): Pair,
    instants: u32,
) -> Vec<(f64, Swapped)> {
    let longer = [Override::set(&format!("scenario.duration_s={FLIGHT_S:?}")).expect("a setting")];
    let unswapped: Plain =
        plain(situation, seed, Some((slot, owner)), &longer).expect("a flight without a swap");
    let (next, flown) = (AtomicUsize::new(0), Mutex::default());
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                loop {
                    let Ok(index) = u32::try_from(next.fetch_add(1, Ordering::Relaxed)) else {
                        return;
                    };
                    if index >= instants {
                        return;
                    }
                    let join_s = FIRST_S + SPAN_S * f64::from(index) / f64::from(instants);
                    let one = swapped_at((situation, seed), (slot, join_s), to, &unswapped);
                    let one = one.expect("a flight with a swap");
                    let flown: &Mutex<Vec<(f64, Swapped)>> = &flown;
                    flown.lock().expect("no panic").push((join_s, one));
                }
            });
        }
    });
    let mut flown: Vec<(f64, Swapped)> = flown.into_inner().expect("no panic");
    flown.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    flown
}
