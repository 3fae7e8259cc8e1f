use super::*;

const ASKS_EVERY_NS: u64 = 20_000_000;
const PERIOD_NS: u64 = 10_000_000;

fn asked(sequence: u64, thrust_n: f64) -> Asked {
    let valid_ns = sequence * ASKS_EVERY_NS;
    Asked { value: [0.1, -0.1, 3.0, thrust_n], sequence, valid_ns }
}

fn report(seat: u32, of: &Asked) -> Report {
    Report {
        release_ns: of.valid_ns,
        seat,
        sequence: of.sequence,
        epoch: 1,
        refused_epoch: 0,
        has_failed_over: false,
        has_tripped: false,
        value: of.value,
        period_ns: PERIOD_NS,
        asked_every_ns: [ASKS_EVERY_NS; 2],
    }
}

fn record(epoch: u64, hands: [u32; 2], at_ns: u64) -> Record {
    Record { epoch, hands, at_ns, every_ns: ASKS_EVERY_NS }
}

/// Long after the last change of hands, with set points 101 to 110 of seat 0 and of its fallback on seat 1.
fn reports() -> Reports {
    let mut reports = Reports::new(4.0);
    assert!(
        reports.take_record(&record(1, [0, 1], 0)) && !reports.take_record(&record(1, [0, 1], 9))
    );
    for sequence in 101..=110 {
        reports.ask(0, asked(sequence, 1.0));
        reports.ask(1, asked(sequence, 1.5));
        assert_eq!(reports.check(&report(0, &asked(sequence, 1.0))), None);
    }
    reports
}

#[test]
fn a_report_of_another_value_than_the_set_point_it_names_is_false() {
    let truth = report(0, &asked(110, 1.0));
    for axis in 0..4 {
        let mut value = truth.value;
        value[axis] += 1e-6;
        let found = reports().check(&Report { value, ..truth });
        assert_eq!(found, Some(TripCause::ReportFalse), "axis {axis}");
    }
    let turned = [0.1, -0.1, 3.0 - core::f64::consts::TAU, 1.0];
    assert_eq!(reports().check(&Report { value: turned, ..truth }), None, "the same heading");
    let none = Report { sequence: 0, value: [0.0; 4], ..truth };
    assert_eq!(reports().check(&none), None, "no set point yet");
}

#[test]
fn a_set_point_beyond_what_the_rotors_give_is_tracked_at_their_bound() {
    let mut reports = reports();
    reports.ask(0, asked(111, 9.0));
    assert_eq!(reports.check(&report(0, &asked(111, 4.0))), None);
}

#[test]
fn a_report_that_stays_at_a_set_point_that_is_over_is_false() {
    let mut reports = reports();
    let frozen = report(0, &asked(106, 1.0));
    let found = (0..10).map(|step| {
        let release_ns = asked(108, 1.0).valid_ns + step * PERIOD_NS;
        reports.check(&Report { release_ns, ..frozen })
    });
    // 107 has been there for two periods of the position loop and one of its own; then three in a row.
    let first = found.into_iter().position(|cause| cause == Some(TripCause::ReportFalse));
    assert_eq!(first, Some(6));
}

#[test]
fn a_set_point_that_was_never_given_is_forgiven_twice_and_not_three_times() {
    let mut reports = reports();
    let forged = Report { sequence: 1000, ..report(0, &asked(110, 1.0)) };
    assert_eq!([reports.check(&forged), reports.check(&forged)], [None; 2]);
    assert_eq!(reports.check(&report(0, &asked(110, 1.0))), None);
    assert_eq!([reports.check(&forged), reports.check(&forged)], [None; 2]);
    assert_eq!(reports.check(&forged), Some(TripCause::ReportFalse));
}

#[test]
fn after_a_change_of_hands_a_report_may_lie_between_the_set_points_for_a_while() {
    let change_ns = asked(110, 1.0).valid_ns;
    let between = Report { value: [0.1, -0.1, 3.0, 1.2], ..report(1, &asked(110, 1.5)) };
    assert_eq!(reports().check(&between), Some(TripCause::ReportFalse));
    let mut changed = reports();
    assert!(changed.take_record(&record(2, [1, 0], change_ns)));
    let between = Report { epoch: 2, ..between };
    assert_eq!(changed.check(&between), None);
    let outside = Report { value: [0.0; 4], ..between };
    assert_eq!(changed.check(&outside), Some(TripCause::ReportFalse));
    // The limiter's time, and two periods of the position loop and one of this before the new owner has published.
    let over_ns = LIMITED_FOR_NS + 2 * ASKS_EVERY_NS + PERIOD_NS;
    let late = Report { release_ns: change_ns + over_ns, ..between };
    assert_eq!(changed.check(&late), Some(TripCause::ReportFalse));
    let mut repeated = reports();
    assert!(repeated.take_record(&record(2, [1, 0], change_ns)));
    assert!(!repeated.take_record(&record(3, [1, 0], late.release_ns)), "it came too late");
    assert_eq!(repeated.check(&Report { epoch: 3, ..late }), None);
}

#[test]
fn a_report_that_names_no_set_point_and_an_empty_seat_is_false() {
    let mut reports = reports();
    let none = Report { sequence: 0, ..report(3, &asked(110, 1.0)) };
    let found = [none; 3].map(|report| reports.check(&report));
    assert_eq!(found, [None, None, Some(TripCause::ReportFalse)]);
}

#[test]
fn a_report_that_names_no_set_point_is_true_once_the_last_one_has_faded() {
    let mut reports = reports();
    let check = |reports: &mut Reports, periods: u64| {
        let release_ns = asked(110, 1.0).valid_ns + periods * PERIOD_NS;
        reports.check(&Report { sequence: 0, release_ns, ..report(0, &asked(110, 1.0)) })
    };
    let silent: Vec<_> = (8..30).map(|periods| check(&mut reports, periods)).collect();
    assert_eq!(silent, [None; 22], "four periods of the position loop after the last one");
    // Those that come then are to be taken, the first within its two periods.
    let ignored = (30..45).map(|periods| {
        if periods % 2 == 0 {
            reports.ask(0, asked(110 + periods / 2, 1.0));
        }
        check(&mut reports, periods)
    });
    let first = ignored.into_iter().position(|cause| cause == Some(TripCause::ReportFalse));
    assert_eq!(first, Some(8));
}

#[test]
fn a_trip_has_to_be_followed_within_two_periods_if_there_is_a_fallback() {
    let mut reports = reports();
    let owner = report(0, &asked(110, 1.0));
    let trip_ns = owner.release_ns;
    reports.trip(0, trip_ns);
    let at = |periods: u64| Report { release_ns: trip_ns + periods * PERIOD_NS, ..owner };
    assert_eq!(reports.check(&at(2)), None);
    assert_eq!(reports.check(&at(3)), Some(TripCause::TripIgnored));
    let fast = Report { period_ns: 1_000_000, release_ns: trip_ns + FOLLOWED_WITHIN_NS, ..owner };
    assert_eq!(reports.check(&fast), None, "the report may be late");
    let level = |periods: u64| Report { sequence: 0, ..at(periods) };
    assert_eq!(reports.check(&level(3)), None);
    let mut later = reports.clone();
    (111..=113).for_each(|sequence| later.ask(1, asked(sequence, 1.5)));
    let levels = 2 * ASKS_EVERY_NS / PERIOD_NS;
    assert_eq!(later.check(&level(levels + 2)), None);
    assert_eq!(later.check(&level(levels + 3)), Some(TripCause::TripIgnored));
    let follows = Report { release_ns: at(3).release_ns, ..report(1, &asked(110, 1.5)) };
    assert_eq!(reports.check(&follows), None);
    let mut over = reports.clone();
    assert!(over.take_record(&record(2, [1, 0], trip_ns)));
    let at = |periods: u64| Report { epoch: 2, ..at(periods) };
    assert_eq!(over.check(&at(3)), None, "of an owner that is none any more");
    for (hands, why) in [([0, NO_SEAT], "no fallback"), ([0, 2], "one that says nothing")] {
        assert!(reports.take_record(&record(2, hands, 0)));
        reports.trip(0, trip_ns);
        assert_eq!(reports.check(&at(3)), None, "{why}");
        let by_itself = Report { sequence: 0, ..at(20) };
        let found = [by_itself; 4].map(|report| reports.check(&report));
        assert_eq!(found, [None; 4], "{why}: it flies by itself");
    }
}

#[test]
fn a_fallback_whose_last_command_was_over_before_the_trip_is_none() {
    let mut reports = Reports::new(4.0);
    assert!(reports.take_record(&record(1, [0, 1], 0)));
    reports.ask(0, asked(110, 1.0));
    let published_ns = asked(110, 1.0).valid_ns - 300_000_000;
    reports.ask(1, Asked { valid_ns: published_ns, ..asked(110, 1.0) });
    let trip_ns = asked(110, 1.0).valid_ns;
    reports.trip(0, trip_ns);
    let owner = report(0, &asked(110, 1.0));
    // The owner's period is long, the fallback's is not.
    let report = Report { asked_every_ns: [200_000_000, 10_000_000], ..owner };
    assert_eq!(reports.check(&Report { release_ns: trip_ns + 30_000_000, ..report }), None);
}

#[test]
fn a_seat_that_there_is_not_and_a_set_point_of_nothing_are_no_way_out() {
    let mut reports = reports();
    let owner = report(0, &asked(110, 1.0));
    let late = Report { release_ns: owner.release_ns + 60_000_000, ..owner };
    for forged in [Report { seat: NO_SEAT, ..owner }, Report { sequence: 0, ..late }] {
        assert_eq!([reports.check(&forged), reports.check(&forged)], [None; 2]);
        assert_eq!(reports.check(&forged), Some(TripCause::ReportFalse));
        assert_eq!(reports.check(&owner), None);
    }
    let other = Report { seat: 1, value: owner.value, ..owner };
    assert_eq!(reports.check(&other), Some(TripCause::ReportFalse), "the other one's set point");
}

#[test]
fn a_slow_loop_may_track_a_set_point_that_is_older_than_all_that_are_known() {
    let mut reports = Reports::new(4.0);
    assert!(reports.take_record(&record(1, [0, 1], 0)));
    let fast = |sequence: u64| Asked { valid_ns: sequence * 1_000_000, ..asked(sequence, 1.0) };
    for sequence in 1_000..=1_095 {
        reports.ask(0, fast(sequence));
    }
    // At 10 Hz beside a position loop at 1 kHz.
    let slow = Report {
        release_ns: fast(1_095).valid_ns,
        period_ns: 100_000_000,
        asked_every_ns: [1_000_000; 2],
        ..report(0, &fast(1_000))
    };
    assert_eq!([reports.check(&slow), reports.check(&slow), reports.check(&slow)], [None; 3]);
}

#[test]
fn an_epoch_a_trip_or_a_fail_over_that_nothing_explains_is_a_false_report() {
    let mut reports = reports();
    let since_ns = asked(110, 1.0).valid_ns;
    assert!(reports.take_record(&record(2, [0, 2], since_ns)));
    (111..=125).for_each(|sequence| reports.ask(0, asked(sequence, 1.0)));
    let truth = Report { epoch: 2, ..report(0, &asked(125, 1.0)) };
    assert_eq!(reports.check(&truth), None);
    let forged = [
        Report { has_failed_over: true, ..truth },
        Report { has_tripped: true, ..truth },
        Report { epoch: 1, ..truth },
        Report { epoch: 3, ..truth },
    ];
    for forged in forged {
        let mut reports = reports.clone();
        assert_eq!([reports.check(&forged), reports.check(&forged)], [None; 2]);
        assert_eq!(reports.check(&forged), Some(TripCause::ReportFalse), "{forged:?}");
    }
    let refused = Report { epoch: 1, refused_epoch: 2, ..truth };
    let found = [refused; 4].map(|report| reports.check(&report));
    assert_eq!(found, [None; 4], "a record may come too late for the loop");

    let follows = Report { seat: 2, has_failed_over: true, ..truth };
    reports.ask(2, asked(125, 1.0));
    let mut disobeyed = reports.clone();
    let found = [Report { seat: 2, ..truth }; 3].map(|report| disobeyed.check(&report));
    assert_eq!(found, [None, None, Some(TripCause::ReportFalse)], "it has only taken the record");
    let mut silent = reports.clone();
    silent.note_silence(asked(125, 1.0).valid_ns + 3 * ASKS_EVERY_NS / 2);
    assert!(!silent.may_have_failed_over());
    silent.note_silence(asked(125, 1.0).valid_ns + 3 * ASKS_EVERY_NS / 2 + 1);
    silent.ask(0, asked(127, 1.0));
    assert_eq!([follows; 4].map(|report| silent.check(&report)), [None; 4], "the owner was silent");
    let mut gap = reports.clone();
    gap.ask(0, asked(127, 1.0));
    assert!(gap.may_have_failed_over(), "nothing has looked between the two");
    let mut tripped = reports.clone();
    tripped.trip(0, truth.release_ns);
    let follows = Report { has_tripped: true, ..follows };
    assert_eq!([follows; 4].map(|report| tripped.check(&report)), [None; 4], "it has tripped");
    // A new owner is left at once if it says nothing, and not if it begins at the instant of its record.
    let flip = record(3, [2, 0], truth.release_ns);
    let mut mute = reports.clone();
    assert!(mute.take_record(&flip));
    let mut speaks = mute.clone();
    mute.note_silence(truth.release_ns + 1);
    assert!(mute.may_have_failed_over());
    speaks.ask(2, Asked { valid_ns: truth.release_ns, ..asked(125, 1.0) });
    speaks.note_silence(truth.release_ns + PERIOD_NS);
    assert!(!speaks.may_have_failed_over());
    // Another fallback makes no silence of the owner's shorter.
    silent.take_record(&record(3, [0, 3], truth.release_ns + 8 * ASKS_EVERY_NS));
    silent.note_silence(truth.release_ns + 8 * ASKS_EVERY_NS);
    assert!(silent.may_have_failed_over());
    let mut late = Reports::new(4.0);
    late.take_record(&record(7, [0, 1], truth.release_ns));
    assert!(late.may_have_failed_over(), "it does not know what there was");
    // Without a fallback none can have taken over.
    assert!(reports.take_record(&record(3, [0, NO_SEAT], truth.release_ns)));
    reports.note_silence(truth.release_ns + 10 * ASKS_EVERY_NS);
    assert!(!reports.may_have_failed_over());
}

#[test]
fn of_the_records_that_a_report_says_it_refuses_the_fourth_in_a_row_makes_it_false() {
    let mut reports = reports();
    let mut refuse = |epoch: u64, refused_epoch: u64| {
        let sequence = 110 + epoch;
        let of = asked(sequence, 1.0);
        let release_ns = of.valid_ns + 4 * PERIOD_NS;
        reports.take_record(&record(epoch, [0, 2], of.valid_ns));
        reports.ask(0, of);
        let report = Report { epoch: 1, refused_epoch, release_ns, ..report(0, &of) };
        [report; 3].map(|report| reports.check(&report))
    };
    let found = [2, 3, 4].map(|epoch| refuse(epoch, epoch));
    assert_eq!(found, [[None; 3]; 3], "a record may come too late for the loop");
    assert_eq!(refuse(5, 5), [None, None, Some(TripCause::ReportFalse)]);
}

#[test]
fn a_record_that_is_taken_ends_the_count_of_those_refused() {
    let mut reports = reports();
    let mut report = |epoch: u64, taken: u64, refused_epoch: u64| {
        let of = asked(110 + epoch, 1.0);
        let release_ns = of.valid_ns + 4 * PERIOD_NS;
        reports.take_record(&record(epoch, [0, 2], of.valid_ns));
        reports.ask(0, of);
        let report = Report { epoch: taken, refused_epoch, release_ns, ..report(0, &of) };
        [report; 3].map(|report| reports.check(&report))
    };
    for epoch in [2, 4, 6, 8] {
        assert_eq!(report(epoch, epoch - 1, epoch), [None; 3]);
        assert_eq!(report(epoch + 1, epoch + 1, epoch), [None; 3]);
    }
}
