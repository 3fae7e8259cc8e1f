//! The parameters of vehicle, loops and plan on which a rehearsal depends, from the scenario of the flight.

use pilot::{MorphKnot, Trajectory};
use rehearsal::{Facts, Snapshot, Sweep};
use scenario::{Plan, Scenario};
use shared_types::PerSlot;

/// Number of intervals at whose ends the plan's speed and acceleration are sampled.
const LOOKS: u32 = 60;
/// Bounds on the duration of a sweep that is brought forward \[s\]: more than the servo needs for its whole
/// range, and short enough to leave time for the challenges that follow.
const SWEEP_S: core::ops::RangeInclusive<f64> = 0.45..=0.6;
/// Largest number of sweeps that are brought forward: one, and the one back.
const SWEEPS: usize = 2;

/// Mean rate above which a sweep changes the inertia within a few control periods \[rad/s\].
const FAST_RAD_S: f64 = 1.0;
/// Time by which servo lag and the estimate of the angle prolong a sweep \[s\].
const SETTLING_S: f64 = 0.1;

/// Time of the plan at a snapshot \[ns\].
pub(super) fn plan_ns(scenario: &Scenario, snapshot: &Snapshot) -> u64 {
    snapshot.at_ns.saturating_add(scenario.settings().start.at_ns())
}

/// The facts of a scenario at a snapshot.
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
        period_s: PerSlot::from_fn(|slot| 1.0 / scenario.slot_rate_hz(slot)),
        latency_s: latency.wrench_command_s + latency.attitude_setpoint_s,
        speed_m_s,
        acceleration_m_s2,
        is_rig: settings.pilot.is_rig(),
        ground: settings.plant.ground,
    })
}

/// Sweeps of the plan that begin too late to be seen within the rehearsed time, to be brought forward.
pub(super) fn sweeps_ahead(scenario: &Scenario, snapshot: &Snapshot) -> Vec<Sweep> {
    if snapshot.guidance.morph.is_some() {
        // A guidance order has replaced the morph schedule for the rest of the flight.
        return Vec::new();
    }
    let knots = knots(scenario);
    let now_s = plan_ns(scenario, snapshot) as f64 * 1e-9;
    // A sweep that begins later would leave no time for its recovery to be measured.
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

/// Times in which the plan has the arms sweep fast (from, until), counted from the beginning of a rehearsed
/// flight \[s\].
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
