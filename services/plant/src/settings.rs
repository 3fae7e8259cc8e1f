//! The section `[plant]` of a scenario.

use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vehicle::VehicleParameters;

use crate::ModelKind;
use crate::gate::GateConfig;
use crate::sensors::{
    BarometerConfig, ImuConfig, MorphEncoderConfig, PoseFixConfig, RangeFinderConfig, SensorConfigs,
};

/// What a scenario sets of the plant.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Loop rate \[Hz\]. Integration steps are shorter where they must be.
    #[garde(range(min = 1.0, max = 10000.0))]
    pub rate_hz: f64,
    /// What is integrated.
    #[garde(skip)]
    pub model: Model,
    /// Steps from one published state to the next.
    #[garde(range(min = 1, max = 100000))]
    pub state_every: u32,
    /// Ground at z = 0; the linear model has none.
    #[garde(skip)]
    pub ground: bool,
    /// How the real vehicle differs from the one that all loops model.
    #[garde(dive)]
    pub mismatch: Mismatch,
    /// Gyro and accelerometer.
    #[garde(dive)]
    pub imu: ImuConfig,
    /// Tracker.
    #[garde(dive)]
    pub pose_fix: PoseFixConfig,
    /// Encoder of β.
    #[garde(dive)]
    pub morph_encoder: MorphEncoderConfig,
    /// Height by air pressure.
    #[garde(dive)]
    pub barometer: BarometerConfig,
    /// Distance to the ground below.
    #[garde(dive)]
    pub range_finder: RangeFinderConfig,
    /// Limits of the actuation gate.
    #[garde(dive)]
    pub gate: GateConfig,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            rate_hz: 1000.0,
            model: Model::Nonlinear,
            state_every: 10,
            ground: true,
            mismatch: Mismatch::default(),
            imu: ImuConfig::default(),
            pose_fix: PoseFixConfig::default(),
            morph_encoder: MorphEncoderConfig::default(),
            barometer: BarometerConfig::default(),
            range_finder: RangeFinderConfig::default(),
            gate: GateConfig::default(),
        }
    }
}

/// What is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// [`ModelKind::Nonlinear`].
    Nonlinear,
    /// [`ModelKind::Linear`], the paper's own.
    Linear,
}

impl Settings {
    /// What the sensors are built from.
    #[must_use]
    pub fn sensors(&self) -> SensorConfigs {
        SensorConfigs {
            imu: self.imu.clone(),
            pose_fix: self.pose_fix.clone(),
            morph_encoder: self.morph_encoder.clone(),
            barometer: self.barometer.clone(),
            range_finder: self.range_finder.clone(),
        }
    }

    /// The equations of motion.
    #[must_use]
    pub fn model_kind(&self) -> ModelKind {
        match self.model {
            Model::Nonlinear => ModelKind::Nonlinear { ground: self.ground },
            Model::Linear => ModelKind::Linear,
        }
    }
}

/// How the real vehicle differs from the modelled one.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Mismatch {
    /// Real inertia over modelled inertia.
    #[garde(range(min = 0.1, max = 10.0))]
    pub inertia_scale: f64,
    /// Real mass over modelled mass.
    #[garde(range(min = 0.1, max = 3.9))]
    pub mass_scale: f64,
    /// Real rotor lag \[s\]; the modelled one if left out.
    #[garde(range(min = 0.0001, max = 1.0))]
    pub rotor_lag_s: Option<f64>,
}

impl Default for Mismatch {
    fn default() -> Self {
        Self { inertia_scale: 1.0, mass_scale: 1.0, rotor_lag_s: None }
    }
}

impl Mismatch {
    /// The real vehicle, given the modelled one.
    #[must_use]
    pub fn real_vehicle(&self, modelled: VehicleParameters) -> VehicleParameters {
        VehicleParameters {
            mass_kg: modelled.mass_kg * self.mass_scale,
            inertia_scale: modelled.inertia_scale * self.inertia_scale,
            rotor_lag_s: self.rotor_lag_s.unwrap_or(modelled.rotor_lag_s),
            ..modelled
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_is_valid_and_the_vehicle_is_as_modelled() {
        let settings: Settings = toml::from_str("").unwrap();
        assert!(settings.validate().is_ok());
        let modelled = VehicleParameters::default();
        assert_eq!(settings.mismatch.real_vehicle(modelled), modelled);
    }

    #[test]
    fn a_mismatch_changes_the_vehicle_and_not_its_rotors() {
        let toml = "mismatch = { inertia_scale = 1.5, mass_scale = 1.25, rotor_lag_s = 0.02 }";
        let settings: Settings = toml::from_str(toml).unwrap();
        let real = settings.mismatch.real_vehicle(VehicleParameters::default());
        let modelled = VehicleParameters::default();
        let expected = VehicleParameters {
            mass_kg: modelled.mass_kg * 1.25,
            inertia_scale: 1.5,
            rotor_lag_s: 0.02,
            ..modelled
        };
        assert_eq!(real, expected);
    }
}
