use super::*;

fn plan() -> Plan {
    let overrides = ["scenario.duration_s=3"].map(|flag| Override::set(flag).unwrap());
    Plan {
        scenario: "hover".to_owned(),
        overrides: overrides.to_vec(),
        flags: String::new(),
        points: 7,
        halvings: 6,
    }
}

#[test]
fn steps_are_on_time_up_to_what_the_edges_of_a_loop_allow() {
    let study = fly(&plan(), &|| ()).unwrap();
    let of = |role: Role| {
        let sweep = study.sweeps.iter().find(|s| s.role == role && s.kind == Kind::Step).unwrap();
        sweep.limits_s.map(Option::unwrap)
    };
    let near = |time_s: f64, expected_s: f64| (0.95..=1.001).contains(&(time_s / expected_s));
    // What reads an estimate waits 0.5 ms for it. The plant's step after the instant at which a command is in effect is
    // 2 ms after its release, and the attitude loop's after that of a set point 10 ms.
    assert!(near(of(Role::Estimator)[0], 0.5e-3), "{:?}", of(Role::Estimator));
    assert!(near(of(Role::Attitude)[0], 2e-3), "{:?}", of(Role::Attitude));
    assert!(near(of(Role::Position)[0], 10e-3), "{:?}", of(Role::Position));
    for role in LOOPS {
        let [on_time_s, passes_s, survives_s] = of(role);
        assert!(on_time_s <= passes_s && passes_s <= survives_s, "{role:?}: {:?}", of(role));
    }
    // The plant holds a command for two periods.
    assert!((0.005..0.05).contains(&of(Role::Attitude)[1]), "{:?}", of(Role::Attitude));
    let stable_s = study.predicted_s.unwrap();
    assert!((0.002..0.02).contains(&stable_s), "{stable_s}");
}

#[test]
fn a_scenario_with_timing_of_its_own_is_refused() {
    let timing = Override::timing("attitude:step=1ms").unwrap();
    let plan = Plan { overrides: vec![timing], ..plan() };
    assert!(matches!(fly(&plan, &|| ()), Err(TimingError::Timed)));
}
