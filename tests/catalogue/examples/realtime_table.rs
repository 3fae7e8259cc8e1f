//! Swaps the entries of the catalogue into realtime flights, one after the other, and compares the ground
//! truth of their recordings with the lockstep flight without a swap.
//!
//! `realtime_table [watch] [FLIGHTS]`: 60 flights by default; `watch` forces each candidate into the slot,
//! where only the monitor guards the flight. If a vehicle is lost although its candidate never commanded,
//! the cause is the machine.
//! Run it after `cargo build --release --workspace --examples --bins`.
#![expect(clippy::print_stdout, reason = "its table is for people")]

use catalogue::swapped::{Guard, SITUATIONS, config_of, plain, swapped_in_realtime};
use catalogue::{Entry, entries, late_entries};
use shared_types::Slot;
use std::path::{Path, PathBuf};

const SEED: u64 = 1;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let flights: usize = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(60);
    let is_forced = arguments.iter().any(|argument| argument == "watch");
    let guard = if is_forced { Guard::Watch } else { Guard::All };
    let built = built();
    let plains = SITUATIONS.map(|situation| plain(&situation, SEED, None, &[]).expect("a flight"));
    let all: Vec<(Slot, Entry)> = Slot::ALL
        .into_iter()
        .flat_map(|slot| {
            let every = late_entries().into_iter().chain(entries(slot));
            every.map(move |entry| (slot, entry))
        })
        .collect();
    let folder = tempfile::TempDir::new().expect("a folder");
    let config = folder.path().join("entry.toml");
    let (mut lost, mut by_machine, mut far, mut flipped) = (0, 0, 0, 0);
    for nth in 0..flights {
        let (slot, entry) = &all[nth % all.len()];
        // Each pass through the catalogue begins with another situation.
        let at = (nth + nth / all.len()) % SITUATIONS.len();
        let situation = &SITUATIONS[at];
        std::fs::write(&config, config_of(entry)).expect("a file");
        let to = built.join("catalogue").display().to_string();
        let to = (to.as_str(), Some::<&Path>(&config));
        let morphquad = built.join("morphquad");
        let flown =
            swapped_in_realtime(&morphquad, (situation, SEED), *slot, to, guard, &plains[at]);
        let head = format!("{} {} {}", slot.label(), entry.name(), situation.name);
        match flown {
            Ok((flown, missed)) => {
                println!(
                    "{head}: {}, flipped {}, {:.2} m, {:.0} deg, trip {:?}, {missed} releases missed; {}",
                    flown.lost.as_deref().unwrap_or("kept"),
                    flown.flipped,
                    flown.excursion_m,
                    flown.tilt_deg,
                    flown.tripped_s,
                    flown.outcome
                );
                lost += u32::from(flown.lost.is_some() && flown.flipped);
                by_machine += u32::from(flown.lost.is_some() && !flown.flipped);
                far += u32::from(flown.excursion_m > 0.5 || flown.tilt_deg > 60.0);
                flipped += u32::from(flown.flipped);
            }
            Err(error) => {
                println!("{head}: not flown: {error}");
                lost += 1;
            }
        }
    }
    println!(
        "{flights} flights, {}: {lost} lost, {by_machine} lost by the machine, {far} beyond 0.5 m or 60 deg, \
         {flipped} flipped",
        guard.name()
    );
}

/// The folder with the executables of this build.
fn built() -> PathBuf {
    let own = std::env::current_exe().expect("the own executable");
    own.parent().and_then(Path::parent).expect("a target folder").to_owned()
}
