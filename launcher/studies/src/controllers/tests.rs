use super::*;

#[test]
fn every_pair_flies_within_its_bounds_recovers_and_is_the_same_again() {
    let flown_count = std::sync::atomic::AtomicUsize::new(0);
    let count = || {
        flown_count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    };
    let plan = Plan { seeds: 1, sizes_deg: vec![94.5], figure_s: 6.0 };
    let study = fly(&plan, &count).unwrap();
    assert_eq!(flown_count.into_inner(), plan.flights());
    assert_eq!(study.rows.len(), 6);
    let shown = report::table(&study);
    for row in &study.rows {
        assert_eq!((row.violations, row.lost), (0, 0), "{shown}");
        assert!(row.push_recovery_s.is_some() && row.pulse_recovery_s.is_some(), "{shown}");
        assert!(row.settling_s.iter().all(Option::is_some), "{shown}");
        assert!(row.rms_m < 0.1, "{shown}");
    }
    let again = fly(&plan, &|| ()).unwrap();
    let timeless = |study: Study| {
        study.rows.into_iter().map(|row| Row { step_ns: [0, 0], ..row }).collect::<Vec<_>>()
    };
    assert_eq!(timeless(study), timeless(again));
}
