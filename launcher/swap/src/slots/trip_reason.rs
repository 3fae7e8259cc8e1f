//! A trip of the monitor as text: what was measured, and what its limit was.

use core::fmt;
use shared_types::{Trip, TripCause};

/// Why an owner tripped.
pub(super) struct TripReason<'a>(pub(super) &'a Trip);

impl fmt::Display for TripReason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let trip = self.0;
        let (angle, limit) = (trip.angle_rad, trip.angle_limit_rad);
        let (distance, distance_limit) = (trip.distance_m, trip.distance_limit_m);
        match trip.cause {
            TripCause::AttitudeDeparts => write!(
                f,
                "it turns away from its set point, by {angle:.3} rad before it could be stopped, limit {limit:.3} rad"
            ),
            TripCause::TiltBeyond => {
                write!(f, "its tilt would reach {angle:.3} rad, limit {limit:.3} rad")
            }
            TripCause::HeadingDeparts => write!(
                f,
                "its heading turns away from its set point, by {angle:.3} rad before it could be stopped, limit {limit:.3} rad"
            ),
            TripCause::AttitudeAstray => write!(
                f,
                "its attitude is {angle:.2} rad off its set point for {:.2} s, limit {limit:.2} rad",
                trip.lasted_s
            ),
            TripCause::RateOscillates => write!(
                f,
                "its body rate has changed sides {} times at {:.2} rad/s, limit {:.2} rad/s",
                trip.reversals, trip.rate_rad_s, trip.rate_limit_rad_s
            ),
            TripCause::ThrustAstray => write!(
                f,
                "its thrust is not what is asked for: {:.2} m/s of vertical speed, limit {:.2} m/s",
                trip.speed_m_s, trip.speed_limit_m_s
            ),
            TripCause::PositionDeparts => write!(
                f,
                "the vehicle would be {distance:.3} m from its reference before it could be stopped, limit {distance_limit:.3} m"
            ),
            TripCause::Sinks => write!(
                f,
                "the vehicle sinks: {distance:.2} m of height are needed to stop it, and {distance_limit:.2} m are left"
            ),
            TripCause::TurnsBeyond => write!(
                f,
                "its full torque for {:.0} ms turns it {angle:.3} rad beyond its set point before it could be stopped, limit {limit:.3} rad",
                1e3 * trip.lasted_s
            ),
            _ => self.of_orders(f),
        }
    }
}

impl TripReason<'_> {
    /// What the owner asked for, followed or reported.
    fn of_orders(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let trip = self.0;
        let (angle, limit) = (trip.angle_rad, trip.angle_limit_rad);
        match trip.cause {
            TripCause::SetpointBeyond => {
                write!(f, "its set point asks for {angle:.2} rad of tilt, limit {limit:.2} rad")
            }
            TripCause::SetpointOscillates => write!(
                f,
                "the tilt of its set point has changed sides {} times at {angle:.2} rad, limit {limit:.2} rad",
                trip.reversals
            ),
            TripCause::ThrustBeyond => write!(
                f,
                "its set point asks for {:.2} N of thrust, limit {:.2} N",
                trip.thrust_n, trip.thrust_limit_n
            ),
            TripCause::HeadingAstray => write!(
                f,
                "its set point asks for a heading {angle:.2} rad off the reference's for {:.2} s, limit {limit:.2} rad",
                trip.lasted_s
            ),
            TripCause::RotorsClipped => {
                write!(f, "it asks the rotors for more than they give for {:.2} s", trip.lasted_s)
            }
            TripCause::Overturns => write!(
                f,
                "the actuation gate had to level the vehicle, or its tilt would have passed {limit:.2} rad"
            ),
            TripCause::ReportFalse => f.write_str("what it reports of the position slot is not so"),
            TripCause::TripIgnored => {
                f.write_str("it still follows the position controller that has tripped")
            }
            // A number that this build does not know, which no port of it lets through.
            _ => f.write_str("it was losing the vehicle"),
        }
    }
}
