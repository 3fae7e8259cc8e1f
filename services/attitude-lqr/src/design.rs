//! Model, cost and gains of one axis, for every morph angle.

use controller::attitude::Timing;
use controller::{OutOfRange, within};
use nalgebra::{SMatrix, SVector};
use vehicle::{MorphAngle, VehicleParameters};

use crate::riccati::{doubling, gain};

/// x = \[∫e, e, ė, a, u(k−1)\]: e = γ − γ of the set point, a the torque behind the lag. Torques in
/// shares of the bound in hover.
pub const STATES: usize = 5;

/// Angles of the table: one every 5°.
const NODES: usize = 24;

type Gain = SVector<f64, STATES>;

/// The complete configuration of the law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LqrConfig {
    /// Times on the way of a command; the period is the control period.
    pub timing: Timing,
    /// Error \[rad\] that costs as much as the whole torque built up within `torque_rise_s`.
    pub angle_error_rad: f64,
    /// That time \[s\], for roll, pitch and yaw.
    pub torque_rise_s: [f64; 3],
    /// An error of `angle_error_rad` for this long \[s\] costs as much again.
    pub integral_s: [f64; 3],
    /// Time \[s\] in which the integral takes back what bounds and rotors did not give.
    pub windup_s: f64,
}

impl LqrConfig {
    pub(crate) fn validate(&self) -> Result<(), OutOfRange> {
        within("rate_hz", 1.0 / self.timing.period_s, 1.0, 1000.001)?;
        within("rotor_lag_s", self.timing.rotor_lag_s, 0.0, 1.0)?;
        within("wrench_latency_s", self.timing.latency_s, 0.0, 1.0)?;
        within("angle_error_rad", self.angle_error_rad, 1e-4, 10.0)?;
        for time_s in self.torque_rise_s {
            within("torque_rise_s", time_s, 1e-6, 100.0)?;
        }
        for time_s in self.integral_s {
            within("integral_s", time_s, 1e-3, 1e3)?;
        }
        within("windup_s", self.windup_s, 1e-3, 1e3)
    }

    /// A and B of x(k+1) = A x + B Δu, the sampled model behind lag and delay with its integral, for
    /// an acceleration of `gain` \[rad/s²\] at the bound.
    #[must_use]
    pub fn model(&self, gain: f64) -> (SMatrix<f64, STATES, STATES>, SVector<f64, STATES>) {
        let period = self.timing.period_s;
        let axis = mpc::LaggedAxis { gain, ..self.timing.axis() };
        let mut a = SMatrix::<f64, STATES, STATES>::zeros();
        let mut b = SVector::<f64, STATES>::zeros();
        a[(0, 0)] = 1.0;
        a[(0, 1)] = period;
        for column in 0..4 {
            let unit: [f64; 4] = core::array::from_fn(|row| f64::from(u8::from(row == column)));
            let image = axis.advance(unit, unit[3], period);
            a.fixed_view_mut::<4, 1>(1, column + 1).copy_from_slice(&image);
        }
        b.fixed_rows_mut::<4>(1).copy_from_slice(&axis.advance([0.0; 4], 1.0, period));
        (a, b)
    }

    /// Q and r of the cost ∑ xᵀQx + r Δu² by Bryson's rule: the sampled
    /// ∫ (e/ē)² + (∫e/(ē Tᵢ))² + (u̇ Tᵣ)² dt, whose loop is the same at every rate.
    #[must_use]
    pub fn cost(&self, axis: usize) -> (SMatrix<f64, STATES, STATES>, f64) {
        let (period, error) = (self.timing.period_s, self.angle_error_rad);
        let mut q = SMatrix::<f64, STATES, STATES>::zeros();
        let integral = error * self.integral_s[axis];
        q[(0, 0)] = period / (integral * integral);
        q[(1, 1)] = period / (error * error);
        let rise = self.torque_rise_s[axis];
        (q, rise * rise / period)
    }

    /// K of Δu = −K x for `axis` at `beta`.
    #[must_use]
    pub fn gain(&self, vehicle: &VehicleParameters, beta: MorphAngle, axis: usize) -> Option<Gain> {
        let bound = vehicle.torque_bound_nm(beta, vehicle.weight_n())[axis];
        let (a, b) = self.model(bound / vehicle.inertia_kg_m2(beta)[axis]);
        let (q, r) = self.cost(axis);
        Some(gain(&a, &b, &doubling(&a, &b, &q, r)?, r))
    }
}

/// Gains of the three axes over the morph angle.
#[derive(Debug, Clone, PartialEq)]
pub struct GainTable([[Gain; 3]; NODES]);

impl GainTable {
    /// Solves for every node; `None` if the vehicle cannot be stabilised.
    #[must_use]
    pub fn new(config: &LqrConfig, vehicle: &VehicleParameters) -> Option<Self> {
        let mut table = [[Gain::zeros(); 3]; NODES];
        for (node, gains) in table.iter_mut().enumerate() {
            let beta = MorphAngle::saturating_from_rad(Self::angle_rad(node))?;
            for (axis, slot) in gains.iter_mut().enumerate() {
                *slot = config.gain(vehicle, beta, axis)?;
            }
        }
        Some(Self(table))
    }

    fn angle_rad(node: usize) -> f64 {
        let share = node as f64 / (NODES - 1) as f64;
        MorphAngle::MIN.rad() + (MorphAngle::MAX.rad() - MorphAngle::MIN.rad()) * share
    }

    /// K of `axis` at `beta`, linear between the nodes.
    #[must_use]
    pub fn at(&self, beta: MorphAngle, axis: usize) -> Gain {
        let range = MorphAngle::MAX.rad() - MorphAngle::MIN.rad();
        let place = (beta.rad() - MorphAngle::MIN.rad()) / range * (NODES - 1) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let node = (place as usize).min(NODES - 2);
        let share = (place - node as f64).clamp(0.0, 1.0);
        let (from, to) = (&self.0[node][axis], &self.0[node + 1][axis]);
        from + (to - from) * share
    }
}
