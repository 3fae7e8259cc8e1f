//! A closed-loop flight of the two laws that is fast enough to meet their bounds.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
#![allow(dead_code, reason = "each user reads a part")]

#[path = "../../services/attitude-mpc/tests/rig/mod.rs"]
#[expect(clippy::unwrap_used, reason = "written for tests, where a panic is the verdict")]
mod rig;

use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Input as AttitudeInput};
use core::f64::consts::TAU;
use nalgebra::Vector3;
use position_mpc::{Input as PositionInput, PositionLaw, PositionLawConfig};
use rig::{Flight, release_ns};
use vehicle::{MorphAngle, VehicleParameters, Wrench, euler_from_quaternion};

const RATE_HZ: f64 = 100.0;
const STEPS: u64 = 800;

/// Inputs of one step of the position law, with its own copy of the preview.
pub(crate) struct PositionSample {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    gamma: Vector3<f64>,
    reference: Vec<Vector3<f64>>,
    applied: position_mpc::Setpoint,
}

impl PositionSample {
    pub(crate) fn input(&self) -> PositionInput<'_> {
        PositionInput {
            position_w_m: self.position,
            velocity_w_m_s: self.velocity,
            gamma_rad: self.gamma,
            age_s: 0.0,
            reference_w_m: &self.reference,
            reference_yaw_rad: 0.0,
            applied: Some(self.applied),
        }
    }
}

/// A figure eight of 5 s, which needs almost all the tilt that is allowed at its fastest.
fn reference(t_s: f64) -> Vector3<f64> {
    let phase = TAU * t_s / 5.0;
    Vector3::new(phase.sin(), 0.5 * (2.0 * phase).sin(), 0.0)
}

/// The arms sweep once from small to large and back in 8 s.
fn morph(t_s: f64) -> MorphAngle {
    let share = 1.0 - (t_s / 4.0 - 1.0).abs();
    let angle = MorphAngle::MIN.rad() + share * (MorphAngle::MAX.rad() - MorphAngle::MIN.rad());
    MorphAngle::saturating_from_rad(angle).unwrap_or(MorphAngle::MIN)
}

/// Both laws at trim.
pub(crate) struct Laws {
    pub(crate) attitude: AttitudeLaw,
    pub(crate) position: PositionLaw,
}

pub(crate) fn laws() -> Laws {
    let vehicle = VehicleParameters::default();
    let attitude = AttitudeLaw::new(AttitudeLawConfig::flight(RATE_HZ), &vehicle);
    let position = PositionLaw::new(PositionLawConfig::flight(RATE_HZ / 2.0), &vehicle);
    Laws { attitude: attitude.expect("defaults fly"), position: position.expect("defaults fly") }
}

/// Recorded inputs of the two laws.
pub(crate) struct RecordedInputs {
    pub(crate) attitude: Vec<AttitudeInput>,
    pub(crate) position: Vec<PositionSample>,
    /// Samples at a bound, attitude and position.
    pub(crate) constrained: [u32; 2],
}

/// Flies both laws and records their inputs.
pub(crate) fn fly() -> RecordedInputs {
    let vehicle = VehicleParameters::default();
    let Laws { mut attitude, mut position } = laws();
    let preview = PositionLawConfig::flight(RATE_HZ / 2.0).horizon.prediction;
    let mut flight = Flight::hover(vehicle, MorphAngle::MIN);
    let hover = Vector3::zeros();
    let mut applied = position_mpc::Setpoint { gamma_rad: hover, thrust_n: vehicle.weight_n() };
    let (mut attitude_inputs, mut position_samples) = (Vec::new(), Vec::new());
    let mut constrained = [0_u32; 2];
    for k in 0..STEPS {
        let t_s = k as f64 / RATE_HZ;
        flight.advance(release_ns(k, RATE_HZ));
        flight.morph_command = morph(t_s);
        // A pulse of one period each second, as in the paper's Test III.
        flight.disturbance.torque_b_nm.x = if k % 100 == 0 { 0.1 } else { 0.0 };
        let (state, torque) = flight.sampled();
        let gamma = euler_from_quaternion(&state.q_wb);
        let input = AttitudeInput {
            gamma_rad: gamma,
            body_rate_rad_s: state.omega_b,
            age_s: 0.0,
            morph_angle: state.beta,
            setpoint: attitude_mpc::Setpoint {
                gamma_rad: applied.gamma_rad,
                thrust_n: applied.thrust_n,
            },
            applied_torque_nm: Some(torque),
        };
        let output = attitude.step(&input);
        constrained[0] += u32::from(output.active > 0);
        flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
        attitude_inputs.push(input);
        if k % 2 == 0 {
            let ahead = |j: usize| reference(t_s + (j + 1) as f64 * 2.0 / RATE_HZ);
            let sample = PositionSample {
                position: state.position_w,
                velocity: state.velocity_w,
                gamma,
                reference: (0..preview).map(ahead).collect(),
                applied,
            };
            let output = position.step(&sample.input());
            constrained[1] += u32::from(output.active > 0);
            applied = output.setpoint;
            position_samples.push(sample);
        }
    }
    RecordedInputs { attitude: attitude_inputs, position: position_samples, constrained }
}
