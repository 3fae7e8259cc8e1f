//! From a reference that moves to rest at a goal: what an order in flight makes of it.
//!
//! Two motions at once. The one at hand dies out along a cubic of its speed, which meets speed and
//! acceleration at the start and neither in the end. The other leads from where that alone would stop to
//! the goal, rest to rest. Their sum is twice continuously differentiable, and unlike one polynomial over
//! the whole way it does not swing out when the way is long.

use super::pace::{braked, moved};
use super::{MorphSchedule, Trajectory, TrajectoryPoint, morph};
use shared_types::time::s_from_ns;
use shared_types::{AngleDiversion, GuidanceOrder, PositionDiversion};
use vehicle::MorphAngle;

/// Where the same motion stops.
fn stops_at(rate: f64, acceleration: f64, brake_s: f64) -> f64 {
    braked(rate, acceleration, brake_s, brake_s)[0]
}

/// Time since a diversion's first instant \[s\].
fn since_s(begin_ns: u64, t_ns: u64) -> f64 {
    s_from_ns(t_ns.saturating_sub(begin_ns))
}

/// \[angle, rate, acceleration\] of a diverted angle; `way` is how it goes from rest to rest.
fn angle_at(diversion: &AngleDiversion, way: impl Fn(f64, f64) -> [f64; 3], t_ns: u64) -> [f64; 3] {
    let &AngleDiversion { from_rad, rate_rad_s, acceleration_rad_s2, goal_rad, .. } = diversion;
    let &AngleDiversion { begin_ns, brake_s, move_s, .. } = diversion;
    let t_s = since_s(begin_ns, t_ns);
    let own = braked(rate_rad_s, acceleration_rad_s2, brake_s, t_s);
    let length = goal_rad - from_rad - stops_at(rate_rad_s, acceleration_rad_s2, brake_s);
    let [h, rate, acceleration] = way(move_s, t_s);
    [from_rad + own[0] + length * h, own[1] + length * rate, own[2] + length * acceleration]
}

/// \[heading, rate, acceleration\] of a diverted heading.
pub(super) fn yaw_at(diversion: &AngleDiversion, t_ns: u64) -> [f64; 3] {
    angle_at(diversion, moved, t_ns)
}

/// \[β, rate, acceleration\] of a diverted deployable angle, which sweeps as a schedule does.
pub(super) fn morph_at(diversion: &AngleDiversion, t_ns: u64) -> [f64; 3] {
    angle_at(diversion, morph::swept, t_ns)
}

/// \[position, velocity, acceleration\] of a diverted position.
pub(super) fn position_at(diversion: &PositionDiversion, t_ns: u64) -> [[f64; 3]; 3] {
    let PositionDiversion { from_w_m, velocity_w_m_s, acceleration_w_m_s2, goal_w_m, .. } =
        diversion;
    let &PositionDiversion { begin_ns, brake_s, move_s, .. } = diversion;
    let t_s = since_s(begin_ns, t_ns);
    let way = moved(move_s, t_s);
    let mut at = [[0.0; 3]; 3];
    for axis in 0..3 {
        let (rate, acceleration) = (velocity_w_m_s[axis], acceleration_w_m_s2[axis]);
        let own = braked(rate, acceleration, brake_s, t_s);
        let length = goal_w_m[axis] - from_w_m[axis] - stops_at(rate, acceleration, brake_s);
        at[0][axis] = from_w_m[axis];
        for (order, value) in at.iter_mut().enumerate() {
            value[axis] += own[order] + length * way[order];
        }
    }
    at
}

/// The reference at an instant: as planned, or as ordered.
#[must_use]
pub fn point(trajectory: &Trajectory, order: Option<&GuidanceOrder>, t_ns: u64) -> TrajectoryPoint {
    let diverted = order.filter(|order| order.position.ordered.is_set());
    let Some(order) = diverted else { return trajectory.at(t_ns) };
    let [position_w_m, velocity_w_m_s, acceleration_w_m_s2] = position_at(&order.position, t_ns);
    let [yaw_rad, ..] = yaw_at(&order.yaw, t_ns);
    TrajectoryPoint { position_w_m, velocity_w_m_s, acceleration_w_m_s2, yaw_rad }
}

/// The deployable angle at an instant, as planned or as ordered, always inside the linkage's range \[rad\].
#[must_use]
pub fn angle_rad(schedule: &MorphSchedule, order: Option<&GuidanceOrder>, t_ns: u64) -> f64 {
    let diverted = order.filter(|order| order.morph.ordered.is_set());
    let Some(order) = diverted else { return schedule.angle_rad(t_ns) };
    let [angle_rad, ..] = morph_at(&order.morph, t_ns);
    angle_rad.clamp(MorphAngle::MIN.rad(), MorphAngle::MAX.rad())
}
