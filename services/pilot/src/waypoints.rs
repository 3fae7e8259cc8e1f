//! Waypoints joined by minimum-jerk segments.

use super::error::{increasing, position, yaw};
use super::time_scaling::{MINIMUM_JERK_PEAKS, minimum_jerk};
use super::{PilotError, TrajectoryPoint};

/// A place to be at rest at a given time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// When \[s\].
    pub t_s: f64,
    /// Where \[m\].
    pub position_w_m: [f64; 3],
    /// Heading \[rad\], taken as a number: from 0 to 2π is one whole turn.
    pub yaw_rad: f64,
}

pub(super) fn check(list: &[Waypoint]) -> Result<(), PilotError> {
    increasing("trajectory.waypoints", list.iter().map(|w| w.t_s))?;
    for (i, waypoint) in list.iter().enumerate() {
        position(format_args!("trajectory.waypoints[{i}].position_w_m"), waypoint.position_w_m)?;
        yaw(format_args!("trajectory.waypoints[{i}].yaw_rad"), waypoint.yaw_rad)?;
    }
    Ok(())
}

/// Holds the first waypoint until its time and the last one from its time on.
pub(super) fn at(list: &[Waypoint], t_s: f64) -> TrajectoryPoint {
    let next = list.partition_point(|w| w.t_s <= t_s);
    let (before, after) = (list.get(next.saturating_sub(1)), list.get(next));
    match (before, after) {
        (Some(from), Some(to)) if next > 0 => segment(from, to, t_s),
        (Some(held), _) => TrajectoryPoint::at_rest(held.position_w_m, held.yaw_rad),
        (None, _) => TrajectoryPoint::at_rest([0.0; 3], 0.0),
    }
}

/// Instants until `until_s` of which one has the largest speed and one the largest acceleration \[s\].
pub(super) fn instants_s(list: &[Waypoint], until_s: f64) -> impl Iterator<Item = f64> {
    let segments = list.iter().zip(list.iter().skip(1));
    let peaks = segments.flat_map(|(from, to)| {
        MINIMUM_JERK_PEAKS.map(|share| from.t_s + share * (to.t_s - from.t_s))
    });
    // In the middle of a segment the last instant may be it.
    peaks.take_while(move |t_s| *t_s < until_s).chain([until_s])
}

fn segment(from: &Waypoint, to: &Waypoint, t_s: f64) -> TrajectoryPoint {
    let duration_s = to.t_s - from.t_s;
    let [h, rate, acceleration] = minimum_jerk((t_s - from.t_s) / duration_s);
    let way = |i: usize| to.position_w_m[i] - from.position_w_m[i];
    TrajectoryPoint {
        position_w_m: core::array::from_fn(|i| from.position_w_m[i] + way(i) * h),
        velocity_w_m_s: core::array::from_fn(|i| way(i) * rate / duration_s),
        acceleration_w_m_s2: core::array::from_fn(|i| {
            way(i) * acceleration / (duration_s * duration_s)
        }),
        yaw_rad: from.yaw_rad + (to.yaw_rad - from.yaw_rad) * h,
    }
}
