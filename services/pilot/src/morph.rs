//! The deployable angle over time.

use super::PilotError;
use super::error::{increasing, within};
use super::time_scaling::TimeScaling;
use shared_types::time::s_from_ns;
use vehicle::MorphAngle;

/// Peak over mean rate of a sweep: with a third of it for each ramp, 1 / (1 − 1/3). A full sweep
/// in 0.3 s then peaks at 575 °/s; a minimum-jerk sweep (1.875) would break the limit of 700 °/s.
pub(super) const PEAK_OVER_MEAN_RATE: f64 = 1.5;

/// An angle to have reached, at rest, at a given time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MorphKnot {
    /// When \[s\].
    pub t_s: f64,
    /// β \[rad\], between 45° and 160°.
    pub angle_rad: f64,
}

/// A checked schedule. Between two knots the angle ramps up for a third of the time, keeps its rate
/// for a third and ramps down, all three times continuously differentiable and at rest at the knots;
/// the first and last knots are held.
#[derive(Debug, Clone)]
pub struct MorphSchedule {
    knots: Vec<MorphKnot>,
}

impl MorphSchedule {
    /// Checks knots against the range of the linkage and the servo's rate limit \[rad/s\].
    ///
    /// # Errors
    /// [`PilotError`]: no knots, times not increasing, an angle out of range, a sweep too fast.
    pub fn new(knots: &[MorphKnot], rate_limit_rad_s: f64) -> Result<Self, PilotError> {
        within("vehicle.servo_rate_limit_rad_s", rate_limit_rad_s, (1e-3, 1e6))?;
        increasing("morph", knots.iter().map(|k| k.t_s))?;
        let range = (MorphAngle::MIN.rad(), MorphAngle::MAX.rad());
        for (i, knot) in knots.iter().enumerate() {
            within(format_args!("morph[{i}].angle_rad"), knot.angle_rad, range)?;
        }
        for (i, (from, to)) in knots.iter().zip(knots.iter().skip(1)).enumerate() {
            let peak_rad = PEAK_OVER_MEAN_RATE * (to.angle_rad - from.angle_rad).abs();
            let rate_rad_s = peak_rad / (to.t_s - from.t_s);
            if rate_rad_s > rate_limit_rad_s {
                return Err(PilotError::MorphTooFast {
                    index: i + 1,
                    rate_rad_s,
                    limit_rad_s: rate_limit_rad_s,
                    shortest_s: peak_rad / rate_limit_rad_s,
                });
            }
        }
        Ok(Self { knots: knots.to_vec() })
    }

    /// β \[rad\] at an instant of the flight, always inside the linkage's range.
    #[must_use]
    pub fn angle_rad(&self, t_ns: u64) -> f64 {
        let t_s = s_from_ns(t_ns);
        let next = self.knots.partition_point(|k| k.t_s <= t_s);
        let before = self.knots.get(next.saturating_sub(1));
        let angle_rad = match (before, self.knots.get(next)) {
            (Some(from), Some(to)) if next > 0 => sweep(from, to, t_s),
            (Some(held), _) => held.angle_rad,
            (None, _) => MorphAngle::MIN.rad(),
        };
        angle_rad.clamp(MorphAngle::MIN.rad(), MorphAngle::MAX.rad())
    }
}

fn sweep(from: &MorphKnot, to: &MorphKnot, t_s: f64) -> f64 {
    let [share, ..] = swept(to.t_s - from.t_s, t_s - from.t_s);
    from.angle_rad + (to.angle_rad - from.angle_rad) * share
}

/// \[h, ḣ, ḧ\] of a sweep from 0 to 1 within `duration_s`.
pub(super) fn swept(duration_s: f64, t_s: f64) -> [f64; 3] {
    if duration_s <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let ramp_s = duration_s / 3.0;
    let way_s = duration_s / PEAK_OVER_MEAN_RATE;
    TimeScaling::ending_at(way_s, ramp_s, ramp_s).at(t_s).map(|s| s / way_s)
}
