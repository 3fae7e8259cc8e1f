use super::*;

fn candidate(closeness: f64, lost: usize, within_m: f64) -> Candidate {
    let random = Robustness { lost, within_m };
    let flags = vec![format!("{closeness} {lost} {within_m}")];
    Candidate { flags, rms_m: vec![closeness], closeness, random, judged: None }
}

fn plan(candidates: u64) -> Plan {
    Plan { candidates, seed: 1, seeds: vec![1, 2], judged: vec![3] }
}

#[test]
fn the_front_is_what_no_other_candidate_beats_in_everything() {
    let candidates = vec![
        candidate(1.0, 0, 0.04),
        candidate(0.9, 1, 0.05),
        candidate(1.1, 0, 0.05),
        candidate(0.9, 0, 0.06),
        candidate(0.9, 1, 0.05),
    ];
    let study = Study { plan: plan(5), candidates };
    let front: Vec<f64> = study.front().iter().map(|one| one.random.within_m).collect();
    // Equals beat one another in nothing.
    assert_eq!(front, [0.05, 0.06, 0.05, 0.04]);
}

#[test]
fn a_candidate_is_within_its_ranges_and_the_same_again() {
    for place in 1..200 {
        let flags = draw(7, place);
        assert_eq!(flags, draw(7, place));
        for (flag, Knob { key, least, most, .. }) in flags.iter().zip(KNOBS) {
            let value: f64 = flag.strip_prefix(&format!("{key}=")).unwrap().parse().unwrap();
            assert!((least..=most).contains(&value), "{flag}");
        }
        assert!(Scenario::load(SCENARIO, &overrides(&flags).unwrap()).is_ok(), "{flags:?}");
    }
    assert_ne!(draw(7, 1), draw(7, 2));
}

#[test]
fn the_shipped_set_is_tried_first_and_the_front_judged_by_other_flights() {
    let study = run(&plan(2), &|| ()).unwrap();
    let [shipped, other] = &study.candidates[..] else { panic!("{}", study.candidates.len()) };
    assert!(shipped.flags.is_empty() && (shipped.closeness - 1.0).abs() < 1e-15);
    assert!(shipped.rms_m.iter().zip(&other.rms_m).any(|(a, b)| (a - b).abs() > 1e-6));
    assert!(study.candidates.iter().all(|one| one.judged.is_some() == study.is_on_front(one)));
    assert!(report::to_json(&study)["candidates"][1]["random"]["lost"].is_u64());
}
