//! Facts about slots that follow from the flight: axes, latencies, rates.

use core::f64::consts::FRAC_PI_2;
use runtime::Graph;
use runtime::arbiter::setpoints::TILT_BOUND_RAD;
use shared_types::{Role, Slot};
use slot::gate::Axis;
use vehicle::{MorphAngle, VehicleParameters};

/// What commands of a slot are measured by.
#[derive(Debug, Clone, Copy)]
pub(super) enum CommandScale {
    /// Torques, of which the arms' length decides how large they can be.
    Wrench(VehicleParameters),
    /// Thrust and tilt.
    Setpoint(VehicleParameters),
}

impl CommandScale {
    pub(super) fn of(slot: Slot, vehicle: &VehicleParameters) -> Self {
        match slot {
            Slot::Attitude => Self::Wrench(*vehicle),
            Slot::Position => Self::Setpoint(*vehicle),
        }
    }

    /// True if the largest command depends on the deployable angle.
    pub(super) fn morphs(&self) -> bool {
        matches!(self, Self::Wrench(_))
    }

    /// Largest command at a measured deployable angle: the unit of the consumer's limiter.
    pub(super) fn largest(&self, morph_angle: MorphAngle) -> [f64; 4] {
        match self {
            Self::Wrench(vehicle) => vehicle.largest_wrench(morph_angle),
            // The heading comes from the reference, whichever controller owns the slot.
            Self::Setpoint(vehicle) => {
                [vehicle.weight_n(), TILT_BOUND_RAD, TILT_BOUND_RAD, core::f64::consts::PI]
            }
        }
    }

    /// What no controller may ask for: by (1), more than rotors between 0 and their most ever give; or
    /// more tilt than leaves any lift.
    pub(super) fn axes(&self) -> [Axis; 4] {
        let (Self::Wrench(vehicle) | Self::Setpoint(vehicle)) = self;
        let rotor_n = vehicle.rotor_thrust_max_n;
        let (names, [x, y, z]) = match self {
            Self::Wrench(_) => {
                let arm_m = vehicle.geometry.arm_length_m(MorphAngle::MAX);
                let levers_m = [arm_m, arm_m, 2.0 * vehicle.yaw_coefficient_m];
                let names = ["thrust (N)", "torque x (N m)", "torque y (N m)", "torque z (N m)"];
                (names, levers_m.map(|lever_m| lever_m * rotor_n))
            }
            Self::Setpoint(_) => {
                let names = ["thrust (N)", "roll (rad)", "pitch (rad)", "yaw (rad)"];
                (names, [FRAC_PI_2, FRAC_PI_2, core::f64::consts::PI])
            }
        };
        let most = [4.0 * rotor_n, x, y, z];
        core::array::from_fn(|i| {
            // Thrust pulls and never pushes; rounding at a bound is no offence.
            let slack = 1e-6 * most[i];
            let min = if i == 0 { -slack } else { -most[i] - slack };
            Axis { name: names[i], min, max: most[i] + slack }
        })
    }
}

/// From release to effect of the command by which a role fills its slot \[ns\].
pub(super) fn command_latency_ns(graph: &Graph, role: Role) -> u64 {
    Slot::of(role).map_or(0, |slot| graph.latency_ns(slot.spec().command))
}

/// Rate of a controller: the slot's own if its period is, so that no rounding comes in.
pub(super) fn millihertz(graph: &Graph, role: Role, period_ns: u64) -> u64 {
    let node = graph.node(role).filter(|node| node.rate.period_ns() == period_ns);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
    node.map_or_else(
        || 1_000_000_000_000_u64.checked_div(period_ns).unwrap_or(0),
        |node| (node.rate.hz() * 1000.0).round() as u64,
    )
}
