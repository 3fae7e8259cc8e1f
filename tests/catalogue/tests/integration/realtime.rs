//! By the wall clock: every kind of fault that a rehearsal does not see, once.

use catalogue::patient_entries;
use catalogue::swapped::{Guard, SITUATIONS, config_of, plain, swapped_in_realtime};
use shared_types::Slot;
use std::path::Path;
use tempfile::TempDir;

#[test]
#[ignore = "soak: a trip takes effect late on a busy machine, and the vehicle goes farther"]
fn what_begins_after_the_window_stays_within_half_a_metre_in_realtime() {
    let seed = std::env::var("MORPHQUAD_SEED").ok().and_then(|seed| seed.parse().ok());
    let seed: u64 = seed.unwrap_or(1);
    let catalogue = env!("CARGO_BIN_EXE_catalogue");
    let morphquad = Path::new(catalogue).with_file_name("morphquad");
    let plains = SITUATIONS.map(|it| plain(&it, seed, None, &[]).expect("a flight"));
    let folder = TempDir::new().expect("a folder");
    let config = folder.path().join("entry.toml");
    let all = Slot::ALL.map(|slot| patient_entries(slot).into_iter().map(move |e| (slot, e)));
    let mut hurt = Vec::new();
    for ((slot, entry), nth) in all.into_iter().flatten().zip(seed..) {
        std::fs::write(&config, config_of(&entry)).expect("a file");
        // Each seed flies a kind in another situation.
        let at = usize::try_from(nth).expect("a small number") % SITUATIONS.len();
        let situation = &SITUATIONS[at];
        let to = (catalogue, Some(config.as_path()));
        let (flown, missed) =
            swapped_in_realtime(&morphquad, (situation, seed), slot, to, Guard::All, &plains[at])
                .expect("a flight");
        let name = format!("{} {}, {}", slot.label(), entry.name(), situation.name);
        println!("{name}: {missed} releases missed, {flown:?}");
        if flown.lost.is_some() || flown.excursion_m > 0.5 || flown.tilt_deg > 60.0 {
            hurt.push(format!("{name}: {missed} releases missed, {flown:?}"));
        }
    }
    assert!(hurt.is_empty(), "{hurt:#?}");
}
