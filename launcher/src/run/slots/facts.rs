//! Facts about slots that follow from the flight: axes, latencies, rates.

use crate::scenario::Scenario;
use runtime::Graph;
use shared_types::{Role, topics};
use slot::gate::Axis;
use vehicle::MorphAngle;

/// Largest command of each slot, T and τ, or T, φ, θ and ψ, at the smallest arms.
pub(crate) fn largest_commands(scenario: &Scenario) -> Vec<(Role, [f64; 4])> {
    let vehicle = scenario.modelled_vehicle();
    let rotor_n = vehicle.rotor_thrust_max_n;
    let arm_m = vehicle.geometry.arm_length_m(MorphAngle::MAX);
    // eq. (1) with each rotor between 0 and its most.
    let torque_nm = [arm_m, arm_m, 2.0 * vehicle.yaw_coefficient_m].map(|lever| lever * rotor_n);
    let thrust_n = 4.0 * rotor_n;
    let [x, y, z] = torque_nm;
    let tilt_rad = core::f64::consts::FRAC_PI_2;
    vec![
        (Role::Attitude, [thrust_n, x, y, z]),
        (Role::Position, [thrust_n, tilt_rad, tilt_rad, core::f64::consts::PI]),
    ]
}

/// Axes of a slot's command, by its largest values.
pub(super) fn axes(slot: Role, u_max: &[f64; 4]) -> [Axis; 4] {
    let names = match slot {
        Role::Attitude => ["thrust (N)", "torque x (N m)", "torque y (N m)", "torque z (N m)"],
        _ => ["thrust (N)", "roll (rad)", "pitch (rad)", "yaw (rad)"],
    };
    core::array::from_fn(|i| {
        // Thrust pulls and never pushes; rounding at a bound is no offence.
        let slack = 1e-6 * u_max[i];
        let min = if i == 0 { -slack } else { -u_max[i] - slack };
        Axis { name: names[i], min, max: u_max[i] + slack }
    })
}

/// From release to effect of the command by which a role fills its slot \[ns\].
pub(super) fn command_latency_ns(graph: &Graph, role: Role) -> u64 {
    match role {
        Role::Attitude => graph.latency_ns(&topics::WRENCH_COMMAND.info),
        Role::Position => graph.latency_ns(&topics::ATTITUDE_SETPOINT.info),
        _ => 0,
    }
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
