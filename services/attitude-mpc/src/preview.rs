//! The morph as it is commanded, over the horizon: gains and limits that change with it.
//!
//! I ω is the momentum that torque builds up, (I ω)' = τ; what changes with β is only how fast the
//! vehicle turns with it, and how much torque its rotors give.

use mpc::{Ahead, Bounds, Horizon};
use nalgebra::Vector3;
use vehicle::{MorphAngle, VehicleParameters};

use crate::config::AttitudeLawConfig;
use crate::schedule;

/// A path closer to the present angle than this counts as none \[rad\]: the noise of the encoder.
const STILL_RAD: f64 = 0.5 * core::f64::consts::PI / 180.0;

/// Planned path of the commanded angle.
#[derive(Debug, Clone, Copy)]
pub struct MorphPlan<'a> {
    /// Commanded angles \[rad\]; the last one lasts.
    pub path_rad: &'a [f64],
    /// Time between them \[s\].
    pub spacing_s: f64,
    /// Time since the first of them was due \[s\].
    pub age_s: f64,
}

impl MorphPlan<'_> {
    /// Commanded angle `ahead_s` from now; `None` without a finite one.
    fn at(&self, ahead_s: f64) -> Option<f64> {
        let steps = (self.age_s + ahead_s) / self.spacing_s;
        let last = self.path_rad.len().checked_sub(1)?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let index = (steps as usize).min(last);
        let (from, to) = (self.path_rad[index], self.path_rad[(index + 1).min(last)]);
        let share = (steps - index as f64).clamp(0.0, 1.0);
        Some(from + (to - from) * share).filter(|angle| angle.is_finite())
    }

    fn leaves(&self, beta: MorphAngle) -> bool {
        self.path_rad.iter().any(|angle| (angle - beta.rad()).abs() > STILL_RAD)
    }
}

/// What the horizon knows of the morph, reused every step.
#[derive(Debug)]
pub(crate) struct Preview {
    angles: Vec<MorphAngle>,
    /// Samples over which the path is followed; it is taken to rest there.
    reach: usize,
    gain: Vec<Vector3<f64>>,
    gain_at: Vec<Vector3<f64>>,
    inputs: Vec<Bounds<3>>,
    coupling: Vec<Vector3<f64>>,
}

impl Preview {
    pub(crate) fn new(horizon: Horizon, reach: usize) -> Self {
        let Horizon { prediction, control } = horizon;
        let zero = Vector3::zeros();
        Self {
            angles: vec![MorphAngle::MIN; prediction + 1],
            reach,
            gain: vec![zero; prediction],
            gain_at: vec![zero; prediction],
            inputs: vec![Bounds::symmetric(zero, zero); control],
            coupling: vec![zero; control],
        }
    }

    /// Follows `plan` from `beta`; false if the arms stay where they are.
    pub(crate) fn follow(
        &mut self,
        plan: &MorphPlan<'_>,
        beta: MorphAngle,
        vehicle: &VehicleParameters,
        period_s: f64,
    ) -> bool {
        if !plan.leaves(beta) {
            return false;
        }
        let mut angle = beta;
        for (j, slot) in self.angles.iter_mut().enumerate() {
            *slot = angle;
            if j >= self.reach {
                continue;
            }
            // The command half way through the period stands for all of it.
            let Some(command) = plan.at((j as f64 + 0.5) * period_s) else { return false };
            let Some(command) = MorphAngle::saturating_from_rad(command) else { return false };
            angle = vehicle.servo_angle_after(angle, command, period_s);
        }
        self.angles.iter().any(|angle| (angle.rad() - beta.rad()).abs() > STILL_RAD)
    }

    /// Gains and limits along the path, in the units of `beta`, its first angle.
    pub(crate) fn ahead(
        &mut self,
        config: &AttitudeLawConfig,
        vehicle: &VehicleParameters,
        unit: &Vector3<f64>,
        thrust: f64,
    ) -> Ahead<'_, 3> {
        let inertia = vehicle.inertia_kg_m2(self.angles[0]);
        for j in 0..self.gain.len() {
            let after = vehicle.inertia_kg_m2(self.angles[j + 1]);
            self.gain_at[j] = inertia.component_div(&after);
            self.gain[j] =
                mean_gain(vehicle, self.angles[j], self.angles[j + 1]).component_mul(&inertia);
        }
        for j in 0..self.inputs.len() {
            let bound = schedule::torque_bounds(config, vehicle, self.angles[j], thrust);
            let level = bound.component_div(unit);
            self.inputs[j] = Bounds::symmetric(level, level);
            let own = schedule::unit(config, vehicle, self.angles[j]);
            self.coupling[j] = unit.component_div(&own);
        }
        Ahead {
            gain: &self.gain,
            gain_at: &self.gain_at,
            inputs: &self.inputs,
            coupling: &self.coupling,
        }
    }
}

/// Mean of 1/I between two angles, by Simpson's rule \[1/(kg m²)\].
pub(crate) fn mean_gain(
    vehicle: &VehicleParameters,
    from: MorphAngle,
    to: MorphAngle,
) -> Vector3<f64> {
    let inverse = |beta: MorphAngle| vehicle.inertia_kg_m2(beta).map(f64::recip);
    let half = 0.5 * (from.rad() + to.rad());
    let middle = MorphAngle::saturating_from_rad(half).unwrap_or(from);
    (inverse(from) + inverse(middle) * 4.0 + inverse(to)) / 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep() -> [f64; 3] {
        [45.0_f64, 45.0, 160.0].map(f64::to_radians)
    }

    #[test]
    fn a_plan_that_stays_is_no_morph_and_one_that_will_leave_is() {
        let vehicle = VehicleParameters::default();
        let mut preview = Preview::new(Horizon { prediction: 20, control: 3 }, 20);
        let mut follow = |path: &[f64], age_s: f64| {
            let plan = MorphPlan { path_rad: path, spacing_s: 0.1, age_s };
            preview.follow(&plan, MorphAngle::MIN, &vehicle, 0.01)
        };
        assert!(!follow(&[0.79], 0.0));
        assert!(!follow(&[], 0.0));
        assert!(!follow(&[f64::NAN; 3], 0.0));
        assert!(follow(&sweep(), 0.0), "within 0.2 s");
        let far: Vec<f64> = [vec![45.0_f64.to_radians(); 5], vec![2.0]].concat();
        assert!(!follow(&far, 0.0), "not within 0.2 s");
        assert!(follow(&far, 0.3));
    }

    #[test]
    fn the_gain_falls_with_the_inertia_the_servo_will_have() {
        let vehicle = VehicleParameters::default();
        let config = AttitudeLawConfig::default();
        let mut preview = Preview::new(Horizon { prediction: 40, control: 3 }, 40);
        let path = sweep();
        let plan = MorphPlan { path_rad: &path[2..], spacing_s: 0.1, age_s: 0.0 };
        assert!(preview.follow(&plan, MorphAngle::MIN, &vehicle, 0.01));
        let unit = schedule::unit(&config, &vehicle, MorphAngle::MIN);
        let ahead = preview.ahead(&config, &vehicle, &unit, 1.0);
        let whole =
            vehicle.inertia_kg_m2(MorphAngle::MIN).x / vehicle.inertia_kg_m2(MorphAngle::MAX).x;
        assert!((ahead.gain_at[39].x - whole).abs() < 1e-3 * whole);
        assert!(ahead.gain.windows(2).all(|pair| pair[1].x <= pair[0].x));
        // At the rate limit of 700 °/s it has turned by 35° after 50 ms.
        let beta = MorphAngle::from_degrees(80.0).unwrap();
        let expected = vehicle.inertia_kg_m2(MorphAngle::MIN).x / vehicle.inertia_kg_m2(beta).x;
        assert!((ahead.gain_at[4].x - expected).abs() < 1e-9);
    }
}
