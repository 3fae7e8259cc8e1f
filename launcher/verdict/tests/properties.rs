//! Properties for arbitrary measurements: a worse one never improves the verdict, one that is not a number
//! never passes, and every reason names its measurement and limit.

use proptest::prelude::*;
use verdict::{
    Basis, CHECKS, Clipping, Contact, End, Grade, Misses, Outcome, SafeMode, Thresholds, Tracking,
    judge,
};

/// A measurement: often within its limit, often exactly at it, sometimes infinite or NaN.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => Just(0.0),
        4 => 0.0..0.2,
        2 => 0.2..2.0,
        1 => 2.0..1e6,
        1 => Just(f64::INFINITY),
        1 => Just(f64::NAN),
    ]
}

fn count() -> impl Strategy<Value = u64> {
    prop_oneof![6 => Just(0), 1 => 1_u64..5, 1 => 5_u64..1_000_000]
}

fn tracking() -> impl Strategy<Value = Option<Tracking>> {
    let numbers = [number(), number(), number(), number(), number(), number()];
    prop::option::of(numbers.prop_map(|numbers| {
        let [rms_m, max_m, recovering_m, sustained_m, end_m, heading_rad] = numbers;
        let errors = Tracking { rms_m, max_m, recovering_m, sustained_m, ..Tracking::default() };
        Tracking { end_m, heading_rad, ..errors }
    }))
}

fn end() -> impl Strategy<Value = End> {
    prop_oneof![
        6 => Just(End::Planned),
        1 => Just(End::Interrupted),
        1 => Just(End::Cut("it is cut".to_owned())),
        1 => Just(End::Crashed("plant killed by signal 9".to_owned())),
    ]
}

fn misses() -> impl Strategy<Value = Misses> {
    (count(), number()).prop_map(|(count, share)| Misses { count, share, of: "plant".to_owned() })
}

prop_compose! {
    fn outcome()(
        end in end(),
        flown_s in prop_oneof![8 => Just(20.0), 1 => 0.0..20.0, 1 => Just(f64::NAN)],
        tracking in tracking(),
        turned_rad in prop::option::of(number()),
        numbers in [number(), number(), number(), number(), number(), number()],
        counts in [count(), count(), count(), count(), count(), count()],
        (missed, late, unsolved) in (misses(), misses(), misses()),
        unrecorded in prop::option::weighted(0.1, Just("disk full".to_owned())),
    ) -> Outcome {
        let [contact, tilt_rad, longest_s, share, clipped_s, cut_s] = numbers;
        let [unexplained, violations, wrong_owner, duplicated, dropped, altered] = counts;
        Outcome {
            end,
            flown_s,
            planned_s: 20.0,
            tracking,
            turned_rad,
            contact: Contact { total_s: contact, from_s: 1.0 },
            tilt_rad,
            safe_mode: SafeMode { unexplained, longest_s, ..SafeMode::default() },
            clipping: Clipping { share, longest_s: clipped_s, longest_from_s: 2.0 },
            cut_s,
            violations,
            unsolved,
            missed,
            late,
            wrong_owner,
            duplicated,
            dropped,
            altered,
            unrecorded,
            ..Outcome::default()
        }
    }
}

prop_compose! {
    fn thresholds()(
        (realtime, faults) in any::<(bool, bool)>(),
        speed_m_s in 0.0..20.0,
        push_m_s2 in 0.0..20.0,
        step_rad in prop::option::of(0.0..1.2),
    ) -> Thresholds {
        let planned_s = 20.0;
        let path = Basis { speed_m_s, push_m_s2, step_rad, ..Basis::default() };
        let basis = Basis { realtime, faults, planned_s, ..path };
        Thresholds::derive(&basis)
    }
}

/// Makes one measurement of an outcome worse by an amount.
type Worsen = fn(&mut Outcome, f64);

fn more(value: &mut f64, by: f64) {
    *value += by;
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number")]
fn more_of(value: &mut u64, by: f64) {
    *value = value.saturating_add(by.ceil() as u64);
}

fn of_tracking(outcome: &mut Outcome, by: f64, field: fn(&mut Tracking) -> &mut f64) {
    if let Some(tracking) = &mut outcome.tracking {
        more(field(tracking), by);
    }
}

const WORSE: [Worsen; 25] = [
    |o, by| of_tracking(o, by, |t| &mut t.rms_m),
    |o, by| of_tracking(o, by, |t| &mut t.max_m),
    |o, by| of_tracking(o, by, |t| &mut t.recovering_m),
    |o, by| of_tracking(o, by, |t| &mut t.sustained_m),
    |o, by| of_tracking(o, by, |t| &mut t.end_m),
    |o, by| of_tracking(o, by, |t| &mut t.heading_rad),
    |o, by| o.turned_rad = o.turned_rad.map(|turned| turned + by),
    |o, by| more(&mut o.contact.total_s, by),
    |o, by| more(&mut o.tilt_rad, by),
    |o, by| more_of(&mut o.safe_mode.unexplained, by),
    |o, by| more(&mut o.safe_mode.longest_s, by),
    |o, by| more(&mut o.clipping.share, by),
    |o, by| more(&mut o.clipping.longest_s, by),
    |o, by| more(&mut o.cut_s, by),
    |o, by| more_of(&mut o.violations, by),
    |o, by| more(&mut o.unsolved.share, by),
    |o, by| more(&mut o.missed.share, by),
    |o, by| more(&mut o.late.share, by),
    |o, by| more_of(&mut o.wrong_owner, by),
    |o, by| more_of(&mut o.duplicated, by),
    |o, by| more_of(&mut o.dropped, by),
    |o, by| more_of(&mut o.altered, by),
    |o, by| more(&mut o.flown_s, -by),
    |o, _| o.end = End::Crashed("plant killed by signal 9".to_owned()),
    |o, _| o.unrecorded = Some("disk full".to_owned()),
];

/// Replaces one measurement each by NaN; the last entry ends the flight early.
const NO_NUMBER: [fn(&mut Outcome); 19] = [
    |o| o.flown_s = f64::NAN,
    |o| o.planned_s = f64::NAN,
    |o| of_tracking(o, f64::NAN, |t| &mut t.rms_m),
    |o| of_tracking(o, f64::NAN, |t| &mut t.max_m),
    |o| of_tracking(o, f64::NAN, |t| &mut t.recovering_m),
    |o| of_tracking(o, f64::NAN, |t| &mut t.sustained_m),
    |o| of_tracking(o, f64::NAN, |t| &mut t.end_m),
    |o| of_tracking(o, f64::NAN, |t| &mut t.heading_rad),
    |o| o.turned_rad = Some(f64::NAN),
    |o| o.contact.total_s = f64::NAN,
    |o| o.tilt_rad = f64::NAN,
    |o| o.safe_mode.longest_s = f64::NAN,
    |o| o.clipping.share = f64::NAN,
    |o| o.clipping.longest_s = f64::NAN,
    |o| o.cut_s = f64::NAN,
    |o| o.unsolved.share = f64::NAN,
    |o| o.missed.share = f64::NAN,
    |o| o.late.share = f64::NAN,
    |o| o.end = End::Cut(String::new()),
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn a_worse_number_never_improves_the_verdict(
        outcome in outcome(),
        thresholds in thresholds(),
        which in 0..WORSE.len(),
        by in prop_oneof![0.0..0.5, 0.5..1e3],
    ) {
        let before = judge(&outcome, &thresholds);
        let mut worse = outcome.clone();
        WORSE[which](&mut worse, by);
        let after = judge(&worse, &thresholds);
        prop_assert!(before.grade() <= after.grade(), "{before:?} became {after:?}");
        if !before.passed() {
            prop_assert!(before.reasons().len() <= after.reasons().len(), "{before:?} {after:?}");
        }
    }

    #[test]
    fn a_tighter_limit_never_improves_the_verdict(
        outcome in outcome(),
        thresholds in thresholds(),
        which in 0..CHECKS.len(),
        factor in 0.0..1.0,
    ) {
        let key = CHECKS[which].key;
        let mut tighter = thresholds.clone();
        let limit = thresholds.limit(key).expect("every check has a limit");
        prop_assert!(tighter.set(key, limit * factor));
        let (before, after) = (judge(&outcome, &thresholds), judge(&outcome, &tighter));
        prop_assert!(before.grade() <= after.grade(), "{before:?} became {after:?}");
    }

    #[test]
    fn a_flight_with_nan_never_passes(thresholds in thresholds(), which in 0..NO_NUMBER.len()) {
        let mut outcome = Outcome {
            flown_s: 20.0,
            planned_s: 20.0,
            tracking: Some(Tracking::default()),
            ..Outcome::default()
        };
        prop_assert!(judge(&outcome, &thresholds).passed());
        NO_NUMBER[which](&mut outcome);
        prop_assert!(!judge(&outcome, &thresholds).passed(), "{outcome:?}");
    }

    #[test]
    fn every_reason_names_a_number_and_a_limit_and_the_worst_comes_first(
        outcome in outcome(),
        thresholds in thresholds(),
    ) {
        let verdict = judge(&outcome, &thresholds);
        prop_assert!(!verdict.reasons().is_empty());
        prop_assert_eq!(verdict.grade(), verdict.reasons()[0].grade);
        prop_assert!(verdict.reasons().is_sorted_by(|a, b| a.grade >= b.grade));
        for reason in verdict.reasons() {
            let between = if reason.key == "flown_s" { " of " } else { "limit " };
            let (head, limit) = reason.text.split_once(between).unwrap_or(("", ""));
            prop_assert!(limit.starts_with(|c: char| c.is_ascii_digit() || "iN".contains(c)), "{}", reason.text);
            let numbered = head.contains(|c: char| c.is_ascii_digit())
                || head.contains("not a number") || head.contains("inf") || head.contains("NaN");
            prop_assert!(numbered, "{}", reason.text);
            if reason.measured.is_finite() && !verdict.passed() && reason.key != "flown_s" {
                prop_assert!(reason.measured > reason.limit, "{reason:?}");
                // They are printed with enough digits to differ.
                let limit = limit.split([';', ':']).next().unwrap_or(limit);
                prop_assert!(!head.contains(&format!(" {limit},")), "{}", reason.text);
            }
        }
    }

    #[test]
    fn the_same_outcome_always_has_the_same_sentence(
        outcome in outcome(),
        thresholds in thresholds(),
    ) {
        let (first, again) = (judge(&outcome, &thresholds), judge(&outcome.clone(), &thresholds.clone()));
        prop_assert_eq!(first.line("hover"), again.line("hover"));
        prop_assert!(first.line("hover").starts_with(first.grade().word()));
        prop_assert!(first.line("hover").contains(&first.reasons()[0].text));
        prop_assert!(!first.line("hover").contains('\n'));
    }
}

#[test]
fn every_check_has_exactly_one_limit_and_every_limit_a_check() {
    let thresholds = Thresholds::default();
    for check in &CHECKS {
        let limit = thresholds.limit(check.key);
        assert!(limit.is_some_and(f64::is_finite), "{}", check.key);
    }
    assert_eq!(thresholds.iter().count(), CHECKS.len());
    assert!(thresholds.iter().all(|(_, threshold)| !threshold.why.is_empty()));
    assert!(!Thresholds::default().set("no_such_limit", 1.0));
}

#[test]
fn limits_follow_from_speed_wind_and_clock() {
    let limit = |basis: Basis, key| Thresholds::derive(&basis).limit(key).expect("a limit");
    let rest = Basis::default();
    let fast = Basis { speed_m_s: 2.0, ..rest };
    let windy = Basis { push_m_s2: 1.0, ..rest };
    assert!(limit(rest, "tracking_max_m") < limit(windy, "tracking_max_m"));
    assert!(limit(rest, "tracking_max_m") < limit(fast, "tracking_max_m"));
    let wild = Basis { speed_m_s: 1e3, push_m_s2: 1e3, ..rest };
    assert!(limit(wild, "tracking_max_m") <= verdict::LOST_M, "no vehicle may get lost");
    let realtime = Basis { realtime: true, planned_s: 20.0, ..rest };
    assert!(limit(rest, "safe_mode_max") < 0.5 && limit(realtime, "safe_mode_max") < 4.5);
    assert!(limit(rest, "missed_max_share") < limit(realtime, "missed_max_share"));
}

#[test]
fn a_reason_names_measurement_instant_and_limit() {
    let outcome = Outcome {
        flown_s: 20.0,
        planned_s: 20.0,
        tracking: Some(Tracking { max_m: 2.232, max_at_s: 5.125, ..Tracking::default() }),
        contact: Contact { total_s: 3.0, from_s: 1.0 },
        ..Outcome::default()
    };
    let mut thresholds = Thresholds::default();
    assert!(thresholds.set("tracking_max_m", 0.25));
    let verdict = judge(&outcome, &thresholds);
    assert_eq!(verdict.grade(), Grade::Failed);
    assert_eq!(
        verdict.line("figure8-morph"),
        "FAILED  figure8-morph: ground contact 3 s from 1.000 s on, limit 0 s; and 1 reason more"
    );
    assert_eq!(verdict.reasons()[1].text, "tracking error 2.232 m at 5.125 s, limit 0.25 m");
}
