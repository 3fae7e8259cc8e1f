//! The section `[vehicle]`: the vehicle as all services model it.

use ::vehicle::{Geometry, Quadratic, VehicleParameters};
use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The vehicle, as it is but for `plant.mismatch`, and as controllers and estimator model it.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleSettings {
    /// Mass \[kg\].
    #[garde(range(min = 0.001, max = 100.0))]
    pub mass_kg: f64,
    /// Gravity \[m/s²\].
    #[garde(range(min = 0.1, max = 100.0))]
    pub gravity_m_s2: f64,
    /// Rotor drag torque per thrust \[m\].
    #[garde(range(min = 1e-6, max = 1.0))]
    pub yaw_coefficient_m: f64,
    /// Largest thrust of one rotor \[N\]; the weight if left out.
    #[garde(range(min = 1e-6, max = 1e4))]
    pub rotor_thrust_max_n: Option<f64>,
    /// Rotor lag \[s\].
    #[garde(range(min = 0.0001, max = 1.0))]
    pub rotor_lag_s: f64,
    /// Linear drag \[N s/m\].
    #[garde(range(min = 0.0, max = 100.0))]
    pub drag_n_s_m: f64,
    /// Largest rate of the morph servo \[°/s\].
    #[garde(range(min = 0.1, max = 1e5))]
    pub servo_rate_limit_deg_s: f64,
    /// Lag of the morph servo \[s\].
    #[garde(range(min = 0.0001, max = 10.0))]
    pub servo_lag_s: f64,
    /// Arm length and inertia over β.
    #[garde(skip)]
    pub geometry: GeometrySettings,
}

impl Default for VehicleSettings {
    fn default() -> Self {
        let nominal = VehicleParameters::default();
        Self {
            mass_kg: nominal.mass_kg,
            gravity_m_s2: nominal.gravity_m_s2,
            yaw_coefficient_m: nominal.yaw_coefficient_m,
            rotor_thrust_max_n: None,
            rotor_lag_s: nominal.rotor_lag_s,
            drag_n_s_m: nominal.drag_n_s_m,
            // Given here in degrees: back and forth through radians would not be exact.
            servo_rate_limit_deg_s: 700.0,
            servo_lag_s: nominal.servo_lag_s,
            geometry: GeometrySettings::default(),
        }
    }
}

impl VehicleSettings {
    /// The modelled vehicle.
    #[must_use]
    pub fn parameters(&self) -> VehicleParameters {
        VehicleParameters {
            mass_kg: self.mass_kg,
            gravity_m_s2: self.gravity_m_s2,
            yaw_coefficient_m: self.yaw_coefficient_m,
            rotor_thrust_max_n: self.rotor_thrust_max_n.unwrap_or(self.mass_kg * self.gravity_m_s2),
            rotor_lag_s: self.rotor_lag_s,
            drag_n_s_m: self.drag_n_s_m,
            servo_rate_limit_rad_s: self.servo_rate_limit_deg_s.to_radians(),
            servo_lag_s: self.servo_lag_s,
            geometry: self.geometry.into(),
            inertia_scale: 1.0,
        }
    }
}

/// `[c0, c1, c2]` of c0 + c1 β + c2 β², β in degrees.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct GeometrySettings {
    /// Arm length \[m\].
    pub arm_length_m: [f64; 3],
    /// Ixx \[kg m²\].
    pub inertia_xx_kg_m2: [f64; 3],
    /// Iyy \[kg m²\].
    pub inertia_yy_kg_m2: [f64; 3],
    /// Izz \[kg m²\].
    pub inertia_zz_kg_m2: [f64; 3],
}

impl Default for GeometrySettings {
    fn default() -> Self {
        let nominal = Geometry::default();
        let triple = |law: Quadratic| [law.c0, law.c1, law.c2];
        Self {
            arm_length_m: triple(nominal.arm_length_m),
            inertia_xx_kg_m2: triple(nominal.inertia_xx_kg_m2),
            inertia_yy_kg_m2: triple(nominal.inertia_yy_kg_m2),
            inertia_zz_kg_m2: triple(nominal.inertia_zz_kg_m2),
        }
    }
}

impl From<GeometrySettings> for Geometry {
    fn from(settings: GeometrySettings) -> Self {
        let law = |[c0, c1, c2]: [f64; 3]| Quadratic { c0, c1, c2 };
        Self {
            arm_length_m: law(settings.arm_length_m),
            inertia_xx_kg_m2: law(settings.inertia_xx_kg_m2),
            inertia_yy_kg_m2: law(settings.inertia_yy_kg_m2),
            inertia_zz_kg_m2: law(settings.inertia_zz_kg_m2),
        }
    }
}
