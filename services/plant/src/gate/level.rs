//! The gate's own idea of what is up, and the law that brings the vehicle level.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use vehicle::{MorphAngle, VehicleParameters, Wrench};

use super::config::GateConfig;
use crate::sensors::ImuSample;

/// Readings beyond these are a fault, not a motion: several times any sensor's range.
const MAX_RATE_RAD_S: f64 = 100.0;
const MAX_FORCE_M_S2: f64 = 1000.0;

/// The accelerometer shows which way is up only while its length is near g.
const FORCE_WINDOW: f64 = 0.25;

/// Longest time that one prediction bridges \[s\].
pub(super) const MAX_STEP_S: f64 = 0.02;

/// Time constant of the vertical speed in a descent \[s\], and by how much its thrust may differ from the weight: within
/// this the gate needs no range of its own for it.
const DESCENT_TIME_CONSTANT_S: f64 = 0.5;
const DESCENT_THRUST_SHARE: f64 = 0.1;

/// A rate older than this no longer damps anything \[ns\].
const MAX_READING_AGE_NS: u64 = 20_000_000;

/// Complementary filter for the direction of up, seen from the body.
///
/// d up/dt = −ω × up + (f/|f| − up) / time constant. A quadrotor's specific force lies along its
/// own z axis over short times, so the time constant is long, and the correction rests in LEVEL,
/// where the thrust is along that axis all the time and the accelerometer would call every tilt level.
#[derive(Debug, Clone, Copy)]
pub(super) struct UpFilter {
    pub(super) up_b: Vector3<f64>,
    pub(super) rate_b: Vector3<f64>,
    pub(super) reading_ns: u64,
}

/// Angle between body z and `up_b`, which need not have length one \[rad\].
fn tilt_rad(up_b: &Vector3<f64>) -> f64 {
    libm::atan2(libm::hypot(up_b.x, up_b.y), up_b.z)
}

impl UpFilter {
    /// Level and at rest.
    pub(super) fn new() -> Self {
        Self { up_b: Vector3::z(), rate_b: Vector3::zeros(), reading_ns: 0 }
    }

    /// Takes a reading over; false if it is a fault.
    pub(super) fn read(&mut self, now_ns: u64, reading: &ImuSample) -> bool {
        // NaN lies in no range.
        let within = |v: &Vector3<f64>, max: f64| v.iter().all(|x| (-max..=max).contains(x));
        let usable = within(&reading.gyro_b_rad_s, MAX_RATE_RAD_S)
            && within(&reading.specific_force_b_m_s2, MAX_FORCE_M_S2);
        if usable {
            self.rate_b = reading.gyro_b_rad_s;
            self.reading_ns = now_ns;
        }
        usable
    }

    /// Turns up by the last rate less the gyro's bias over `dt_s`.
    pub(super) fn predict(&mut self, dt_s: f64, bias_b: &Vector3<f64>) {
        let rate_b = self.rate_b - bias_b;
        let turn = UnitQuaternion::from_scaled_axis(rate_b * -dt_s.min(MAX_STEP_S));
        self.up_b = (turn * self.up_b).try_normalize(0.1).unwrap_or_else(Vector3::z);
    }

    /// Moves up by `share` towards a usable reading's specific force.
    pub(super) fn correct(&mut self, force_b: &Vector3<f64>, gravity: f64, share: f64) {
        let length = force_b.norm();
        if (length / gravity - 1.0).abs() < FORCE_WINDOW {
            let blend = self.up_b + (force_b / length - self.up_b) * share;
            // Nothing to correct with, if the two point in opposite directions.
            self.up_b = blend.try_normalize(0.1).unwrap_or(self.up_b);
        }
    }

    /// Angle between body z and up \[rad\].
    pub(super) fn tilt_rad(&self) -> f64 {
        tilt_rad(&self.up_b)
    }

    /// Rate about roll and pitch \[rad/s\].
    pub(super) fn turning_rad_s(&self) -> f64 {
        libm::hypot(self.rate_b.x, self.rate_b.y)
    }

    /// Tilt once the vehicle has turned further by `angle_rad` in the direction in which it turns about roll and pitch;
    /// one at rest may turn in any.
    pub(super) fn tilt_after_rad(&self, angle_rad: f64) -> f64 {
        let axis = Vector3::new(self.rate_b.x, self.rate_b.y, 0.0).try_normalize(1e-9);
        let Some(axis) = axis else { return self.tilt_rad() + angle_rad };
        let turned = UnitQuaternion::from_scaled_axis(axis * -angle_rad) * self.up_b;
        tilt_rad(&turned)
    }

    /// Rotation vector that turns the body until up is where `aim_b` says: the angle between them times
    /// aim × up / |aim × up|.
    fn tilt_error(&self, aim_b: &Vector3<f64>) -> Vector3<f64> {
        let across = aim_b.cross(&self.up_b);
        let angle_rad = libm::atan2(across.norm(), aim_b.dot(&self.up_b));
        across.try_normalize(1e-9).map_or_else(Vector3::zeros, |axis| axis * angle_rad)
    }

    /// Vertical acceleration of the vehicle by a reading of the specific force `force_b` \[m/s²\].
    pub(super) fn climbing_m_s2(&self, force_b: &Vector3<f64>, gravity: f64) -> f64 {
        force_b.dot(&self.up_b) - gravity
    }

    pub(super) fn is_blind(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.reading_ns) > MAX_READING_AGE_NS
    }
}

/// Thrust that takes a level vehicle from the vertical speed `climb_m_s` to that of a descent \[N\].
pub(super) fn descent_thrust_n(
    vehicle: &VehicleParameters,
    climb_m_s: f64,
    descend_m_s: f64,
) -> f64 {
    let faster_m_s2 = (-descend_m_s - climb_m_s) / DESCENT_TIME_CONSTANT_S;
    let share =
        faster_m_s2 / vehicle.gravity_m_s2 - descend_m_s * vehicle.drag_n_s_m / vehicle.weight_n();
    vehicle.weight_n() * (1.0 + share.clamp(-DESCENT_THRUST_SHARE, DESCENT_THRUST_SHARE))
}

/// What the law is to bring about.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim {
    /// Where up is to be, seen from the body.
    up_b: Vector3<f64>,
    thrust_n: f64,
}

impl Aim {
    /// Level, with the thrust of hover.
    pub(super) fn level(vehicle: &VehicleParameters) -> Self {
        Self { up_b: Vector3::z(), thrust_n: vehicle.weight_n() }
    }

    /// At roll and pitch as far as their tilt is at most `most_rad`, with the same thrust upwards.
    pub(super) fn tilted(roll_pitch_rad: [f64; 2], most_rad: f64, thrust_n: f64) -> Self {
        let upwards = roll_pitch_rad.map(libm::cos).iter().product::<f64>() * thrust_n;
        let [roll_rad, pitch_rad] = Vector2::from(roll_pitch_rad).cap_magnitude(most_rad).into();
        let (sin_roll, cos_roll) = libm::sincos(roll_rad);
        let (sin_pitch, cos_pitch) = libm::sincos(pitch_rad);
        let up_b = Vector3::new(-sin_pitch, sin_roll * cos_pitch, cos_roll * cos_pitch);
        Self { up_b, thrust_n: upwards / up_b.z }
    }
}

/// α = ωₙ² e − 2 ζ ωₙ ω, τ = I(β) α; the thrust is that of the aim, and m g while the filter is blind.
#[derive(Debug, Clone, Copy)]
pub(super) struct LevelLaw {
    stiffness: f64,
    damping: f64,
    torque_fraction: f64,
}

impl LevelLaw {
    pub(super) fn level(config: &GateConfig) -> Self {
        let GateConfig { level_bandwidth_rad_s, level_damping, level_torque_fraction, .. } =
            *config;
        Self::new(level_bandwidth_rad_s, level_damping, level_torque_fraction)
    }

    pub(super) fn recover(config: &GateConfig) -> Self {
        let GateConfig {
            recover_bandwidth_rad_s, recover_damping, recover_torque_fraction, ..
        } = *config;
        Self::new(recover_bandwidth_rad_s, recover_damping, recover_torque_fraction)
    }

    /// With the undamped frequency `bandwidth_rad_s` and torques up to a share of m g L(β).
    fn new(bandwidth_rad_s: f64, damping: f64, torque_fraction: f64) -> Self {
        Self {
            stiffness: bandwidth_rad_s * bandwidth_rad_s,
            damping: 2.0 * damping * bandwidth_rad_s,
            torque_fraction,
        }
    }

    /// Angular acceleration with which it brakes a turn about roll or pitch \[rad/s²\].
    pub(super) fn braking_rad_s2(&self, vehicle: &VehicleParameters, beta: MorphAngle) -> f64 {
        let torque_nm =
            self.torque_fraction * vehicle.weight_n() * vehicle.geometry.arm_length_m(beta);
        torque_nm / vehicle.inertia_kg_m2(beta).xy().max()
    }

    /// |τ| ≤ fraction · m g L(β), and of it yaw at most fraction · m g k; no torque while the filter
    /// is blind.
    pub(super) fn wrench(
        &self,
        vehicle: &VehicleParameters,
        filter: &UpFilter,
        aim: &Aim,
        beta: MorphAngle,
        now_ns: u64,
    ) -> Wrench {
        let weight = vehicle.weight_n();
        if filter.is_blind(now_ns) {
            return Wrench::thrust(weight);
        }
        let alpha = filter.tilt_error(&aim.up_b) * self.stiffness - filter.rate_b * self.damping;
        let mut tau = vehicle.inertia_kg_m2(beta).component_mul(&alpha);
        let yaw_max = self.torque_fraction * weight * vehicle.yaw_coefficient_m;
        tau.z = tau.z.clamp(-yaw_max, yaw_max);
        let torque_max = self.torque_fraction * weight * vehicle.geometry.arm_length_m(beta);
        Wrench { thrust_n: aim.thrust_n, torque_b_nm: tau.cap_magnitude(torque_max) }
    }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
mod tests {
    use super::*;

    const G: f64 = 9.81;

    fn reading(gyro: Vector3<f64>, force: Vector3<f64>) -> ImuSample {
        ImuSample { gyro_b_rad_s: gyro, specific_force_b_m_s2: force, saturated: false }
    }

    fn up_at(roll: f64, pitch: f64) -> UpFilter {
        let q_wb = vehicle::quaternion_from_euler(&Vector3::new(roll, pitch, 0.7));
        UpFilter { up_b: q_wb.inverse_transform_vector(&Vector3::z()), ..UpFilter::new() }
    }

    fn torque(filter: &UpFilter, beta: MorphAngle) -> Vector3<f64> {
        let law = LevelLaw::level(&GateConfig::default());
        let vehicle = VehicleParameters::default();
        law.wrench(&vehicle, filter, &Aim::level(&vehicle), beta, 0).torque_b_nm
    }

    #[test]
    fn the_prediction_follows_a_coning_attitude() {
        let mut filter = UpFilter::new();
        let mut q_wb = UnitQuaternion::<f64>::identity();
        for k in 0..2000 {
            let t = f64::from(k) * 1e-3;
            let omega = Vector3::new(libm::cos(7.0 * t), libm::sin(5.0 * t), 3.0);
            q_wb *= UnitQuaternion::from_scaled_axis(omega * 1e-3);
            assert!(filter.read(0, &reading(omega, Vector3::zeros())));
            filter.predict(1e-3, &Vector3::zeros());
        }
        assert!((filter.up_b - q_wb.inverse_transform_vector(&Vector3::z())).norm() < 1e-12);
    }

    #[test]
    fn the_accelerometer_corrects_with_its_time_constant_and_only_near_g() {
        let mut filter = up_at(0.2, 0.0);
        for _ in 0..3000 {
            filter.correct(&Vector3::new(0.0, 0.0, G), G, 1e-3 / 3.0);
        }
        // One time constant leaves 1/e of a small tilt.
        assert!((filter.tilt_rad() / 0.2 - (-1.0_f64).exp()).abs() < 0.01);

        let mut filter = up_at(0.2, 0.0);
        for force in [0.0, 0.7 * G, 1.3 * G, 100.0] {
            filter.correct(&Vector3::new(0.0, 0.0, force), G, 0.5);
        }
        assert!((filter.tilt_rad() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn faulty_readings_are_not_taken_over() {
        let mut filter = UpFilter::new();
        let z = Vector3::z();
        assert!(filter.read(1, &reading(z * 2.0, z * G)));
        for bad in [f64::NAN, f64::INFINITY, -1e300] {
            assert!(!filter.read(2, &reading(z * bad, z * G)));
            assert!(!filter.read(2, &reading(z, z * bad)));
        }
        assert_eq!((filter.rate_b, filter.reading_ns), (z * 2.0, 1));
    }

    #[test]
    fn the_torque_turns_the_vehicle_back_and_stays_within_its_limit() {
        for beta in [MorphAngle::MIN, MorphAngle::MAX] {
            assert!(torque(&up_at(0.1, 0.0), beta).x < 0.0);
            assert!(torque(&up_at(0.0, 0.1), beta).y < 0.0);
            let spinning = UpFilter { rate_b: Vector3::new(3.0, -4.0, 5.0), ..UpFilter::new() };
            let damping = torque(&spinning, beta);
            assert!(damping.x < 0.0 && damping.y > 0.0 && damping.z < 0.0);

            let arm = VehicleParameters::default().geometry.arm_length_m(beta);
            let limit = 0.25 * VehicleParameters::default().weight_n() * arm;
            let wild = UpFilter { rate_b: Vector3::repeat(90.0), ..up_at(1.0, -1.0) };
            assert!((torque(&wild, beta).norm() / limit - 1.0).abs() < 1e-12);
        }
        assert_eq!(torque(&UpFilter::new(), MorphAngle::MIN), Vector3::zeros());
    }

    #[test]
    fn without_a_recent_reading_there_is_thrust_but_no_torque() {
        let law = LevelLaw::level(&GateConfig::default());
        let (vehicle, filter) = (VehicleParameters::default(), up_at(0.3, 0.0));
        let at =
            |now_ns| law.wrench(&vehicle, &filter, &Aim::level(&vehicle), MorphAngle::MIN, now_ns);
        assert!(at(MAX_READING_AGE_NS).torque_b_nm.norm() > 0.0);
        assert_eq!(at(MAX_READING_AGE_NS + 1), Wrench::thrust(vehicle.weight_n()));
    }
}
