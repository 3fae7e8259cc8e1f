//! What becomes of bad owners that are watched, and of good ones.
#![expect(
    clippy::unwrap_used,
    clippy::too_many_lines,
    clippy::needless_for_each,
    clippy::match_same_arms,
    reason = "a world that is built and flown in one go, whose failures fail the test"
)]

mod course;
mod spoil;
mod world;

use course::{COURSES, Course};
use monitor::Limits;
use shared_types::Role;
use spoil::{CERTAIN, LIKELY, Spoil};
use world::{Case, FLIP_MS, Outcome, fly};

/// A watch that never trips anybody.
fn blind() -> Limits {
    let none = f64::INFINITY;
    Limits {
        turn_away_rad: none,
        tilt_rad: none,
        heading_rad: none,
        astray_rad: none,
        astray_s: none,
        swing_rate_rad_s: none,
        swing_tilt_rad: none,
        setpoint_tilt_rad: none,
        thrust_speed_m_s: none,
        excursion_m: none,
        off_course_m: none,
        off_course_s: none,
        height_m: -none,
    }
}

fn pairs(slot: Role) -> Vec<[usize; 2]> {
    let kinds = if slot == Role::Attitude { 3 } else { 2 };
    let pair = |before: usize| (0..kinds).map(move |owner| [before, owner]);
    (0..kinds).flat_map(pair).filter(|[before, owner]| before != owner).collect()
}

fn case(slot: Role, course: Course, seed: u64, spoil: Spoil) -> Case {
    let pairs = pairs(slot);
    let laws = pairs[usize::try_from(seed).unwrap() % pairs.len()];
    Case { slot, course, seed, spoil, laws, with_fallback: true, trip_at_ms: None }
}

#[expect(clippy::print_stdout, reason = "a table for whoever asks for it")]
fn row(case: &Case, outcome: &Outcome) {
    let trip = outcome.trip.map_or("no trip".to_owned(), |(ms, cause)| {
        format!("{:6.0} ms {cause:?}", ms - FLIP_MS as f64)
    });
    println!(
        "{:9} {:8} {:15} {:?} {:4} tilt {:4.2} rad, off {:5.2} m, at the end {:5.2} m, recover {:4} ms{} {trip}",
        case.slot.label(),
        format!("{:?}", case.course),
        format!("{:?}", case.spoil),
        case.laws,
        if outcome.is_safe() { "ok" } else { "LOST" },
        outcome.tilt_rad,
        outcome.error_m,
        outcome.last_error_m,
        outcome.recovering_ms,
        if outcome.was_cut { " CUT" } else { "" },
    );
}

/// Flies each of these everywhere, and gives how many there were and how many were lost.
fn lost(spoils: &[Spoil], seeds: u64) -> (usize, usize) {
    let (mut flown, mut lost) = (0, 0);
    for slot in [Role::Attitude, Role::Position] {
        for spoil in spoils {
            for course in COURSES {
                for seed in 1..=seeds {
                    let case = case(slot, course, seed, *spoil);
                    let outcome = fly(&case, Limits::default());
                    row(&case, &outcome);
                    flown += 1;
                    lost += usize::from(!outcome.is_safe());
                }
            }
        }
    }
    (flown, lost)
}

#[test]
fn no_good_controller_trips_on_any_course() {
    for slot in [Role::Attitude, Role::Position] {
        for course in COURSES {
            for seed in 1..=6 {
                let case = case(slot, course, seed, Spoil::Good);
                let outcome = fly(&case, Limits::default());
                row(&case, &outcome);
                assert!(outcome.trip.is_none() && outcome.is_safe(), "{case:?}: {outcome:?}");
            }
        }
    }
}

#[test]
fn owners_that_turn_the_wrong_way_or_say_nothing_new_never_lose_the_vehicle() {
    let (_, lost) = lost(&CERTAIN, 2);
    assert_eq!(lost, 0);
}

#[test]
fn of_owners_that_fly_badly_one_in_twenty_at_most_loses_the_vehicle() {
    let (flown, lost) = lost(&LIKELY, 2);
    assert!(20 * lost <= flown, "{lost} of {flown}");
}

#[test]
fn trips_come_well_before_the_last_instant_from_which_the_vehicle_recovers() {
    let mut margins = Vec::new();
    for spoil in [Spoil::WrongSign(0), Spoil::WrongSign(1), Spoil::Exchanged, Spoil::Frozen] {
        for course in [Course::Hover, Course::Figure8, Course::Gusts] {
            let case = case(Role::Attitude, course, 1, spoil);
            // Only what is lost without a watch has a last instant.
            if fly(&case, blind()).is_safe() {
                continue;
            }
            let Some((tripped_ms, _)) = fly(&case, Limits::default()).trip else { continue };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
            let from = tripped_ms as u64 - 1;
            let recovers = |at: &u64| {
                fly(&Case { trip_at_ms: Some(*at), ..case }, Limits::default()).is_safe()
            };
            let last = (0..80).map(|k| from + 10 * k).take_while(recovers).last();
            let margin_ms = last.map_or(0, |last| last - from);
            println!(
                "{spoil:?} {course:?}: trip after {} ms, margin {margin_ms} ms",
                from - FLIP_MS
            );
            margins.push(margin_ms);
        }
    }
    margins.sort_unstable();
    let median = margins[margins.len() / 2];
    println!("median {median} ms of {margins:?}");
    assert!(margins.len() >= 6 && median >= 50, "{margins:?}");
}
