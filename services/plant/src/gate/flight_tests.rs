//! The gate on the nonlinear vehicle with noisy sensors, after its controller fell silent.

use nalgebra::Vector3;
use shared_types::Quaternion;
use std::collections::VecDeque;
use vehicle::{
    Actuation, Disturbance, NonlinearModel, PlantInputs, PlantModel, RigidBodyState, StepStatus,
};

use super::*;
use crate::sensors::{Imu, ImuConfig, Sensor as _};

const MS: u64 = 1_000_000;

/// Everything at one tick that the tests look at.
struct Moment {
    output: GateOutput,
    tilt_rad: f64,
    rate_rad_s: f64,
}

struct Flight {
    model: NonlinearModel,
    imu: Imu,
    gate: Gate,
    beta: MorphAngle,
    tick: u64,
    unproven: Option<UnprovenRange>,
    /// When the estimates end.
    estimated_until_ns: u64,
    /// Those that have not reached the gate, the oldest first.
    on_the_way: VecDeque<StateEstimate>,
    estimate: Option<StateEstimate>,
    reference: Reference,
}

impl Flight {
    fn new(config: &GateConfig, beta: MorphAngle, seed: u64) -> Self {
        let vehicle = VehicleParameters::default();
        let hover = RigidBodyState::hover(&vehicle, Vector3::zeros(), beta);
        Self {
            model: NonlinearModel::new(vehicle, None, hover).unwrap(),
            imu: Imu::new(&ImuConfig::default(), seed).unwrap(),
            gate: Gate::new(config, &vehicle).unwrap(),
            beta,
            tick: 0,
            unproven: None,
            estimated_until_ns: 0,
            on_the_way: VecDeque::new(),
            estimate: None,
            reference: Reference::default(),
        }
    }

    /// One millisecond; `wrench` is the controller's command, if it sends one.
    fn step(&mut self, wrench: Option<Wrench>) -> Moment {
        let now_ns = self.tick * MS;
        self.tick += 1;
        let inputs = |wrench| PlantInputs {
            actuation: Actuation::Wrench(wrench),
            morph_command_rad: self.beta.rad(),
            disturbance: Disturbance::default(),
        };
        let truth = self.model.truth(&inputs(Wrench::thrust(0.0)));
        let (omega, force) = (truth.state.omega_b, truth.specific_force_b_m_s2);
        let command =
            wrench.map(|wrench| Command { wrench, effective_ns: now_ns, validity_ns: 20 * MS });
        if now_ns < self.estimated_until_ns {
            let state = &truth.state;
            self.on_the_way.push_back(StateEstimate {
                described_ns: now_ns,
                position_w_m: state.position_w.into(),
                velocity_w_m_s: state.velocity_w.into(),
                q_wb: Quaternion::from_array(vehicle::components(state.q_wb)),
                body_rate_b_rad_s: omega.into(),
                specific_force_b_m_s2: force.into(),
                gyro_bias_b_rad_s: self.imu.gyro_bias_b_rad_s(now_ns).into(),
                accelerometer_bias_b_m_s2: self.imu.accelerometer_bias_b_m_s2(now_ns).into(),
                ..StateEstimate::default()
            });
        }
        if self.on_the_way.front().is_some_and(|estimate| estimate.described_ns + 20 * MS < now_ns)
        {
            self.estimate = self.on_the_way.pop_front();
        }
        let output = self.gate.tick(&GateInput {
            now_ns,
            command,
            is_revoked: false,
            tripped: false,
            led_astray: false,
            unproven: self.unproven.as_ref(),
            reading: self.imu.sample(now_ns, &omega, &force),
            morph_angle_rad: self.beta.rad(),
            estimate: self.estimate.as_ref(),
            reference: Some(&self.reference),
        });
        assert_eq!(self.model.step(1e-3, &inputs(output.wrench)), StepStatus::Advanced);
        let up = truth.state.q_wb * Vector3::z();
        Moment { output, tilt_rad: up.angle(&Vector3::z()), rate_rad_s: omega.norm() }
    }

    /// Pushes the vehicle over about `axis` until it has `tilt_rad` and about 2 rad/s, then sends
    /// one last command without torque.
    fn upset(&mut self, axis: Vector3<f64>, tilt_rad: f64) -> Moment {
        let weight = self.gate.vehicle.weight_n();
        // From rest, ω² = 2 α φ.
        let alpha = axis * (2.0 * 2.0 / (2.0 * tilt_rad));
        let torque_b_nm = self.gate.vehicle.inertia_kg_m2(self.beta).component_mul(&alpha);
        for _ in 0..3000 {
            let moment = self.step(Some(Wrench { thrust_n: weight, torque_b_nm }));
            if moment.tilt_rad >= tilt_rad {
                break;
            }
        }
        self.step(Some(Wrench::thrust(weight)))
    }
}

#[test]
fn level_recovers_from_0_3_rad_and_2_rad_s_at_every_size() {
    let axes = [Vector3::x(), -Vector3::y(), Vector3::new(0.6, 0.8, 0.0)];
    for beta in [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX] {
        for (axis, seed) in axes.into_iter().zip(1..) {
            let mut flight = Flight::new(&GateConfig::default(), beta, seed);
            let upset = flight.upset(axis, 0.3);
            assert!(upset.tilt_rad >= 0.3 && upset.rate_rad_s > 1.9, "{}", upset.rate_rad_s);

            let moments: Vec<Moment> = (0..2000).map(|_| flight.step(None)).collect();
            let arm = flight.gate.vehicle.geometry.arm_length_m(beta);
            let torque_max = |share: f64| share * flight.gate.vehicle.weight_n() * arm;
            let worst = moments.iter().map(|m| m.tilt_rad).fold(0.0, f64::max);
            assert!(worst < 0.4, "worst tilt {worst}");
            let mut is_gentle = false;
            for moment in &moments[45..] {
                assert!(matches!(moment.output.mode, Mode::Level { .. }));
                // As much as RECOVER has while it leans or turns too far, by the gate's own readings.
                let is_wild = !is_gentle && (moment.tilt_rad > 0.29 || moment.rate_rad_s > 2.9);
                is_gentle |= !is_wild;
                let most_nm = torque_max(if is_wild { 0.5 } else { 0.25 });
                assert!(moment.output.wrench.torque_b_nm.norm() <= most_nm * (1.0 + 1e-12));
            }
            // A gyro bias of 0.01 rad/s (1 σ per axis) drifts by up to about 0.05 rad in 2 s.
            for moment in &moments[1000..] {
                assert!(moment.tilt_rad < 0.08, "tilt {}", moment.tilt_rad);
                assert!(moment.rate_rad_s < 0.1, "rate {}", moment.rate_rad_s);
            }
        }
    }
}

/// A circle of 1 m in 6 s: position and velocity.
fn circle(ms: u32) -> (Vector3<f64>, Vector3<f64>) {
    let (sin, cos) = libm::sincos(core::f64::consts::TAU * f64::from(ms) / 6000.0);
    (Vector3::new(cos - 1.0, sin, 0.0), Vector3::new(-sin, cos, 0.0) * 1.047)
}

/// Largest distance from the circle in the second second, at a size and with a seed, and the velocity as the rotors are
/// cut. The vehicle enters the circle from rest, and descends from 2 s on.
fn circled(beta: MorphAngle, seed: u64, estimated_until_ns: u64) -> (f64, Vector3<f64>) {
    let mut flight =
        Flight { estimated_until_ns, ..Flight::new(&GateConfig::default(), beta, seed) };
    let mut away_m: f64 = 0.0;
    for ms in 0..5900_u32 {
        if ms.is_multiple_of(20) {
            flight.reference.header.valid_ns = u64::from(ms) * MS;
            (flight.reference.count, flight.reference.spacing_ns) = (48, 50 * MS);
            for (point, index) in flight.reference.points.iter_mut().zip(0..) {
                let (position, velocity) = circle(ms + 50 * index);
                (point.position_w_m, point.velocity_w_m_s) = (position.into(), velocity.into());
            }
        }
        let tilt_rad = flight.step(None).tilt_rad;
        assert!(tilt_rad < 0.35, "{tilt_rad} rad at {ms} ms");
        if (1000..2000).contains(&ms) {
            away_m = away_m.max((flight.model.state().position_w - circle(ms).0).norm());
        }
    }
    (away_m, flight.model.state().velocity_w)
}

#[test]
fn without_a_controller_the_gate_flies_along_the_reference_and_descends_at_rest() {
    for (beta, seed) in [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX].into_iter().zip(1..)
    {
        let (away_m, velocity_w) = circled(beta, seed, u64::MAX);
        assert!(away_m < 0.15, "{beta:?}: {away_m} m");
        assert!(velocity_w.xy().norm() < 0.05, "{beta:?}: {velocity_w}");
        assert!((-0.8..-0.6).contains(&velocity_w.z), "{beta:?}: {velocity_w}");
    }
}

/// It knows the biases of its readings by the last estimate, and comes to rest before it forgets where it is.
#[test]
fn without_an_estimator_either_the_gate_follows_the_reference_by_its_own_readings() {
    for (beta, seed) in [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX].into_iter().zip(1..)
    {
        let (away_m, velocity_w) = circled(beta, seed, 300 * MS);
        assert!(away_m < 0.2, "{beta:?}: {away_m} m");
        assert!(velocity_w.xy().norm() < 0.2, "{beta:?}: {velocity_w}");
        assert!((-1.0..-0.4).contains(&velocity_w.z), "{beta:?}: {velocity_w}");
    }
}

#[test]
fn a_vehicle_that_no_controller_commands_any_more_comes_down_slowly() {
    const SEEDS: u64 = 12;
    let mut mean_m_s = 0.0;
    let sizes = [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX];
    for (seed, beta) in (1..=SEEDS).zip(sizes.into_iter().cycle()) {
        let mut flight = Flight::new(&GateConfig::default(), beta, seed);
        for _ in 0..2000 {
            flight.step(None);
        }
        let height_m = flight.model.state().position_w.z;
        assert!(height_m.abs() < 0.05, "seed {seed}: {height_m} m");
        for _ in 0..3900 {
            assert!(matches!(flight.step(None).output.mode, Mode::Level { .. }));
        }
        // The speed is known by the accelerometer alone, whose bias of 0.05 m/s² (1 σ) is 0.3 m/s after 6 s.
        let speed_m_s = flight.model.state().velocity_w.z;
        assert!((-1.5..0.0).contains(&speed_m_s), "seed {seed}: {speed_m_s} m/s");
        mean_m_s += speed_m_s / SEEDS as f64;
        // A command at the last moment is followed.
        let weight_n = flight.gate.vehicle.weight_n();
        assert_eq!(flight.step(Some(Wrench::thrust(weight_n))).output.mode, Mode::Normal);
    }
    assert!((-0.9..-0.5).contains(&mean_m_s), "{mean_m_s} m/s");
}

/// Largest tilt within 0.5 s of full torque \[rad\], for `first_ms` about an axis `between_rad` from the later one.
fn tilt_by_full_torque(
    unproven: Option<UnprovenRange>,
    beta: MorphAngle,
    first_ms: u32,
    between_rad: f64,
) -> f64 {
    let mut worst_rad: f64 = 0.0;
    for (direction_rad, seed) in [0.0, -1.6, 0.9].into_iter().zip(1..) {
        let mut flight = Flight { unproven, ..Flight::new(&GateConfig::default(), beta, seed) };
        let vehicle = flight.gate.vehicle;
        let thrust_n = vehicle.weight_n();
        let most_nm = 1.05 * vehicle.torque_bound_nm(beta, thrust_n).x;
        for ms in 0..500 {
            let is_first = ms < first_ms;
            let (sin, cos) = libm::sincos(direction_rad + if is_first { between_rad } else { 0.0 });
            // Roll and pitch may both be at their bounds.
            let within = |share: f64| (1.5 * share).clamp(-1.0, 1.0) * most_nm;
            let torque_b_nm = Vector3::new(within(cos), within(sin), 0.0);
            worst_rad = worst_rad.max(flight.step(Some(Wrench { thrust_n, torque_b_nm })).tilt_rad);
        }
    }
    worst_rad
}

#[test]
fn no_torque_of_an_unproven_owner_tilts_the_vehicle_beyond_its_range() {
    let vehicle = VehicleParameters::default();
    let tilt_rad = core::f64::consts::FRAC_PI_3;
    let weight_n = vehicle.weight_n();
    let range =
        UnprovenRange { believed: vehicle, thrust_n: [0.2 * weight_n, 2.1 * weight_n], tilt_rad };
    for beta in [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX] {
        // At once, against itself first, and crosswise first, so that it tilts as it turns.
        for (first_ms, between_rad) in
            [(0, 0.0), (10, 3.1), (20, 3.1), (40, 3.1), (20, 1.5), (30, 1.5)]
        {
            let unbounded_rad = tilt_by_full_torque(None, beta, first_ms, between_rad);
            assert!(unbounded_rad > 2.0, "{unbounded_rad}");
            let worst_rad = tilt_by_full_torque(Some(range), beta, first_ms, between_rad);
            let case = format!("{beta:?} {first_ms} ms {between_rad} rad");
            assert!((0.7..tilt_rad + 0.01).contains(&worst_rad), "{case}: {worst_rad}");
        }
    }
}

#[test]
fn a_vehicle_that_cannot_be_turned_back_is_cut_after_the_tip_over_time() {
    let powerless = GateConfig {
        level_torque_fraction: 0.0,
        recover_torque_fraction: 0.0,
        ..GateConfig::default()
    };
    let mut flight = Flight::new(&powerless, MorphAngle::MEDIUM, 1);
    assert!(flight.upset(Vector3::x(), 1.8).tilt_rad >= 1.8);
    let modes: Vec<Mode> = (0..1000).map(|_| flight.step(None).output.mode).collect();
    let level = modes.iter().filter(|mode| matches!(mode, Mode::Level { .. })).count();
    assert_eq!((level, modes.last()), (200, Some(&Mode::Cut)));
}

#[test]
fn a_silent_unproven_owners_vehicle_that_cannot_be_turned_back_is_cut_too() {
    let feeble = GateConfig {
        level_torque_fraction: 0.0,
        recover_torque_fraction: 1e-3,
        ..GateConfig::default()
    };
    let vehicle = VehicleParameters::default();
    let range = UnprovenRange { believed: vehicle, thrust_n: [0.2, 2.4], tilt_rad: 1.0 };
    let mut flight =
        Flight { unproven: Some(range), ..Flight::new(&feeble, MorphAngle::MEDIUM, 1) };
    let thrust_n = vehicle.weight_n();
    for _ in 0..30 {
        let torque_b_nm = Vector3::new(0.05, 0.0, 0.0);
        flight.step(Some(Wrench { thrust_n, torque_b_nm }));
    }
    let last = (0..5000).map(|_| flight.step(None).output.mode).last();
    assert_eq!(last, Some(Mode::Cut));
}

#[test]
fn after_ten_seconds_of_flight_the_gate_still_knows_what_is_up() {
    for seed in 1..=5 {
        let mut flight = Flight::new(&GateConfig::default(), MorphAngle::MEDIUM, seed);
        let weight = flight.gate.vehicle.weight_n();
        for k in 0..10_000 {
            // A rate loop on the truth, weaving to either side like a slow figure of eight.
            let t = f64::from(k) * 1e-3;
            let wish = Vector3::new(0.3 * libm::cos(2.0 * t), 0.3 * libm::cos(4.0 * t), 0.0);
            let state = flight.model.state();
            let gamma = vehicle::euler_from_quaternion(&state.q_wb);
            let alpha = (wish - state.omega_b) * 20.0 - gamma * 2.0;
            let torque_b_nm = flight.gate.vehicle.inertia_kg_m2(flight.beta).component_mul(&alpha);
            let thrust_n = weight / (libm::cos(gamma.x) * libm::cos(gamma.y));
            flight.step(Some(Wrench { thrust_n, torque_b_nm }));
        }
        let up = flight.model.state().q_wb.inverse_transform_vector(&Vector3::z());
        let error = up.angle(&flight.gate.filter.up_b);
        // Bias 0.01 rad/s times the time constant of 3 s, 1 σ per axis, and the turns in flight.
        assert!(error < 0.12, "seed {seed}: {error} rad");
    }
}
