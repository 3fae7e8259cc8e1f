//! Each refusal, and its limits.

use super::*;

const T: Axis = Axis { name: "thrust T [N]", min: 0.0, max: 20.0 };
const TORQUE: Axis = Axis { name: "torque τx [N m]", min: -0.5, max: 0.5 };
const AXES: [Axis; 4] = [T, TORQUE, TORQUE, TORQUE];

/// The owner goes back and forth; the candidate adds to τx.
fn pair(k: u64, difference: impl Fn(f64) -> f64) -> Pair {
    let owner = if k.is_multiple_of(2) { 0.1 } else { -0.1 };
    Pair {
        effective_ns: k * 10_000_000,
        candidate: [10.0, owner + difference(owner), 0.0, 0.0],
        owner: [10.0, owner, 0.0, 0.0],
    }
}

fn fill(gate: &mut Gate, phase: Phase, instants: u64, difference: impl Fn(f64) -> f64) {
    for k in 0..instants {
        gate.compare(phase, &pair(k, &difference)).expect("a possible command");
    }
}

fn judged(limits: GateLimits, difference: impl Fn(f64) -> f64) -> Result<GateFigures, Refusal> {
    let mut gate = Gate::new(AXES, limits, false);
    fill(&mut gate, Phase::Free, 50, difference);
    gate.verdict()
}

#[test]
fn the_same_commands_pass_with_all_figures_at_nought() {
    let figures = judged(GateLimits::SAME_KIND, |_| 0.0).unwrap();
    assert_eq!((figures.free, figures.tracked, figures.missed), (50, 0, 0));
    assert!(figures.free_worst.iter().all(|worst| worst.value <= 0.0));
    assert!(
        (judged(GateLimits::OTHER_KIND, |_| 0.0).unwrap().slope[1].unwrap() - 1.0).abs() < 1e-12
    );
}

#[test]
fn the_same_kind_may_differ_by_one_percent_of_the_largest_command() {
    assert!(judged(GateLimits::SAME_KIND, |_| 0.0049).is_ok());
    let refusal = judged(GateLimits::SAME_KIND, |_| 0.0051).unwrap_err();
    let Refusal::TooFar { phase, axis, value, limit, at_ns } = refusal else { panic!("{refusal}") };
    assert_eq!((phase, axis, at_ns % 10_000_000), (Phase::Free, TORQUE.name, 0));
    assert!((value - 0.0102).abs() < 1e-12 && (limit - 0.01).abs() < 1e-12);
}

#[test]
fn another_kind_is_judged_one_step_ahead_at_its_worst_instant() {
    let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, true);
    fill(&mut gate, Phase::Tracking, 20, |_| 0.049);
    fill(&mut gate, Phase::Free, 20, |_| 0.0);
    assert!(gate.verdict().is_ok());
    gate.compare(Phase::Tracking, &pair(77, |_| 0.051)).unwrap();
    let refusal = gate.verdict().unwrap_err();
    assert!(
        matches!(refusal, Refusal::TooFar { phase: Phase::Tracking, at_ns: 770_000_000, .. }),
        "{refusal}"
    );
    assert!(refusal.to_string().contains("10.200 %"), "{refusal}");
}

#[test]
fn running_free_it_is_judged_on_the_whole_and_at_its_worst() {
    // ±12 % at each instant is 12 % rms.
    assert!(judged(GateLimits::OTHER_KIND, |u| 0.45 * u).is_ok(), "9 % rms");
    let refusal = judged(GateLimits::OTHER_KIND, |u| 0.6 * u).unwrap_err();
    assert!(matches!(refusal, Refusal::TooFarOnTheWhole { .. }), "{refusal}");
    let refusal = judged(GateLimits::OTHER_KIND, |_| 0.16).unwrap_err();
    assert!(matches!(refusal, Refusal::TooFar { phase: Phase::Free, .. }), "{refusal}");
}

#[test]
fn a_wrong_sign_and_a_wrong_gain_are_seen_in_the_slope_however_small_the_commands() {
    for (factor, fine) in
        [(-1.0, false), (0.1, false), (0.3, true), (1.0, true), (4.0, true), (10.0, false)]
    {
        let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, false);
        for k in 0..50 {
            let owner = if k % 2 == 0 { 1e-3 } else { -1e-3 };
            let pair = Pair {
                effective_ns: k,
                candidate: [10.0, factor * owner, 0.0, 0.0],
                owner: [10.0, owner, 0.0, 0.0],
            };
            gate.compare(Phase::Free, &pair).unwrap();
        }
        let verdict = gate.verdict();
        assert_eq!(verdict.is_ok(), fine, "{factor}: {verdict:?}");
        assert!(fine || verdict.unwrap_err().yields_to_force());
    }
}

#[test]
fn what_no_controller_may_do_is_told_at_once_and_never_forced() {
    for value in [f64::NAN, f64::INFINITY, 0.51, -0.51] {
        let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, false);
        let bad = Pair { effective_ns: 42, candidate: [10.0, 0.0, value, 0.0], owner: [10.0; 4] };
        let refusal = gate.compare(Phase::Free, &bad).unwrap_err();
        assert!(!refusal.yields_to_force());
        assert!(matches!(
            refusal,
            Refusal::NotFinite { at_ns: 42, .. } | Refusal::OutOfBounds { at_ns: 42, .. }
        ));
        fill_after(&mut gate);
        assert!(gate.verdict().is_err(), "and it is not forgotten");
    }
}

fn fill_after(gate: &mut Gate) {
    for k in 0..50 {
        let _ = gate.compare(Phase::Free, &pair(k, |_| 0.0));
    }
}

#[test]
fn an_owner_that_is_not_finite_is_nothing_to_compare_with() {
    let mut gate = Gate::new(AXES, GateLimits::SAME_KIND, false);
    let pair = Pair { effective_ns: 1, candidate: [10.0, 0.0, 0.0, 0.0], owner: [f64::NAN; 4] };
    assert_eq!(gate.compare(Phase::Free, &pair), Ok(()));
    assert_eq!(gate.figures().free, 0);
}

#[test]
fn a_missed_deadline_and_too_short_a_shadow_are_reasons_too() {
    let mut gate = Gate::new(AXES, GateLimits::SAME_KIND, false);
    fill(&mut gate, Phase::Free, 9, |_| 0.0);
    let few = Refusal::TooFew { phase: Phase::Free, seen: 9, limit: 10 };
    assert_eq!(gate.verdict(), Err(few));
    gate.miss(17);
    gate.miss(18);
    assert_eq!(gate.verdict(), Err(Refusal::MissedDeadlines { missed: 2, limit: 0, at_ns: 17 }));
    let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, true);
    fill(&mut gate, Phase::Free, 50, |_| 0.0);
    assert!(matches!(gate.verdict(), Err(Refusal::TooFew { phase: Phase::Tracking, .. })));
}
