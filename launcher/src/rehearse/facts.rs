//! What is known of vehicle, loops and plan, from the scenario that is flown.

use crate::pilot::{MorphKnot, Trajectory};
use crate::scenario::{Plan, Scenario};
use rehearsal::{Facts, Snapshot, Sweep};
use shared_types::Role;

/// Instants at which the plan's speed and acceleration are looked at.
const LOOKS: u32 = 60;
/// A sweep that is brought forward takes this long at least and at most \[s\]: what the servo needs for
/// all of its range with time to spare, and what leaves time for what follows.
const SWEEP_S: core::ops::RangeInclusive<f64> = 0.45..=0.6;
/// Sweeps that are brought forward: there and back.
const SWEEPS: usize = 2;

/// A sweep of this mean rate changes the inertia within a few control periods \[rad/s\].
const FAST_RAD_S: f64 = 1.0;
/// The servo's lag and the estimate of the angle make a sweep last longer \[s\].
const SETTLING_S: f64 = 0.1;

/// Time of the plan at a snapshot \[ns\].
pub(super) fn plan_ns(scenario: &Scenario, snapshot: &Snapshot) -> u64 {
    snapshot.at_ns.saturating_add(scenario.settings().start.at_ns())
}

/// Of a scenario at a snapshot.
pub(super) fn of(scenario: &Scenario, snapshot: &Snapshot) -> Result<Facts, String> {
    let settings = scenario.settings();
    let law = scenario.position_law().map_err(|error| error.to_string())?;
    let (mut speed_m_s, mut acceleration_m_s2) = (0.0_f64, 0.0_f64);
    if let Plan::Flight(plan) = scenario.plan() {
        let trajectory = Trajectory::new(&plan.trajectory).map_err(|error| error.to_string())?;
        let norm = |[x, y, z]: [f64; 3]| (x * x + y * y + z * z).sqrt();
        let from_ns = plan_ns(scenario, snapshot);
        for look in 0..=LOOKS {
            let ahead_s = settings.rehearsal.duration_s * f64::from(look) / f64::from(LOOKS);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
            let point = trajectory.at(from_ns + (ahead_s * 1e9) as u64);
            speed_m_s = speed_m_s.max(norm(point.velocity_w_m_s));
            acceleration_m_s2 = acceleration_m_s2.max(norm(point.acceleration_w_m_s2));
        }
    }
    let latency = settings.latency;
    Ok(Facts {
        vehicle: scenario.modelled_vehicle(),
        morph_angle_rad: snapshot.morph_angle_rad,
        tilt_max_rad: law.tilt_max_rad,
        attitude_period_s: 1.0 / scenario.slot_rate_hz(Role::Attitude),
        position_period_s: 1.0 / scenario.slot_rate_hz(Role::Position),
        latency_s: latency.wrench_command_s + latency.attitude_setpoint_s,
        speed_m_s,
        acceleration_m_s2,
        is_rig: settings.pilot.is_rig(),
        ground: settings.plant.ground,
    })
}

/// Sweeps that the plan has ahead and the rehearsed time does not reach, to be brought forward.
pub(super) fn sweeps_ahead(scenario: &Scenario, snapshot: &Snapshot) -> Vec<Sweep> {
    if snapshot.guidance.morph.is_some() {
        // What was ordered has taken the schedule's place for good.
        return Vec::new();
    }
    let knots = knots(scenario);
    let now_s = plan_ns(scenario, snapshot) as f64 * 1e-9;
    // What begins later would not be over in time for its recovery to be seen.
    let reach_s = now_s + 0.5 * scenario.settings().rehearsal.duration_s;
    let end_s = now_s - snapshot.at_ns as f64 * 1e-9 + scenario.settings().scenario.duration_s;
    let sweep = |pair: &[MorphKnot]| {
        let [from, to] = pair else { return None };
        let moves = (to.angle_rad - from.angle_rad).abs() > 1e-6;
        let ahead = from.t_s > reach_s && from.t_s < end_s;
        (moves && ahead).then(|| Sweep {
            at_s: 0.0,
            angle_deg: to.angle_rad.to_degrees().clamp(45.0, 160.0),
            over_s: (to.t_s - from.t_s).clamp(*SWEEP_S.start(), *SWEEP_S.end()),
        })
    };
    knots.windows(2).filter_map(sweep).take(SWEEPS).collect()
}

fn knots(scenario: &Scenario) -> Vec<MorphKnot> {
    match scenario.plan() {
        Plan::Flight(plan) => plan.morph,
        Plan::Rig(plan) => plan.morph,
    }
}

/// When the arms sweep fast by plan, after the beginning of a rehearsed flight \[s\].
pub(super) fn sweeps_planned(scenario: &Scenario, snapshot: &Snapshot) -> Vec<(f64, f64)> {
    if snapshot.guidance.morph.is_some() {
        return Vec::new();
    }
    let now_s = plan_ns(scenario, snapshot) as f64 * 1e-9;
    let fast = |pair: &[MorphKnot]| {
        let [from, to] = pair else { return None };
        let mean_rad_s = (to.angle_rad - from.angle_rad).abs() / (to.t_s - from.t_s);
        (mean_rad_s > FAST_RAD_S).then_some((from.t_s - now_s, to.t_s - now_s + SETTLING_S))
    };
    knots(scenario).windows(2).filter_map(fast).collect()
}
