//! What a vehicle is made of, in numbers, checked once before anything flies on them.

use nalgebra::Vector3;

use crate::parameter_error::positive;
use crate::{Allocator, Geometry, MorphAngle, ParameterError};

/// Mass, actuators, drag and morph law of one vehicle. Mass, gravity and geometry are Table I of
/// the paper; the others are typical of this vehicle class, because the paper prints none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleParameters {
    /// Total mass m \[kg\] (Table I).
    pub mass_kg: f64,
    /// Gravity g \[m/s²\] (Table I).
    pub gravity_m_s2: f64,
    /// Rotor drag torque per thrust, k in `M_i` = k `F_i` \[m\].
    pub yaw_coefficient_m: f64,
    /// Largest thrust of one rotor \[N\]; m g each gives a thrust-to-weight ratio of 4.
    pub rotor_thrust_max_n: f64,
    /// Time constant of a rotor's first-order lag \[s\].
    pub rotor_lag_s: f64,
    /// Linear drag \[N s/m\], the same on each axis: force = drag · (wind − v).
    pub drag_n_s_m: f64,
    /// Largest rate of the morph servo \[rad/s\].
    pub servo_rate_limit_rad_s: f64,
    /// Time constant of the morph servo's first-order lag \[s\].
    pub servo_lag_s: f64,
    /// Arm length and inertia as functions of β.
    pub geometry: Geometry,
    /// Factor on the inertia of the geometry; other than 1 makes a vehicle that its model misjudges.
    pub inertia_scale: f64,
}

impl Default for VehicleParameters {
    fn default() -> Self {
        Self {
            mass_kg: 0.12,
            gravity_m_s2: 9.81,
            yaw_coefficient_m: 0.016,
            rotor_thrust_max_n: 0.12 * 9.81,
            rotor_lag_s: 0.015,
            drag_n_s_m: 0.05,
            servo_rate_limit_rad_s: 700.0_f64.to_radians(),
            servo_lag_s: 0.020,
            geometry: Geometry::default(),
            inertia_scale: 1.0,
        }
    }
}

impl VehicleParameters {
    /// Refuses what no vehicle can have.
    ///
    /// # Errors
    /// The first parameter that is not finite, not positive (drag may be zero), too weak to hover,
    /// or whose morph law leaves an arm or an inertia non-positive inside the morph range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        const POSITIVE: &str = "give a finite number above zero";
        positive("mass_kg", self.mass_kg, POSITIVE)?;
        positive("gravity_m_s2", self.gravity_m_s2, POSITIVE)?;
        positive("yaw_coefficient_m", self.yaw_coefficient_m, POSITIVE)?;
        positive("rotor_thrust_max_n", self.rotor_thrust_max_n, POSITIVE)?;
        positive("rotor_lag_s", self.rotor_lag_s, "give a time above zero, 1e-4 s for no lag")?;
        positive("servo_rate_limit_rad_s", self.servo_rate_limit_rad_s, POSITIVE)?;
        positive("servo_lag_s", self.servo_lag_s, "give a time above zero, 1e-4 s for no lag")?;
        positive("inertia_scale", self.inertia_scale, "give a factor above zero, 1 for Table I")?;
        if !(self.drag_n_s_m >= 0.0 && self.drag_n_s_m.is_finite()) {
            return Err(ParameterError {
                name: "drag_n_s_m",
                value: self.drag_n_s_m,
                remedy: "give a finite number, zero for no drag",
            });
        }
        if 4.0 * self.rotor_thrust_max_n <= self.weight_n() {
            return Err(ParameterError {
                name: "rotor_thrust_max_n",
                value: self.rotor_thrust_max_n,
                remedy: "four rotors must lift more than the weight",
            });
        }
        self.geometry.validate()
    }

    /// Weight m g \[N\], the collective thrust of hover.
    #[must_use]
    pub fn weight_n(&self) -> f64 {
        self.mass_kg * self.gravity_m_s2
    }

    /// Principal inertia (Ixx, Iyy, Izz) \[kg m²\] in B at `beta`, with the scale.
    #[must_use]
    pub fn inertia_kg_m2(&self, beta: MorphAngle) -> Vector3<f64> {
        self.geometry.inertia_kg_m2(beta) * self.inertia_scale
    }

    /// dI/dβ \[kg m²/rad\] in B at `beta`, with the scale.
    #[must_use]
    pub fn inertia_slope_kg_m2_rad(&self, beta: MorphAngle) -> Vector3<f64> {
        self.geometry.inertia_slope_kg_m2_rad(beta) * self.inertia_scale
    }

    /// What a controller may ask of each torque \[N m\] at `beta` and `thrust_n` \[N\] without
    /// taking from the others more than its share: roll and pitch m g L min(1/2, T/(2 m g)), yaw
    /// k m g, and never more than rotors that give at most F add to the thrust of hover by (1), L (2 F − m g/2) and
    /// 2 k (2 F − m g/2). Beyond hover the thrust gives way, so that a vehicle at full thrust still turns.
    #[must_use]
    pub fn torque_bound_nm(&self, beta: MorphAngle, thrust_n: f64) -> Vector3<f64> {
        let weight = self.weight_n();
        let arm = self.geometry.arm_length_m(beta);
        let spare_n = self.spare_at_hover_n();
        let tilt = (weight * arm * (0.5 * thrust_n / weight).min(0.5)).min(arm * spare_n);
        let yaw = self.yaw_coefficient_m * weight.min(2.0 * spare_n);
        Vector3::new(tilt, tilt, yaw)
    }

    /// What a pair of rotors can give beyond hover, 2 F − m g/2 \[N\].
    fn spare_at_hover_n(&self) -> f64 {
        (2.0 * self.rotor_thrust_max_n - 0.5 * self.weight_n()).max(0.0)
    }

    /// T \[N\] of hover and, by (1), the torques \[N m\] that rotors can add to it at `beta`: the unit in
    /// which steps of commands and disagreements about them are measured.
    #[must_use]
    pub fn largest_wrench(&self, beta: MorphAngle) -> [f64; 4] {
        let weight_n = self.weight_n();
        // The pair that slows down can give up half of the weight, the other as much as is left.
        let spare_n = (0.5 * weight_n).min(self.spare_at_hover_n());
        let tilt_nm = self.geometry.arm_length_m(beta) * spare_n;
        [weight_n, tilt_nm, tilt_nm, 2.0 * self.yaw_coefficient_m * spare_n]
    }

    /// The control allocation for the arms at `beta`.
    #[must_use]
    pub fn allocator(&self, beta: MorphAngle) -> Allocator {
        Allocator {
            arm_length_m: self.geometry.arm_length_m(beta),
            yaw_coefficient_m: self.yaw_coefficient_m,
            thrust_max_n: self.rotor_thrust_max_n,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Wrench;

    #[test]
    fn the_default_vehicle_is_valid_and_has_a_thrust_to_weight_ratio_of_four() {
        let vehicle = VehicleParameters::default();
        assert_eq!(vehicle.validate(), Ok(()));
        assert!((4.0 * vehicle.rotor_thrust_max_n / vehicle.weight_n() - 4.0).abs() < 1e-12);
    }

    #[test]
    fn weak_rotors_bound_the_torques_to_what_they_can_add_to_the_thrust_of_hover() {
        let strong = VehicleParameters::default();
        let weight_n = strong.weight_n();
        let weak = VehicleParameters { rotor_thrust_max_n: 1.5 * weight_n / 4.0, ..strong };
        for beta in [MorphAngle::MIN, MorphAngle::MAX] {
            for weights in [0.3, 0.7, 1.0] {
                let thrust_n = weights * weight_n;
                let bound = weak.torque_bound_nm(beta, thrust_n);
                for torque in [[bound.x, 0.0, 0.0], [0.0, bound.y, 0.0], [0.0, 0.0, bound.z]] {
                    let wrench = Wrench { torque_b_nm: torque.into(), ..Wrench::thrust(thrust_n) };
                    let rotors_n = weak.allocator(beta).unlimited_thrusts(&wrench);
                    let most_n = rotors_n.into_iter().fold(0.0, f64::max);
                    assert!(
                        most_n <= weak.rotor_thrust_max_n * (1.0 + 1e-12),
                        "{weights}: {most_n}"
                    );
                }
                let usual = strong.torque_bound_nm(beta, thrust_n);
                assert!((usual.x - bound.x > 1e-9) == (weights > 0.5), "{weights}");
            }
            let hover = weak.torque_bound_nm(beta, weight_n);
            assert_eq!(weak.torque_bound_nm(beta, 1.5 * weight_n), hover);
        }
    }

    #[test]
    fn each_impossible_parameter_is_refused_by_name() {
        type Spoil = fn(&mut VehicleParameters);
        let cases: [(&str, Spoil); 10] = [
            ("mass_kg", |v| v.mass_kg = 0.0),
            ("gravity_m_s2", |v| v.gravity_m_s2 = f64::NAN),
            ("yaw_coefficient_m", |v| v.yaw_coefficient_m = -0.016),
            ("rotor_thrust_max_n", |v| v.rotor_thrust_max_n = 0.25 * v.mass_kg * v.gravity_m_s2),
            ("rotor_lag_s", |v| v.rotor_lag_s = 0.0),
            ("drag_n_s_m", |v| v.drag_n_s_m = f64::NAN),
            ("servo_rate_limit_rad_s", |v| v.servo_rate_limit_rad_s = f64::INFINITY),
            ("servo_lag_s", |v| v.servo_lag_s = -1.0),
            ("inertia_scale", |v| v.inertia_scale = 0.0),
            ("geometry.arm_length_m", |v| v.geometry.arm_length_m.c1 = -1.0),
        ];
        for (name, spoil) in cases {
            let mut vehicle = VehicleParameters::default();
            spoil(&mut vehicle);
            assert_eq!(vehicle.validate().unwrap_err().name, name);
        }
    }

    #[test]
    fn the_inertia_scale_multiplies_inertia_and_slope_alike() {
        let scaled = VehicleParameters { inertia_scale: 1.5, ..VehicleParameters::default() };
        let beta = MorphAngle::MIN;
        let geometry = scaled.geometry;
        assert_eq!(scaled.inertia_kg_m2(beta), geometry.inertia_kg_m2(beta) * 1.5);
        let slope = geometry.inertia_slope_kg_m2_rad(beta);
        assert_eq!(scaled.inertia_slope_kg_m2_rad(beta), slope * 1.5);
    }
}
