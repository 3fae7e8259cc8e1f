use super::*;
use figures::results::Table;

#[test]
fn sweeps_fit_between_the_leads_of_the_figure_and_rest_in_between() {
    for (sweep_s, count) in [(4.0, 3), (2.0, 5), (1.0, 7), (0.6, 9), (0.3, 11)] {
        let windows = windows(sweep_s);
        assert_eq!(windows.len(), count, "{sweep_s}");
        assert!(windows[0].from_s >= 3.0 && windows[count - 1].to_s <= 17.0 + 1e-9);
        for pair in windows.windows(2) {
            assert!((pair[1].from_s - pair[0].to_s - REST_S).abs() < 1e-9);
        }
    }
}

#[test]
fn the_scheduled_law_keeps_its_marks_and_a_fixed_one_does_not_fly_alike() {
    let study = fly(&Plan::quick(3), &|| ()).unwrap();
    let marks = marks(&study);
    assert_eq!(marks.len(), 4);
    let shown = report::mark_table(&marks).to_string();
    assert!(marks.iter().all(|mark| mark.holds), "{shown}\n{}", report::table(&study));
    let of = |law| study.cells.iter().filter(move |cell| cell.law == law);
    assert!(of(Law::Scheduled).all(|cell| cell.verdict() == Verdict::Flown));
    assert!(of(Law::Fixed(45.0)).all(|cell| cell.verdict() != Verdict::Flown));
}

#[test]
fn a_study_is_the_same_study_again_whatever_the_threads_do() {
    let plan = Plan {
        sweeps_s: vec![0.3],
        laws: vec![Law::Scheduled],
        conditions: vec![Conditions::calm(StateSource::Estimator)],
        seeds: 2,
        other_seeds: 1,
    };
    let flown_count = std::sync::atomic::AtomicUsize::new(0);
    let count = || {
        flown_count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    };
    let first = fly(&plan, &count).unwrap();
    assert_eq!(flown_count.into_inner(), plan.flights());
    let csv = |study: &Study| Table::to_csv(&report::flights(study));
    assert_eq!(csv(&first), csv(&fly(&plan, &|| ()).unwrap()));
}
