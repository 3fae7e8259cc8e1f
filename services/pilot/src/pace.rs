//! How fast a motion may be, and how long it therefore takes.

use super::time_scaling::minimum_jerk;

/// What a motion keeps to: peak speed, acceleration and jerk, in m or rad.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    pub(super) rate: f64,
    pub(super) acceleration: f64,
    pub(super) jerk: f64,
}

/// Of each of the two motions that a diverted position is made of. A tilt of 0.35 rad gives 3.6 m/s²,
/// of which half is left to wind and errors.
pub(super) const POSITION: Pace = Pace { rate: 1.5, acceleration: 1.2, jerk: 6.0 };

/// How a position comes to rest. The longer the motion at hand takes to die out, the faster and the further an
/// acceleration goes on meanwhile, so that it has more jerk than a way.
pub(super) const POSITION_BRAKE: Pace = Pace { jerk: 20.0, ..POSITION };

/// Of a heading: yaw has the least torque of the axes.
pub(super) const YAW: Pace = Pace { rate: 0.8, acceleration: 0.6, jerk: 3.0 };

/// Peak speed, acceleration and jerk of the minimum-jerk way from 0 to 1 in unit time.
const WAY: Pace = Pace { rate: 1.875, acceleration: 5.773_502_691_896_258, jerk: 60.0 };

/// A motion with acceleration a that dies out within T gains up to 4/27 a T of speed on the way: half of its own, or of
/// the pace's, at most.
const SPEED_UP: f64 = 0.5 * 27.0 / 4.0;

impl Pace {
    /// Time in which a motion at `rate` with `acceleration` may die out \[s\].
    pub(super) fn brake_s(&self, rate: f64, acceleration: f64) -> f64 {
        // The cubic decelerates by up to 3/2 v/T, with a jerk of up to 6 v/T² + 4 a/T.
        let by_rate = (1.5 * rate / self.acceleration).max((12.0 * rate / self.jerk).sqrt());
        // A large acceleration that dies out slowly would carry the motion far away.
        let longest_s = SPEED_UP * rate.max(self.rate) / acceleration;
        by_rate.max(8.0 * acceleration / self.jerk).min(longest_s)
    }

    /// Time of a way of `length`, rest to rest \[s\].
    pub(super) fn move_s(&self, length: f64) -> f64 {
        let by_rate = WAY.rate * length / self.rate;
        let by_acceleration = (WAY.acceleration * length / self.acceleration).sqrt();
        by_rate.max(by_acceleration).max(libm::cbrt(WAY.jerk * length / self.jerk))
    }
}

/// \[s, ṡ, s̈\] of a motion with speed `rate` and acceleration `acceleration` at 0 that dies out within
/// `brake_s`.
pub(super) fn braked(rate: f64, acceleration: f64, brake_s: f64, t_s: f64) -> [f64; 3] {
    if brake_s <= 0.0 {
        return [0.0; 3];
    }
    let tau = (t_s / brake_s).clamp(0.0, 1.0);
    let (squared, bent) = (tau * tau, acceleration * brake_s);
    [
        brake_s
            * (rate * tau * (1.0 + squared * (0.5 * tau - 1.0))
                + bent * squared * (0.5 + tau * (0.25 * tau - 2.0 / 3.0))),
        rate * (1.0 + squared * (2.0 * tau - 3.0)) + bent * tau * (1.0 + tau * (tau - 2.0)),
        rate / brake_s * 6.0 * tau * (tau - 1.0) + acceleration * (1.0 + tau * (3.0 * tau - 4.0)),
    ]
}

/// \[h, ḣ, ḧ\] of a way from 0 to 1 within `move_s`.
pub(super) fn moved(move_s: f64, t_s: f64) -> [f64; 3] {
    if move_s <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let [h, rate, acceleration] = minimum_jerk(t_s / move_s);
    [h, rate / move_s, acceleration / (move_s * move_s)]
}
