//! Which way an order makes of a goal: how long it takes, so that the vehicle can follow.

use super::diversion::{morph_at, point, position_at, yaw_at};
use super::morph::PEAK_OVER_MEAN_RATE;
use super::pace::{POSITION, POSITION_BRAKE, YAW};
use super::{MorphSchedule, Trajectory};
use core::f64::consts::{PI, TAU};
use shared_types::time::{ns_from_s, s_from_ns};
use shared_types::{AngleDiversion, Flag, GuidanceOrder, PositionDiversion};
use vehicle::MorphAngle;

/// Fastest that a diverted position moves, unless it does so already \[m/s\].
pub const SPEED_LIMIT_M_S: f64 = 2.0;

/// Largest acceleration of a diverted position, unless it has more already \[m/s²\].
pub const ACCELERATION_LIMIT_M_S2: f64 = 2.0;

/// Longest time in which a sweep that is under way dies out \[s\].
const MORPH_BRAKE_S: f64 = 0.3;

/// Half of the interval over which a planned angle is differentiated \[ns\].
const STEP_NS: u64 = 500_000;

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Instants spread over a time that begins at `begin_ns`, its end included.
fn instants(begin_ns: u64, length_s: f64) -> impl Iterator<Item = u64> {
    (0..=128).map(move |k| begin_ns + ns_from_s(length_s * f64::from(k) / 128.0))
}

/// The way to `goal_w_m` from where the reference is at `begin_ns`, and how it moves there.
#[must_use]
pub fn position(
    trajectory: &Trajectory,
    before: Option<&GuidanceOrder>,
    goal_w_m: [f64; 3],
    begin_ns: u64,
) -> PositionDiversion {
    let start = point(trajectory, before, begin_ns);
    let (rate, acceleration) = (norm(start.velocity_w_m_s), norm(start.acceleration_w_m_s2));
    let mut way = PositionDiversion {
        begin_ns,
        from_w_m: start.position_w_m,
        velocity_w_m_s: start.velocity_w_m_s,
        acceleration_w_m_s2: start.acceleration_w_m_s2,
        goal_w_m,
        brake_s: POSITION_BRAKE.brake_s(rate, acceleration),
        move_s: f64::INFINITY,
        ordered: Flag::Yes,
        reserved: 0,
    };
    // With an endless way only the brake moves.
    let [stop_w_m, ..] = position_at(&way, begin_ns + ns_from_s(way.brake_s));
    way.move_s = POSITION.move_s(norm(core::array::from_fn(|i| goal_w_m[i] - stop_w_m[i])));
    let (rate, acceleration) =
        (rate.max(SPEED_LIMIT_M_S), acceleration.max(ACCELERATION_LIMIT_M_S2));
    let is_too_fast = |way: &PositionDiversion| {
        instants(begin_ns, way.brake_s.max(way.move_s)).any(|t_ns| {
            let [_, v, a] = position_at(way, t_ns);
            norm(v) > rate * 1.001 || norm(a) > acceleration * 1.001
        })
    };
    for _ in 0..40 {
        if !is_too_fast(&way) {
            break;
        }
        way.move_s = 1.1 * way.move_s + 0.05;
    }
    way
}

/// The turn to `goal_rad`, the shorter way round. Without a goal a turn that was ordered before goes on,
/// and any other comes to rest by itself.
#[must_use]
pub fn yaw(
    trajectory: &Trajectory,
    before: Option<&GuidanceOrder>,
    goal_rad: Option<f64>,
    begin_ns: u64,
) -> AngleDiversion {
    let ordered = before.filter(|order| order.position.ordered.is_set());
    if let (Some(order), None) = (ordered, goal_rad) {
        return order.yaw;
    }
    let planned = |t_ns: u64| trajectory.at(t_ns).yaw_rad;
    let [from_rad, rate_rad_s, acceleration_rad_s2] =
        ordered.map_or_else(|| derivatives(planned, begin_ns), |o| yaw_at(&o.yaw, begin_ns));
    let (rate, acceleration) = (rate_rad_s.abs(), acceleration_rad_s2.abs());
    let brake_s = YAW.brake_s(rate, acceleration);
    let mut way = AngleDiversion {
        begin_ns,
        from_rad,
        rate_rad_s,
        acceleration_rad_s2,
        goal_rad: from_rad,
        brake_s,
        move_s: f64::INFINITY,
        ordered: Flag::Yes,
        reserved: 0,
    };
    let [stop_rad, ..] = yaw_at(&way, begin_ns + ns_from_s(brake_s));
    let turn_rad = goal_rad.map_or(0.0, |goal_rad| {
        let turn_rad = libm::fmod(goal_rad - stop_rad, TAU);
        if turn_rad > PI {
            turn_rad - TAU
        } else if turn_rad <= -PI {
            turn_rad + TAU
        } else {
            turn_rad
        }
    });
    way.goal_rad = stop_rad + turn_rad;
    way.move_s = YAW.move_s(turn_rad.abs());
    way
}

/// The sweep to `goal_rad` within `over_s`, from wherever the arms are commanded at `begin_ns`.
///
/// # Errors
/// The shortest time that the servo's rate limit leaves for it \[s\].
pub fn morph(
    schedule: &MorphSchedule,
    before: Option<&GuidanceOrder>,
    (goal_rad, over_s): (f64, f64),
    rate_limit_rad_s: f64,
    begin_ns: u64,
) -> Result<AngleDiversion, f64> {
    let ordered = before.filter(|order| order.morph.ordered.is_set());
    let planned = |t_ns: u64| schedule.angle_rad(t_ns);
    let [from_rad, rate_rad_s, acceleration_rad_s2] =
        ordered.map_or_else(|| derivatives(planned, begin_ns), |o| morph_at(&o.morph, begin_ns));
    let way = |over_s: f64, brake_s: f64| AngleDiversion {
        begin_ns,
        from_rad,
        rate_rad_s,
        acceleration_rad_s2,
        goal_rad,
        brake_s,
        move_s: over_s,
        ordered: Flag::Yes,
        reserved: 0,
    };
    // The arms stop soon enough to stay within the linkage, and no sooner.
    let found = |over_s: f64| {
        let rests = rate_rad_s.abs() < 1e-9 && acceleration_rad_s2.abs() < 1e-6;
        let longest_s = if rests { 0.0 } else { MORPH_BRAKE_S.min(over_s) };
        let mut brakes = (0..24).map(|k| longest_s * libm::pow(0.8, f64::from(k)));
        brakes.find_map(|brake_s| {
            let way = way(over_s, brake_s);
            let range = MorphAngle::MIN.rad() - 1e-9..=MorphAngle::MAX.rad() + 1e-9;
            let stays = instants(begin_ns, over_s.max(brake_s)).all(|t_ns| {
                let [angle_rad, rate_rad_s, _] = morph_at(&way, t_ns);
                range.contains(&angle_rad) && rate_rad_s.abs() <= rate_limit_rad_s * (1.0 + 1e-9)
            });
            stays.then_some(way)
        })
    };
    if let Some(way) = found(over_s) {
        return Ok(way);
    }
    let mut shortest_s = PEAK_OVER_MEAN_RATE * (goal_rad - from_rad).abs() / rate_limit_rad_s;
    for _ in 0..200 {
        if shortest_s > over_s && found(shortest_s).is_some() {
            break;
        }
        shortest_s = shortest_s * 1.02 + 1e-3;
    }
    Err(shortest_s)
}

/// Value, rate and acceleration of a planned angle.
fn derivatives(planned: impl Fn(u64) -> f64, t_ns: u64) -> [f64; 3] {
    let middle_ns = t_ns.max(STEP_NS);
    let [before, at, after] = [middle_ns - STEP_NS, middle_ns, middle_ns + STEP_NS].map(&planned);
    let step_s = s_from_ns(STEP_NS);
    let rate = (after - before) / (2.0 * step_s);
    [planned(t_ns), rate, (after - 2.0 * at + before) / (step_s * step_s)]
}

/// Instant at which everything has come to rest \[ns\].
#[must_use]
pub fn rest_ns(begin_ns: u64, brake_s: f64, move_s: f64) -> u64 {
    begin_ns + ns_from_s(brake_s.max(move_s))
}
