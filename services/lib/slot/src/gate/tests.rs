//! Each refusal, and its limits.

use super::*;

const T: Axis = Axis { name: "thrust T [N]", min: 0.0, max: 20.0 };
const TORQUE: Axis = Axis { name: "torque τx [N m]", min: -0.5, max: 0.5 };
const AXES: [Axis; 4] = [T, TORQUE, TORQUE, TORQUE];
const U_MAX: [f64; 4] = [20.0, 0.5, 0.5, 0.5];

/// The owner goes back and forth, six samples each way; the candidate adds to τx.
fn pair(k: u64, difference: impl Fn(f64) -> f64) -> Pair {
    let owner = if (k / 6).is_multiple_of(2) { 0.1 } else { -0.1 };
    Pair {
        effective_ns: k * 10_000_000,
        candidate: [10.0, owner + difference(owner), 0.0, 0.0],
        owner: [10.0, owner, 0.0, 0.0],
        u_max: U_MAX,
    }
}

fn fill(gate: &mut Gate, phase: Phase, instants: u64, difference: impl Fn(f64) -> f64) {
    for k in 0..instants {
        gate.compare(phase, &pair(k, &difference)).expect("a possible command");
    }
}

fn judged(limits: GateLimits, difference: impl Fn(f64) -> f64) -> Result<GateFigures, Refusal> {
    let mut gate = Gate::new(AXES, limits, false);
    fill(&mut gate, Phase::Free, 120, difference);
    gate.verdict()
}

#[test]
fn the_same_commands_pass_with_all_figures_at_nought() {
    let figures = judged(GateLimits::SAME_KIND, |_| 0.0).unwrap();
    assert_eq!((figures.free, figures.tracked, figures.missed), (120, 0, 0));
    assert!(figures.free_worst.iter().all(|worst| worst.value <= 0.0));
    let slope = judged(GateLimits::OTHER_KIND, |_| 0.0).unwrap().slope;
    assert!((slope[1].unwrap().value - 1.0).abs() < 1e-12 && slope[2].is_none(), "{slope:?}");
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
fn another_kind_may_differ_the_more_the_more_the_owner_does() {
    // A busy owner: a standard deviation of 20 %, 20 % at most.
    let busy = |off: f64| judged(GateLimits::OTHER_KIND, |u| off * u);
    assert!(busy(1.7).is_ok(), "34 % rms of 10 % and 30 %");
    let quiet = |difference: f64, phase: Phase| {
        let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, phase == Phase::Tracking);
        for k in 0..60 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let mut pair = Pair {
                effective_ns: k * 10_000_000,
                candidate: [10.0, 0.0, 0.0, 0.0],
                owner: [10.0, 0.0, 0.0, 0.0],
                u_max: U_MAX,
            };
            gate.compare(Phase::Free, &pair).unwrap();
            pair.candidate[1] = sign * difference;
            gate.compare(phase, &pair).unwrap();
        }
        gate.verdict()
    };
    for phase in [Phase::Tracking, Phase::Free] {
        assert!(quiet(0.049, phase).is_ok());
    }
    let refusal = quiet(0.051, Phase::Tracking).unwrap_err();
    assert!(
        matches!(refusal, Refusal::TooFarOnTheWhole { phase: Phase::Tracking, .. }),
        "{refusal}"
    );
    assert!(refusal.to_string().contains("10.200 %"), "{refusal}");
    let refusal = quiet(0.16, Phase::Tracking).unwrap_err();
    assert!(matches!(refusal, Refusal::TooFar { phase: Phase::Tracking, .. }), "{refusal}");
}

#[test]
fn what_lasts_may_be_half_of_what_comes_and_goes() {
    assert!(judged(GateLimits::OTHER_KIND, |_| 0.024).is_ok());
    for off in [0.026, -0.026] {
        let refusal = judged(GateLimits::OTHER_KIND, |_| off).unwrap_err();
        assert!(matches!(refusal, Refusal::TooFarOnAverage { .. }), "{refusal}");
        assert!(refusal.yields_to_force());
    }
}

#[test]
fn in_realtime_a_moment_of_difference_is_pardoned_once_in_half_a_second() {
    let with = |limits: GateLimits, moments: u64| {
        let mut gate = Gate::new(AXES, limits, false);
        for k in 0..50 {
            // Each lasts three instants.
            let off = if k / 10 < moments && k % 10 < 3 { 0.02 } else { 0.0 };
            gate.compare(Phase::Free, &pair(k, |_| off)).unwrap();
        }
        gate.verdict()
    };
    let patient = GateLimits { rms: 0.1, ..GateLimits::SAME_KIND.patient() };
    assert!(with(patient, 2).is_ok());
    assert!(with(patient, 3).is_err());
    assert!(with(GateLimits { rms: 0.1, ..GateLimits::SAME_KIND }, 1).is_err());
}

#[test]
fn a_user_may_allow_more_or_less() {
    let within = |limits: GateLimits, bump: f64, off: f64| judged(limits.within(bump), |_| off);
    assert!(within(GateLimits::SAME_KIND, 0.05, 0.024).is_ok());
    assert!(within(GateLimits::SAME_KIND, 0.05, 0.026).is_err());
    assert!(within(GateLimits::OTHER_KIND, 0.01, 0.002).is_ok());
    assert!(within(GateLimits::OTHER_KIND, 0.01, 0.003).is_err());
}

#[test]
fn a_wrong_sign_and_a_wrong_gain_are_seen_in_the_slope_however_small_the_commands() {
    for (factor, fine) in [
        (-1.0, false),
        (0.0, false),
        (0.05, false),
        (0.3, true),
        (1.0, true),
        (2.5, true),
        (3.0, false),
    ] {
        let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, false);
        for k in 0..120 {
            let owner = if (k / 6) % 2 == 0 { 1e-3 } else { -1e-3 };
            let pair = Pair {
                effective_ns: k * 10_000_000,
                candidate: [10.0, factor * owner, 0.0, 0.0],
                owner: [10.0, owner, 0.0, 0.0],
                u_max: U_MAX,
            };
            gate.compare(Phase::Free, &pair).unwrap();
        }
        let verdict = gate.verdict();
        assert_eq!(verdict.is_ok(), fine, "{factor}: {verdict:?}");
        assert!(fine || verdict.unwrap_err().yields_to_force());
    }
}

#[test]
fn what_no_controller_may_do_is_refused_at_once_and_never_forced() {
    for value in [f64::NAN, f64::INFINITY, 0.51, -0.51] {
        let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, false);
        let candidate = [10.0, 0.0, value, 0.0];
        let bad = Pair { effective_ns: 42, candidate, owner: [10.0; 4], u_max: U_MAX };
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
    let candidate = [10.0, 0.0, 0.0, 0.0];
    let pair = Pair { effective_ns: 1, candidate, owner: [f64::NAN; 4], u_max: U_MAX };
    assert_eq!(gate.compare(Phase::Free, &pair), Ok(()));
    assert_eq!(gate.figures().free, 0);
}

#[test]
fn a_missed_deadline_and_too_short_a_shadow_are_reasons_too() {
    let mut gate = Gate::new(AXES, GateLimits::SAME_KIND, false);
    fill(&mut gate, Phase::Free, 9, |_| 0.0);
    let few = Refusal::TooFew { phase: Phase::Free, seen: 9, limit: 10 };
    assert_eq!(gate.verdict(), Err(few));
    gate.misses(0, 0, 16);
    gate.misses(1, 0, 17);
    gate.misses(2, 1, 18);
    assert_eq!(gate.verdict(), Err(Refusal::MissedDeadlines { missed: 2, limit: 1, at_ns: 17 }));
    let mut gate = Gate::new(AXES, GateLimits::OTHER_KIND, true);
    fill(&mut gate, Phase::Free, 50, |_| 0.0);
    assert!(matches!(gate.verdict(), Err(Refusal::TooFew { phase: Phase::Tracking, .. })));
}
