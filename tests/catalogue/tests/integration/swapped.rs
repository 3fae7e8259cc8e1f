//! Swaps six bad controllers into flights with one seed each; the example `swap_table` flies the whole table.

use catalogue::swapped::{Guard, SITUATIONS, config_of, plain, swapped};
use catalogue::{Entry, Fault, entries};
use shared_types::Slot;
use std::path::Path;

fn entry(slot: Slot, name: &str) -> Entry {
    let found = entries(slot).into_iter().find(|entry| entry.name() == name);
    found.expect("an entry of the catalogue")
}

fn six() -> [(Slot, Entry); 6] {
    [
        (Slot::Attitude, entry(Slot::Attitude, "wrong sign in roll")),
        (Slot::Attitude, entry(Slot::Attitude, "gain x10")),
        (Slot::Attitude, entry(Slot::Attitude, "no number after 0.7 s")),
        (Slot::Attitude, entry(Slot::Attitude, "works until the arms fold")),
        (Slot::Position, entry(Slot::Position, "wrong sign in pitch")),
        (Slot::Position, entry(Slot::Position, "frozen output")),
    ]
}

#[test]
fn bad_controllers_are_refused_or_tripped_and_lose_the_vehicle_without_safeguards() {
    let executable = env!("CARGO_BIN_EXE_catalogue");
    let folder = tempfile::TempDir::new().unwrap();
    // In the others some of these faults are mild.
    let situations = &SITUATIONS[..4];
    let mut lost_without = 0;
    for (nth, (slot, entry)) in six().into_iter().enumerate() {
        let situation = &situations[nth % situations.len()];
        let config = folder.path().join(format!("{nth}.toml"));
        std::fs::write(&config, config_of(&entry)).unwrap();
        let unswapped = plain(situation, 7, None, &[]).unwrap();
        let fly = |guard: Guard| {
            let to = (executable, Some::<&Path>(&config));
            let flown = swapped((situation, 7), slot, to, guard, &unswapped).unwrap();
            println!("{} {} {}: {flown:?}", slot.label(), entry.name(), guard.name());
            flown
        };
        let guarded = fly(Guard::All);
        assert_eq!((guarded.lost.as_deref(), guarded.flipped), (None, false), "{}", entry.name());
        assert!(guarded.excursion_m <= 0.5 && guarded.tilt_deg <= 60.0, "{guarded:?}");
        let watched = fly(Guard::Watch);
        assert!(watched.lost.is_none(), "{}: {watched:?}", entry.name());
        assert!(watched.flipped, "{watched:?}");
        lost_without += u32::from(fly(Guard::None).lost.is_some());
    }
    assert!(lost_without >= 4, "what loses no vehicle shows nothing: {lost_without}");
}

#[test]
fn an_entry_survives_a_round_trip_through_its_configuration_file() {
    for slot in Slot::ALL {
        for entry in entries(slot) {
            let read: Entry = toml::from_str(&config_of(&entry)).unwrap();
            assert_eq!(read, entry);
        }
    }
    assert_eq!(Entry::default().fault, Fault::Nothing);
}
