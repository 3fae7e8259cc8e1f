#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use proptest::prelude::*;
use serde::Deserialize;

use super::*;
use core::f64::consts::TAU;

#[derive(Debug, Deserialize)]
struct Scenario {
    disturbance_injector: InjectorConfig,
}

/// An injector from the entries of a script, without their headers.
fn injector(rate_hz: u32, entries: &[&str], seed: u64) -> Result<Injector, String> {
    let header = "\n[[disturbance_injector.script]]\n";
    let script: String = entries.iter().flat_map(|entry| [header, entry]).collect();
    let text = format!("[disturbance_injector]\nrate_hz = {rate_hz}\n{script}");
    let scenario: Scenario = toml::from_str(&text).map_err(|e| e.to_string())?;
    Injector::new(&scenario.disturbance_injector, seed).map_err(|e| e.to_string())
}

fn play(rate_hz: u32, entries: &[&str], seed: u64, time_s: u64) -> Vec<Disturbance> {
    let mut injector = injector(rate_hz, entries, seed).unwrap();
    let releases = (0..time_s * u64::from(rate_hz)).map(|k| k * 1_000_000_000 / u64::from(rate_hz));
    releases.map(|now_ns| injector.step(now_ns)).collect()
}

/// Indices of the samples in which `channel` is not zero.
fn hits(samples: &[Disturbance], channel: impl Fn(&Disturbance) -> f64) -> Vec<usize> {
    (0..samples.len()).filter(|i| channel(&samples[*i]) != 0.0).collect()
}

const WIND: &str = "kind = 'wind'\nmean_w_m_s = [1.5, 0.5, 0.0]\nsigma_m_s = [0.7, 0.7, 0.35]";

#[test]
fn an_empty_script_is_calm_at_200_hz() {
    let config: InjectorConfig = toml::from_str("").unwrap();
    assert_eq!(config.rate_hz.to_bits(), 200.0_f64.to_bits());
    let mut injector = Injector::new(&config, 1).unwrap();
    assert_eq!(injector.step(0), Disturbance::CALM);
}

#[test]
fn constant_loads_add_up_on_every_channel() {
    let entries = [
        "kind = 'constant'\nload = { force_w_n = [0.15, -0.10, -0.20] }",
        "kind = 'constant'\nload = { force_w_n = [0.05, 0.0, 0.0], torque_b_nm = [0.0, 0.0, 0.002] }",
        "kind = 'constant'\nload = { wind_w_m_s = [1.0, 0.0, 0.0] }",
    ];
    for sample in play(200, &entries, 1, 1) {
        let expected = Disturbance {
            force_w_n: [0.15 + 0.05, -0.10, -0.20],
            torque_b_nm: [0.0, 0.0, 0.002],
            wind_w_m_s: [1.0, 0.0, 0.0],
            ..Disturbance::CALM
        };
        assert_eq!(sample, expected);
    }
}

#[test]
fn a_step_acts_from_its_first_instant_until_before_its_last() {
    let entry = "kind = 'step'\nat_s = 0.5\nuntil_s = 0.75\nload = { force_w_n = [0.0, 0.0, 1.0] }";
    let samples = play(200, &[entry], 1, 1);
    assert_eq!(hits(&samples, |s| s.force_w_n[2]), (100..150).collect::<Vec<_>>());
    let endless = "kind = 'step'\nat_s = 0.5\nload = { force_w_n = [0.0, 0.0, 1.0] }";
    assert_eq!(hits(&play(200, &[endless], 1, 1), |s| s.force_w_n[2]).len(), 100);
}

#[test]
fn a_pulse_or_kick_hits_exactly_one_sample_at_any_rate_and_instant() {
    for rate_hz in [50, 150, 200, 1000] {
        for at_s in ["0.0", "0.3", "0.30001", "0.333333333"] {
            let pulse = format!(
                "kind = 'pulse'\nat_s = {at_s}\nload = {{ torque_b_nm = [1.0, 0.0, 0.0] }}"
            );
            let kick = format!("kind = 'kick'\nat_s = {at_s}\nbody_rate_b_rad_s = [0.0, 2.0, 0.0]");
            let samples = play(rate_hz, &[&pulse, &kick], 1, 1);
            let hit = hits(&samples, |s| s.torque_b_nm[0]);
            assert_eq!(hit, hits(&samples, |s| s.body_rate_kick_b_rad_s[1]));
            let at: f64 = at_s.parse().unwrap();
            // The first release at or after the instant; half a nanosecond is rounding.
            let expected = (at * f64::from(rate_hz) - 1e-6).ceil().max(0.0);
            assert_eq!(hit.iter().map(|i| *i as f64).collect::<Vec<_>>(), [expected]);
        }
    }
}

#[test]
fn a_pulse_with_a_duration_acts_for_it_and_a_short_one_is_not_lost() {
    let pulse = |duration: &str| {
        format!(
            "kind = 'pulse'\nat_s = 0.302\nduration_s = {duration}\nload = {{ force_w_n = [1.0, 0.0, 0.0] }}"
        )
    };
    let count = |duration| hits(&play(200, &[&pulse(duration)], 1, 1), |s| s.force_w_n[0]);
    assert_eq!(count("0.1"), (61..81).collect::<Vec<_>>());
    assert_eq!(count("0.001"), [61]);
}

#[test]
fn a_sine_and_a_ramp_follow_their_formulas() {
    let sine = "kind = 'sine'\nat_s = 0.25\nuntil_s = 0.75\nfrequency_hz = 3.0\nphase_rad = 0.5\nload = { force_w_n = [2.0, 0.0, 0.0] }";
    let ramp =
        "kind = 'ramp'\nat_s = 0.2\nuntil_s = 0.6\nload = { torque_b_nm = [0.0, 0.0, 0.04] }";
    for (k, sample) in (0..).zip(play(200, &[sine, ramp], 1, 1)) {
        let t = f64::from(k) / 200.0;
        let wave = 2.0 * (TAU * 3.0 * (t - 0.25) + 0.5).sin();
        let force = if (0.25..0.75).contains(&t) { wave } else { 0.0 };
        assert!((sample.force_w_n[0] - force).abs() < 1e-12);
        let torque = 0.04 * ((t - 0.2) / 0.4).clamp(0.0, 1.0);
        assert!((sample.torque_b_nm[2] - torque).abs() < 1e-12);
    }
}

#[test]
fn rd_is_a_tenth_of_a_newton_metre_for_one_control_period() {
    let entry = "kind = 'rd'\nat_s = 0.3\nrd = [1.0, 1.0, 0.1]";
    let samples = play(200, &[entry], 1, 1);
    assert_eq!(hits(&samples, |s| s.torque_b_nm[0]), [60, 61]);
    let torque = samples[60].torque_b_nm;
    for (measured, expected) in torque.into_iter().zip([0.1, 0.1, 0.01]) {
        assert!((measured - expected).abs() < 1e-12);
    }
}

#[test]
fn the_impulse_of_rd_is_the_same_at_every_rate() {
    let entry = "kind = 'rd'\nat_s = 0.3033\nduration_s = 0.01\nrd = [1.0, -2.0, 0.1]";
    for rate_hz in [30, 50, 100, 150, 200, 333, 1000] {
        let samples = play(rate_hz, &[entry], 1, 1);
        for (axis, expected) in [1e-3, -2e-3, 1e-4].into_iter().enumerate() {
            let sum: f64 = samples.iter().map(|s| s.torque_b_nm[axis]).sum();
            assert!((sum / f64::from(rate_hz) - expected).abs() < 1e-15, "{rate_hz} Hz");
        }
    }
}

#[test]
fn a_random_rd_is_normal_with_a_tenth_of_the_spread_in_yaw() {
    let entry = "kind = 'rd'\nat_s = 0.0\nduration_s = 0.005";
    let count = 5000;
    let mut squares = [0.0; 3];
    for seed in 0..count {
        let torque = injector(200, &[entry], seed).unwrap().step(0).torque_b_nm;
        for (sum, x) in squares.iter_mut().zip(torque) {
            *sum += x * x / count as f64;
        }
    }
    for (square, sigma) in squares.into_iter().zip([0.1, 0.1, 0.01]) {
        // 5000 draws: the deviation is known to 1 %.
        assert!((square.sqrt() / sigma - 1.0).abs() < 0.04, "{}", square.sqrt());
    }
}

#[test]
fn a_payload_is_picked_up_and_dropped_and_rotors_lose_and_regain_thrust() {
    let entries = [
        "kind = 'payload'\nat_s = 0.2\nuntil_s = 0.6\nmass_kg = 0.03",
        "kind = 'payload'\nat_s = 0.4\nmass_kg = 0.01",
        "kind = 'rotor_efficiency'\nat_s = 0.5\nuntil_s = 0.8\nrotor = 4\nefficiency = 0.5",
        "kind = 'rotor_efficiency'\nat_s = 0.7\nrotor = 4\nefficiency = 0.8",
    ];
    let samples = play(10, &entries, 1, 1);
    let payload: Vec<f64> = samples.iter().map(|s| (s.payload_kg * 1e3).round()).collect();
    assert_eq!(payload, [0.0, 0.0, 30.0, 30.0, 40.0, 40.0, 10.0, 10.0, 10.0, 10.0]);
    let rotor: Vec<f64> = samples.iter().map(|s| s.rotor_efficiency[3]).collect();
    assert_eq!(rotor, [1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.4, 0.8, 0.8]);
    assert!(samples.iter().all(|s| s.rotor_efficiency[..3] == [1.0; 3]));
}

#[test]
fn the_seed_decides_and_an_appended_event_leaves_the_others_as_they_were() {
    let bits = |entries: &[&str], seed| {
        let samples = play(200, entries, seed, 2);
        samples.iter().map(|s| s.wind_w_m_s.map(f64::to_bits)).collect::<Vec<_>>()
    };
    let alone = bits(&[WIND], 5);
    assert_eq!(alone, bits(&[WIND], 5));
    assert_ne!(alone, bits(&[WIND], 6));
    assert_eq!(alone, bits(&[WIND, "kind = 'rd'\nat_s = 0.5"], 5));
    // The same event at another place gusts differently: the sum is not twice the one.
    let twice = play(200, &[WIND, WIND], 5, 2);
    let single = play(200, &[WIND], 5, 2);
    let differ = |(a, b): (&Disturbance, &Disturbance)| {
        (a.wind_w_m_s[0] - 2.0 * b.wind_w_m_s[0]).abs() > 1e-3
    };
    assert!(twice.iter().zip(&single).filter(|pair| differ(*pair)).count() > 390);
}

#[test]
fn a_restored_injector_continues_bit_for_bit_and_a_step_allocates_nothing() {
    let entries = [
        WIND,
        "kind = 'rd'\nat_s = 0.5\nduration_s = 0.1",
        "kind = 'pulse'\nat_s = 0.7\nload = { force_w_n = [1.0, 0.0, 0.0] }",
        "kind = 'sine'\nfrequency_hz = 2.0\nload = { force_w_n = [0.1, 0.0, 0.0] }",
    ];
    let mut first = injector(200, &entries, 5).unwrap();
    let mut twin = injector(200, &entries, 99).unwrap();
    let count = allocation_counter::measure(|| {
        for now_ns in (0..200).map(|k| k * 5_000_000) {
            twin.restore(&first.memory());
            assert_eq!(first.step(now_ns), twin.step(now_ns));
            assert_eq!(first.memory(), twin.memory());
        }
    });
    assert_eq!(count.count_total, 0);
}

#[test]
fn a_fault_added_in_flight_begins_at_its_instant_and_leaves_the_rest_alone() {
    let fault = "kind = 'rotor_efficiency'\nat_s = 1.0\nrotor = 2\nefficiency = 0.5";
    let kick =
        |at_s: &str| format!("kind = 'kick'\nat_s = {at_s}\nbody_rate_b_rad_s = [1.0, 0.0, 0.0]");
    let (past, due) = (kick("0.1"), kick("0.75"));
    let mut plain = injector(200, &[WIND], 5).unwrap();
    for now_ns in (0..100).map(|k| k * 5_000_000) {
        plain.step(now_ns);
    }
    let mut changed = injector(200, &[WIND, fault, &past, &due], 5).unwrap();
    changed.restore(&plain.memory());
    for now_ns in (100..400).map(|k| k * 5_000_000) {
        let (was, is) = (plain.step(now_ns), changed.step(now_ns));
        assert_eq!(was.wind_w_m_s.map(f64::to_bits), is.wind_w_m_s.map(f64::to_bits));
        let efficiency = if now_ns < 1_000_000_000 { 1.0 } else { 0.5 };
        assert!((is.rotor_efficiency[1] - efficiency).abs() < 1e-12);
        let kicked = is.body_rate_kick_b_rad_s[0] > 0.0;
        assert_eq!(kicked, now_ns == 750_000_000, "{now_ns}");
    }
}

#[test]
fn another_seed_goes_on_where_it_would_be_itself() {
    let mut injectors = [5, 6].map(|seed| injector(200, &[WIND], seed).unwrap());
    for now_ns in (0..10).map(|k| k * 5_000_000) {
        for injector in &mut injectors {
            injector.step(now_ns);
        }
    }
    let [mut first, second] = injectors;
    first.reseed(6);
    assert_eq!(first.memory().events[0].noise, second.memory().events[0].noise);
    let values = |injector: &Injector| injector.memory().events[0].values.map(f64::to_bits);
    assert_ne!(values(&first), values(&second));
}

#[test]
fn a_seventeenth_event_is_refused_with_the_limit() {
    let kick = "kind = 'kick'\nat_s = 1.0\nbody_rate_b_rad_s = [0.0, 0.0, 1.0]";
    assert!(injector(200, &[kick; 16], 1).is_ok());
    let refusal = injector(200, &[kick; 17], 1).unwrap_err();
    assert!(refusal.contains("17 events") && refusal.contains("at most 16"), "{refusal}");
}

#[test]
fn each_unusable_entry_is_refused_by_the_name_of_its_key() {
    let cases = [
        ("kind = 'gale'", "gale"),
        ("kind = 'wind'\nmean_w_m_s = [nan, 0.0, 0.0]", "mean_w_m_s"),
        ("kind = 'wind'\nmean_w_m_s = [1.0, 0.0, 0.0]\nsigma_m_s = [-0.1, 0.0, 0.0]", "sigma_m_s"),
        ("kind = 'wind'\nmean_w_m_s = [1.0, 0.0, 0.0]\nsigma = 1.0", "unknown field"),
        ("kind = 'wind'\nmean_w_m_s = [1.0, 0.0, 0.0]\nlength_m = [0.0, 1.0, 1.0]", "length_m"),
        ("kind = 'constant'\nload = { force_w_n = [inf, 0.0, 0.0] }", "force_w_n"),
        ("kind = 'constant'\nload = { force_n = [1.0, 0.0, 0.0] }", "unknown field"),
        ("kind = 'step'\nat_s = 2.0\nuntil_s = 2.0\nload = {}", "until_s"),
        ("kind = 'ramp'\nat_s = 2.0\nuntil_s = nan\nload = {}", "until_s"),
        ("kind = 'step'\nat_s = -1.0\nload = {}", "at_s"),
        ("kind = 'pulse'\nat_s = 1.0\nduration_s = 0.0\nload = {}", "duration_s"),
        ("kind = 'sine'\nfrequency_hz = 0.0\nload = {}", "frequency_hz"),
        ("kind = 'rd'\nat_s = 0.0\nrd = [nan, 0.0, 0.0]", "rd"),
        ("kind = 'payload'\nat_s = 0.0\nmass_kg = -0.01", "mass_kg"),
        ("kind = 'rotor_efficiency'\nat_s = 0.0\nrotor = 0\nefficiency = 0.5", "rotor"),
        ("kind = 'rotor_efficiency'\nat_s = 0.0\nrotor = 5\nefficiency = 0.5", "rotor"),
        ("kind = 'rotor_efficiency'\nat_s = 0.0\nrotor = 1\nefficiency = 1.1", "efficiency"),
    ];
    for (entry, key) in cases {
        let refusal = injector(200, &[entry], 1).unwrap_err();
        assert!(refusal.contains(key), "{entry}: {refusal}");
    }
    assert!(injector(0, &[], 1).unwrap_err().contains("rate_hz"));
    assert!(injector(10_001, &[], 1).unwrap_err().contains("rate_hz"));
}

proptest! {
    #[test]
    fn whatever_the_instants_every_number_stays_finite(
        steps in prop::collection::vec(prop_oneof![Just(0), 0..10_000_000_u64, Just(u64::MAX / 64)], 1..60)
    ) {
        let entries = [
            WIND,
            "kind = 'rd'\nat_s = 0.01",
            "kind = 'ramp'\nat_s = 0.0\nuntil_s = 0.1\nload = { force_w_n = [1.0, 1.0, 1.0] }",
            "kind = 'sine'\nfrequency_hz = 5e3\nload = { torque_b_nm = [1.0, 1.0, 1.0] }",
        ];
        let mut injector = injector(200, &entries, 1).unwrap();
        let mut now_ns = 0_u64;
        for step in steps {
            now_ns = now_ns.saturating_add(step);
            let s = injector.step(now_ns);
            let vectors = [s.wind_w_m_s, s.force_w_n, s.torque_b_nm, s.body_rate_kick_b_rad_s];
            prop_assert!(vectors.as_flattened().iter().all(|x| x.is_finite()));
        }
    }
}
