#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use super::*;
use crate::sensors::DropOut;

fn still(imu: &mut Imu, now_ns: u64) -> Option<ImuSample> {
    imu.sample(now_ns, &Vector3::zeros(), &Vector3::new(0.0, 0.0, 9.81))
}

/// Six channels over `count` samples at rest.
fn record(config: &ImuConfig, count: usize) -> [Vec<f64>; 6] {
    let mut imu = Imu::new(config, 11).unwrap();
    let mut channels: [Vec<f64>; 6] = std::array::from_fn(|_| Vec::with_capacity(count));
    for _ in 0..count {
        let now_ns = imu.next_sample_ns();
        let sample = still(&mut imu, now_ns).unwrap();
        let readings = sample.gyro_b_rad_s.iter().chain(&sample.specific_force_b_m_s2);
        for (channel, x) in channels.iter_mut().zip(readings) {
            channel.push(*x);
        }
    }
    channels
}

/// Overlapping Allan variance over clusters of `n` samples, from the integral of the signal
/// [IEEE Std 952-1997, annex C].
fn allan_variance(signal: &[f64], n: usize) -> f64 {
    let mut integral = vec![0.0];
    integral.extend(signal.iter().scan(0.0, |sum, x| {
        *sum += x;
        Some(*sum)
    }));
    let n_f = n as f64;
    let squares: Vec<f64> = integral
        .windows(2 * n + 1)
        .map(|w| ((w[2 * n] - 2.0 * w[n] + w[0]) / n_f).powi(2))
        .collect();
    0.5 * squares.iter().sum::<f64>() / squares.len() as f64
}

/// Three axes averaged, relative to N²/τ + K² τ/3.
fn against_theory(axes: &[Vec<f64>], rate_hz: u32, tau_s: f64, density: f64, walk: f64) -> f64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "small and positive"
    )]
    let n = (tau_s * f64::from(rate_hz)).round() as usize;
    let measured = axes.iter().map(|axis| allan_variance(axis, n)).sum::<f64>() / 3.0;
    (measured / (density * density / tau_s + walk * walk * tau_s / 3.0)).sqrt()
}

#[test]
fn the_allan_deviation_is_the_configured_one_at_every_rate() {
    for (rate_hz, count) in [(100, 300_000), (1000, 600_000)] {
        let config = ImuConfig { rate_hz, ..ImuConfig::default() };
        let channels = record(&config, count);
        for tau_s in [0.1, 1.0, 5.0] {
            let gyro = against_theory(&channels[..3], rate_hz, tau_s, 1.2e-4, 2e-5);
            let force = against_theory(&channels[3..], rate_hz, tau_s, 2e-3, 1e-4);
            // 3 axes of at least 120 clusters each: 1 σ is below 4 %.
            assert!((gyro - 1.0).abs() < 0.10, "gyro {rate_hz} Hz, tau {tau_s}: {gyro}");
            assert!((force - 1.0).abs() < 0.10, "force {rate_hz} Hz, tau {tau_s}: {force}");
        }
    }
}

#[test]
fn the_bias_walks_as_far_per_second_at_every_rate() {
    for (rate_hz, count) in [(50, 200_000), (200, 600_000)] {
        let config = ImuConfig {
            rate_hz,
            gyro_noise_density_rad_s_sqrt_hz: 0.0,
            accelerometer_noise_density_m_s2_sqrt_hz: 0.0,
            ..ImuConfig::default()
        };
        let channels = record(&config, count);
        for tau_s in [2.0, 10.0] {
            let gyro = against_theory(&channels[..3], rate_hz, tau_s, 0.0, 2e-5);
            let force = against_theory(&channels[3..], rate_hz, tau_s, 0.0, 1e-4);
            assert!((gyro - 1.0).abs() < 0.10, "gyro {rate_hz} Hz, tau {tau_s}: {gyro}");
            assert!((force - 1.0).abs() < 0.10, "force {rate_hz} Hz, tau {tau_s}: {force}");
        }
    }
}

#[test]
fn the_initial_bias_has_the_configured_spread_over_seeds() {
    let config = ImuConfig::default();
    let (mut gyro, mut force) = (0.0, 0.0);
    for seed in 0..2000 {
        let imu = Imu::new(&config, seed).unwrap();
        gyro += imu.gyro_bias_b_rad_s(0).norm_squared() / 6000.0;
        force += imu.accelerometer_bias_b_m_s2(0).norm_squared() / 6000.0;
    }
    // 6000 draws: the deviation is known to 0.9 %, 1 σ.
    assert!((gyro.sqrt() / 0.01 - 1.0).abs() < 0.04, "{}", gyro.sqrt());
    assert!((force.sqrt() / 0.05 - 1.0).abs() < 0.04, "{}", force.sqrt());
}

#[test]
fn a_noise_free_sensor_tells_the_truth_until_its_range_or_a_scripted_step() {
    let bias_step = BiasStep {
        at_s: 0.005,
        gyro_b_rad_s: [0.1, 0.0, 0.0],
        accelerometer_b_m_s2: [0.0, 0.0, -0.5],
    };
    let config = ImuConfig { noise_free: true, bias_step: Some(bias_step), ..ImuConfig::default() };
    let mut imu = Imu::new(&config, 1).unwrap();
    let (omega, force) = (Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.5, 0.25, 9.0));
    let sample = imu.sample(4_000_000, &omega, &force).unwrap();
    assert_eq!((sample.gyro_b_rad_s, sample.specific_force_b_m_s2), (omega, force));
    assert!(!sample.saturated);
    let sample = imu.sample(5_000_000, &omega, &force).unwrap();
    assert_eq!(sample.gyro_b_rad_s, Vector3::new(1.1, -2.0, 3.0));
    assert_eq!(sample.specific_force_b_m_s2, Vector3::new(0.5, 0.25, 8.5));
    let sample = imu.sample(6_000_000, &(omega * 20.0), &(force * -100.0)).unwrap();
    assert_eq!(sample.gyro_b_rad_s, Vector3::new(20.1, -35.0, 35.0));
    assert_eq!(sample.specific_force_b_m_s2, Vector3::new(-50.0, -25.0, -157.0));
    assert!(sample.saturated);
}

#[test]
fn a_drop_out_loses_its_samples_and_changes_no_other() {
    let drop_outs = vec![DropOut { from_s: 0.002, until_s: 0.004 }];
    let mut holed = Imu::new(&ImuConfig { drop_outs, ..ImuConfig::default() }, 1).unwrap();
    let mut whole = Imu::new(&ImuConfig::default(), 1).unwrap();
    for step in 0..10 {
        let [holed, whole] = [&mut holed, &mut whole].map(|imu| still(imu, step * 1_000_000));
        assert_eq!(holed, whole.filter(|_| !(2..4).contains(&step)), "step {step}");
    }
}

#[test]
fn a_truth_that_is_not_finite_gives_no_sample_and_the_sensor_recovers() {
    let mut imu = Imu::new(&ImuConfig::default(), 1).unwrap();
    let mut healthy = imu.clone();
    let bad = Vector3::new(0.0, f64::NAN, 0.0);
    assert_eq!(imu.sample(0, &bad, &Vector3::zeros()), None);
    let _ = still(&mut healthy, 0);
    assert_eq!(still(&mut imu, 1_000_000), still(&mut healthy, 1_000_000));
}

#[test]
fn equal_seeds_give_equal_bytes_and_a_restored_sensor_continues_them() {
    let config = ImuConfig { rate_hz: 150, ..ImuConfig::default() };
    let mut imu = Imu::new(&config, 5).unwrap();
    let mut twin = Imu::new(&config, 5).unwrap();
    let mut other = Imu::new(&config, 6).unwrap();
    for tick in 0..500_u64 {
        let now_ns = tick * 1_000_000;
        let sample = still(&mut imu, now_ns);
        assert_eq!(sample, still(&mut twin, now_ns));
        if let Some(different) = still(&mut other, now_ns) {
            assert_ne!(Some(different), sample);
        }
        let mut restored = Imu::new(&config, 99).unwrap();
        restored.restore(&imu.memory());
        twin = restored;
    }
}

#[test]
fn a_sample_allocates_nothing() {
    let mut imu = Imu::new(&ImuConfig::default(), 1).unwrap();
    let count = allocation_counter::measure(|| {
        for tick in 0..100 {
            let _ = still(&mut imu, tick * 1_000_000);
            imu.restore(&imu.memory());
        }
    });
    assert_eq!(count.count_total, 0);
}
