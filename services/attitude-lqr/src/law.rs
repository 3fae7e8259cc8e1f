//! One step of the law.

use controller::OutOfRange;
use controller::attitude::{AttitudeLaw, Common, Sample};
use nalgebra::{SVector, Vector3};
use vehicle::{ParameterError, VehicleParameters, wrap_pi};

use crate::design::{GainTable, LqrConfig};

shared_types::memory! {
    /// The law's whole evolving memory.
    #[derive(PartialEq)]
    pub struct Memory {
        /// Set point, torques, counters.
        pub common: Common,
        /// ∫(γ − γ of the set point) \[rad s\].
        pub integral_rad_s: [f64; 3],
        /// Torque as the law would have had it \[N m\].
        pub wish_nm: [f64; 3],
        /// γ of the last set point \[rad\].
        pub setpoint_rad: [f64; 3],
    }
}

/// Why a law cannot be built.
#[derive(Debug, Clone, PartialEq)]
pub enum LqrError {
    /// A number outside its range.
    Range(OutOfRange),
    /// The vehicle is impossible.
    Vehicle(ParameterError),
    /// The Riccati equation has no solution.
    NotStabilisable,
}

impl core::fmt::Display for LqrError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Range(error) => error.fmt(f),
            Self::Vehicle(error) => error.fmt(f),
            Self::NotStabilisable => f.write_str("no gain stabilises the model with these weights"),
        }
    }
}

impl core::error::Error for LqrError {}

/// The attitude LQR.
#[derive(Debug)]
pub struct LqrLaw {
    config: LqrConfig,
    vehicle: VehicleParameters,
    table: GainTable,
    /// Share of a shortfall that the integral takes in one sample.
    windup_share: f64,
    integral: Vector3<f64>,
    wish: Vector3<f64>,
    setpoint: Vector3<f64>,
}

impl LqrLaw {
    /// Solves for all gains.
    ///
    /// # Errors
    /// A number outside its range, an impossible vehicle, or one that cannot be stabilised.
    pub fn new(config: LqrConfig, vehicle: &VehicleParameters) -> Result<Self, LqrError> {
        config.validate().map_err(LqrError::Range)?;
        vehicle.validate().map_err(LqrError::Vehicle)?;
        let table = GainTable::new(&config, vehicle).ok_or(LqrError::NotStabilisable)?;
        let windup_share = -libm::expm1(-config.timing.period_s / config.windup_s);
        let zero = Vector3::zeros();
        let (integral, wish, setpoint) = (zero, zero, zero);
        Ok(Self { config, vehicle: *vehicle, table, windup_share, integral, wish, setpoint })
    }

    /// The law's numbers.
    #[must_use]
    pub fn config(&self) -> &LqrConfig {
        &self.config
    }
}

impl AttitudeLaw for LqrLaw {
    type Memory = Memory;

    fn torque(&mut self, sample: &Sample) -> Vector3<f64> {
        let unit = self.vehicle.torque_bound_nm(sample.morph_angle, self.vehicle.weight_n());
        for axis in 0..3 {
            let gain = self.table.at(sample.morph_angle, axis);
            let last = sample.applied_nm[axis] / unit[axis];
            if sample.follows {
                // Back-calculation [Astrom, Hagglund] 3.5: of what was wished at k−1 and not applied,
                // by bounds, rotors or because another controller flies, the integral gives way.
                let lacking = last - self.wish[axis] / unit[axis];
                self.integral[axis] -= self.windup_share * lacking / gain[0];
                // Set-point weighting [Astrom, Hagglund] 3.4: b = Tᵢ K₀/K₁ puts the zero that the integral
                // brings onto its pole −1/Tᵢ, so that a step does not overshoot by it.
                let weight = (self.config.integral_s[axis] * gain[0] / gain[1]).min(1.0);
                let moved = wrap_pi(sample.setpoint_rad[axis] - self.setpoint[axis]);
                self.integral[axis] += (1.0 - weight) * gain[1] / gain[0] * moved;
            }
            let x = SVector::from([
                self.integral[axis],
                sample.error_rad[axis],
                sample.gamma_rate_rad_s[axis],
                sample.torque_nm[axis] / unit[axis],
                last,
            ]);
            // u(k) = u(k−1) + Δu(k), Δu = −K x
            self.wish[axis] = (last - gain.dot(&x)) * unit[axis];
            self.integral[axis] += self.config.timing.period_s * sample.error_rad[axis];
        }
        self.setpoint = sample.setpoint_rad;
        self.wish
    }

    fn memory(&self, common: &Common) -> Memory {
        Memory {
            common: *common,
            integral_rad_s: self.integral.into(),
            wish_nm: self.wish.into(),
            setpoint_rad: self.setpoint.into(),
        }
    }

    fn restore(&mut self, memory: &Memory) -> Result<Common, String> {
        let parts = [memory.integral_rad_s, memory.wish_nm, memory.setpoint_rad];
        if !parts.iter().flatten().all(|number| number.is_finite()) {
            return Err("it holds a number that is not finite".to_owned());
        }
        [self.integral, self.wish, self.setpoint] = parts.map(Vector3::from);
        Ok(memory.common)
    }
}
