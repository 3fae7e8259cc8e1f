use nalgebra::Vector3;
use proptest::prelude::*;
use shared_types::Quaternion;

use super::*;

const MS: u64 = 1_000_000;

fn gate() -> Gate {
    Gate::new(&GateConfig::default(), &VehicleParameters::default()).unwrap()
}

fn command(effective_ns: u64) -> Command {
    Command {
        wrench: Wrench { thrust_n: 1.3, torque_b_nm: Vector3::new(0.004, -0.003, 0.0005) },
        effective_ns,
        validity_ns: 20 * MS,
    }
}

/// Of those that may be followed.
fn newest(gate: &mut Gate, now_ns: u64, commands: &[Command]) -> Option<Command> {
    let judged = commands.iter().filter_map(|command| gate.judge(now_ns, command));
    judged.max_by_key(|command| command.effective_ns)
}

fn tick(gate: &mut Gate, now_ns: u64, commands: &[Command]) -> GateOutput {
    let reading = ImuSample {
        gyro_b_rad_s: Vector3::zeros(),
        specific_force_b_m_s2: Vector3::new(0.0, 0.0, 9.81),
        saturated: false,
    };
    let command = newest(gate, now_ns, commands);
    gate.tick(&GateInput {
        now_ns,
        command,
        is_revoked: false,
        tripped: false,
        led_astray: false,
        unproven: None,
        reading: Some(reading),
        morph_angle_rad: 1.0,
        estimate: None,
        reference: None,
    })
}

/// Ticks of 1 ms without commands over [from, until), which is not empty.
fn silence(gate: &mut Gate, from_ms: u64, until_ms: u64) -> GateOutput {
    (from_ms + 1..until_ms).fold(tick(gate, from_ms * MS, &[]), |_, ms| tick(gate, ms * MS, &[]))
}

#[test]
fn it_starts_in_hover_and_waits_20_ms_for_the_first_command() {
    let mut gate = gate();
    let first = tick(&mut gate, 0, &[]);
    let weight = VehicleParameters::default().weight_n();
    assert_eq!((first.mode, first.wrench), (Mode::Normal, Wrench::thrust(weight)));
    assert_eq!(silence(&mut gate, 1, 20).mode, Mode::Normal);
    assert_eq!(tick(&mut gate, 20 * MS, &[]).mode, Mode::Hold { since_ns: 20 * MS });
}

#[test]
fn without_commands_it_holds_the_last_then_levels_then_descends_then_cuts_for_good() {
    let mut gate = gate();
    let last = command(5 * MS);
    let taken = tick(&mut gate, 5 * MS, &[last]);
    assert_eq!((taken.mode, taken.wrench), (Mode::Normal, last.wrench));

    let normal = silence(&mut gate, 6, 25);
    assert_eq!((normal.mode, normal.wrench), (Mode::Normal, last.wrench));
    let hold = silence(&mut gate, 25, 45);
    assert_eq!((hold.mode, hold.wrench), (Mode::Hold { since_ns: 25 * MS }, last.wrench));
    let level = silence(&mut gate, 45, 2045);
    let weight = VehicleParameters::default().weight_n();
    assert!(matches!(level.mode, Mode::Level { since_ns, .. } if since_ns == 45 * MS));
    assert_eq!(level.wrench, Wrench::thrust(weight));
    // The readings show that it does not sink.
    let descent = silence(&mut gate, 2045, 6045);
    assert_eq!((descent.mode, descent.wrench), (level.mode, Wrench::thrust(0.9 * weight)));
    let cut = tick(&mut gate, 6045 * MS, &[]);
    assert_eq!((cut.mode, cut.wrench), (Mode::Cut, Wrench::thrust(0.0)));
    let late = tick(&mut gate, 6046 * MS, &[command(6046 * MS)]);
    assert_eq!((late.mode, late.wrench), (Mode::Cut, Wrench::thrust(0.0)));
    assert_eq!(late.counters.safe_mode_episodes, 1);
}

#[test]
fn a_fast_controller_is_held_for_two_of_its_own_periods_only() {
    let mut gate = gate();
    let fast = Command { validity_ns: 4 * MS, ..command(0) };
    tick(&mut gate, 0, &[fast]);
    assert_eq!(silence(&mut gate, 1, 8).mode, Mode::Hold { since_ns: 4 * MS });
    assert!(matches!(tick(&mut gate, 8 * MS, &[]).mode, Mode::Level { .. }));
}

#[test]
fn a_valid_command_ends_hold_and_level_and_each_episode_counts_once() {
    let mut gate = gate();
    tick(&mut gate, 0, &[command(0)]);
    silence(&mut gate, 1, 30);
    let back = tick(&mut gate, 30 * MS, &[command(30 * MS)]);
    assert_eq!((back.mode, back.counters.safe_mode_episodes), (Mode::Normal, 1));
    silence(&mut gate, 31, 500);
    let back = tick(&mut gate, 500 * MS, &[command(499 * MS)]);
    assert_eq!((back.mode, back.counters.safe_mode_episodes), (Mode::Normal, 2));
}

#[test]
fn refused_commands_are_counted_by_kind_and_do_not_prolong_anything() {
    let mut gate = gate();
    tick(&mut gate, 0, &[command(0)]);
    let mut last = None;
    for now_ns in (1..60).map(|ms| ms * MS) {
        let good = command(now_ns);
        let refused = [
            Command { wrench: Wrench::thrust(f64::NAN), ..good },
            Command { wrench: Wrench::thrust(-0.1), ..good },
            Command { effective_ns: now_ns + 1, ..good },
        ];
        last = Some(tick(&mut gate, now_ns, &refused));
    }
    let last = last.unwrap();
    assert!(matches!(last.mode, Mode::Level { .. }));
    let expected = GateCounters {
        refused_wrong_owner: 0,
        refused_not_finite: 59,
        refused_out_of_range: 59,
        refused_out_of_time: 59,
        reduced: 0,
        bad_readings: 0,
        safe_mode_episodes: 1,
    };
    assert_eq!(last.counters, expected);
}

#[test]
fn an_unproven_owner_gets_what_the_laws_of_its_slot_may_ask_for() {
    let vehicle = VehicleParameters::default();
    let weight_n = vehicle.weight_n();
    let range = UnprovenRange {
        believed: vehicle,
        thrust_n: [0.2 * weight_n, 2.1 * weight_n],
        tilt_rad: 1.0,
    };
    let mut gate = gate();
    let mut judge = |thrust_n: f64, torque_b_nm: [f64; 3]| {
        let wrench = Wrench { thrust_n, torque_b_nm: torque_b_nm.into() };
        let judged = gate.judge_unproven(0, &Command { wrench, ..command(0) }, &range);
        (judged.map(|judged| judged.wrench), gate.counters)
    };
    let lawful = vehicle.torque_bound_nm(MorphAngle::MIN, weight_n);
    let (kept, counters) = judge(weight_n, lawful.into());
    assert_eq!(kept, Some(Wrench { thrust_n: weight_n, torque_b_nm: lawful }));
    assert_eq!(counters, GateCounters::default());

    // More than rotors give, on every axis: nothing is refused.
    let (reduced, counters) = judge(9.0 * weight_n, [1.0, -1.0, 1.0]);
    let reduced = reduced.unwrap();
    assert!((reduced.thrust_n / weight_n - 2.1).abs() < 1e-12);
    let shares = reduced.torque_b_nm.component_div(&lawful);
    assert!((shares - Vector3::new(1.05, -1.05, 1.05)).amax() < 1e-12, "{shares}");
    assert_eq!(counters, GateCounters { reduced: 1, ..GateCounters::default() });

    for not_finite in [f64::NAN, f64::INFINITY] {
        assert_eq!(judge(not_finite, [0.0; 3]).0, None);
        assert_eq!(judge(weight_n, [0.0, not_finite, 0.0]).0, None);
    }
}

#[test]
fn a_command_older_than_the_last_owners_counts_if_it_is_the_fallbacks() {
    let mut gate = gate();
    tick(&mut gate, 3 * MS, &[command(3 * MS)]);
    let fallback = Command { wrench: Wrench::thrust(1.0), ..command(2 * MS) };
    assert_eq!(tick(&mut gate, 4 * MS, &[fallback]).wrench, fallback.wrench);
    assert_eq!(tick(&mut gate, 22 * MS, &[]).mode, Mode::Hold { since_ns: 22 * MS });
}

#[test]
fn between_two_commands_in_range_nothing_is_refused_and_nothing_leaves_the_range() {
    let mut gate = gate();
    let wrench = Wrench { thrust_n: -0.3, torque_b_nm: Vector3::new(9.0, 0.0, 0.0) };
    let command = Some(Command { wrench, ..command(0) });
    let output = gate.tick(&GateInput {
        now_ns: 0,
        command,
        is_revoked: false,
        tripped: false,
        led_astray: false,
        unproven: None,
        reading: None,
        morph_angle_rad: 1.0,
        estimate: None,
        reference: None,
    });
    assert_eq!(output.wrench.thrust_n.to_bits(), 0.0_f64.to_bits());
    assert!((0.01..1.0).contains(&output.wrench.torque_b_nm.x), "{:?}", output.wrench);
    assert_eq!((output.mode, output.counters), (Mode::Normal, GateCounters::default()));
}

#[test]
fn a_damaged_memory_cuts_instead_of_flying_on_nan() {
    let mut gate = gate();
    let mut memory = gate.memory();
    memory.wrench[2] = f64::NAN;
    gate.restore(&memory);
    let output = tick(&mut gate, 0, &[]);
    assert_eq!((output.mode, output.wrench), (Mode::Cut, Wrench::thrust(0.0)));
}

#[test]
fn limits_that_are_no_numbers_are_refused_by_name() {
    let refused = |toml: &str| {
        let config: GateConfig = toml::from_str(toml).unwrap();
        Gate::new(&config, &VehicleParameters::default()).unwrap_err().to_string()
    };
    assert!(refused("level_max_s = nan").contains("level_max_s"));
    assert!(refused("hold_max_s = -0.02").contains("hold_max_s"));
    assert!(refused("thrust_range_weights = inf").contains("thrust_range_weights"));
    assert!(toml::from_str::<GateConfig>("hold_s = 0.02").is_err());
    let vehicle = VehicleParameters { mass_kg: f64::NAN, ..VehicleParameters::default() };
    assert!(Gate::new(&GateConfig::default(), &vehicle).is_err());
}

/// Any bit pattern, with the troublesome ones as often as the harmless.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(-0.0)],
        -2.0..6.0,
    ]
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    [number(), number(), number()].prop_map(Vector3::from)
}

fn any_command() -> impl Strategy<Value = Command> {
    let times = (0..60 * MS, prop_oneof![Just(u64::MAX), Just(0), 0..30 * MS]);
    (number(), vector(), times).prop_map(|(thrust_n, torque_b_nm, (effective_ns, validity_ns))| {
        Command {
            // Small enough for some to be accepted.
            wrench: Wrench { thrust_n, torque_b_nm: torque_b_nm * 1e-3 },
            effective_ns,
            validity_ns,
        }
    })
}

fn any_reading() -> impl Strategy<Value = Option<ImuSample>> {
    prop::option::of((vector(), vector()).prop_map(|(gyro_b_rad_s, specific_force_b_m_s2)| {
        ImuSample { gyro_b_rad_s, specific_force_b_m_s2, saturated: false }
    }))
}

type AnyTick = (Vec<Command>, Option<ImuSample>, f64, u64);

fn any_tick() -> impl Strategy<Value = AnyTick> {
    (prop::collection::vec(any_command(), 0..3), any_reading(), number(), 0..20 * MS)
}

proptest! {
    #[test]
    fn no_garbage_reaches_a_rotor(ticks in prop::collection::vec(any_tick(), 1..40)) {
        let vehicle = VehicleParameters::default();
        let (mut gate, mut twin) = (gate(), gate());
        let range = UnprovenRange { believed: vehicle, thrust_n: [0.2, 2.4], tilt_rad: 1.0 };
        let (mut now_ns, mut was_cut) = (0, false);
        for (commands, reading, morph_angle_rad, step_ns) in &ticks {
            now_ns += step_ns;
            // Whatever gets past the judge must not get past the gate.
            let unjudged = commands.first().copied().filter(|_| now_ns % 2 == 0);
            let command = newest(&mut gate, now_ns, commands).or(unjudged);
            // Whatever is believed, and wherever the vehicle is to be.
            let (believed, wanted) = commands.first().zip(commands.last()).map_or_else(
                Default::default,
                |(a, b)| (1e3 * a.wrench.torque_b_nm, 1e3 * b.wrench.torque_b_nm),
            );
            let mut reference = Reference { count: now_ns % 60, ..Reference::default() };
            reference.points[0].position_w_m = wanted.into();
            let estimate = StateEstimate {
                described_ns: now_ns.saturating_sub(7 * MS),
                body_rate_b_rad_s: wanted.into(),
                accelerometer_bias_b_m_s2: believed.into(),
                position_w_m: believed.into(),
                velocity_w_m_s: wanted.into(),
                q_wb: Quaternion::from_array([*morph_angle_rad, 0.5, believed.x, 0.5]),
                ..StateEstimate::default()
            };
            let input = GateInput {
                now_ns,
                command,
                is_revoked: now_ns % 11 == 0,
                tripped: now_ns % 7 == 0,
                led_astray: now_ns % 11 == 0,
                unproven: Some(&range).filter(|_| now_ns % 3 == 0),
                reading: *reading,
                morph_angle_rad: *morph_angle_rad,
                estimate: Some(&estimate).filter(|_| now_ns % 13 > 0),
                reference: Some(&reference).filter(|_| now_ns % 5 > 0),
            };
            twin.restore(&gate.memory());
            let output = gate.tick(&input);
            prop_assert_eq!(output, twin.tick(&input));
            prop_assert_eq!(gate.memory(), twin.memory());

            prop_assert!(output.wrench.is_finite());
            prop_assert!((0.0..=4.0 * vehicle.weight_n()).contains(&output.wrench.thrust_n));
            let allocation = vehicle.allocator(MorphAngle::MIN).allocate(&output.wrench);
            let thrusts = allocation.map(|a| a.rotor_thrust_n);
            prop_assert!(thrusts.is_some_and(|thrusts| thrusts
                .iter()
                .all(|f| (0.0..=vehicle.rotor_thrust_max_n).contains(f))));
            prop_assert!(!was_cut || output.mode == Mode::Cut);
            was_cut = output.mode == Mode::Cut;
        }
    }
}

#[test]
fn a_tick_allocates_nothing() {
    let mut gate = gate();
    let count = allocation_counter::measure(|| {
        for ms in 0..3000 {
            let output = tick(&mut gate, ms * MS, &[command(ms.min(100) * MS)]);
            assert!(output.wrench.is_finite());
        }
    });
    assert_eq!(count.count_total, 0);
}
