//! The monitor alone, without admission check and rehearsal: it must trip bad controllers in time, and never a
//! shipped one.

use catalogue::swapped::{
    Guard, Plain, SITUATIONS, Situation, Swapped, config_of, pair_settings, paired, plain, swapped,
    swapped_with_late_trips,
};
use catalogue::{Entry, Fault, entries, entries_of_pairs, patient_entries};
use scenario::Override;
use scenario::services::names_for;
use shared_types::Slot;
use std::path::PathBuf;
use tempfile::TempDir;

const SEED: u64 = 3;

/// Flies entries of the catalogue with its executable.
struct Flights {
    folder: TempDir,
    plains: [Plain; SITUATIONS.len()],
}

impl Flights {
    fn new() -> Self {
        let plains =
            SITUATIONS.map(|situation| plain(&situation, SEED, None, &[]).expect("a flight"));
        Self { folder: TempDir::new().expect("a folder"), plains }
    }

    fn configure_as(&self, name: &str, entry: &Entry) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, config_of(entry)).expect("a file");
        path
    }

    fn fly(&self, at: usize, slot: Slot, entry: &Entry, guard: (Guard, u64)) -> Swapped {
        let config = self.configure_as("entry.toml", entry);
        let to = (env!("CARGO_BIN_EXE_catalogue"), Some(config.as_path()));
        let situation: &Situation = &SITUATIONS[at];
        swapped_with_late_trips((situation, SEED), slot, to, guard, &self.plains[at])
            .expect("a flight")
    }
}

#[test]
fn the_vehicle_survives_every_bad_controller_that_is_forced_in() {
    let flights = Flights::new();
    let (mut flown, mut flipped) = (0, 0);
    let all =
        Slot::ALL.into_iter().flat_map(|slot| entries(slot).into_iter().map(move |e| (slot, e)));
    for (nth, (slot, entry)) in all.enumerate() {
        let at = nth % SITUATIONS.len();
        let swapped = flights.fly(at, slot, &entry, (Guard::Watch, 0));
        let name = entry.name();
        println!("{} {name} {}: {swapped:?}", slot.label(), SITUATIONS[at].name);
        assert!(swapped.lost.is_none(), "{name}: {swapped:?}");
        (flown, flipped) = (flown + 1, flipped + u32::from(swapped.flipped));
    }
    // A forced swap is still refused if the candidate commands what no vehicle could follow.
    assert!(flipped + 2 >= flown, "{flipped} of {flown}");
}

/// No rehearsal sees such a fault, and no rollback window lasts until it shows.
#[test]
fn what_begins_after_rehearsal_and_window_stays_within_half_a_metre() {
    let flights = Flights::new();
    let all = Slot::ALL.map(|slot| patient_entries(slot).into_iter().map(move |e| (slot, e)));
    for (nth, (slot, entry)) in all.into_iter().flatten().enumerate() {
        let at = nth % SITUATIONS.len();
        let flown = flights.fly(at, slot, &entry, (Guard::All, 0));
        let name = format!("{} {}, {}", slot.label(), entry.name(), SITUATIONS[at].name);
        println!("{name}: {flown:?}");
        assert!(flown.flipped && flown.recovered && flown.lost.is_none(), "{name}: {flown:?}");
        assert!(flown.excursion_m <= 0.5 && flown.tilt_deg <= 60.0, "{name}: {flown:?}");
        let other = 1 - slot.index();
        assert_eq!(
            flown.epochs[other], 1,
            "what it does costs no other its slot, {name}: {flown:?}"
        );
        // What the vehicle can be flown with need not be tripped, silence is followed without a trip, and in simulated
        // time a process that has ended is started again.
        let is_bearable =
            matches!(entry.fault, Fault::Bias | Fault::Delay | Fault::Leak | Fault::WorldFrame);
        let is_restarted = entry.fault == Fault::Exits;
        let is_silent = matches!(entry.fault, Fault::NotANumber | Fault::Silent) || is_restarted;
        assert!(flown.tripped_s.is_some() != is_silent || is_bearable, "{name}: {flown:?}");
        let is_taken_back = flown.outcome.starts_with("taken back: ");
        assert!(is_taken_back || is_bearable || is_restarted, "{name}: {flown:?}");
        assert!(flown.unreported.is_empty(), "{name}: {flown:?}");
    }
}

/// Settings with which commands of the attitude slot take effect so late, and come so often.
fn commands_after(ms: u8, rate_hz: u16) -> [Override; 2] {
    let keys = [
        format!("latency.wrench_command_s={}", 1e-3 * f64::from(ms)),
        format!("attitude_mpc.rate_hz={rate_hz}"),
    ];
    keys.map(|key| Override::set(&key).expect("a setting"))
}

/// The phase between the commands and the steps of the monitor follows from latency and rate of the commands.
#[test]
fn full_torque_trips_within_25_ms_of_its_first_effect_in_every_phase() {
    let flights = Flights::new();
    let all = patient_entries(Slot::Attitude).into_iter();
    let slams: Vec<Entry> = all.filter(|entry| entry.fault == Fault::Slams).collect();
    assert_eq!(slams.len(), 3);
    for (nth, entry) in slams.into_iter().enumerate() {
        let config = flights.configure_as("slams.toml", &entry);
        let to = (env!("CARGO_BIN_EXE_catalogue"), Some(config.as_path()));
        for (ms, rate_hz) in (1..10).map(|ms| (ms, 100)).chain([(1, 125), (3, 125), (1, 160)]) {
            // Where the arms are folded then, as the entries' largest torques are.
            let situation = &SITUATIONS[nth % 2];
            let edits = commands_after(ms, rate_hz);
            let plain = plain(situation, SEED, None, &edits).expect("a flight");
            let flown = swapped((situation, SEED), Slot::Attitude, to, Guard::All, &plain);
            let flown = flown.expect("a flight");
            let name = format!("{} after {ms} ms at {rate_hz} Hz", entry.name());
            println!("{name}: {flown:?}");
            let tripped_s = flown.tripped_after_s.expect("a trip") - entry.after_s;
            let effect_s = tripped_s - 1e-3 * f64::from(ms);
            assert!((0.0..0.0251).contains(&effect_s), "{name}, {effect_s} s: {flown:?}");
        }
    }
}

/// As if the fallback had died: until the initial controller flies, the vehicle is level.
#[test]
fn without_a_fallback_a_trip_costs_a_metre_at_most() {
    let flights = Flights::new();
    let alone = Override::set("monitor.fallback=none").expect("a setting");
    let situation = &SITUATIONS[0];
    let plain = plain(situation, SEED, None, &[alone]).expect("a flight");
    for slot in Slot::ALL {
        let bad = patient_entries(slot).into_iter().filter(|entry| {
            matches!(entry.fault, Fault::Slams | Fault::Gain)
                || matches!((entry.fault, entry.amount), (Fault::Thrust, 0.0))
        });
        for entry in bad {
            let config = flights.configure_as("alone.toml", &entry);
            let to = (env!("CARGO_BIN_EXE_catalogue"), Some(config.as_path()));
            let flown = swapped((situation, SEED), slot, to, Guard::All, &plain).expect("a flight");
            let name = format!("{} {}", slot.label(), entry.name());
            println!("{name}: {flown:?}");
            assert!(flown.tripped_s.is_some() && flown.recovered, "{name}: {flown:?}");
            assert!(flown.excursion_m <= 1.0 && flown.tilt_deg <= 60.0, "{name}: {flown:?}");
        }
    }
}

/// An attitude controller may leave it to others to follow a trip of the position controller, or fail together with it.
#[test]
fn a_pair_of_bad_controllers_is_taken_back_and_reported_slot_by_slot() {
    let flights = Flights::new();
    let plains = SITUATIONS
        .map(|situation| plain(&situation, SEED, None, &pair_settings()).expect("a flight"));
    let bad = patient_entries(Slot::Position).into_iter().filter(|entry| {
        matches!((entry.fault, entry.amount), (Fault::Thrust, 4.0) | (Fault::Slams, -2.0))
            || entry.fault == Fault::WrongSign && entry.axis == 0
    });
    let pairs = entries_of_pairs().into_iter().flat_map(|attitude| {
        bad.clone().map(move |position| (attitude.clone(), position)).collect::<Vec<_>>()
    });
    for (nth, (attitude, position)) in pairs.enumerate() {
        let at = nth % SITUATIONS.len();
        let first = flights.configure_as("attitude.toml", &attitude);
        let second = flights.configure_as("position.toml", &position);
        let faulty = env!("CARGO_BIN_EXE_catalogue");
        let pair = [first.as_path(), second.as_path()].map(|config| (faulty, Some(config)));
        let flown = paired((&SITUATIONS[at], SEED), pair, &plains[at]);
        let flown = flown.expect("a flight");
        let name =
            format!("{}, then {}, {}", attitude.name(), position.name(), SITUATIONS[at].name);
        println!("{name}: {flown:?}");
        assert!(flown.flipped && flown.recovered && flown.lost.is_none(), "{name}: {flown:?}");
        assert!(flown.excursion_m <= 0.5 && flown.tilt_deg <= 60.0, "{name}: {flown:?}");
        assert!(flown.tripped_s.is_some() && flown.unreported.is_empty(), "{name}: {flown:?}");
        // The attitude controller is not to blame for what the position controller does.
        let is_bad = [attitude.fault != Fault::Nothing, true];
        assert_eq!(flown.trips.map(|trips| trips > 0), is_bad, "{name}: {flown:?}");
    }
}

#[test]
fn no_shipped_controller_trips() {
    for slot in Slot::ALL {
        for owner in names_for(slot.role()) {
            for situation in &SITUATIONS {
                let unswapped = plain(situation, SEED, Some((slot, owner)), &[]).expect("a flight");
                for to in names_for(slot.role()).filter(|to| *to != owner) {
                    let flight = (situation, SEED);
                    let flown = swapped(flight, slot, (to, None), Guard::Watch, &unswapped)
                        .expect("a flight");
                    let facts = (flown.flipped, flown.tripped_s, flown.lost.as_deref());
                    let name = situation.name;
                    assert_eq!(facts, (true, None, None), "{to} for {owner}, {name}: {flown:?}");
                }
            }
        }
    }
}

/// What full torque is judged by depends on when its commands take effect, and on how long each lasts.
#[test]
fn no_shipped_attitude_controller_trips_whenever_its_commands_take_effect() {
    for (ms, rate_hz) in [(3, 100), (6, 100), (9, 100), (1, 50), (1, 125), (1, 250)] {
        let situation = &SITUATIONS[2];
        let edits = commands_after(ms, rate_hz);
        let unswapped = plain(situation, SEED, None, &edits).expect("a flight");
        for to in names_for(Slot::Attitude.role()).skip(1) {
            let flight = (situation, SEED);
            let flown = swapped(flight, Slot::Attitude, (to, None), Guard::Watch, &unswapped)
                .expect("a flight");
            let name = format!("{to} after {ms} ms at {rate_hz} Hz");
            assert_eq!((flown.flipped, flown.tripped_s), (true, None), "{name}: {flown:?}");
        }
    }
}

/// The point of no return is the last instant at which a trip still saves the vehicle; here of half of the faults it has to
/// lie at least so much later than the trip.
#[test]
fn trips_come_well_before_the_point_of_no_return() {
    const MARGIN_NS: u64 = 50_000_000;
    let flights = Flights::new();
    let (mut survived, mut flown) = (0, 0);
    let wanted = |entry: &Entry| match entry.fault {
        Fault::WrongSign => entry.axis != 3,
        fault => matches!(fault, Fault::Exchanged | Fault::Frozen),
    };
    for entry in entries(Slot::Attitude).into_iter().filter(wanted) {
        for at in [0, 1, 3] {
            let fly = |guard, later_ns| flights.fly(at, Slot::Attitude, &entry, (guard, later_ns));
            // Only a vehicle that is lost without the monitor has a point of no return.
            if fly(Guard::None, 0).recovered {
                continue;
            }
            assert!(fly(Guard::Watch, 0).recovered, "{}", entry.name());
            let survives = fly(Guard::Watch, MARGIN_NS).recovered;
            println!("{} {}: {survives}", entry.name(), SITUATIONS[at].name);
            (survived, flown) = (survived + u32::from(survives), flown + 1);
        }
    }
    assert!(flown >= 6 && 2 * survived >= flown, "{survived} of {flown}");
}
